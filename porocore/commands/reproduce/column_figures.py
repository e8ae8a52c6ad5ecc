"""The paper's figures of the column: histories, profiles, tangents, test of the network."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from porocore.commands.reproduce.study import LARGE, Results
from porocore.interfaces.solution import MacroSolution, Profile
from porocore.report.figures.curves import (
    OTHERS,
    PROFILE_FIELDS,
    ColumnAxis,
    ProfileField,
    profile_at,
    profile_figure,
)
from porocore.report.figures.sampling import parity_figure
from porocore.report.figures.style import (
    DASHED,
    LINEAR,
    NONLINEAR,
    TIME_COLOURS,
    legend_above,
    new_figure,
    styled,
)
from porocore.states import Array

HISTORIES = {
    "settlement": r"largest settlement $\max(-u_2)$ [–]",
    "pressure_max": r"largest pore pressure $p\,/E$ [–]",
    "drained_paper": r"drained volume $\int\!\!\int (1/\det\bar F)\,\nabla\cdot(\bar G w)\,dV\,dt$ [–]",
}


def paper_velocity(profile: Profile) -> Array:
    """Return the paper's w (elements, 3) = −K F̄⁻ᵀ ∇_X p = F̄ q/det F̄; the reports push q forward with F₀ instead."""
    volume_ratio = np.linalg.det(profile.deformation)[:, None]
    w: Array = np.einsum("eij,ej->ei", profile.deformation, profile.flux) / volume_ratio
    return w


VELOCITY = ProfileField(
    "relative fluid velocity $w_2$", "relative fluid velocity", lambda f: paper_velocity(f)[:, 1], "velocity"
)
#: Labels of the components of the tangent.
TANGENT_LABELS = {
    "M_2222": r"$\partial\langle\nabla_Y u^1\rangle_{22}/\partial H_{22}$ [–]",
    "M_2211": r"$\partial\langle\nabla_Y u^1\rangle_{11}/\partial H_{22}$ [–]",
    "Q_22": "$Q_{22}$ [$1/E$]",
    "Q_11": "$Q_{11}$ [$1/E$]",
}


@styled
def history(results: Results, name: str, load: float) -> Figure:
    """A scalar against time: the nonlinear laws and the linear one."""
    case = results.column.case(load)
    figure = new_figure(5.4, 3.9)
    axes = figure.add_subplot()
    curves: list[tuple[MacroSolution, str, Any, str]] = [
        (solution, *look, f"nonlinear, closure {solution.law}")
        for solution, look in zip((case.nonlinear, *case.others), ((NONLINEAR, "-"), *OTHERS), strict=False)
    ]
    for solution, colour, stroke, label in (*curves, (case.both[1], LINEAR, DASHED, "linear")):
        values = getattr(solution.history, name)
        axes.plot(solution.history.time, values, color=colour, ls=stroke, label=label)
    axes.set(xlabel="time $t$ [–]", ylabel=HISTORIES[name])
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    legend_above(figure, axes, columns=2)
    return figure


def along_column(results: Results, quantity: str, load: float = LARGE, *, linear: bool = True) -> Figure:
    """A field along the column at the early, middle and late time, with both closures."""
    case = results.column.case(load)
    return profile_figure(
        case.nonlinear,
        case.linear if linear else None,
        quantity,
        others=case.others,
        times=results.column.times,
    )


def conductivity(results: Results, component: str) -> Figure:
    """K_t along the column, with its value in the undeformed cell, which is that of the linear law."""
    case = results.column.case(LARGE)
    i = int(component[0]) - 1
    return profile_figure(
        case.nonlinear,
        None,
        f"K{component}",
        others=case.others,
        times=results.column.times,
        rest=float(results.reference.conductivity[i, i]),
    )


@styled
def velocity(results: Results, *, transformed: bool) -> Figure:
    """w against the linear one, or w against the transformed Ḡw."""
    case, times = results.column.case(LARGE), results.column.times
    if not transformed:
        return profile_figure(case.nonlinear, case.linear, VELOCITY, times=times)
    figure = new_figure(5.4, 4.0)
    axes = figure.add_subplot()
    line = ColumnAxis.from_solution(case.nonlinear)
    for time, colour in zip(times, TIME_COLOURS, strict=False):
        here = profile_at(case.nonlinear, time)
        for what, stroke in ((VELOCITY, "-"), (PROFILE_FIELDS["flux"], DASHED)):
            y, value, _ = line.series(here, what)
            axes.plot(y, value, color=colour, ls=stroke, label=f"$t$ = {time:g}" if stroke == "-" else None)
    axes.plot([], [], color="0.35", label="$w$")
    axes.plot([], [], color="0.35", ls=DASHED, label=r"$w^{tr} = \bar G w$")
    axes.set(xlabel="position along the column $X_2$ [–]", ylabel="relative fluid velocity, component 2 [–]")
    axes.margins(x=0.02)
    legend_above(figure, axes, columns=3)
    return figure


def tangent(results: Results, name: str) -> Figure:
    """M or Q of the surrogate at the states along the column."""
    column = results.column
    quantity = ProfileField(TANGENT_LABELS[name], name, partial(column.tangent, name), None)
    rest = results.tangent_at_rest(name)
    return profile_figure(column.case(LARGE).nonlinear, None, quantity, times=column.times, rest=rest)


def network_test(results: Results) -> Figure:
    """Predicted against solved held-out states."""
    return parity_figure(results.column.context.surrogate.outputs)
