"""Figures of probes, reactions and inflows against time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from porocore.core.units.results import ResultUnits
from porocore.interfaces.solution import MacroSolution
from porocore.report.figures.style import (
    DASHED,
    TIME_COLOURS,
    axis_label,
    legend_above,
    new_figure,
    styled,
)
from porocore.states import Array

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
    """

    label: str
    quantity: str
    plain: str
    curves: dict[str, Array]


def panels(solution: MacroSolution) -> Iterator[Panel]:
    """Yield panels of pressures and displacements of probes, reactions and inflows, as far as there are any."""
    probes, reactions = solution.probes, solution.reactions
    displacements = {f"{name} $u_{i + 1}$": v[:, i] for name, v in probes.items() for i in range(3)}
    forces = {f"{name} $R_{i + 1}$": v[:, i] for name, v in reactions.items() for i in range(3)}
    pressures = {n: v[:, 3] for n, v in probes.items()}
    for label, quantity, plain, curves in (
        ("pore pressure $p$", "pressure", "pressure at the probes", pressures),
        ("displacement", "displacement", "displacement of the probes", displacements),
        ("force on the body", "force", "forces of held or moved surfaces", forces),
        ("inflow of fluid", "flow", "inflow through surfaces of given pressure", dict(solution.inflow)),
    ):
        largest = max((float(np.abs(v).max()) for v in curves.values()), default=0.0)
        kept = {name: v for name, v in curves.items() if np.abs(v).max() > VISIBLE * largest}
        if kept:
            yield Panel(label, quantity, plain, kept)


@styled
def series_figure(
    nonlinear: MacroSolution, linear: MacroSolution, plain: str, units: ResultUnits | None = None
) -> Figure:
    """Draw the panel called ``plain`` against time, the cell's law solid and linear poroelasticity dashed."""
    units = units or ResultUnits()
    panel = next(p for p in panels(nonlinear) if p.plain == plain)
    others = {p.plain: p.curves for p in panels(linear)}.get(plain, {})
    figure = new_figure(5.4, 3.6)
    axes = figure.add_subplot()
    t, factor = units.factor("time"), units.factor(panel.quantity)
    for i, (name, values) in enumerate(panel.curves.items()):
        colour = TIME_COLOURS[i % len(TIME_COLOURS)]
        axes.plot(nonlinear.history.time * t, values * factor, color=colour, label=name)
        if name in others:
            axes.plot(linear.history.time * t, others[name] * factor, color=colour, ls=DASHED, lw=1.3)
    axes.plot([], [], color="0.35", ls=DASHED, lw=1.3, label="linear")
    axes.set_xlabel(axis_label("time $t$", "time", units))
    axes.set_ylabel(axis_label(panel.label, panel.quantity, units))
    axes.margins(x=0.01)
    legend_above(figure, axes, columns=3)
    return figure
