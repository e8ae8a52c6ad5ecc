"""The report's figures, as matplotlib Figure objects that share no global state."""

from porocore.report.figures.body import body_figure
from porocore.report.figures.cell import cell_picture
from porocore.report.figures.history import history_figure
from porocore.report.figures.profiles import PROFILE_FIELDS, profile_figure
from porocore.report.figures.sampling import samples_figure, samples_of
from porocore.report.figures.series import relaxation_figure, series_figure
from porocore.report.figures.style import png_bytes, svg_bytes
from porocore.report.figures.surrogate import parity_figure, training_figure

__all__ = [
    "PROFILE_FIELDS",
    "body_figure",
    "cell_picture",
    "history_figure",
    "parity_figure",
    "png_bytes",
    "profile_figure",
    "relaxation_figure",
    "samples_figure",
    "samples_of",
    "series_figure",
    "svg_bytes",
    "training_figure",
]
