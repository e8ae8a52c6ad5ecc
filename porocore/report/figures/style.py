"""Style of all figures: fonts, colours, legends, labels with units; figures as SVG and PNG bytes."""

from __future__ import annotations

import functools
import io
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

from porocore.core.files.atomic import atomic_path
from porocore.core.units import ResultUnits, units_now

P = ParamSpec("P")
T = TypeVar("T")

# Okabe & Ito's palette, which the colour-blind can tell apart.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILLION, PURPLE, GREY = "#0072B2", "#D55E00", "#CC79A7", "#767676"

#: Colours of the times of a profile, in order.
TIME_COLOURS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, BLACK)
NONLINEAR, LINEAR = BLUE, VERMILLION
DASHED = (0, (5, 2))
DOTTED = (0, (1, 1.6))

STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "axes.labelsize": 10,
    "axes.titlesize": 10,
    "legend.fontsize": 9,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.7,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "figure.facecolor": "white",
    "axes.facecolor": "white",
    "axes.formatter.use_mathtext": True,
    "axes.formatter.limits": (-3, 4),
    "figure.constrained_layout.w_pad": 0.08,
    "figure.constrained_layout.h_pad": 0.06,
    "svg.fonttype": "path",
    "svg.hashsalt": "porocore",  # the same figure gives the same bytes
}


def styled(make: Callable[P, T]) -> Callable[P, T]:
    """Run ``make`` under matplotlib's defaults and :data:`STYLE`, and put the reader's own settings back."""

    @functools.wraps(make)
    def inside(*args: P.args, **kwargs: P.kwargs) -> T:
        with matplotlib.rc_context():
            # Not the reader's matplotlibrc: text.usetex, for one, needs a LaTeX that the machine may not have.
            matplotlib.rcdefaults()
            matplotlib.rcParams.update(STYLE)
            return make(*args, **kwargs)

    return inside


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of so many inches with its own Agg canvas."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def legend_above(figure: Figure, axes: Axes, columns: int) -> None:
    """Put the legend of ``axes`` above the panel, outside the data."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper left", ncols=columns, handlelength=2.2, columnspacing=1.3
    )


#: By what a dimensionless quantity is divided, where that is not obvious.
_DIVIDED_BY = {"pressure": r"$\,/E$", "stress": r"$\,/E$", "force": r"$\,/(E L^2)$"}


def axis_label(words: str, quantity: str, units: ResultUnits | None = None) -> str:
    """Return the label of an axis, with the unit in brackets, by default that of the study."""
    units = units or units_now()
    by = "" if units.given else _DIVIDED_BY.get(quantity, "")
    return f"{words}{by} [{units.name(quantity)}]"


def named(name: str) -> str:
    """Return a name that a user gave as a text of a figure: no formula, and none that a legend leaves out."""
    return (" " if name.startswith("_") else "") + name.replace("$", r"\$")


def lighter(colour: str, share: float = 0.62) -> tuple[float, float, float]:
    """Return ``colour`` mixed with white."""
    red, green, blue = (1 - (1 - share) * (1 - c) for c in to_rgb(colour))
    return red, green, blue


class PlainTicks(ScalarFormatter):
    """Numbers at ticks as plain text, which looks the same as by the parser of formulas and is far faster.

    A factor such as 10⁻³ beside the axis remains a formula.
    """

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Return the number at a tick."""
        return super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$")


@styled
def svg_bytes(figure: Figure) -> bytes:
    """Return the figure as an SVG document; text is drawn as paths, so that it looks the same everywhere."""
    # The resolution is that of parts which are drawn as an image.
    return _saved(figure, "svg", 160, {"Date": None, "Creator": None})


@styled
def png_bytes(figure: Figure, dpi: int = 160) -> bytes:
    """Return the figure as a PNG image."""
    return _saved(figure, "png", dpi, {"Software": None})


def write_pictures(figure: Figure, *paths: Path, dpi: int = 160) -> None:
    """Write a figure to files, as an SVG document or a PNG image as their names say.

    Raises
    ------
    RunFolderError
        A file cannot be written.
    """
    for path in paths:
        with atomic_path(path) as part:
            part.write_bytes(svg_bytes(figure) if path.suffix == ".svg" else png_bytes(figure, dpi))


def _saved(figure: Figure, form: str, dpi: int, metadata: Any) -> bytes:
    """Return the figure as a file; its first one lays it out, for all others."""
    for axes in figure.axes:
        for axis in axes._axis_map.values():
            if type(axis.get_major_formatter()) is ScalarFormatter:
                axis.set_major_formatter(PlainTicks())
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        # A name in a script that the font lacks is drawn as boxes; tables and files have it whole.
        warnings.filterwarnings("ignore", r"Glyph \d+", UserWarning)
        figure.savefig(buffer, format=form, dpi=dpi, metadata=metadata)
    figure.set_layout_engine(None)
    return buffer.getvalue()
