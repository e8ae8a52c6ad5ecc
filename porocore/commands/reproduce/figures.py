"""Figures of the publication: their list, what each needs, and the functions that draw those of the column.

They are numbered as in the paper. Figures 1, 10 and 12 are sketches and hold no results.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure

from porocore.commands.reproduce.study import LARGE, SMALL, Results
from porocore.core.echo import echo
from porocore.errors import ConfigurationError
from porocore.interfaces.solution import MacroSolution, Profile
from porocore.report.figures import style
from porocore.report.figures.curves import (
    OTHERS,
    PROFILE_FIELDS,
    ColumnAxis,
    ProfileField,
    profile_at,
    profile_figure,
)
from porocore.report.figures.sampling import parity_figure
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


@style.styled
def history(name: str, load: float, results: Results) -> Figure:
    """Draw a scalar against time: the nonlinear laws and the linear one."""
    case = results.column.case(load)
    figure = style.new_figure(5.4, 3.9)
    axes = figure.add_subplot()
    curves: list[tuple[MacroSolution, str, Any, str]] = [
        (solution, *look, f"nonlinear, closure {solution.law}")
        for solution, look in zip(
            (case.nonlinear, *case.others), ((style.NONLINEAR, "-"), *OTHERS), strict=False
        )
    ]
    for solution, colour, stroke, label in (*curves, (case.both[1], style.LINEAR, style.DASHED, "linear")):
        values = getattr(solution.history, name)
        axes.plot(solution.history.time, values, color=colour, ls=stroke, label=label)
    axes.set(xlabel="time $t$ [–]", ylabel=HISTORIES[name])
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    style.legend_above(figure, axes, columns=2)
    return figure


def along_column(quantity: str, load: float, results: Results, *, linear: bool = True) -> Figure:
    """Draw a field along the column at the early, middle and late time, with both closures."""
    case = results.column.case(load)
    compared = case.linear if linear else None
    return profile_figure(case.nonlinear, compared, quantity, others=case.others, times=results.column.times)


def conductivity(i: int, results: Results) -> Figure:
    """Draw K_t,ii along the column, with its value in the undeformed cell, which is that of the linear law."""
    case, rest = results.column.case(LARGE), float(results.reference.conductivity[i - 1, i - 1])
    return profile_figure(
        case.nonlinear, None, f"K{i}{i}", others=case.others, times=results.column.times, rest=rest
    )


@style.styled
def transformed_velocity(results: Results) -> Figure:
    """Draw w and the transformed Ḡw."""
    solution = results.column.case(LARGE).nonlinear
    figure = style.new_figure(5.4, 4.0)
    axes = figure.add_subplot()
    line = ColumnAxis.from_solution(solution)
    for time, colour in zip(results.column.times, style.TIME_COLOURS, strict=False):
        here = profile_at(solution, time)
        for what, stroke in ((VELOCITY, "-"), (PROFILE_FIELDS["flux"], style.DASHED)):
            y, value, _ = line.series(here, what)
            axes.plot(y, value, color=colour, ls=stroke, label=f"$t$ = {time:g}" if stroke == "-" else None)
    axes.plot([], [], color="0.35", label="$w$")
    axes.plot([], [], color="0.35", ls=style.DASHED, label=r"$w^{tr} = \bar G w$")
    axes.set(xlabel="position along the column $X_2$ [–]", ylabel="relative fluid velocity, component 2 [–]")
    axes.margins(x=0.02)
    style.legend_above(figure, axes, columns=3)
    return figure


def velocity(results: Results) -> Figure:
    """Draw w against the linear one."""
    case = results.column.case(LARGE)
    return profile_figure(case.nonlinear, case.linear, VELOCITY, times=results.column.times)


def tangent(name: str, results: Results) -> Figure:
    """Draw a component of M or Q of the surrogate at the states along the column."""
    column, rest = results.column, results.tangent_at_rest(name)
    quantity = ProfileField(TANGENT_LABELS[name], name, partial(column.tangent, name), None)
    return profile_figure(column.case(LARGE).nonlinear, None, quantity, times=column.times, rest=rest)


def network_test(results: Results) -> Figure:
    """Draw predicted against solved held-out states."""
    return parity_figure(results.column.context.surrogate.outputs)


Stage = Literal["fields", "sensitivity", "column"]
SKETCHES = (1, 10, 12)


@dataclass(frozen=True)
class PaperFigure:
    """One panel of a figure.

    Attributes
    ----------
    number, panel
        Such as 13 and ``"a"``; the panel is empty where there is one only.
    label
        Label in the paper's source.
    shows
        Content in words.
    stage
        Computation that it needs.
    draw
        Function that draws it; None for the stages that draw their pictures themselves, named by the label.
    """

    number: int
    panel: str
    label: str
    shows: str
    stage: Stage
    draw: Callable[[Results], Figure] | None = None

    @property
    def name(self) -> str:
        """Number and panel."""
        return f"{self.number}{self.panel}"

    @property
    def file(self) -> str:
        """Name of its PNG."""
        return f"figure-{self.number:02d}{self.panel}.png"


def _fields(number: int, state: str, load: str) -> list[PaperFigure]:
    shows = (f"|u¹| on the deformed cell under {load}", f"Ψ on the undeformed cell under {load}")
    return [
        PaperFigure(number, panel, f"{kind}_{state}", text, "fields")
        for panel, kind, text in zip("ab", ("disp", "energy"), shows, strict=True)
    ]


def _cell(number: int, panel: str, label: str, shows: str) -> PaperFigure:
    return PaperFigure(number, panel, label, shows, "sensitivity")


def _column(
    number: int, panel: str, label: str, shows: str, draw: Callable[..., Figure], *args: Any, **how: Any
) -> PaperFigure:
    return PaperFigure(number, panel, label, shows, "column", partial(draw, *args, **how))


def _both_loads(
    number: int, label: str, shows: str, draw: Callable[..., Figure], quantity: str
) -> list[PaperFigure]:
    return [
        _column(number, panel, f"{label}{suffix}", f"{shows}, P = {load:g}", draw, quantity, load)
        for panel, load, suffix in (("a", LARGE, "02"), ("b", SMALL, "001"))
    ]


FIGURES: tuple[PaperFigure, ...] = (
    *_fields(2, "pressure", "pore pressure"),
    *_fields(3, "uni", "H_11"),
    *_fields(4, "shear", "H_12"),
    _cell(5, "a", "dyu1_Av_1", "average of ∇u¹, components with the indices of the load"),
    _cell(5, "b", "dyu1_Av_2", "average of ∇u¹, other components"),
    _cell(6, "a", "dyu1_max_1", "largest |∇u¹|, components with the indices of the load"),
    _cell(6, "b", "dyu1_max_2", "largest |∇u¹|, other components"),
    _cell(7, "a", "psi_Av", "average of Ψ"),
    _cell(7, "b", "psi_max", "largest Ψ"),
    _cell(8, "a", "K11", "K_t,11 by its initial value"),
    _cell(8, "b", "K22", "K_t,22 by its initial value"),
    _cell(9, "a", "Mijkl_reference", "M in the reference configuration"),
    _cell(9, "b", "Mijkl_deformed", "M multiplied by Ĵ"),
    _cell(9, "c", "Q_11", "Q, in the reference configuration and multiplied by Ĵ"),
    _cell(9, "d", "Biot_Modulus", "Biot modulus, in both forms"),
    _column(11, "", "ANN_test", "network against the cell on states that it never saw", network_test),
    *_both_loads(13, "T_SettlementMax", "largest settlement against time", history, "settlement"),
    *_both_loads(14, "T_PorepressureMax", "largest pore pressure against time", history, "pressure_max"),
    *_both_loads(15, "T_DrainedFluid", "drained volume against time", history, "drained_paper"),
    _column(16, "a", "y_K22", "K_t,22 along the column", conductivity, 2),
    _column(16, "b", "y_K11", "K_t,11 along the column", conductivity, 1),
    *_both_loads(17, "y_Porepressure", "pore pressure along the column", along_column, "p"),
    *_both_loads(18, "y_Settlement", "settlement along the column", along_column, "settlement"),
    _column(19, "", "y_dxu022", "∂u_2/∂X_2 along the column", along_column, "H22", LARGE),
    _column(20, "a", "y_dyu122", "⟨∇u¹⟩_22 along the column", along_column, "mean_grad_22", LARGE),
    _column(20, "b", "y_dyu111", "⟨∇u¹⟩_11 along the column", along_column, "mean_grad_11", LARGE),
    _column(21, "a", "y_F022", "F̄_22 along the column", along_column, "F22", LARGE, linear=False),
    _column(21, "b", "y_F011", "F̄_11 along the column", along_column, "F11", LARGE, linear=False),
    _column(22, "a", "y_w02", "relative fluid velocity along the column", velocity),
    _column(22, "b", "y_w_tr02", "relative fluid velocity and transformed one", transformed_velocity),
    _column(23, "a", "y_M2222", "M_2222 along the column", tangent, "M_2222"),
    _column(23, "b", "y_M2211", "∂⟨∇u¹⟩_11/∂H_22 along the column", tangent, "M_2211"),
    _column(23, "c", "y_Q22", "Q_22 along the column", tangent, "Q_22"),
    _column(23, "d", "y_Q11", "Q_11 along the column", tangent, "Q_11"),
)


def select_figures(wanted: Sequence[str] | None) -> tuple[PaperFigure, ...]:
    """Return the figures with these numbers, ``13`` or ``13a``; all for None.

    Raises
    ------
    ConfigurationError
        There is no such figure.
    """
    if not wanted:
        return FIGURES
    found: dict[PaperFigure, None] = {}
    for name in wanted:
        which = [figure for figure in FIGURES if name.lower() in (str(figure.number), figure.name)]
        if not which:
            numbers = sorted({figure.number for figure in FIGURES})
            raise ConfigurationError(
                f"--figure: there is no figure {echo(name)} to be computed; expected one of "
                f"{', '.join(map(str, numbers))}, with or without its panel, such as 13 or 13a "
                f"(figures {', '.join(map(str, SKETCHES))} are sketches)"
            )
        found |= dict.fromkeys(which)
    return tuple(found)
