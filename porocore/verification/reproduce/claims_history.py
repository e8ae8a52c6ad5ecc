"""Dehghani & Zilian 2022 on the column as a whole: settlement, pressure and drainage against time."""

from __future__ import annotations

import numpy as np

from porocore.interfaces.solution import MacroSolution
from porocore.macro.body.kinds import make_body
from porocore.report.figures.profiles import profile_at
from porocore.report.format import number, percent, plain
from porocore.verification.reproduce.claims import Claim, Finding, Verdict, judge_statement
from porocore.verification.reproduce.column import LARGE, SMALL, Column
from porocore.verification.reproduce.study import Results


def _others(column: Column, load: float, figure: str) -> str:
    """The same figure of merit with the other closures."""
    parts = [f"closure {m['law']}: {number(m[figure])}" for m in column.figures_of(load)["others"]]
    return f" ({', '.join(parts)})" if parts else ""


def _height(column: Column) -> float:
    return float(np.ptp(make_body(column.config.macro.body).points[:, 1]))


def _share_of_height(results: Results) -> Finding:
    column = results.column
    settled = column.figures_of(LARGE)["nonlinear"]["final_settlement"]
    share = settled / _height(column)
    return Finding(
        f"{percent(share, 0)} of the height, {number(settled)}{_others(column, LARGE, 'final_settlement')}",
        "partly" if 0.25 <= share <= 0.4 else "no",
        "with C_eff of the published M, linear poroelasticity gives 45 %, and the paper's 20 % less than that is 36 %; "
        "its figure of H_22, which is the same number in a confined column, says 32 %",
    )


def _twenty_percent(results: Results) -> Finding:
    ratio = results.column.figures_of(LARGE)["settlement_ratio"]
    others = [m["final_settlement"] for m in results.column.figures_of(LARGE)["others"]]
    linear = results.column.figures_of(LARGE)["linear"]["final_settlement"]
    more = "".join(f"; closure potential: {percent(1 - o / linear)}" for o in others)
    return judge_statement(0.15 <= 1 - ratio <= 0.25, f"{percent(1 - ratio)} smaller{more}")


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


def _small_strain(results: Results) -> Finding:
    settled = results.column.figures_of(SMALL)["nonlinear"]["final_settlement"] / _height(results.column)
    return judge_statement(0.015 <= settled <= 0.025, f"{percent(settled)} of the height")


def _small_settlement(results: Results) -> Finding:
    column = results.column.figures_of(SMALL)
    return judge_statement(
        abs(column["settlement_ratio"] - 1) < 0.03,
        f"{percent(1 - column['settlement_ratio'])} smaller than linear",
    )


def _small_sooner(results: Results) -> Finding:
    ratio = results.column.figures_of(SMALL)["time_to_95_percent_ratio"]
    return judge_statement(ratio < 1, f"95 % are reached {percent(1 - ratio)} earlier")


def _small_transient(results: Results) -> Finding:
    case = results.column.case(SMALL)
    nonlinear, linear = case.nonlinear.history, case.linear.history
    more = (nonlinear.settlement - linear.settlement) / linear.settlement[-1]
    ahead = nonlinear.settlement / nonlinear.settlement[-1] - linear.settlement / linear.settlement[-1]
    i = int(np.argmax(ahead))
    verdict: Verdict = "yes" if more.max() > 1e-4 else "partly" if ahead[i] > 1e-4 else "no"
    return Finding(
        f"by its own final value at most {percent(float(ahead[i]), 2)} ahead, at t = "
        f"{number(float(nonlinear.time[i]), 3)}; in absolute terms at most {percent(float(more.max()), 2)} ahead",
        verdict,
        ""
        if verdict == "yes"
        else "it settles sooner, but not so much that it would outweigh the smaller final value",
    )


def _pressure_sooner(results: Results) -> Finding:
    halves = [
        _time_below(s, 0.5) for s in (results.column.case(LARGE).nonlinear, results.column.case(LARGE).linear)
    ]
    tenths = [
        _time_below(s, 0.1) for s in (results.column.case(LARGE).nonlinear, results.column.case(LARGE).linear)
    ]
    return judge_statement(
        tenths[0] < tenths[1],
        f"below half of its largest value from t = {number(halves[0], 3)} (linear {number(halves[1], 3)}), "
        f"below a tenth from {number(tenths[0], 3)} ({number(tenths[1], 3)})",
    )


def _time_below(solution: MacroSolution, share: float) -> float:
    """Return the time when the largest pressure has fallen to a share of its peak, linear between the steps."""
    history = solution.history
    peak = int(np.argmax(history.pressure_max))
    falling = history.pressure_max[peak:] / history.pressure_max[peak]
    return float(np.interp(-share, -falling, history.time[peak:]))


def _drained_less(results: Results) -> Finding:
    figures = results.column.figures_of(LARGE)
    nonlinear, linear = figures["nonlinear"], figures["linear"]
    return judge_statement(
        figures["drained_ratio"] < 0.95,
        f"{percent(1 - figures['drained_ratio'])} less by the paper's integral, "
        f"{percent(1 - nonlinear['drained_flux'] / linear['drained_flux'])} less through the boundary",
    )


