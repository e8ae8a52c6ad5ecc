"""Claims of Dehghani & Zilian 2022 on the column: histories, profiles, tangents, dimensional scales."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np

from porocore.commands.reproduce.claims import Claim, Claims, Finding, compare_number, judge_statement
from porocore.commands.reproduce.figures import paper_velocity
from porocore.commands.reproduce.study import LARGE, SMALL, Column, Results
from porocore.core.units import SCENARIOS
from porocore.interfaces.solution import MacroSolution, Profile
from porocore.macro.body.kinds import make_body
from porocore.report.figures.curves import ColumnAxis, profile_at
from porocore.report.format import number, percent, plain
from porocore.states import Array

CLAIMS = Claims()


@CLAIMS.claim("Numerical example", "106 elements; the load in 10 increments of a tenth of the usual time")
def _discretisation(results: Results) -> Finding:
    macro = results.config.macro
    elements = len(make_body(macro.body).cells)
    tenth = bool(np.isclose(macro.time.ramp_step, macro.time.step / 10))
    return judge_statement(
        elements == 106 and macro.time.ramp_increments == 10 and tenth,
        f"{elements} elements; {macro.time.ramp_increments} increments of {plain(macro.time.ramp_step)}, then of "
        f"{plain(macro.time.step)}",
    )


@CLAIMS.claim("Figures 13, 14", "sheer increase of settlement and pressure at the beginning")
def _jump(results: Results) -> Finding:
    history = results.column.case(LARGE).nonlinear.history
    ramped = int(np.flatnonzero(history.ramp >= 1 - 1e-9)[0])
    share = float(history.settlement[ramped] / history.settlement[-1])
    pressure = float(history.pressure_max[ramped] / history.pressure_max.max())
    return judge_statement(
        share > 0.2 and pressure > 0.9,
        f"at t = {plain(float(history.time[ramped]))} {percent(share, 0)} of the final settlement and "
        f"{percent(pressure, 0)} of the largest pressure are there",
    )


def _height(column: Column) -> float:
    return float(np.ptp(make_body(column.results.config.macro.body).points[:, 1]))


@CLAIMS.claim("Figure 13a", "P = −0.2: the settlement is around 30 % of the initial length")
def _share_of_height(results: Results) -> Finding:
    figures = results.column.figures_of(LARGE)
    settled = figures["nonlinear"]["final_settlement"]
    share = settled / _height(results.column)
    others = ", ".join(f"closure {m['law']}: {number(m['final_settlement'])}" for m in figures["others"])
    return Finding(
        f"{percent(share, 0)} of the height, {number(settled)}" + (f" ({others})" if others else ""),
        "partly" if 0.25 <= share <= 0.4 else "no",
        "with C_eff of the published M, linear poroelasticity gives 45 %, and the paper's 20 % less than that is 36 %; "
        "its figure of H_22, which is the same number in a confined column, says 32 %",
    )


@CLAIMS.claim("Figures 13a, 18a", "P = −0.2: the final settlement is around 20 % smaller than the linear one")
def _twenty_percent(results: Results) -> Finding:
    figures = results.column.figures_of(LARGE)
    ratio, linear = figures["settlement_ratio"], figures["linear"]["final_settlement"]
    others = [percent(1 - other["final_settlement"] / linear) for other in figures["others"]]
    more = "".join(f"; closure potential: {other}" for other in others)
    return judge_statement(0.15 <= 1 - ratio <= 0.25, f"{percent(1 - ratio)} smaller{more}")


@CLAIMS.claim("Figures 13a, 18a", "P = −0.2: steady at t = 38, considerably sooner than linear")
def _steady(results: Results) -> Finding:
    found, linear = (results.column.figures_of(LARGE)[law] for law in ("nonlinear", "linear"))
    early, late = found["time_to_95_percent"], found["time_to_99_percent"]
    history = results.column.case(LARGE).nonlinear.history
    then = float(np.interp(38, history.time, history.settlement)) / found["final_settlement"]
    return judge_statement(
        early <= 38 <= late * 1.1 and linear["time_to_95_percent"] > late,
        f"95 % at {number(early, 3)}, 99 % at {number(late, 3)}; at t = 38 {percent(then)} of the final settlement; "
        f"linear: 95 % at {number(linear['time_to_95_percent'], 3)}, 99 % at {number(linear['time_to_99_percent'], 3)}",
        "the paper states no criterion of the steady state",
    )


@CLAIMS.claim("Figure 13b", "P = −0.01: strain around 2 %")
def _small_strain(results: Results) -> Finding:
    settled = results.column.figures_of(SMALL)["nonlinear"]["final_settlement"] / _height(results.column)
    return judge_statement(0.015 <= settled <= 0.025, f"{percent(settled)} of the height")


@CLAIMS.claim("Figures 13b, 18b", "P = −0.01: final settlements almost equal")
def _small_settlement(results: Results) -> Finding:
    ratio = results.column.figures_of(SMALL)["settlement_ratio"]
    return judge_statement(abs(ratio - 1) < 0.03, f"{percent(1 - ratio)} smaller than linear")


@CLAIMS.claim("Figure 13b", "P = −0.01: the final settlement is reached earlier")
def _small_sooner(results: Results) -> Finding:
    ratio = results.column.figures_of(SMALL)["time_to_95_percent_ratio"]
    return judge_statement(ratio < 1, f"95 % are reached {percent(1 - ratio)} earlier")


@CLAIMS.claim("Figure 18b", "P = −0.01: slightly more settlement than linear in between")
def _small_transient(results: Results) -> Finding:
    case = results.column.case(SMALL)
    nonlinear, linear = (solution.history for solution in case.both)
    more = (nonlinear.settlement - linear.settlement) / linear.settlement[-1]
    ahead = nonlinear.settlement / nonlinear.settlement[-1] - linear.settlement / linear.settlement[-1]
    i = int(np.argmax(ahead))
    return judge_statement(
        "yes" if more.max() > 1e-4 else "partly" if ahead[i] > 1e-4 else "no",
        f"by its own final value at most {percent(float(ahead[i]), 2)} ahead, at t = "
        f"{number(float(nonlinear.time[i]), 3)}; in absolute terms at most {percent(float(more.max()), 2)} ahead",
        "it settles sooner, but not so much that it would outweigh the smaller final value",
    )


@CLAIMS.claim("Figures 13, 14", "largest settlement at the top, largest pressure at the bottom")
def _end_points(results: Results) -> Finding:
    solution, places = results.column.case(LARGE).nonlinear, []
    for time in results.column.times:
        profile = profile_at(solution, time)
        at = np.argmax(-profile.u[:, 1]), np.argmax(profile.p)
        places.append((solution.points[at[0], 1], solution.points[at[1], 1]))
    top = _height(results.column)
    return judge_statement(
        all(u == top and p == 0 for u, p in places),
        f"largest settlement at X_2 = {plain(float(places[-1][0]))}, largest pressure at "
        f"{plain(float(places[-1][1]))}, at all kept times",
    )


def _time_below(solution: MacroSolution, share: float) -> float:
    """Return the time when the largest pressure has fallen to a share of its peak, linear between the steps."""
    history = solution.history
    peak = int(np.argmax(history.pressure_max))
    falling = history.pressure_max[peak:] / history.pressure_max[peak]
    return float(np.interp(-share, -falling, history.time[peak:]))


@CLAIMS.claim("Figure 14a", "P = −0.2: the pressure vanishes faster than linear")
def _pressure_sooner(results: Results) -> Finding:
    case = results.column.case(LARGE)
    halves, tenths = ([_time_below(s, share) for s in case.both] for share in (0.5, 0.1))
    return judge_statement(
        tenths[0] < tenths[1],
        f"below half of its largest value from t = {number(halves[0], 3)} (linear {number(halves[1], 3)}), "
        f"below a tenth from {number(tenths[0], 3)} ({number(tenths[1], 3)})",
    )


@CLAIMS.claim("Figures 14b, 15b", "P = −0.01: pressure and drained volume closer to linear than under −0.2")
def _closer_when_small(results: Results) -> Finding:
    texts, closer = [], []
    for name, word in (("pressure_max", "pressure"), ("drained_paper", "drained volume")):
        gaps = []
        for case in (results.column.case(LARGE), results.column.case(SMALL)):
            one, other = (getattr(solution.history, name) for solution in case.both)
            gaps.append(float(np.abs(one - other).max() / np.abs(other).max()))
        closer.append(gaps[1] < gaps[0])
        texts.append(f"{word}: largest gap {percent(gaps[0], 0)} under −0.2, {percent(gaps[1])} under −0.01")
    return judge_statement(all(closer), "; ".join(texts))


@CLAIMS.claim("Figure 15a", "P = −0.2: drainage is faster")
def _drained_sooner(results: Results) -> Finding:
    case = results.column.case(LARGE)
    nonlinear, linear = (
        float(np.interp(10, s.history.time, s.history.drained_paper) / s.history.drained_paper[-1])
        for s in case.both
    )
    return judge_statement(
        nonlinear > linear,
        f"at t = 10 {percent(nonlinear, 0)} of the final volume, linear {percent(linear, 0)}",
    )


@CLAIMS.claim("Figure 15a", "P = −0.2: the final drained volume is considerably less than linear")
def _drained_less(results: Results) -> Finding:
    figures = results.column.figures_of(LARGE)
    nonlinear, linear = figures["nonlinear"], figures["linear"]
    return judge_statement(
        figures["drained_paper_ratio"] < 0.95,
        f"{percent(1 - figures['drained_paper_ratio'])} less by the paper's integral, "
        f"{percent(1 - nonlinear['drained'] / linear['drained'])} less through the boundary",
    )


@CLAIMS.claim(
    "Numerical example",
    "the pressure deviates from linear at smaller settlements (around 0.1) than the settlement does",
)
def _fluid_more_sensitive(results: Results) -> Finding:
    case = results.column.case(SMALL)
    nonlinear, linear = (solution.history for solution in case.both)
    i = int(np.argmin(np.abs(nonlinear.settlement - 0.1)))
    settlement, pressure = (
        abs(float(one[i] - other[i])) / float(scale)
        for one, other, scale in (
            (nonlinear.settlement, linear.settlement, linear.settlement[-1]),
            (nonlinear.pressure_max, linear.pressure_max, linear.pressure_max.max()),
        )
    )
    return judge_statement(
        pressure > settlement,
        f"where the settlement is 0.1 (t = {number(float(nonlinear.time[i]), 3)}) it is {percent(settlement, 2)} "
        f"of its final value away from linear, the pressure {percent(pressure, 2)} of its largest",
        "the paper's 'time 1.7e5' is in no unit of its own",
    )


@CLAIMS.claim("Figure 17", "at the steady state the pressure is zero everywhere")
def _pressure_gone(results: Results) -> Finding:
    final = results.column.figures_of(LARGE)["nonlinear"]["final_pressure"]
    return judge_statement(final < 1e-3, f"largest p at the end: {number(final, 1)}")


#: A field of element means.
Take: TypeAlias = Callable[[Profile], Array]


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
        gaps[0] < 0.1 < gaps[-1],
        "largest gap by the largest linear pressure of the time: " + ", ".join(texts),
    )


@CLAIMS.claim("Figures 19, 21", "largest H_22 around −0.32; the other components negligible")
def _h22(results: Results) -> Finding:
    end = results.column.case(LARGE).nonlinear.profiles[-1]
    others = np.abs(end.grad_u).max(axis=0)
    others[1, 1] = 0
    least = float(end.grad_u[:, 1, 1].min())
    found = compare_number(
        -0.32,
        least,
        0.05,
        "the same as with the settlement of 30 % of the height, see there",
        f"; every other component is below {number(max(float(others.max()), 1e-16), 1)}",
    )
    return found if others.max() < 1e-6 else replace(found, verdict="no")


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
    apart = max(abs(w / linear - 1) for w, linear in found)
    return judge_statement(
        apart > 0.2 and fallen[0] < 0.5 * fallen[1],
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
