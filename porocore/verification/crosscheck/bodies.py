"""Crosscheck of macro solvers: histories of one body under the same law, compared pair by pair."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from porocore.core.console import Console
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.solution import MacroSolution, StepReport
from porocore.macro.integration.forecast import StepForecast
from porocore.macro.laws import ClosedLaw
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.plugins.border import body_solution_of
from porocore.plugins.registry import registry
from porocore.states import Array
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig
from porocore.study.preflight.abilities import lacking
from porocore.verification.crosscheck.attempt import attempt
from porocore.verification.crosscheck.cells import relative
from porocore.verification.crosscheck.compared_states import SharedSamples
from porocore.verification.crosscheck.comparison import BODY, Comparison
from porocore.verification.crosscheck.surrogates import SurrogateRun

#: Compared at every time, with their names for a reader.
HISTORIES = {
    "settlement": "settlement",
    "pressure_max": "largest pressure",
    "drained": "drained volume",
    "drained_paper": "drained volume, paper's measure",
}
#: A value is compared relative to itself, and to this share of the largest of its history where it is smaller.
SMALLEST_SHARE = 0.01
#: Two times or two nodes are the same, relative to the end or to the size of the body.
SAME = 1e-9


@dataclass(frozen=True, eq=False)
class BodyRun:
    """Solution of one macro solver under one law, or the reason why there is none."""

    backend: str
    law: str
    solution: MacroSolution | None
    seconds: float
    failure: str = ""
    lacks: str = ""
    solver: type[MacroSolver] | None = None


def make_laws(config: RunConfig, samples: SharedSamples, surrogates: list[SurrogateRun]) -> dict[str, Any]:
    """Linear poroelasticity, and each surrogate closed; instead of a law the reason why there is none."""
    reference, material = samples.reference, config.cell.solid

    def linear() -> MacroLaw:
        return LinearPoroelasticity(
            LinearCoefficients.from_reference(
                reference.response, reference.solid_fraction, material, reference.conductivity
            )
        )

    def closed(run: SurrogateRun) -> MacroLaw:
        closure = reference.closure(config.closure, material, config.conductivity)
        assert run.surrogate is not None
        return ClosedLaw(run.surrogate, closure, name=run.name)

    outcomes = {"linear": attempt(linear)}
    for run in surrogates:
        if run.surrogate is not None:
            outcomes[run.name] = attempt(closed, run)
    return {name: outcome.value or outcome.reason for name, outcome in outcomes.items()}


def run_body(config: RunConfig, backend: str, name: str, law: MacroLaw, console: Console) -> BodyRun:
    """Solve the body under the first load."""
    settings = config.with_backends(fem=backend)
    load = settings.macro.loads[0]
    problem = settings.macro.problem(load)
    found = attempt(registry().get, "macro solver", backend)
    if found.value is None:
        return BodyRun(backend, name, None, found.seconds, found.reason)
    kind: type[MacroSolver] = found.value
    missing = lacking(kind, problem)
    if missing:
        return BodyRun(backend, name, None, 0.0, lacks=missing, solver=kind)
    forecast = StepForecast(problem)
    with console.task(f"body, {name}, {backend}", "", "t = ") as task:

        def show(step: StepReport) -> None:
            forecast.add(step.time)
            task.update(round(step.time, 6), step.end, work=forecast.work)

        def solve() -> MacroSolution:
            solver: MacroSolver = make_backend("macro solver", settings)
            return body_solution_of(solver, solver.prepare(problem), law, problem, on_step=show)

        outcome = attempt(solve)
    return BodyRun(backend, name, outcome.value, outcome.seconds, outcome.reason, solver=kind)


def compare_bodies(runs: list[BodyRun]) -> list[Comparison]:
    """Every pair under every law, and what failed."""
    found = [
        Comparison.failure("body", f"law {run.law}", "solution", run.backend, run.failure)
        for run in runs
        if run.failure
    ]
    found += [
        Comparison.left_out(
            "body", f"law {run.law}", "solution", run.backend, f"it does not offer {run.lacks}"
        )
        for run in runs
        if run.lacks
    ]
    solved = [run for run in runs if run.solution is not None]
    for law in dict.fromkeys(run.law for run in solved):
        for one, other in combinations([run for run in solved if run.law == law], 2):
            found += _compare_pair(f"law {law}", one, other)
    return found


def _compare_pair(case: str, one: BodyRun, other: BodyRun) -> list[Comparison]:
    a, b = one.solution, other.solution
    assert a is not None
    assert b is not None

    solvers = [run.solver for run in (one, other) if run.solver is not None]
    alike = all(solver.meshes == "core" for solver in solvers)
    allowed = BODY if alike else sum(solver.accuracy for solver in solvers)

    def line(quantity: str, difference: float) -> Comparison:
        return Comparison("body", case, quantity, one.backend, other.backend, difference, allowed)

    def failure(quantity: str, reason: str) -> list[Comparison]:
        return [Comparison.failure("body", case, quantity, one.backend, reason, other=other.backend)]

    times = a.history.time, b.history.time
    if len(times[0]) != len(times[1]) or np.abs(times[0] - times[1]).max() > SAME * times[0][-1]:
        return failure("times", f"other time steps: {len(times[0]) - 1} against {len(times[1]) - 1}")
    found = [
        line(label, float(history_difference(getattr(a.history, name), getattr(b.history, name)).max()))
        for name, label in HISTORIES.items()
    ]
    orders = node_orders(a.points, b.points)
    if orders is None or len(a.profiles) != len(b.profiles):
        return found + failure("profiles", "other nodes, or other times")
    pressure = float(a.history.pressure_max.max())
    for p, q in zip(a.profiles, b.profiles, strict=True):
        for name, floor in (("u", 0.0), ("p", pressure)):
            x, y = getattr(p, name)[orders[0]], getattr(q, name)[orders[1]]
            found.append(line(f"{name} at t = {p.time:g}", relative(x, y, floor)))
    return found


def history_difference(a: Array, b: Array) -> Array:
    """Difference at every time, relative to the value, or to a share of the largest; infinite for no number."""
    size = np.maximum(np.abs(a), np.abs(b))
    scale = np.maximum(size, SMALLEST_SHARE * size.max())
    difference = np.abs(a - b)
    relative = np.divide(difference, scale, out=np.zeros_like(difference), where=difference != 0)
    return np.where(np.isfinite(a) & np.isfinite(b), relative, np.inf)


def node_orders(a: Array, b: Array) -> tuple[Array, Array] | None:
    """Permutations that bring the nodes of two meshes (n, 3) into one order; None if they are other nodes."""
    if a.shape != b.shape:
        return None
    size = np.ptp(a, axis=0).max()
    first, second = (np.lexsort(np.round(points / size / 1e-6).T) for points in (a, b))
    same = np.abs(a[first] - b[second]).max() <= SAME * size
    return (first, second) if same else None
