"""Figure of settlement, pore pressure and drained volume against time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from porocore.core.units.results import ResultUnits
from porocore.interfaces.solution import MacroSolution
from porocore.report.figures.style import (
    DASHED,
    DOTTED,
    GREEN,
    LINEAR,
    NONLINEAR,
    ORANGE,
    PURPLE,
    axis_label,
    legend_above,
    new_figure,
    styled,
)
from porocore.report.metrics import time_within
from porocore.states import Array

MARKS = ((0.95, "o"), (0.99, "D"))
#: Of further laws, in order.
OTHERS = ((GREEN, (0, (7, 1.5))), (PURPLE, (0, (4, 1.2, 1, 1.2))), (ORANGE, (0, (2, 1))))


@styled
def history_figure(
    nonlinear: MacroSolution,
    linear: MacroSolution | None,
    *others: MacroSolution,
    log_time: bool = False,
    settles: bool = True,
    units: ResultUnits | None = None,
) -> Figure:
    """Draw histories of one load, the cell's law against linear poroelasticity.

    Parameters
    ----------
    nonlinear, linear
        Two solutions of one problem; None: without the linear one.
    *others
        Further nonlinear ones, such as with another closure; each is then called by its law.
    log_time
        Logarithmic time axis; the state at rest, t = 0, is then left out.
    settles
        Whether the settlement is a result; one that is prescribed is not drawn.
    units
        Of the axes; dimensionless by default.

    Returns
    -------
    Figure
        Panels above each other: largest settlement, largest pore pressure, drained volume (what has left through the
        boundary solid or dashed, the paper's measure dotted).
    """
    units = units or ResultUnits()
    figure = new_figure(5.4, 7.6 if settles else 5.4)
    rows = list(figure.subplots(3 if settles else 2, 1, sharex=True))
    for solution, colour, style, label in _curves(nonlinear, linear, others):
        _draw(rows, solution, 1 if log_time else 0, units, {"color": colour, "ls": style, "label": label})
    drawn = [each.history for each, *_ in _curves(nonlinear, linear, others)]
    marked = any(
        time_within(each.time, each.settlement, share) is not None for each in drawn for share, _ in MARKS
    )
    _shared_legend(rows[0], MARKS if settles and marked else ())
    rows[0].set_ylabel(axis_label("settlement max$(-u_2)$", "displacement", units))
    rows[-2].set_ylabel(axis_label("largest pore pressure $p$", "pressure", units))
    rows[-1].set_ylabel(axis_label("drained volume", "volume", units))
    rows[-1].set_xlabel(axis_label("time $t$", "time", units) + (", logarithmic" if log_time else ""))
    for axes in rows:
        if axes.dataLim.ymin >= 0:
            axes.set_ylim(bottom=0)
        axes.margins(x=0.01)
    if log_time:
        rows[-1].set_xscale("log")
    else:
        rows[-1].set_xlim(left=0)
    figure.align_ylabels()
    legend_above(figure, rows[0], columns=2)
    return figure


def _draw(
    rows: Sequence[Axes], solution: MacroSolution, first: int, units: ResultUnits, how: dict[str, Any]
) -> None:
    """Draw one solution from its step ``first`` on, in two panels or in three with the settlement."""
    history = solution.history
    time, volume = history.time * units.factor("time"), units.factor("volume")
    values = [history.pressure_max * units.factor("pressure"), history.drained * volume]
    settled = history.settlement * units.factor("displacement")
    for axes, each in zip(rows, [*([settled] if len(rows) > 2 else []), *values], strict=True):
        axes.plot(time[first:], each[first:], **how)
    paper = history.drained_paper[first:] * volume
    rows[-1].plot(time[first:], paper, color=how["color"], ls=DOTTED, lw=2.4, alpha=0.75)
    for share, marker in MARKS if len(rows) > 2 else ():
        _mark(rows[0], time, settled, share, marker, how["color"])


def _curves(
    nonlinear: MacroSolution, linear: MacroSolution | None, others: tuple[MacroSolution, ...]
) -> list[tuple[MacroSolution, str, Any, str]]:
    """Return each solution with its colour, line style and label."""
    return [
        (nonlinear, NONLINEAR, "-", nonlinear.law if others else "nonlinear"),
        *([] if linear is None else [(linear, LINEAR, DASHED, "linear")]),
        *((other, colour, style, other.law) for other, (colour, style) in zip(others, OTHERS, strict=False)),
    ]


def _shared_legend(axes: Axes, marks: Sequence[tuple[float, str]]) -> None:
    """Add empty grey curves, whose legend explains the strokes and markers that all laws share."""
    axes.plot([], [], color="0.35", ls=DOTTED, lw=2.4, label="drained, the paper's measure")
    for share, marker in marks:
        axes.plot([], [], color="0.35", ls="", marker=marker, ms=5, label=f"{100 * share:.0f} % of final")


def _mark(axes: Axes, time: Array, value: Array, share: float, marker: str, colour: str) -> None:
    when = time_within(time, value, share)
    if when is not None:
        axes.plot(
            when, np.interp(when, time, value), marker=marker, ms=5.5, color=colour, mec="white", mew=0.8
        )
