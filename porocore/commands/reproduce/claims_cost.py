"""Claims of Dehghani & Zilian 2022 on sampling, network and computational cost."""

from __future__ import annotations

import numpy as np

from porocore.commands.reproduce.claims import Claims, Finding
from porocore.commands.reproduce.study import LARGE, POINTS, Column, Results
from porocore.macro.body.kinds import make_body
from porocore.report.format import duration, number, plain

#: Of the element of the macro problem; every Newton iteration asks for all.
POINTS_OF_ELEMENT = 27
APPROACH = "Data-driven approach"
CLAIMS = Claims()


@CLAIMS.claim(APPROACH, "three hidden layers of 40 neurons, sigmoid, Adam, mean squared error")
def _network(results: Results) -> Finding:
    settings = getattr(results.column.surrogate, "settings", {})
    hidden, activation = settings.get("hidden"), settings.get("activation")
    if not hidden:
        return Finding(results.column.context.surrogate.description)
    # The model of this name is trained by Adam on the mean squared error.
    model = results.config.surrogate_model
    same = hidden == [40, 40, 40] and activation == "sigmoid" and model == "mlp"
    trained = "Adam, mean squared error" if model == "mlp" else f"trained as the model {model} is"
    return Finding(
        f"hidden layers {hidden}, {activation}, {trained}; anchored at the undeformed cell",
        "yes" if same else "–",
    )


@CLAIMS.claim(APPROACH, "−0.4 ≤ H_22 ≤ 0.4 by 0.03 and −1 ≤ p ≤ 1 by 0.1, refined by the density check")
def _ranges(results: Results) -> Finding:
    parts = [
        f"{plain(s.range[0])} … {plain(s.range[1])} for {name}" + (f" by {plain(s.step)}" if s.step else "")
        for name, s in results.config.sampling.inputs.items()
    ]
    return Finding(
        "; ".join(parts),
        why="these are the states that the column visits; p = −1 has no equilibrium with this cell "
        "(homogeneous hydrostatic tension of the solid peaks at 0.45 E)",
    )


@CLAIMS.claim(APPROACH, "1,189 solid problems solved")
def _states(results: Results) -> Finding:
    return Finding(
        f"{len(results.column.results.dataset)} (and {len(results.column.results.held_out)} held out)"
    )


@CLAIMS.claim("Cell tests", "20.5 s a solid problem: 6.5 s solving, 14 s averaging")
def _one_solve(results: Results) -> Finding:
    seconds = float(np.mean(results.column.results.dataset.seconds()))
    return Finding(f"{duration(seconds)}, with the ten derivatives")


@CLAIMS.claim(APPROACH, "406 min for all of them")
def _all_solves(results: Results) -> Finding:
    seconds = float(np.sum(results.column.results.dataset.seconds()))
    return Finding(f"{duration(seconds)} of solves in {duration(results.column.results.seconds['sampling'])}")


@CLAIMS.claim(APPROACH, "training about 10 min")
def _training(results: Results) -> Finding:
    return Finding(duration(results.column.results.seconds["training"]))


@CLAIMS.claim("Figure 11", "the trained network predicts what the cell problem gives")
def _accuracy(results: Results) -> Finding:
    metrics = results.column.metrics["surrogate"]
    rms = metrics["rms_error_percent_of_range"].values()
    worst = max(metrics["largest_error_percent_of_range"].values())
    return Finding(
        f"on {metrics['test_states']} states that it never saw: RMS {number(min(rms), 2)} to "
        f"{number(max(rms), 2)} %, at most {number(worst, 2)} % of each component's range",
        "yes" if worst < 2 else "no",
    )


@CLAIMS.claim(APPROACH, "0.2 ms a call of the network")
def _call(results: Results) -> Finding:
    seconds = results.call_seconds
    return Finding(
        f"{duration(seconds)} for {POINTS:,} states at once, with all derivatives: "
        f"{number(1e6 * seconds / POINTS, 2)} µs a state"
    )


def _points(column: Column) -> int:
    return POINTS_OF_ELEMENT * len(make_body(column.results.config.macro.body).cells)


def _iterations(column: Column) -> float:
    nonlinear = column.figures_of(LARGE)["nonlinear"]
    return float(nonlinear["newton_iterations"] / nonlinear["steps"])


@CLAIMS.claim(APPROACH, "2,250 calls and about 0.45 s an increment")
def _increment(results: Results) -> Finding:
    column = results.column
    points, iterations = _points(column), _iterations(column)
    seconds = column.results.seconds[f"macro, {column.results.config.closure}, load {LARGE:g}"]
    seconds /= column.figures_of(LARGE)["nonlinear"]["steps"]
    return Finding(
        f"{points * iterations:,.0f} states an increment ({points:,} points, {number(iterations, 2)} Newton "
        f"iterations); {duration(seconds)} an increment, everything included"
    )


@CLAIMS.claim(APPROACH, "nearly 13 hours an increment without the network")
def _without(results: Results) -> Finding:
    column = results.column
    seconds = _points(column) * _iterations(column) * float(np.mean(column.results.dataset.seconds()))
    return Finding(
        f"{duration(seconds)} if every point solved a cell of its own",
        why="points of one state share a cell in direct FE² (porocore solve --law direct), 9 here",
    )


@CLAIMS.claim(APPROACH, "a steady state may need 200 increments")
def _steps(results: Results) -> Finding:
    return Finding(f"{results.column.figures_of(LARGE)['nonlinear']['steps']} steps")
