"""The report's figures, as matplotlib Figure objects that share no global state."""

from porocore.report.figures.body import body_figure, plane_figure
from porocore.report.figures.cell import cell_picture, histogram_figure
from porocore.report.figures.curves import (
    PROFILE_FIELDS,
    history_figure,
    indentation_figure,
    profile_figure,
    relaxation_figure,
    series_figure,
)
from porocore.report.figures.sampling import parity_figure, samples_figure, samples_of, training_figure
from porocore.report.figures.style import png_bytes, svg_bytes

__all__ = [
    "PROFILE_FIELDS",
    "body_figure",
    "cell_picture",
    "histogram_figure",
    "history_figure",
    "indentation_figure",
    "parity_figure",
    "plane_figure",
    "png_bytes",
    "profile_figure",
    "relaxation_figure",
    "samples_figure",
    "samples_of",
    "series_figure",
    "svg_bytes",
    "training_figure",
]
