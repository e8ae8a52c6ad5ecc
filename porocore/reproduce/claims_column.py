"""Dehghani & Zilian 2022 on the consolidation of the column."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from porocore.report.dimensional import fluid_velocity
from porocore.report.figures.profiles import Line, profile_at
from porocore.report.format import number, percent, plain
from porocore.reproduce.claims import Claim, Finding, compared, judged
from porocore.reproduce.column import LARGE, SMALL, Column
from porocore.reproduce.study import Results
from porocore.scales import SCENARIOS
from porocore.solution import MacroSolution, Profile
from porocore.states import Array

#: A field of element means.
Take: TypeAlias = Callable[[Profile], Array]


def _others(column: Column, load: float, figure: str) -> str:
    """The same figure of merit with the other closures."""
    parts = [f"closure {m['law']}: {number(m[figure])}" for m in column.figures_of(load)["others"]]
    return f" ({', '.join(parts)})" if parts else ""


def _height(column: Column) -> float:
    return column.config.macro.size[1]


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
    return judged(0.15 <= 1 - ratio <= 0.25, f"{percent(1 - ratio)} smaller{more}")


def _steady(results: Results) -> Finding:
    found, linear = (results.column.figures_of(LARGE)[law] for law in ("nonlinear", "linear"))
    early, late = found["time_to_95_percent"], found["time_to_99_percent"]
    history = results.column.case(LARGE).nonlinear.history
    then = float(np.interp(38, history.time, history.settlement)) / found["final_settlement"]
    return judged(
        early <= 38 <= late * 1.1 and linear["time_to_95_percent"] > late,
        f"95 % at {number(early, 3)}, 99 % at {number(late, 3)}; at t = 38 {percent(then)} of the final settlement; "
        f"linear: 95 % at {number(linear['time_to_95_percent'], 3)}, 99 % at {number(linear['time_to_99_percent'], 3)}",
        "the paper states no criterion of the steady state",
    )


def _small_strain(results: Results) -> Finding:
    settled = results.column.figures_of(SMALL)["nonlinear"]["final_settlement"] / _height(results.column)
    return judged(0.015 <= settled <= 0.025, f"{percent(settled)} of the height")


def _small_settlement(results: Results) -> Finding:
    column = results.column.figures_of(SMALL)
    return judged(
        abs(column["settlement_ratio"] - 1) < 0.03,
        f"{percent(1 - column['settlement_ratio'])} smaller than linear",
    )


def _small_sooner(results: Results) -> Finding:
    ratio = results.column.figures_of(SMALL)["time_to_95_percent_ratio"]
    return judged(ratio < 1, f"95 % are reached {percent(1 - ratio)} earlier")


def _small_transient(results: Results) -> Finding:
    case = results.column.case(SMALL)
    nonlinear, linear = case.nonlinear.history, case.linear.history
    gap = (nonlinear.settlement - linear.settlement) / linear.settlement[-1]
    i = int(np.argmax(gap))
    return judged(
        bool(gap[i] > 0),
        f"at most {percent(float(gap[i]), 2)} of the final settlement more, "
        f"at t = {number(float(nonlinear.time[i]), 3)}; "
        f"less from t = {number(_last_positive(nonlinear.time, gap), 3)} on",
        "the settlement is smaller at all times",
    )


def _last_positive(time: Array, gap: Array) -> float:
    positive = np.flatnonzero(gap > 0)
    return float(time[positive[-1]]) if len(positive) else 0.0


def _pressure_sooner(results: Results) -> Finding:
    halves = [
        _time_below(s, 0.5) for s in (results.column.case(LARGE).nonlinear, results.column.case(LARGE).linear)
    ]
    tenths = [
        _time_below(s, 0.1) for s in (results.column.case(LARGE).nonlinear, results.column.case(LARGE).linear)
    ]
    return judged(
        tenths[0] < tenths[1],
        f"below half of its largest value from t = {number(halves[0], 3)} (linear {number(halves[1], 3)}), "
        f"below a tenth from {number(tenths[0], 3)} ({number(tenths[1], 3)})",
    )


def _time_below(solution: MacroSolution, share: float) -> float:
    """When the largest pressure has fallen to a share of its peak, linear between the steps."""
    history = solution.history
    peak = int(np.argmax(history.pressure_max))
    falling = history.pressure_max[peak:] / history.pressure_max[peak]
    return float(np.interp(-share, -falling, history.time[peak:]))


def _drained_less(results: Results) -> Finding:
    figures = results.column.figures_of(LARGE)
    nonlinear, linear = figures["nonlinear"], figures["linear"]
    return judged(
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
    return judged(
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
    return judged(all(gaps), "; ".join(texts))


def _fluid_more_sensitive(results: Results) -> Finding:
    case = results.column.case(SMALL)
    nonlinear, linear = case.nonlinear.history, case.linear.history
    i = int(np.argmin(np.abs(nonlinear.settlement - 0.1)))
    settlement = abs(float(nonlinear.settlement[i] - linear.settlement[i])) / float(linear.settlement[-1])
    pressure = abs(float(nonlinear.pressure_max[i] - linear.pressure_max[i])) / float(
        linear.pressure_max.max()
    )
    return judged(
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
    return judged(
        all(u == top and p == 0 for u, p in places),
        f"largest settlement at X_2 = {plain(float(places[-1][0]))}, largest pressure at "
        f"{plain(float(places[-1][1]))}, at all kept times",
    )


def _pressure_gone(results: Results) -> Finding:
    final = results.column.figures_of(LARGE)["nonlinear"]["final_pressure"]
    return judged(final < 1e-3, f"largest p at the end: {number(final, 1)}")


def _pressure_profiles(results: Results) -> Finding:
    case = results.column.case(LARGE)
    gaps = []
    for time in results.column.times:
        one, other = profile_at(case.nonlinear, time).p, profile_at(case.linear, time).p
        gaps.append(float(np.abs(one - other).max() / np.abs(other).max()))
    return judged(
        gaps[0] < gaps[-1],
        "largest gap by the largest linear pressure of the time: "
        + ", ".join(
            f"{percent(g, 0)} at t = {plain(t)}" for g, t in zip(gaps, results.column.times, strict=True)
        ),
    )


def _ends(column: Column, take: Take, time: float) -> tuple[float, float]:
    """A field of element means in the lowest and in the highest element."""
    solution = column.case(LARGE).nonlinear
    profile, line = profile_at(solution, time), Line.of(solution)
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
    return judged(rising and found[-1][0] > rest, f"{text}; undeformed {number(rest, 3)}")


def _k11(results: Results) -> Finding:
    rest = float(results.reference.conductivity[0, 0])
    found, text = _along(results.column, lambda f: f.conductivity[:, 0, 0], "K_t,11")
    return judged(
        found[0][0] > rest and found[0][1] < found[0][0] and found[-1][0] < rest,
        f"{text}; undeformed {number(rest, 3)}",
    )


def _h22(results: Results) -> Finding:
    solution = results.column.case(LARGE).nonlinear
    end = solution.profiles[-1]
    others = np.abs(end.grad_u).max(axis=0)
    others[1, 1] = 0
    least = float(end.grad_u[:, 1, 1].min())
    return compared(
        -0.32,
        least,
        0.05,
        "as with the settlement: the published M, Q and the law give this value, see the row on 30 % of the height",
        f"; every other component is below {number(max(float(others.max()), 1e-16), 1)}",
    )


def _mean_22(results: Results) -> Finding:
    found, text = _along(results.column, lambda f: f.mean_grad[:, 1, 1], "⟨∇u¹⟩_22")
    return judged(all(top > 0 for _, top in found) and found[-1][0] > 0, text)


def _mean_11(results: Results) -> Finding:
    found, text = _along(results.column, lambda f: f.mean_grad[:, 0, 0], "⟨∇u¹⟩_11")
    return judged(found[0][0] < 0 < found[-1][0], text)


def _mean_33(results: Results) -> Finding:
    profile = results.column.case(LARGE).nonlinear.profiles[-1]
    gap = float(np.abs(profile.mean_grad[:, 2, 2] - profile.mean_grad[:, 0, 0]).max())
    share = gap / float(np.abs(profile.mean_grad[:, 0, 0]).max())
    return judged(share < 0.02, f"they differ by at most {percent(share, 2)} at the end")


def _f22(results: Results) -> Finding:
    profile = results.column.case(LARGE).nonlinear.profiles[-1]
    bar, simple = float(profile.deformation[:, 1, 1].mean()), float(1 + profile.grad_u[:, 1, 1].mean())
    return judged(
        bar > simple,
        f"F̄_22 = {number(bar, 3)} at the end where 1 + H_22 = {number(simple, 3)}",
    )


def _f11(results: Results) -> Finding:
    found, text = _along(results.column, lambda f: f.deformation[:, 0, 0], "F̄_11")
    H = max(float(np.abs(p.grad_u[:, 0, 0]).max()) for p in results.column.case(LARGE).nonlinear.profiles)
    return judged(
        H < 1e-9 and abs(found[-1][0] - 1) > 1e-3, f"{text}; largest H_11: {number(max(H, 1e-16), 1)}"
    )


def _velocity(results: Results) -> Finding:
    case = results.column.case(LARGE)
    found = []
    for time in results.column.times:
        here, there = profile_at(case.nonlinear, time), profile_at(case.linear, time)
        found.append((_largest(fluid_velocity(here)), _largest(there.flux), _largest(here.flux)))
    texts = [
        f"t = {plain(t)}: w {number(w, 3)}, Ḡw {number(tr, 3)}, linear {number(lin, 3)}"
        for (w, lin, tr), t in zip(found, results.column.times, strict=True)
    ]
    return judged(
        found[0][0] > found[0][1] and found[-1][0] < found[-1][1],
        "largest: " + "; ".join(texts),
    )


def _largest(w: Array) -> float:
    return float(np.abs(w[:, 1]).max())


def _tangents(results: Results, name: str) -> tuple[float, list[tuple[float, float]], str]:
    column = results.column

    def take(profile: Profile) -> Array:
        tangent = column.tangent(profile)
        assert tangent.mean_grad_grad_u is not None
        assert tangent.mean_grad_p is not None
        M, Q = tangent.mean_grad_grad_u, tangent.mean_grad_p
        fields = {
            "M_2222": M[:, 1, 1, 1, 1],
            "M_2211": M[:, 1, 1, 0, 0],
            "Q_22": Q[:, 1, 1],
            "Q_11": Q[:, 0, 0],
        }
        return fields[name]

    M, Q = results.linear.mean_grad_grad_u, results.linear.mean_grad_p
    rest = {"M_2222": M[1, 1, 1, 1], "M_2211": M[1, 1, 0, 0], "Q_22": Q[1, 1], "Q_11": Q[0, 0]}[name]
    found, text = _along(column, take, name)
    return float(rest), found, f"{text}; undeformed {number(float(rest), 3)}"


def _m2222(results: Results) -> Finding:
    rest, found, text = _tangents(results, "M_2222")
    return judged(abs(found[-1][0] - rest) > abs(found[0][0] - rest), text)


def _m2211(results: Results) -> Finding:
    rest, found, text = _tangents(results, "M_2211")
    return judged(
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
        return judged(
            wanted,
            f"p = 0.2 alone: {number(pressed, 3)}; drained, H_22 alone: {number(by_H, 3)}; "
            f"undeformed {number(rest, 3)}",
            "past the crease (H_22 ≈ −0.2) contact of the wall changes the slopes; the paper leaves contact out",
        )

    return Claim("Figure 23", claim, check)


def _scenario(name: str, quantity: str, published: float, unit: float = 1.0) -> Finding:
    return compared(published, SCENARIOS[name].factor(quantity) * unit, 0.01)


CLAIMS = (
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
    Claim("Figure 16a", "K_22 increases during the consolidation", _k22),
    Claim(
        "Figure 16b",
        "K_11 increases at the bottom at short times, decreases towards the top and at long times",
        _k11,
    ),
    Claim("Figure 17", "pressure profiles close to linear at first, diverging later", _pressure_profiles),
    Claim("Figure 17", "at the steady state the pressure is zero everywhere", _pressure_gone),
    Claim("Figures 19, 21", "largest H_22 around −0.32; the other components negligible", _h22),
    Claim("Figure 20a", "⟨∇u¹⟩_22 is positive against the effect of the pressure", _mean_22),
    Claim("Figure 20b", "⟨∇u¹⟩_11 is negative at short times, positive later", _mean_11),
    Claim("Figure 20", "⟨∇u¹⟩_33 is similar to ⟨∇u¹⟩_11", _mean_33),
    Claim("Figure 21a", "F̄_22 is moderated: larger than 1 + H_22", _f22),
    Claim("Figure 21b", "F̄_11 is only due to ⟨∇u¹⟩_11", _f11),
    Claim(
        "Figure 22",
        "fluid velocities differ considerably from linear: faster drainage at first, then an earlier end",
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
