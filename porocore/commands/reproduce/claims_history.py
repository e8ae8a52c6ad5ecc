"""Claims of Dehghani & Zilian 2022 on histories: settlement, pressure, drainage."""

from __future__ import annotations

import numpy as np

from porocore.commands.reproduce.claims import Claims, Finding, judge_statement
from porocore.commands.reproduce.study import LARGE, SMALL, Column, Results
from porocore.interfaces.solution import MacroSolution
from porocore.macro.body.kinds import make_body
from porocore.report.figures.curves import profile_at
from porocore.report.format import number, percent, plain

CLAIMS = Claims()


@CLAIMS.claim("Numerical example", "106 elements; the load in 10 increments of a tenth of the usual time")
def _discretisation(results: Results) -> Finding:
    macro = results.config.macro
    elements = len(make_body(macro.body).cells)
    return judge_statement(
        elements == 106 and macro.time.ramp_increments == 10,
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
    return float(np.ptp(make_body(column.config.macro.body).points[:, 1]))


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


@CLAIMS.claim("Figure 13b", "P = −0.01: the final settlement is reached slightly earlier")
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
    "pressure and drainage deviate from linear at smaller settlements (around 0.1) than the settlement does",
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
