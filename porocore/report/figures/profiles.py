"""Figures of fields along a column's axis; check that a body is a column; times of the profiles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from porocore.core.units.results import spoken
from porocore.interfaces.solution import MacroSolution, Profile
from porocore.report.figures.style import (
    DASHED,
    DOTTED,
    GREY,
    TIME_COLOURS,
    axis_label,
    legend_above,
    lighter,
    new_figure,
    styled,
)
from porocore.states import Array


@dataclass(frozen=True)
class ProfileField:
    """Field of a :class:`~porocore.interfaces.solution.Profile`: label, values, quantity, and by node or by element.

    A quantity of None is a plain number whose label has a unit.
    """

    label: str
    plain: str
    take: Callable[[Profile], Array]
    quantity: str | None = ""
    nodal: bool = False


PROFILE_FIELDS: dict[str, ProfileField] = {
    "p": ProfileField("pore pressure $p$", "pore pressure", lambda f: f.p, "pressure", nodal=True),
    "settlement": ProfileField(
        "settlement $-u_2$", "settlement", lambda f: -f.u[:, 1], "displacement", nodal=True
    ),
    "H22": ProfileField(
        r"$\partial u_2 / \partial X_2$",
        "macroscopic displacement gradient ∂u₂/∂X₂",
        lambda f: f.grad_u[:, 1, 1],
    ),
    "mean_grad_22": ProfileField(
        r"$\langle\nabla_Y u^1\rangle_{22}$",
        "mean microscopic displacement gradient, component 22",
        lambda f: f.mean_grad[:, 1, 1],
    ),
    "mean_grad_11": ProfileField(
        r"$\langle\nabla_Y u^1\rangle_{11}$",
        "mean microscopic displacement gradient, component 11",
        lambda f: f.mean_grad[:, 0, 0],
    ),
    "K22": ProfileField(
        r"conductivity $(K_t)_{22}$",
        "transformed conductivity along the column",
        lambda f: f.conductivity[:, 1, 1],
        "conductivity",
    ),
    "K11": ProfileField(
        r"conductivity $(K_t)_{11}$",
        "transformed conductivity across the column",
        lambda f: f.conductivity[:, 0, 0],
        "conductivity",
    ),
    "F22": ProfileField(
        r"deformation $\bar F_{22}$",
        "mean deformation gradient, component 22",
        lambda f: f.deformation[:, 1, 1],
    ),
    "F11": ProfileField(
        r"deformation $\bar F_{11}$",
        "mean deformation gradient, component 11",
        lambda f: f.deformation[:, 0, 0],
    ),
    "P22": ProfileField(
        "total stress $P_{E,22}$", "total stress along the column", lambda f: f.stress[:, 1, 1], "stress"
    ),
    "flux": ProfileField(
        r"fluid flux $(\bar G w)_2$", "fluid flux upwards", lambda f: f.flux[:, 1], "velocity"
    ),
}


@dataclass(frozen=True, eq=False)
class ColumnAxis:
    """Nodes and elements along the y axis through the corner of least x and z, in order of y."""

    nodes: npt.NDArray[np.int64]  #: (k,) indices
    node_y: Array  #: (k,)
    elements: npt.NDArray[np.int64]  #: (e,) indices
    element_y: Array  #: (e,) centres
    ends: Array  #: (e, 2) least and largest y of each element

    @classmethod
    def from_solution(cls, solution: MacroSolution) -> ColumnAxis:
        """Return the axis of a box mesh."""
        points, cells = solution.points, solution.cells
        slack = 1e-9 * float(np.ptp(points, axis=0).max())
        corner = points.min(axis=0)
        on_axis = (np.abs(points[:, [0, 2]] - corner[[0, 2]]) < slack).all(axis=1)
        nodes = np.flatnonzero(on_axis)
        nodes = nodes[np.argsort(points[nodes, 1], kind="stable")]
        elements = np.flatnonzero(on_axis[cells].any(axis=1))
        ends = np.stack(
            [points[cells[elements], 1].min(axis=1), points[cells[elements], 1].max(axis=1)], axis=1
        )
        order = np.argsort(ends[:, 0], kind="stable")
        return cls(nodes, points[nodes, 1], elements[order], ends[order].mean(axis=1), ends[order])

    def series(self, profile: Profile, quantity: ProfileField) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
        """Return positions, values and flags (outside the training range), each (k,) or (e,)."""
        flagged = profile.outside_training_range[self.elements] > 0
        if not quantity.nodal:
            return self.element_y, quantity.take(profile)[self.elements], flagged
        slack = 1e-9 * float(self.node_y[-1] - self.node_y[0])
        low, high = self.ends[flagged].T
        inside = (self.node_y[:, None] >= low - slack) & (self.node_y[:, None] <= high + slack)
        return self.node_y, quantity.take(profile)[self.nodes], inside.any(axis=1)


@styled
def profile_figure(
    nonlinear: MacroSolution,
    linear: MacroSolution | None,
    quantity: str | ProfileField,
    *,
    others: Sequence[MacroSolution] = (),
    times: Sequence[float] | None = None,
    rest: float | None = None,
) -> Figure:
    """Draw one field along the column, solid for the cell's law and dashed for linear poroelasticity.

    Parts in which the cell law was flagged are pale with hollow markers.

    Parameters
    ----------
    nonlinear, linear
        Two solutions with profiles at the same times; None: without the linear one.
    quantity
        A key of :data:`PROFILE_FIELDS`, or one of one's own.
    others
        Solutions with other closures, drawn dotted.
    times
        Which profiles to show, six at most; None: all but the closing one (if there are others).
    rest
        Value of the undeformed cell, drawn as a line.

    Raises
    ------
    ValueError
        The quantity is unknown, or a solution has no profile at one of the times.
    """
    what = _field(quantity)
    times = chosen_times(nonlinear) if times is None else times
    units = spoken()
    length, factor = units.factor("displacement"), units.factor(what.quantity or "")
    figure = new_figure(5.4, 4.0)
    axes = figure.add_subplot()
    line = ColumnAxis.from_solution(nonlinear)
    compared: list[tuple[MacroSolution, Any, str]] = [] if linear is None else [(linear, DASHED, "linear")]
    compared += [(other, DOTTED, f"closure {other.law}") for other in others]
    for time, colour in zip(times, TIME_COLOURS, strict=False):
        for solution, stroke, _ in compared:
            y, value, _ = ColumnAxis.from_solution(solution).series(profile_at(solution, time), what)
            axes.plot(y * length, value * factor, color=colour, ls=stroke, lw=1.3)
        y, value, flagged = line.series(profile_at(nonlinear, time), what)
        if flagged.any():
            _flagged_parts(axes, y * length, value * factor, flagged, colour)
        value, label = np.where(flagged, np.nan, value * factor), f"$t$ = {units.text(time, 'time', 6)}"
        axes.plot(y * length, value, color=colour, label=label)
    for _, stroke, label in compared:
        axes.plot([], [], color="0.35", ls=stroke, lw=1.3, label=label)
    if rest is not None:
        axes.axhline(rest * factor, color=GREY, ls=DASHED, lw=1.0, label="undeformed cell")
    axes.set_xlabel(axis_label("position along the column $X_2$", "displacement", units))
    axes.set_ylabel(what.label if what.quantity is None else axis_label(what.label, what.quantity, units))
    axes.margins(x=0.02)
    if any(line.series(profile_at(nonlinear, time), what)[2].any() for time in times[: len(TIME_COLOURS)]):
        axes.plot([], [], color="0.65", marker="o", ms=3.6, mfc="white", mec="0.5", label="flagged")
    legend_above(figure, axes, columns=3)
    return figure


def _field(quantity: str | ProfileField) -> ProfileField:
    if not isinstance(quantity, str):
        return quantity
    if quantity not in PROFILE_FIELDS:
        raise ValueError(f"unknown quantity '{quantity}'; choose from {', '.join(PROFILE_FIELDS)}")
    return PROFILE_FIELDS[quantity]


def _flagged_parts(axes: Axes, y: Array, value: Array, flagged: npt.NDArray[np.bool_], colour: str) -> None:
    """Draw the whole curve pale, with hollow markers where it is flagged."""
    every = max(1, len(y) // 24)
    axes.plot(y, value, color=lighter(colour), lw=1.7)
    spots = np.flatnonzero(flagged)[::every]
    axes.plot(y[spots], value[spots], ls="", marker="o", ms=3.6, mfc="white", mec=lighter(colour, 0.4))


def is_column(solution: MacroSolution) -> bool:
    """Tell whether the body is a column of single elements along y, which profiles along its axis describe fully."""
    return solution.cells.shape[1] == 27 and len(ColumnAxis.from_solution(solution).elements) == len(
        solution.cells
    )


def chosen_times(solution: MacroSolution) -> tuple[float, ...]:
    """Return the times of the profiles after rest, without the last one if there are others; six at most."""
    times = tuple(profile.time for profile in solution.after_rest)
    return times[: max(1, len(times) - 1)][: len(TIME_COLOURS)]


def profile_at(solution: MacroSolution, time: float) -> Profile:
    """Return the profile at ``time``; ValueError if none was kept."""
    for profile in solution.profiles:
        if abs(profile.time - time) <= 1e-9 * max(1.0, abs(time)):
            return profile
    kept = ", ".join(f"{profile.time:g}" for profile in solution.profiles)
    raise ValueError(f"the {solution.law} solution has no profile at t = {time:g}; it has {kept or 'none'}")
