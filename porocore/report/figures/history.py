"""Figure of settlement or heave, pore pressure or suction, and drained volume against time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from porocore.core.units.results import ResultUnits
from porocore.interfaces.solution import History, MacroSolution
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
from porocore.report.metrics import solution_metrics, time_within
from porocore.report.words.settlement import only_suction, rises
from porocore.states import Array

MARKS = ((0.95, "o"), (0.99, "D"))
#: Of further laws, in order.
OTHERS = ((GREEN, (0, (7, 1.5))), (PURPLE, (0, (4, 1.2, 1, 1.2))), (ORANGE, (0, (2, 1))))


@dataclass(frozen=True)
class _Panel:
    """A quantity of the body against time."""

    label: str
    quantity: str
    of: Callable[[History], Array]


SETTLEMENT = _Panel("settlement max$(-u_2)$", "displacement", lambda history: history.settlement)
HEAVE = _Panel("heave max$(u_2)$", "displacement", lambda history: history.heave)
PRESSURE = _Panel("largest pore pressure $p$", "pressure", lambda history: history.pressure_max)
SUCTION = _Panel("least pore pressure $p$", "pressure", lambda history: history.pressure_min)
DRAINED = _Panel("drained volume", "volume", lambda history: history.drained)
#: The publication's own measure of it.
PAPER = _Panel("", "volume", lambda history: history.drained_paper)


def _panels(solutions: Sequence[MacroSolution], settles: bool) -> list[_Panel]:
    """Return what is drawn: heave of a body that rises by all laws, the least pressure where there is only suction."""
    found = [solution_metrics(each) for each in solutions]
    heaves = all(map(rises, found))
    pressure = SUCTION if all(map(only_suction, found)) else PRESSURE
    return [*([HEAVE if heaves else SETTLEMENT] if settles else []), pressure, DRAINED]


@styled
def history_figure(
    nonlinear: MacroSolution,
    linear: MacroSolution | None,
    *others: MacroSolution,
    log_time: bool = False,
    settles: bool = True,
    units: ResultUnits | None = None,
    published: bool = False,
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
    published
        Draw the publication's own measure of the drained volume too, dotted.

    The panels are largest settlement, largest pore pressure, drained volume. Where the body moves further up than down
    the first is the largest heave, where no pressure is positive the second is the least one.
    """
    units = units or ResultUnits()
    figure = new_figure(5.4, 7.6 if settles else 5.4)
    rows = list(figure.subplots(3 if settles else 2, 1, sharex=True))
    curves = _curves(nonlinear, linear, others)
    panels = _panels([each for each, *_ in curves], settles)
    for solution, colour, style, label in curves:
        _draw(rows, panels, solution, log_time, units, {"color": colour, "ls": style, "label": label})
        if published:
            how = {"color": colour, "ls": DOTTED, "lw": 2.4, "alpha": 0.75}
            _draw(rows[-1:], [PAPER], solution, log_time, units, how)
    drawn = [each.history for each, *_ in curves]
    marked = any(
        time_within(each.time, each.settlement, share) is not None for each in drawn for share, _ in MARKS
    )
    _shared_legend(rows[-1], MARKS if SETTLEMENT in panels and marked else (), published)
    for axes, panel in zip(rows, panels, strict=True):
        axes.set_ylabel(axis_label(panel.label, panel.quantity, units))
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
    legend_above(figure, rows[-1], columns=2)
    return figure


def _draw(
    rows: Sequence[Axes],
    panels: Sequence[_Panel],
    solution: MacroSolution,
    log_time: bool,
    units: ResultUnits,
    how: dict[str, Any],
) -> None:
    """Draw one solution in all panels; the state at rest is left out of a logarithmic axis."""
    by, history = units.factor("time"), solution.history
    time, shown = history.time, history.time > 0 if log_time else history.time >= 0
    for axes, panel in zip(rows, panels, strict=True):
        values = panel.of(history) * units.factor(panel.quantity)
        axes.plot(time[shown] * by, values[shown], **how)
        for share, mark in MARKS if panel is SETTLEMENT else ():
            _mark(axes, time * by, values, share, mark, how["color"])


def _curves(
    nonlinear: MacroSolution, linear: MacroSolution | None, others: tuple[MacroSolution, ...]
) -> list[tuple[MacroSolution, str, Any, str]]:
    """Return each solution with its colour, line style and label."""
    return [
        (nonlinear, NONLINEAR, "-", nonlinear.law if others else "nonlinear"),
        *([] if linear is None else [(linear, LINEAR, DASHED, "linear")]),
        *((other, colour, style, other.law) for other, (colour, style) in zip(others, OTHERS, strict=False)),
    ]


def _shared_legend(axes: Axes, marks: Sequence[tuple[float, str]], published: bool) -> None:
    """Add empty grey curves, whose legend explains the strokes and markers that all laws share."""
    if published:
        axes.plot([], [], color="0.35", ls=DOTTED, lw=2.4, label="drained, the paper's measure")
    for share, marker in marks:
        axes.plot([], [], color="0.35", ls="", marker=marker, ms=5, label=f"{100 * share:.0f} % of final")


def _mark(axes: Axes, time: Array, value: Array, share: float, marker: str, colour: str) -> None:
    when = time_within(time, value, share)
    if when is not None:
        axes.plot(
            when, np.interp(when, time, value), marker=marker, ms=5.5, color=colour, mec="white", mew=0.8
        )
