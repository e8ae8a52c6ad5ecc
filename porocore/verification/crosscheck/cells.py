"""Crosscheck of cell solvers: averages, derivatives and conductivity of the same states; tolerances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np

from porocore.core.console import Task
from porocore.interfaces.cell import CellSolver
from porocore.plugins.border import conductivity_of, solution_of
from porocore.plugins.registry import registry
from porocore.states import Array, CellResponse, Status
from porocore.study.config.config import RunConfig
from porocore.study.preflight.abilities import offers_conductivity
from porocore.study.stages.stage_files import prepare_cell
from porocore.verification.crosscheck.attempt import attempt
from porocore.verification.crosscheck.compared_states import STATES
from porocore.verification.crosscheck.comparison import CELL, Comparison

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


def tolerance(one: type[CellSolver] | None, other: type[CellSolver] | None) -> float | None:
    """Return what two solvers may differ by: round-off on the core's mesh, else the sum of what they declare.

    None: one of them is an estimate, which declares nothing.
    """
    solvers = [solver for solver in (one, other) if solver is not None]
    if all(solver.meshes == "core" for solver in solvers):
        return CELL
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
