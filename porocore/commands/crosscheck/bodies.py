"""Crosscheck of cell solvers, surrogates and macro solvers: results compared pair by pair."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from porocore.commands.backends import attempt
from porocore.commands.crosscheck.comparison import BODY, CELL, SPREAD, STATES, Comparison, SharedSamples
from porocore.core.console import Console, Task
from porocore.interfaces.cell import CellSolver
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.solution import MacroSolution
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.plugins.border import body_solution_of, conductivity_of, prediction_of, solution_of
from porocore.plugins.registry import registry
from porocore.states import Array, CellResponse, MacroState, Status
from porocore.study.config.config import RunConfig
from porocore.study.notes.abilities import lacking, offers_conductivity
from porocore.study.run.composition import make_backend, prepare_cell, with_memory
from porocore.study.run.solving import body_progress
from porocore.study.run.training import show_training

#: How the averages and the derivatives are written.
AVERAGES = {"mean_grad": "⟨∇u¹⟩", "potential": "W", "stress": "P_E", "fluid_volume": "φ"}
DERIVATIVES = {
    "mean_grad_grad_u": "∂⟨∇u¹⟩/∂H",
    "mean_grad_p": "∂⟨∇u¹⟩/∂p",
    "stress_grad_u": "∂P_E/∂H",
    "stress_p": "∂P_E/∂p",
    "fluid_volume_grad_u": "∂φ/∂H",
    "fluid_volume_p": "∂φ/∂p",
}
#: All that is compared of a response; the last is there with ``conductivity: deformed`` only.
RESPONSES = AVERAGES | {"conductivity": "K_ref"}
#: A deformation of ordinary size, for the scale of what vanishes at rest.
STRAIN = 0.1


@dataclass(frozen=True, eq=False)
class CellRun:
    """Results of one cell solver.

    Attributes
    ----------
    backend
        Its name.
    responses
        By state; a state at which it raised an exception is not there.
    conductivity : (3, 3)
        None where it failed.
    failures
        By what was tried.
    seconds
        By what was tried.
    solver
        Its class, which declares on which meshes and how accurately it solves; None where it could not be made.
    """

    backend: str
    responses: dict[str, CellResponse]
    conductivity: Array | None
    failures: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    solver: type[CellSolver] | None = None


def make_meshes(config: RunConfig) -> None:
    """Every mesh that the states need, so that the first backend does not pay for what all share.

    Raises
    ------
    PorocoreError
        The cell cannot be meshed.
    """
    config.cell.require_member()
    domains = {"eighth", "whole"} if config.cell.symmetric else {"whole"}
    for domain in sorted(domains):
        config.cell.make_mesh("solid", domain)  # type: ignore[arg-type]
    config.cell.make_mesh("fluid", min(domains))  # type: ignore[arg-type]


def run_cell(config: RunConfig, backend: str, task: Task) -> CellRun:
    """Solve the states and the flow with one backend; ``task`` shows how far it is."""
    settings, steps = config.with_backends(fem=backend), len(STATES) + 2
    failures: dict[str, str] = {}
    seconds: dict[str, float] = {}
    done = 0

    def step(name: str, what: Callable[..., Any], *args: Any) -> Any:
        nonlocal done
        task.update(done, steps, detail=name)
        outcome = attempt(what, *args)
        done += 1
        task.update(done, steps)
        seconds[name] = outcome.seconds
        if outcome.reason:
            failures[name] = outcome.reason
        return outcome.value

    def set_up() -> tuple[CellSolver, Any]:
        kind: type[CellSolver] = registry().get("cell solver", backend)
        if offers_conductivity(kind, settings.conductivity):
            return prepare_cell(backend, settings.fem.options, settings.cell, settings.conductivity)
        solver = kind(**settings.fem.options)
        return solver, solver.prepare(settings.cell)

    ready = step("set-up", set_up)
    if ready is None:
        return CellRun(backend, {}, None, failures, seconds)
    solver, prepared = ready
    solutions = {name: step(name, solution_of, solver, prepared, state) for name, state in STATES.items()}
    conducts = "piola" in type(solver).conductivities
    conductivity = step("conductivity", conductivity_of, solver, prepared) if conducts else None
    responses = {name: solution.response for name, solution in solutions.items() if solution is not None}
    return CellRun(backend, responses, conductivity, failures, seconds, type(solver))


def tolerance(
    one: type[CellSolver | MacroSolver] | None,
    other: type[CellSolver | MacroSolver] | None,
    alike: float = CELL,
) -> float | None:
    """Return what two solvers may differ by: ``alike`` on the core's mesh, else the sum of what they declare.

    None: one of them is an estimate, which declares nothing.
    """
    solvers = [solver for solver in (one, other) if solver is not None]
    if all(solver.meshes == "core" for solver in solvers):
        return alike
    declared = [solver.accuracy for solver in solvers]
    known = [accuracy for accuracy in declared if accuracy is not None]
    return sum(known) if len(known) == len(declared) else None


def compare_cells(runs: list[CellRun]) -> list[Comparison]:
    """Every pair at every state, and what failed."""
    found = [
        Comparison.failure("cell", name if name in STATES else "", _tried(name), run.backend, reason)
        for run in runs
        for name, reason in run.failures.items()
    ]
    for one, other in combinations(runs, 2):
        allowed = tolerance(one.solver, other.solver)
        if allowed is None:
            estimate = one if one.solver is not None and one.solver.accuracy is None else other
            reason = f"{estimate.backend} is an estimate that declares no accuracy"
            found.append(
                Comparison.left_out("cell", "", "responses", one.backend, reason, other=other.backend)
            )
            continue
        for name in STATES:
            if name in one.responses and name in other.responses:
                found += compare_responses(
                    name, one.backend, one.responses[name], other.backend, other.responses[name], allowed
                )
        found += _compare_conductivity(one, other, allowed)
    return found


def _compare_conductivity(one: CellRun, other: CellRun, allowed: float) -> list[Comparison]:
    """K at rest, where both have it."""
    for run in (one, other):
        if run.solver is not None and "piola" not in run.solver.conductivities:
            reason = f"{run.backend} computes no conductivity"
            return [Comparison.left_out("cell", "at rest", "K", one.backend, reason, other=other.backend)]
    if one.conductivity is None or other.conductivity is None:
        return []
    difference = relative(one.conductivity, other.conductivity, 0.0)
    return [Comparison("cell", "at rest", "K", one.backend, other.backend, difference, allowed)]


def compare_responses(
    case: str, one: str, a: CellResponse, other: str, b: CellResponse, allowed: float = CELL
) -> list[Comparison]:
    """Two backends at one state (one row each): status, averages, derivatives."""
    statuses = Status(int(a.status[0])), Status(int(b.status[0]))
    if statuses[0] is not statuses[1]:
        reason = f"{statuses[0].name} against {statuses[1].name}"
        return [Comparison.failure("cell", case, "status", one, reason, other=other)]
    found = [Comparison("cell", case, "status", one, other, 0.0, allowed)]
    if not statuses[0].has_values:
        return found
    floors = scales(a)
    for table, first, second in ((RESPONSES, a, b), (DERIVATIVES, a.tangent, b.tangent)):
        for name, symbol in table.items():
            x, y = getattr(first, name, None), getattr(second, name, None)
            if x is None and y is None:
                continue
            if x is None or y is None:
                reason = f"not provided by {one if x is None else other}"
                found.append(Comparison.failure("cell", case, symbol, one, reason, other=other))
                continue
            difference = relative(x[0], y[0], floors.get(name, 0.0))
            found.append(Comparison("cell", case, symbol, one, other, difference, allowed))
    return found


def scales(response: CellResponse) -> dict[str, float]:
    """Return the averages of an ordinary deformation: the scale where it vanishes, as it does at rest.

    The largest derivative with respect to H times :data:`STRAIN`; for the energy, stress times strain.
    """
    slopes = {}
    for name in ("mean_grad", "stress", "fluid_volume"):
        slope = getattr(response.tangent, f"{name}_grad_u", None)
        if slope is not None:
            slopes[name] = STRAIN * float(np.abs(slope[0]).max())
    if "stress" in slopes:
        slopes["potential"] = STRAIN * slopes["stress"]
    return slopes


def relative(a: Any, b: Any, floor: float) -> float:
    """Largest difference of two tensors over their largest component, or over ``floor`` if that is larger.

    Infinite where a component is no number.
    """
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    if a.shape != b.shape or not (np.isfinite(a).all() and np.isfinite(b).all()):
        return float("inf")
    difference = float(np.abs(a - b).max())
    scale = max(float(np.abs(a).max()), float(np.abs(b).max()), floor)
    return difference / scale if difference > 0 else 0.0


def _tried(name: str) -> str:
    return "solution" if name in STATES else name


@dataclass(frozen=True, eq=False)
class SurrogateRun:
    """One trained surrogate.

    Attributes
    ----------
    name
        Its backend.
    surrogate
        None where training or prediction failed.
    errors
        Largest error on the held-out states within its range, by response, as a share of the span.
    seconds
        Of the training.
    failure
        Why there is none.
    """

    name: str
    surrogate: Surrogate | None
    errors: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    failure: str = ""


def train(config: RunConfig, name: str, samples: SharedSamples, console: Console) -> SurrogateRun:
    """Fit one surrogate and measure it on the held-out states."""
    settings = config.with_backends(surrogate=name)
    with console.task(f"training, {name}", "epochs") as task:

        def fit() -> Surrogate:
            surrogate: Surrogate = make_backend("surrogate", settings)
            return surrogate.fit(
                samples.training, seed=settings.surrogate.seed, on_progress=partial(show_training, task)
            )

        fitted = attempt(fit)
    if fitted.value is None:
        return SurrogateRun(name, None, seconds=fitted.seconds, failure=fitted.reason)
    surrogate = fitted.value
    measured = attempt(held_out_errors, surrogate, samples)
    if measured.value is None:
        return SurrogateRun(name, None, seconds=fitted.seconds, failure=measured.reason)
    return SurrogateRun(name, surrogate, measured.value, fitted.seconds)


def load_libraries(names: tuple[str, ...]) -> None:
    """Load the libraries before the first cell solve, as a run does; a failure shows again in training."""
    for name in names:
        attempt(lambda name=name: registry().get("surrogate", name).load_libraries())  # type: ignore[misc]


def held_out_errors(surrogate: Surrogate, samples: SharedSamples) -> dict[str, float]:
    """Largest error of each response that it predicts, in the range that it knows, as a share of the span."""
    predicted = prediction_of(surrogate, samples.states, tangent=False)
    inside = ~predicted.flagged
    errors = {}
    for response in RESPONSES:
        values, solved = getattr(predicted, response), getattr(samples.solved, response)
        if values is not None and solved is not None:
            known = inside & np.isfinite(solved.reshape(len(solved), -1)).all(axis=1)
            errors[response] = _largest(values[known] - solved[known], samples.span(response))
    return errors


def compare_surrogates(runs: list[SurrogateRun], samples: SharedSamples, seed: int) -> list[Comparison]:
    """Each with the held-out states, and each pair at states between them."""
    found = []
    for run in runs:
        if run.surrogate is None:
            found.append(Comparison.failure("surrogate", "", "training", run.name, run.failure))
            continue
        case, allowed = "held-out states", type(run.surrogate).expected_error
        found += [
            Comparison("surrogate", case, RESPONSES[response], run.name, "cell solves", error, allowed)
            for response, error in run.errors.items()
        ]
    between = samples.between(seed)
    for one, other in combinations([run for run in runs if run.surrogate is not None], 2):
        found += _compare_surrogates(one, other, between, samples)
    return found


def _compare_surrogates(
    one: SurrogateRun, other: SurrogateRun, between: MacroState, samples: SharedSamples
) -> list[Comparison]:
    case, found = "between the states", []
    predicted = []
    for run in (one, other):
        assert run.surrogate is not None
        outcome = attempt(run.surrogate.predict, between, tangent=False)
        if outcome.value is None:
            return [Comparison.failure("surrogate", case, "prediction", run.name, outcome.reason)]
        predicted.append(outcome.value)
    a, b = predicted
    expected = [type(run.surrogate).expected_error for run in (one, other) if run.surrogate is not None]
    # What approximates says so; the others are held to what they were measured to reach.
    declared = sum(expected) if max(expected) > Surrogate.expected_error else 0.0
    inside = ~a.flagged & ~b.flagged
    for response in RESPONSES:
        if response in one.errors and response in other.errors:
            values = getattr(a, response)[inside] - getattr(b, response)[inside]
            tolerance = max(SPREAD * (one.errors[response] + other.errors[response]), declared)
            difference = _largest(values, samples.span(response))
            symbol = RESPONSES[response]
            found.append(Comparison("surrogate", case, symbol, one.name, other.name, difference, tolerance))
    return found


def _largest(difference: Array, span: float) -> float:
    """Return the largest difference as a share of the span; infinite without finite predictions."""
    largest = float(np.abs(difference).max(initial=0.0)) / span
    return largest if len(difference) and np.isfinite(largest) else float("inf")


#: Compared at every time, with their names for a reader.
HISTORIES = {
    "displacement": "largest displacement",
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
        coefficients = LinearCoefficients.from_reference(
            reference.response, reference.solid_fraction, material, reference.conductivity
        )
        return with_memory(LinearPoroelasticity(coefficients), config, linear=True)

    def closed(run: SurrogateRun) -> MacroLaw:
        closure = reference.closure(config.closure, material, config.conductivity)
        assert run.surrogate is not None
        return with_memory(ClosedLaw(run.surrogate, closure, name=run.name), config)

    outcomes = {"linear": attempt(linear)}
    for run in surrogates:
        if run.surrogate is not None:
            outcomes[run.name] = attempt(closed, run)
    return {name: outcome.value or outcome.reason for name, outcome in outcomes.items()}


def run_body(config: RunConfig, backend: str, name: str, law: MacroLaw, console: Console) -> BodyRun:
    """Solve the body under the first load."""
    settings = config.with_backends(fem=backend)
    load = settings.macro.loads[0]
    problem = settings.problem(load)
    found = attempt(registry().get, "macro solver", backend)
    if found.value is None:
        return BodyRun(backend, name, None, found.seconds, found.reason)
    kind: type[MacroSolver] = found.value
    missing = lacking(kind, problem)
    if missing:
        return BodyRun(backend, name, None, 0.0, lacks=missing, solver=kind)
    title = f"body, {name}, {backend}"
    with body_progress(console, title, problem, settings.result_units) as (show, _):

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

    allowed = tolerance(one.solver, other.solver, BODY) or 0.0

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
