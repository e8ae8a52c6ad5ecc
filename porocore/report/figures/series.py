"""Figures of probes, reactions and inflows against time; early peaks, axes that turn logarithmic."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from porocore.core.units.results import ResultUnits
from porocore.interfaces.solution import MacroSolution
from porocore.report.figures.style import (
    DASHED,
    TIME_COLOURS,
    axis_label,
    legend_above,
    named,
    new_figure,
    styled,
)
from porocore.states import Array

#: A peak within this share of the time, and the most of what happens with it, would be a line of one pixel.
EARLY = 0.05
#: A curve that ends this share below its peak has one.
FALLS = 0.01
#: A component below this share of the largest of its kind is round-off, or of no interest, and not drawn.
VISIBLE = 1e-3


@dataclass(frozen=True)
class Panel:
    """Curves of one kind of quantity.

    Attributes
    ----------
    label
        Of the axis, without its unit.
    quantity
        Of :data:`porocore.core.units.scales.QUANTITIES`.
    plain
        In words.
    curves
        Name of each, and its values.
    sign
        What is positive, where that is a convention.
    """

    label: str
    quantity: str
    plain: str
    curves: dict[str, Array]
    sign: str = ""


def panels(solution: MacroSolution) -> Iterator[Panel]:
    """Yield panels of pressures and displacements of probes, forces and inflows, as far as there are any."""
    probes, compression, inflow = (
        {named(name): values for name, values in kind.items()}
        for kind in (solution.probes, solution.compression, solution.inflow)
    )
    displacements = {f"{name} $u_{i + 1}$": v[:, i] for name, v in probes.items() for i in range(3)}
    pressures, forces = {n: v[:, 3] for n, v in probes.items()}, "forces of held or moved surfaces"
    for panels_of_kind in (
        [Panel("pore pressure $p$", "pressure", "pressure at the probes", pressures)],
        [Panel("displacement", "displacement", "displacement of the probes", displacements)],
        [
            Panel("compressive force", "force", forces, compression, "positive in compression"),
            Panel(
                "force on the body", "force", f"other {forces}", _others(solution), "positive along the axis"
            ),
        ],
        [
            Panel(
                "inflow of fluid",
                "flow",
                "inflow through surfaces of given pressure"
                + (" and their images in the whole body" if solution.copies > 1 else ""),
                inflow,
                "positive into the body",
            )
        ],
    ):
        sizes = [np.abs(v).max() for panel in panels_of_kind for v in panel.curves.values()]
        largest = max(map(float, sizes), default=0.0)
        for panel in panels_of_kind:
            kept = {name: v for name, v in panel.curves.items() if np.abs(v).max() > VISIBLE * largest}
            if kept:
                yield replace(panel, curves=kept)


def _others(solution: MacroSolution) -> dict[str, Array]:
    """Return the components of the forces that are not the compressive force on the same surface."""
    found = {}
    for name, force in solution.reactions.items():
        pressed = solution.compression.get(name)
        for i, axis in enumerate("xyz"):
            values = force[:, i]
            if pressed is None or not _same(np.abs(values), np.abs(pressed)):
                found[f"{named(name)}, along {axis}"] = values
    return found


def _same(one: Array, other: Array) -> bool:
    return bool(np.abs(one - other).max() <= VISIBLE * np.abs(other).max())


def early_peak(time: Array, curves: Iterable[Array]) -> float | None:
    """Return the time of the first peak if it and most of what happens come early in the run; otherwise None."""
    end, early = float(time[-1]), time[1:] <= EARLY * time[-1]
    peaks, changes = [], np.zeros(len(time) - 1)
    for values in curves:
        size = np.abs(values)
        if size[-1] < (1 - FALLS) * size.max():
            peaks.append(float(time[size.argmax()]))
        changes += np.abs(np.diff(values)) / max(float(np.ptp(values)), np.finfo(float).tiny)
    first = min(peaks, default=end)
    happens = changes[early].sum() >= changes.sum() / 2
    return first if 0 < first <= EARLY * end and happens else None


def _logarithmic_after(axes: Axes, bend: float, end: float) -> None:
    """Give the axis of time one scale from 0 to ``bend`` and a logarithmic one from there to ``end``."""
    axes.set_xscale("symlog", linthresh=bend, linscale=0.6)
    decades = 10.0 ** np.arange(np.floor(np.log10(bend)), np.ceil(np.log10(end)) + 1)
    later = [each for each in decades if 1.5 * bend < each <= end * 1.001]
    axes.set_xticks([0.0, bend, *later], [_short(each) for each in (0.0, bend, *later)])
    axes.set_xticks([], minor=True)


def _short(time: float) -> str:
    return f"{float(f'{time:.3g}'):g}"


def end_of_rise(solution: MacroSolution, panel: Panel) -> float | None:
    """Return the time at which the largest curve peaks, if it falls from there; otherwise None."""
    values = np.abs(max(panel.curves.values(), key=lambda each: float(np.abs(each).max())))
    step = int(values.argmax())
    falls = step < len(values) - 2 and values[-1] < (1 - FALLS) * values[step]
    return float(solution.history.time[step]) if falls else None


@styled
def relaxation_figure(
    nonlinear: MacroSolution, linear: MacroSolution | None, plain: str, units: ResultUnits | None = None
) -> Figure:
    """Draw the panel called ``plain``, which falls, against the logarithm of the time from its peak."""
    units = units or ResultUnits()
    panel = next(p for p in panels(nonlinear) if p.plain == plain)
    figure = new_figure(5.4, 3.6)
    axes = figure.add_subplot()
    begin = end_of_rise(nonlinear, panel) or 0.0
    _draw(axes, panel, nonlinear, linear, units, begin)
    axes.set_xscale("log")
    axes.set_xlabel(axis_label("time from the peak", "time", units) + ", logarithmic")
    legend_above(figure, axes, columns=3)
    return figure


@styled
def series_figure(
    nonlinear: MacroSolution, linear: MacroSolution | None, plain: str, units: ResultUnits | None = None
) -> Figure:
    """Draw the panel called ``plain`` against time, the cell's law solid and linear poroelasticity dashed."""
    units = units or ResultUnits()
    panel = next(p for p in panels(nonlinear) if p.plain == plain)
    figure = new_figure(5.4, 3.6)
    axes, t = figure.add_subplot(), units.factor("time")
    _draw(axes, panel, nonlinear, linear, units)
    axes.set_xlabel(axis_label("time $t$", "time", units))
    bend = early_peak(nonlinear.history.time, panel.curves.values())
    if bend is not None:
        _logarithmic_after(axes, bend * t, float(nonlinear.history.time[-1]) * t)
        axes.set_xlabel(f"{axes.get_xlabel()}, logarithmic after {_short(bend * t)}")
    legend_above(figure, axes, columns=3)
    return figure


