"""Claims of Dehghani & Zilian 2022 on profiles: pressure, deformation, conductivity, tangents."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import numpy as np

from porocore.commands.reproduce.claims import Claim, Claims, Finding, compare_number, judge_statement
from porocore.commands.reproduce.column_figures import paper_velocity
from porocore.commands.reproduce.study import LARGE, Column, Results
from porocore.core.units import SCENARIOS
from porocore.interfaces.solution import Profile
from porocore.report.figures.curves import ColumnAxis, profile_at
from porocore.report.format import number, percent, plain
from porocore.states import Array

#: A field of element means.
Take: TypeAlias = Callable[[Profile], Array]
CLAIMS = Claims()


def _along(column: Column, take: Take, name: str) -> tuple[list[tuple[float, float]], str]:
    """Return a field of element means at the bottom and at the top at each time, and in words."""
    solution = column.case(LARGE).nonlinear
    upwards = ColumnAxis.from_solution(solution).elements
    found, texts = [], []
    for time in column.times:
        bottom, top = (float(x) for x in take(profile_at(solution, time))[upwards[[0, -1]]])
        found.append((bottom, top))
        texts.append(f"{number(bottom, 3)} … {number(top, 3)} at t = {plain(time)}")
    return found, f"{name} from bottom to top: " + ", ".join(texts)


@CLAIMS.claim("Figure 16a", "K_22 increases during the consolidation")
def _k22(results: Results) -> Finding:
    rest = float(results.reference.conductivity[1, 1])
    found, text = _along(results.column, lambda f: f.conductivity[:, 1, 1], "K_t,22")
    rising = all(later[0] >= sooner[0] - 1e-9 for sooner, later in itertools.pairwise(found))
    return judge_statement(rising and found[-1][0] > rest, f"{text}; undeformed {number(rest, 3)}")


@CLAIMS.claim(
    "Figure 16b", "K_11 increases at the bottom at short times, decreases towards the top and at long times"
)
def _k11(results: Results) -> Finding:
    rest = float(results.reference.conductivity[0, 0])
    found, text = _along(results.column, lambda f: f.conductivity[:, 0, 0], "K_t,11")
    return judge_statement(
        found[0][0] > rest and found[0][1] < found[0][0] and found[-1][0] < rest,
        f"{text}; undeformed {number(rest, 3)}",
    )


@CLAIMS.claim("Figure 17", "pressure profiles close to linear at first, diverging later")
def _pressure_profiles(results: Results) -> Finding:
    case = results.column.case(LARGE)
    gaps, texts = [], []
    for time in results.column.times:
        one, other = (profile_at(solution, time).p for solution in case.both)
        gaps.append(float(np.abs(one - other).max() / np.abs(other).max()))
        texts.append(f"{percent(gaps[-1], 0)} at t = {plain(time)}")
    return judge_statement(
        gaps[0] < gaps[-1], "largest gap by the largest linear pressure of the time: " + ", ".join(texts)
    )


@CLAIMS.claim("Figures 19, 21", "largest H_22 around −0.32; the other components negligible")
def _h22(results: Results) -> Finding:
    end = results.column.case(LARGE).nonlinear.profiles[-1]
    others = np.abs(end.grad_u).max(axis=0)
    others[1, 1] = 0
    least = float(end.grad_u[:, 1, 1].min())
    return compare_number(
        -0.32,
        least,
        0.05,
        "the same as with the settlement of 30 % of the height, see there",
        f"; every other component is below {number(max(float(others.max()), 1e-16), 1)}",
    )


@CLAIMS.claim("Figure 20a", "⟨∇u¹⟩_22 is positive against the effect of the pressure")
def _mean_22(results: Results) -> Finding:
    found, text = _along(results.column, lambda f: f.mean_grad[:, 1, 1], "⟨∇u¹⟩_22")
    return judge_statement(all(top > 0 for _, top in found) and found[-1][0] > 0, text)


@CLAIMS.claim("Figure 20b", "⟨∇u¹⟩_11 is negative at short times, positive later")
def _mean_11(results: Results) -> Finding:
    found, text = _along(results.column, lambda f: f.mean_grad[:, 0, 0], "⟨∇u¹⟩_11")
    return judge_statement(found[0][0] < 0 < found[-1][0], text)


@CLAIMS.claim("Figure 20", "⟨∇u¹⟩_33 is similar to ⟨∇u¹⟩_11")
def _mean_33(results: Results) -> Finding:
    profile = results.column.case(LARGE).nonlinear.profiles[-1]
    gap = float(np.abs(profile.mean_grad[:, 2, 2] - profile.mean_grad[:, 0, 0]).max())
    share = gap / float(np.abs(profile.mean_grad[:, 0, 0]).max())
    return judge_statement(share < 0.02, f"they differ by at most {percent(share, 2)} at the end")


@CLAIMS.claim("Figure 21a", "F̄_22 is moderated: larger than 1 + H_22")
def _f22(results: Results) -> Finding:
    profile = results.column.case(LARGE).nonlinear.profiles[-1]
    bar, simple = float(profile.deformation[:, 1, 1].mean()), float(1 + profile.grad_u[:, 1, 1].mean())
    return judge_statement(
        bar > simple,
        f"F̄_22 = {number(bar, 3)} at the end where 1 + H_22 = {number(simple, 3)}",
    )


@CLAIMS.claim("Figure 21b", "F̄_11 is only due to ⟨∇u¹⟩_11")
def _f11(results: Results) -> Finding:
    found, text = _along(results.column, lambda f: f.deformation[:, 0, 0], "F̄_11")
    H = max(float(np.abs(p.grad_u[:, 0, 0]).max()) for p in results.column.case(LARGE).nonlinear.profiles)
    return judge_statement(
        H < 1e-9 and abs(found[-1][0] - 1) > 1e-3, f"{text}; largest H_11: {number(max(H, 1e-16), 1)}"
    )


def _largest(w: Array) -> float:
    return float(np.abs(w[:, 1]).max())


@CLAIMS.claim(
    "Figure 22",
    "fluid velocities diverge considerably from linear, with a faster transition to the steady state",
)
def _velocity(results: Results) -> Finding:
    case = results.column.case(LARGE)
    found, texts = [], []
    for time in results.column.times:
        here, there = (profile_at(solution, time) for solution in case.both)
        w, linear, pushed = (_largest(flow) for flow in (paper_velocity(here), there.flux, here.flux))
        found.append((w, linear))
        texts.append(
            f"t = {plain(time)}: w {number(w, 3)}, Ḡw {number(pushed, 3)}, linear {number(linear, 3)}"
        )
    fallen = [found[-1][k] / found[0][k] for k in (0, 1)]
    return judge_statement(
        fallen[0] < 0.5 * fallen[1],
        f"largest: {'; '.join(texts)}. From the first to the last time w falls to {percent(fallen[0])}, "
        f"the linear one to {percent(fallen[1])}",
    )


def _tangents(results: Results, name: str) -> tuple[float, list[tuple[float, float]], str]:
    """Return the value at rest, those at the bottom and top at each time, and all in words."""
    rest = results.tangent_at_rest(name)
    found, text = _along(results.column, partial(results.column.tangent, name), name)
    return rest, found, f"{text}; undeformed {number(rest, 3)}"


@CLAIMS.claim("Figure 23a", "the changes of M_2222 are dominated by the negative H_22")
def _m2222(results: Results) -> Finding:
    rest, found, text = _tangents(results, "M_2222")
    return judge_statement(abs(found[-1][0] - rest) > abs(found[0][0] - rest), text)


@CLAIMS.claim(
    "Figure 23b", "M_2211 decreases at first at the bottom and increases towards the top and at long times"
)
def _m2211(results: Results) -> Finding:
    rest, found, text = _tangents(results, "M_2211")
    return judge_statement(
        found[0][0] < rest and found[0][1] > found[0][0] and found[-1][0] > found[0][0],
        text,
        "the sign of the change depends on the crease and contact of the cell, which the paper leaves out",
    )


def _q(name: str, results: Results) -> Finding:
    along = results.sensitivity.loads["pressure"]
    pressed = float(np.interp(0.2, along.values, along.quantities["Q_11"]))
    rest, found, _ = _tangents(results, name)
    by_H = found[-1][0]
    return judge_statement(
        pressed > rest and (by_H < rest if name == "Q_22" else by_H > rest),
        f"p = 0.2 alone: {number(pressed, 3)}; drained, H_22 alone: {number(by_H, 3)}; "
        f"undeformed {number(rest, 3)}",
        "past the crease (H_22 ≈ −0.2) contact of the wall changes the slopes; the paper leaves contact out",
    )


CLAIMS += [
    Claim("Figure 23", "pressure increases Q_22, H_22 decreases it", partial(_q, "Q_22")),
    Claim("Figure 23", "pressure and H_22 both increase Q_11", partial(_q, "Q_11")),
]


def _scale(scenario: str, quantity: str, published: float, unit: float, results: Results) -> Finding:
    return compare_number(published, SCENARIOS[scenario].factor(quantity) * unit, 0.01)


CLAIMS += [
    Claim("Dimensional variables", said, partial(_scale, scenario, quantity, published, unit))
    for said, scenario, quantity, published, unit in (
        ("brain tissue: P in 10³ Pa", "brain-tissue", "pressure", 1e3, 1.0),
        ("brain tissue: t in 250 s", "brain-tissue", "time", 250, 1.0),
        ("brain tissue: w in 4e-3 mm/s", "brain-tissue", "velocity", 4e-3, 1e3),
        ("soil: P in 1.5e6 Pa", "soil", "pressure", 1.5e6, 1.0),
        ("soil: t in 16.6 s", "soil", "time", 16.6, 1.0),
        ("soil: w in 6e-2 m/s", "soil", "velocity", 6e-2, 1.0),
    )
]