def _drained_sooner(results: Results) -> Finding:
    case = results.column.case(LARGE)
    at_10 = [
        float(np.interp(10, s.history.time, s.history.drained) / s.history.drained[-1])
        for s in (case.nonlinear, case.linear)
    ]
    return judge_statement(
        at_10[0] > at_10[1],
        f"at t = 10 {percent(at_10[0], 0)} of the final volume, linear {percent(at_10[1], 0)}",
    )


def _closer_when_small(results: Results) -> Finding:
    texts, gaps = [], []
    for name in ("pressure_max", "drained"):
        found = []
        for load in (LARGE, SMALL):
            case = results.column.case(load)
            one, other = getattr(case.nonlinear.history, name), getattr(case.linear.history, name)
            found.append(float(np.abs(one - other).max() / np.abs(other).max()))
        gaps.append(found[1] < found[0])
        word = "pressure" if name == "pressure_max" else "drained volume"
        texts.append(
            f"{word}: largest gap {percent(found[0], 0)} under −0.2, {percent(found[1])} under −0.01"
        )
    return judge_statement(all(gaps), "; ".join(texts))


def _fluid_more_sensitive(results: Results) -> Finding:
    case = results.column.case(SMALL)
    nonlinear, linear = case.nonlinear.history, case.linear.history
    i = int(np.argmin(np.abs(nonlinear.settlement - 0.1)))
    settlement = abs(float(nonlinear.settlement[i] - linear.settlement[i])) / float(linear.settlement[-1])
    pressure = abs(float(nonlinear.pressure_max[i] - linear.pressure_max[i])) / float(
        linear.pressure_max.max()
    )
    return judge_statement(
        pressure > settlement,
        f"where the settlement is 0.1 (t = {number(float(nonlinear.time[i]), 3)}) it is {percent(settlement, 2)} "
        f"of its final value away from linear, the pressure {percent(pressure, 2)} of its largest",
        "the paper's 'time 1.7e5' is in no unit of its own",
    )


def _end_points(results: Results) -> Finding:
    places = []
    for time in results.column.times:
        solution = results.column.case(LARGE).nonlinear
        profile = profile_at(solution, time)
        places.append(
            (solution.points[np.argmax(-profile.u[:, 1]), 1], solution.points[np.argmax(profile.p), 1])
        )
    top = _height(results.column)
    return judge_statement(
        all(u == top and p == 0 for u, p in places),
        f"largest settlement at X_2 = {plain(float(places[-1][0]))}, largest pressure at "
        f"{plain(float(places[-1][1]))}, at all kept times",
    )


def _pressure_gone(results: Results) -> Finding:
    final = results.column.figures_of(LARGE)["nonlinear"]["final_pressure"]
    return judge_statement(final < 1e-3, f"largest p at the end: {number(final, 1)}")


def _discretisation(results: Results) -> Finding:
    macro = results.config.macro
    elements = len(make_body(macro.body).cells)
    return judge_statement(
        elements == 106 and macro.time.ramp_increments == 10,
        f"{elements} elements; {macro.time.ramp_increments} increments of {plain(macro.time.ramp_step)}, then of "
        f"{plain(macro.time.step)}",
    )


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


CLAIMS = (
    Claim(
        "Numerical example",
        "106 elements; the load in 10 increments of a tenth of the usual time",
        _discretisation,
    ),
    Claim("Figures 13, 14", "sheer increase of settlement and pressure at the beginning", _jump),
    Claim("Figure 13a", "P = −0.2: the settlement is around 30 % of the initial length", _share_of_height),
    Claim(
        "Figures 13a, 18a",
        "P = −0.2: the final settlement is around 20 % smaller than the linear one",
        _twenty_percent,
    ),
    Claim("Figures 13a, 18a", "P = −0.2: steady at t = 38, considerably sooner than linear", _steady),
    Claim("Figure 13b", "P = −0.01: strain around 2 %", _small_strain),
    Claim("Figures 13b, 18b", "P = −0.01: final settlements almost equal", _small_settlement),
    Claim("Figure 13b", "P = −0.01: the final settlement is reached slightly earlier", _small_sooner),
    Claim("Figure 18b", "P = −0.01: slightly more settlement than linear in between", _small_transient),
    Claim("Figures 13, 14", "largest settlement at the top, largest pressure at the bottom", _end_points),
    Claim("Figure 14a", "P = −0.2: the pressure vanishes faster than linear", _pressure_sooner),
    Claim(
        "Figures 14b, 15b",
        "P = −0.01: pressure and drained volume closer to linear than under −0.2",
        _closer_when_small,
    ),
    Claim("Figure 15a", "P = −0.2: drainage is faster", _drained_sooner),
    Claim("Figure 15a", "P = −0.2: the final drained volume is considerably less than linear", _drained_less),
    Claim(
        "Numerical example",
        "pressure and drainage deviate from linear at smaller settlements (around 0.1) than the settlement does",
        _fluid_more_sensitive,
    ),
    Claim("Figure 17", "at the steady state the pressure is zero everywhere", _pressure_gone),
)
