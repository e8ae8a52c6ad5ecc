"""Dehghani & Zilian 2022 along the column: profiles of pressure, deformation, conductivity, velocity and tangents."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from porocore.core.units.scales import SCENARIOS
from porocore.interfaces.solution import Profile
from porocore.report.figures.profiles import ColumnAxis, profile_at
from porocore.report.format import number, percent, plain
from porocore.states import Array
from porocore.verification.reproduce.claims import Claim, Finding, compare_number, judge_statement
from porocore.verification.reproduce.column import LARGE, Column
from porocore.verification.reproduce.column_figures import paper_velocity
from porocore.verification.reproduce.study import Results

#: A field of element means.
Take: TypeAlias = Callable[[Profile], Array]


def _pressure_profiles(results: Results) -> Finding:
    case = results.column.case(LARGE)
    gaps = []
    for time in results.column.times:
        one, other = profile_at(case.nonlinear, time).p, profile_at(case.linear, time).p
        gaps.append(float(np.abs(one - other).max() / np.abs(other).max()))
    return judge_statement(
        gaps[0] < gaps[-1],
        "largest gap by the largest linear pressure of the time: "
        + ", ".join(
            f"{percent(g, 0)} at t = {plain(t)}" for g, t in zip(gaps, results.column.times, strict=True)
        ),
    )


def _ends(column: Column, take: Take, time: float) -> tuple[float, float]:
    """A field of element means in the lowest and in the highest element."""
    solution = column.case(LARGE).nonlinear
    profile, line = profile_at(solution, time), ColumnAxis.from_solution(solution)
    values = take(profile)[line.elements]
    return float(values[0]), float(values[-1])


def _along(column: Column, take: Take, name: str) -> tuple[list[tuple[float, float]], str]:
    """Bottom and top at each time, and in words."""
    found = [_ends(column, take, time) for time in column.times]
    texts = [
        f"{number(b, 3)} … {number(t, 3)} at t = {plain(time)}"
        for (b, t), time in zip(found, column.times, strict=True)
    ]
    return found, f"{name} from bottom to top: " + ", ".join(texts)


def _k22(results: Results) -> Finding:
    rest = float(results.reference.conductivity[1, 1])
    found, text = _along(results.column, lambda f: f.conductivity[:, 1, 1], "K_t,22")
    rising = all(later[0] >= sooner[0] - 1e-9 for sooner, later in itertools.pairwise(found))
    return judge_statement(rising and found[-1][0] > rest, f"{text}; undeformed {number(rest, 3)}")


def _k11(results: Results) -> Finding:
    rest = float(results.reference.conductivity[0, 0])
    found, text = _along(results.column, lambda f: f.conductivity[:, 0, 0], "K_t,11")
    return judge_statement(
        found[0][0] > rest and found[0][1] < found[0][0] and found[-1][0] < rest,
        f"{text}; undeformed {number(rest, 3)}",
    )


def _h22(results: Results) -> Finding:
    solution = results.column.case(LARGE).nonlinear
    end = solution.profiles[-1]
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


def _mean_22(results: Results) -> Finding:
    found, text = _along(results.column, lambda f: f.mean_grad[:, 1, 1], "⟨∇u¹⟩_22")
    return judge_statement(all(top > 0 for _, top in found) and found[-1][0] > 0, text)


def _mean_11(results: Results) -> Finding:
    found, text = _along(results.column, lambda f: f.mean_grad[:, 0, 0], "⟨∇u¹⟩_11")
    return judge_statement(found[0][0] < 0 < found[-1][0], text)


def _mean_33(results: Results) -> Finding:
    profile = results.column.case(LARGE).nonlinear.profiles[-1]
    gap = float(np.abs(profile.mean_grad[:, 2, 2] - profile.mean_grad[:, 0, 0]).max())
    share = gap / float(np.abs(profile.mean_grad[:, 0, 0]).max())
    return judge_statement(share < 0.02, f"they differ by at most {percent(share, 2)} at the end")


def _f22(results: Results) -> Finding:
    profile = results.column.case(LARGE).nonlinear.profiles[-1]
    bar, simple = float(profile.deformation[:, 1, 1].mean()), float(1 + profile.grad_u[:, 1, 1].mean())
    return judge_statement(
        bar > simple,
        f"F̄_22 = {number(bar, 3)} at the end where 1 + H_22 = {number(simple, 3)}",
    )


def _f11(results: Results) -> Finding:
    found, text = _along(results.column, lambda f: f.deformation[:, 0, 0], "F̄_11")
    H = max(float(np.abs(p.grad_u[:, 0, 0]).max()) for p in results.column.case(LARGE).nonlinear.profiles)
    return judge_statement(
        H < 1e-9 and abs(found[-1][0] - 1) > 1e-3, f"{text}; largest H_11: {number(max(H, 1e-16), 1)}"
    )


def _velocity(results: Results) -> Finding:
    case = results.column.case(LARGE)
    found = []
    for time in results.column.times:
        here, there = profile_at(case.nonlinear, time), profile_at(case.linear, time)
        found.append((_largest(paper_velocity(here)), _largest(there.flux), _largest(here.flux)))
    texts = [
        f"t = {plain(t)}: w {number(w, 3)}, Ḡw {number(tr, 3)}, linear {number(lin, 3)}"
        for (w, lin, tr), t in zip(found, results.column.times, strict=True)
    ]
    fallen = [found[-1][k] / found[0][k] for k in (0, 1)]
    return judge_statement(
        fallen[0] < 0.5 * fallen[1],
        f"largest: {'; '.join(texts)}. From the first to the last time w falls to {percent(fallen[0])}, "
        f"the linear one to {percent(fallen[1])}",
    )


def _largest(w: Array) -> float:
    return float(np.abs(w[:, 1]).max())


#: Components of M and Q, 0-based. The paper's network knows only H_22 and p, so that its "M_2211" can only be the
#: derivative of component 11 by H_22, M_1122; in the undeformed cubic cell both are the same.
TANGENTS = {"M_2222": (1, 1, 1, 1), "M_2211": (0, 0, 1, 1), "Q_22": (1, 1), "Q_11": (0, 0)}


def _tangents(results: Results, name: str) -> tuple[float, list[tuple[float, float]], str]:
    """Value at rest, bottom and top at each time, and in words."""
    column, at = results.column, TANGENTS[name]
    field = "mean_grad_grad_u" if len(at) == 4 else "mean_grad_p"

    def take(profile: Profile) -> Array:
        values: Array = getattr(column.tangent(profile), field)[:, *at]
        return values

    rest = float(getattr(results.linear, field)[at])
    found, text = _along(column, take, name)
    return rest, found, f"{text}; undeformed {number(rest, 3)}"


def _m2222(results: Results) -> Finding:
    rest, found, text = _tangents(results, "M_2222")
    return judge_statement(abs(found[-1][0] - rest) > abs(found[0][0] - rest), text)


def _m2211(results: Results) -> Finding:
    rest, found, text = _tangents(results, "M_2211")
    return judge_statement(
        found[0][0] < rest and found[0][1] > found[0][0] and found[-1][0] > found[0][0],
        text,
        "the sign of the change depends on the crease and contact of the cell, which the paper leaves out",
    )


def _q(name: str, claim: str) -> Claim:
    def check(results: Results) -> Finding:
        along = results.sensitivity.loads["pressure"]
        pressed = float(np.interp(0.2, along.values, along.quantities["Q_11"]))
        rest, found, _ = _tangents(results, name)
        by_H = found[-1][0]
        wanted = pressed > rest and (by_H < rest if name == "Q_22" else by_H > rest)
        return judge_statement(
            wanted,
            f"p = 0.2 alone: {number(pressed, 3)}; drained, H_22 alone: {number(by_H, 3)}; "
            f"undeformed {number(rest, 3)}",
            "past the crease (H_22 ≈ −0.2) contact of the wall changes the slopes; the paper leaves contact out",
        )

    return Claim("Figure 23", claim, check)


def _scenario(name: str, quantity: str, published: float, unit: float = 1.0) -> Finding:
    return compare_number(published, SCENARIOS[name].factor(quantity) * unit, 0.01)


CLAIMS = (
    Claim("Figure 16a", "K_22 increases during the consolidation", _k22),
    Claim(
        "Figure 16b",
        "K_11 increases at the bottom at short times, decreases towards the top and at long times",
        _k11,
    ),
    Claim("Figure 17", "pressure profiles close to linear at first, diverging later", _pressure_profiles),
    Claim("Figures 19, 21", "largest H_22 around −0.32; the other components negligible", _h22),
    Claim("Figure 20a", "⟨∇u¹⟩_22 is positive against the effect of the pressure", _mean_22),
    Claim("Figure 20b", "⟨∇u¹⟩_11 is negative at short times, positive later", _mean_11),
    Claim("Figure 20", "⟨∇u¹⟩_33 is similar to ⟨∇u¹⟩_11", _mean_33),
    Claim("Figure 21a", "F̄_22 is moderated: larger than 1 + H_22", _f22),
    Claim("Figure 21b", "F̄_11 is only due to ⟨∇u¹⟩_11", _f11),
    Claim(
        "Figure 22",
        "fluid velocities diverge considerably from linear, with a faster transition to the steady state",
        _velocity,
    ),
    Claim("Figure 23a", "the changes of M_2222 are dominated by the negative H_22", _m2222),
    Claim(
        "Figure 23b",
        "M_2211 decreases at first at the bottom and increases towards the top and at long times",
        _m2211,
    ),
    _q("Q_22", "pressure increases Q_22, H_22 decreases it"),
    _q("Q_11", "pressure and H_22 both increase Q_11"),
    Claim(
        "Dimensional variables",
        "brain tissue: P in 10³ Pa",
        lambda r: _scenario("brain-tissue", "pressure", 1e3),
    ),
    Claim(
        "Dimensional variables", "brain tissue: t in 250 s", lambda r: _scenario("brain-tissue", "time", 250)
    ),
    Claim(
        "Dimensional variables",
        "brain tissue: w in 4e-3 mm/s",
        lambda r: _scenario("brain-tissue", "velocity", 4e-3, 1e3),
    ),
    Claim("Dimensional variables", "soil: P in 1.5e6 Pa", lambda r: _scenario("soil", "pressure", 1.5e6)),
    Claim("Dimensional variables", "soil: t in 16.6 s", lambda r: _scenario("soil", "time", 16.6)),
    Claim("Dimensional variables", "soil: w in 6e-2 m/s", lambda r: _scenario("soil", "velocity", 6e-2)),
)
