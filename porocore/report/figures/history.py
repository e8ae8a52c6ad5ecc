"""Settlement, pore pressure and drained volume against time."""

from __future__ import annotations

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
from porocore.report.metrics import time_to_fraction
from porocore.states import Array

MARKS = ((0.95, "o"), (0.99, "D"))
#: Of further laws, in order.
OTHERS = ((GREEN, (0, (7, 1.5))), (PURPLE, (0, (4, 1.2, 1, 1.2))), (ORANGE, (0, (2, 1))))


@styled
def history_figure(
    nonlinear: MacroSolution,
    linear: MacroSolution,
    *others: MacroSolution,
    log_time: bool = False,
    units: ResultUnits | None = None,
) -> Figure:
    """Draw histories of one load, the cell's law against linear poroelasticity.

    Parameters
    ----------
    nonlinear, linear
        Two solutions of one problem.
    *others
        Further nonlinear ones, such as with another closure; each is then called by its law.
    log_time
        Logarithmic time axis; the state at rest, t = 0, is then left out.
    units
        Of the axes; dimensionless by default.

    Returns
    -------
    Figure
        Three panels above each other: largest settlement, largest pore pressure, drained volume (what
        has left through the boundary solid or dashed, the paper's measure dotted).
    """
    units = units or ResultUnits()
    t, length, stress, volume = (
        units.factor(name) for name in ("time", "displacement", "pressure", "volume")
    )
    figure = new_figure(5.4, 7.6)
    settlement, pressure, drained = figure.subplots(3, 1, sharex=True)
    first = 1 if log_time else 0
    for solution, colour, style, label in _curves(nonlinear, linear, others):
        history = solution.history
        time = history.time[first:] * t
        settlement.plot(time, history.settlement[first:] * length, color=colour, ls=style, label=label)
        pressure.plot(time, history.pressure_max[first:] * stress, color=colour, ls=style)
        drained.plot(time, history.drained[first:] * volume, color=colour, ls=style)
        drained.plot(
            time, history.drained_paper[first:] * volume, color=colour, ls=DOTTED, lw=2.4, alpha=0.75
        )
        for share, marker in MARKS:
            _mark(settlement, history.time * t, history.settlement * length, share, marker, colour)
    _shared_legend(settlement)
    settlement.set_ylabel(axis_label("settlement max$(-u_2)$", "displacement", units))
    pressure.set_ylabel(axis_label("largest pore pressure $p$", "pressure", units))
    drained.set_ylabel(axis_label("drained volume", "volume", units))
    drained.set_xlabel(axis_label("time $t$", "time", units) + (", logarithmic" if log_time else ""))
    for axes in (settlement, pressure, drained):
        if axes.dataLim.ymin >= 0:
            axes.set_ylim(bottom=0)
        axes.margins(x=0.01)
    if log_time:
        drained.set_xscale("log")
    else:
        drained.set_xlim(left=0)
    figure.align_ylabels()
    legend_above(figure, settlement, columns=2)
    return figure


def _curves(
    nonlinear: MacroSolution, linear: MacroSolution, others: tuple[MacroSolution, ...]
) -> list[tuple[MacroSolution, str, Any, str]]:
    """Return each solution with its colour, line style and label."""
    return [
        (nonlinear, NONLINEAR, "-", nonlinear.law if others else "nonlinear"),
        (linear, LINEAR, DASHED, "linear"),
        *((other, colour, style, other.law) for other, (colour, style) in zip(others, OTHERS, strict=False)),
    ]


def _shared_legend(axes: Axes) -> None:
    """Add empty grey curves, whose legend explains the strokes and markers that all laws share."""
    axes.plot([], [], color="0.35", ls=DOTTED, lw=2.4, label="drained, the paper's measure")
    for share, marker in MARKS:
        axes.plot([], [], color="0.35", ls="", marker=marker, ms=5, label=f"{100 * share:.0f} % of final")


def _mark(axes: Axes, time: Array, value: Array, share: float, marker: str, colour: str) -> None:
    when = time_to_fraction(time, value, share)
    if when is not None:
        axes.plot(
            when, np.interp(when, time, value), marker=marker, ms=5.5, color=colour, mec="white", mew=0.8
        )