def _draw(
    axes: Axes,
    panel: Panel,
    nonlinear: MacroSolution,
    linear: MacroSolution | None,
    units: ResultUnits,
    begin: float | None = None,
) -> None:
    """Draw the curves of a panel, against time or the time from ``begin`` on."""
    others = {} if linear is None else {p.plain: p.curves for p in panels(linear)}.get(panel.plain, {})
    t, factor = units.factor("time"), units.factor(panel.quantity)

    def line(solution: MacroSolution, values: Array, **how: Any) -> None:
        time = solution.history.time
        later = time > (-np.inf if begin is None else begin)
        axes.plot((time[later] - (begin or 0.0)) * t, values[later] * factor, **how)

    drawn: dict[str, list[str]] = {}
    for name, values in panel.curves.items():
        # Of curves that cover each other, such as the forces at both ends of a column, one is drawn.
        same = next((other for other in drawn if _same(values, panel.curves[other])), name)
        drawn.setdefault(same, []).append(name)
    for i, (name, names) in enumerate(drawn.items()):
        colour = TIME_COLOURS[i % len(TIME_COLOURS)]
        line(nonlinear, panel.curves[name], color=colour, label=" and ".join(names))
        if linear is not None and name in others:
            line(linear, others[name], color=colour, ls=DASHED, lw=1.3)
    if linear is not None:
        axes.plot([], [], color="0.35", ls=DASHED, lw=1.3, label="linear")
    sign = f"\n({panel.sign})" if panel.sign else ""
    axes.set_ylabel(axis_label(panel.label, panel.quantity, units) + sign)
    axes.margins(x=0.01)
