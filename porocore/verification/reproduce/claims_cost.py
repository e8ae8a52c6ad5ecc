"""Dehghani & Zilian 2022 on sampling, network and computational cost."""

from __future__ import annotations

import numpy as np

from porocore.macro.body.kinds import make_body
from porocore.report.format import duration, number, plain
from porocore.verification.reproduce.claims import Claim, Finding
from porocore.verification.reproduce.column import LARGE, Column
from porocore.verification.reproduce.study import Results

#: Of the element of the macro problem; every Newton iteration asks for all.
POINTS_OF_ELEMENT = 27


def _points(column: Column) -> int:
    return POINTS_OF_ELEMENT * len(make_body(column.config.macro.body).cells)


def _iterations(column: Column) -> float:
    nonlinear = column.figures_of(LARGE)["nonlinear"]
    return float(nonlinear["newton_iterations"] / nonlinear["steps"])


def _seconds_of_step(column: Column) -> float:
    steps = column.figures_of(LARGE)["nonlinear"]["steps"]
    return column.timings[f"macro, {column.config.closure}, load {LARGE:g}"] / float(steps)


def _network(results: Results) -> Finding:
    settings = getattr(results.column.surrogate, "settings", {})
    hidden, activation = settings.get("hidden"), settings.get("activation")
    same = hidden == [40, 40, 40] and activation == "sigmoid"
    text = f"hidden layers {hidden}, {activation}" if hidden else results.column.context.surrogate.description
    return Finding(text + ", anchored at the undeformed cell", "yes" if same else "–")


def _ranges(results: Results) -> Finding:
    swept = results.config.sampling.inputs
    parts = [
        f"{plain(s.range[0])} … {plain(s.range[1])} for {name}" + (f" by {plain(s.step)}" if s.step else "")
        for name, s in swept.items()
    ]
    return Finding(
        "; ".join(parts),
        "–",
        "these are the states that the column visits; p = −1 has no equilibrium with this cell "
        "(homogeneous hydrostatic tension of the solid peaks at 0.45 E)",
    )


def _states(results: Results) -> Finding:
    column = results.column
    return Finding(f"{len(column.dataset)} (and {len(column.held_out)} held out)", "–")


def _one_solve(results: Results) -> Finding:
    seconds = float(np.mean(results.column.dataset.seconds()))
    return Finding(f"{duration(seconds)}, with the ten derivatives", "–")


def _all_solves(results: Results) -> Finding:
    seconds = float(np.sum(results.column.dataset.seconds()))
    wall = results.column.timings["sampling"]
    return Finding(f"{duration(seconds)} of solves in {duration(wall)}", "–")


def _training(results: Results) -> Finding:
    return Finding(duration(results.column.timings["training"]), "–")


def _accuracy(results: Results) -> Finding:
    rms = results.column.metrics["surrogate"]["rms_error_percent_of_range"]
    worst = results.column.metrics["surrogate"]["largest_error_percent_of_range"]
    count = results.column.metrics["surrogate"]["test_states"]
    return Finding(
        f"on {count} states that it never saw: RMS {number(min(rms.values()), 2)} to {number(max(rms.values()), 2)} %, "
        f"at most {number(max(worst.values()), 2)} % of each component's range",
        "yes" if max(worst.values()) < 2 else "no",
    )


def _call(results: Results) -> Finding:
    calls = results.calls
    return Finding(
        f"{duration(calls.seconds)} for {calls.points:,} states at once, with all derivatives: "
        f"{number(1e6 * calls.seconds / calls.points, 2)} µs a state",
        "–",
    )


def _increment(results: Results) -> Finding:
    column = results.column
    asked = _points(column) * _iterations(column)
    return Finding(
        f"{asked:,.0f} states an increment ({_points(column):,} points, {number(_iterations(column), 2)} Newton "
        f"iterations); {duration(_seconds_of_step(column))} an increment, everything included",
        "–",
    )


def _without(results: Results) -> Finding:
    column = results.column
    seconds = _points(column) * _iterations(column) * float(np.mean(column.dataset.seconds()))
    return Finding(
        f"{duration(seconds)} if every point solved a cell of its own",
        "–",
        "points of one state share a cell in direct FE² (porocore solve --law direct), 9 here",
    )


def _steps(results: Results) -> Finding:
    return Finding(f"{results.column.figures_of(LARGE)['nonlinear']['steps']} steps", "–")


CLAIMS = (
    Claim(
        "Data-driven approach",
        "three hidden layers of 40 neurons, sigmoid, Adam, mean squared error",
        _network,
    ),
    Claim(
        "Data-driven approach",
        "−0.4 ≤ H_22 ≤ 0.4 by 0.03 and −1 ≤ p ≤ 1 by 0.1, refined by the density check",
        _ranges,
    ),
    Claim("Data-driven approach", "1,189 solid problems solved", _states),
    Claim("Cell tests", "20.5 s a solid problem: 6.5 s solving, 14 s averaging", _one_solve),
    Claim("Data-driven approach", "406 min for all of them", _all_solves),
    Claim("Data-driven approach", "training about 10 min", _training),
    Claim("Figure 11", "the trained network predicts what the cell problem gives", _accuracy),
    Claim("Data-driven approach", "0.2 ms a call of the network", _call),
    Claim("Data-driven approach", "2,250 calls and about 0.45 s an increment", _increment),
    Claim("Data-driven approach", "nearly 13 hours an increment without the network", _without),
    Claim("Data-driven approach", "a steady state may need 200 increments", _steps),
)
