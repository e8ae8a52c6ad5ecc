"""Following a load from a known equilibrium to the wanted one.

Each step: a predictor along the exact tangent, then Newton on Π with a line search that keeps J > 0 and
lowers the energy. The linear systems are solved by conjugate gradients with a factor that is kept from
iterate to iterate and from load to load, and renewed when it no longer serves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.cell.overlap import mirror_gap, walls_overlap
from porocore.states import Status
from porocore_fem_skfem.factor import FactorError
from porocore_fem_skfem.linalg import conjugate_gradients
from porocore_fem_skfem.solid import Constraints, Point, SolidProblem

#: More iterations than this cost more than a new factor.
PATIENCE = 18
ITERATIONS = 12
#: In any component of H and in p; a step beyond it seldom converges.
LARGEST_STEP = 0.16
SMALLEST_STEP = 1 / 300
#: Steps of one path that may fail; behind a bifurcation every further one would.
FAILURES = 6
ARMIJO = 1e-4


@dataclass
class Equilibrium:
    """A solid at (H, p) with u¹ (3, nodes) and its kinematics."""

    H: Any
    p: float
    u: Any
    at: Point
    iterations: int = 0


@dataclass
class Outcome:
    """Where a load path ended: the equilibrium, None unless the wanted load was reached, and the status."""

    status: Status
    equilibrium: Equilibrium | None
    steps: int
    iterations: int


class StepFailed(Exception):
    """Newton's iteration did not reach the load; ``status`` says what stood in the way."""

    def __init__(self, status: Status) -> None:
        super().__init__(status.name)
        self.status = status


def undeformed(problem: SolidProblem) -> Equilibrium:
    """u¹ = 0 at H = 0, p = 0."""
    u = np.zeros((3, problem.n_nodes))
    H = np.zeros((3, 3))
    return Equilibrium(H, 0.0, u, problem.point(H, 0.0, problem.gradient(u)))


def follow(problem: SolidProblem, start: Equilibrium, H: Any, p: float, tolerance: float) -> Outcome:
    """From ``start`` to (H, p) in adaptive steps.

    A state on the way whose walls overlap ends the path: what lies behind it is not reached without contact.
    """
    here, share = start, 0.0
    largest = LARGEST_STEP / max(float(np.abs(H - start.H).max()), abs(p - start.p), 1e-12)
    step = min(1.0, largest)
    steps = iterations = failures = 0
    while share < 1:
        goal = min(1.0, share + step)
        H_goal, p_goal = start.H + goal * (H - start.H), start.p + goal * (p - start.p)
        try:
            reached = _newton(problem, _predict(problem, here, H_goal, p_goal), tolerance)
        except StepFailed as failed:
            step, failures = (goal - share) / 4, failures + 1
            if step < SMALLEST_STEP or failures > FAILURES:
                return Outcome(failed.status, None, steps, iterations)
            continue
        here, step, share = reached, min(2 * (goal - share), largest), goal
        steps, iterations = steps + 1, iterations + here.iterations
        if _overlaps(problem, here):
            return Outcome(Status.overlap, None, steps, iterations)
    return Outcome(Status.converged, here, steps, iterations)


def _overlaps(problem: SolidProblem, here: Equilibrium) -> bool:
    if problem.mesh.domain == "eighth":
        return gap(problem, here) < 0
    return walls_overlap(problem.mesh, here.H, here.u[:, problem.nodes].T)


def gap(problem: SolidProblem, here: Equilibrium) -> float:
    """Of the wall to the mirror planes; NaN where the domain has none."""
    if problem.mesh.domain == "whole":
        return float("nan")
    return mirror_gap(problem.mesh, here.H, here.u.T)


def _predict(problem: SolidProblem, here: Equilibrium, H: Any, p: float) -> Equilibrium:
    """The equilibrium's first-order continuation to (H, p)."""
    constraints = problem.constraints()
    dH = np.broadcast_to((H - here.H)[:, :, None], here.at.F.shape)
    change = problem.tangent_apply(here.at, dH) + (p - here.p) * here.at.cof
    rhs = -problem.assemble(change).ravel()[constraints.free]
    u = here.u
    if rhs.any():
        u = u + _direction(problem, constraints, here.at, rhs, 1e-3)
    at = problem.point(H, p, problem.gradient(u))
    if at.J.min() <= 0:
        raise StepFailed(Status.inverted)
    return Equilibrium(H, p, u, at)


def _newton(problem: SolidProblem, guess: Equilibrium, tolerance: float) -> Equilibrium:
    constraints = problem.constraints()
    free = constraints.free
    u, at = guess.u, guess.at
    stress = problem.stress(at)
    residual = problem.assemble(stress).ravel()[free]
    energy = problem.energy(at)
    scale = _force_scale(problem, stress)[free]
    goal = tolerance * float(np.linalg.norm(scale))
    norm = float(np.linalg.norm(residual))
    for iteration in range(ITERATIONS):
        if norm <= goal:
            return Equilibrium(guess.H, guess.p, u, at, iteration)
        accuracy = min(1e-2, max(1e-7, 0.1 * goal / norm, norm / float(np.linalg.norm(scale))))
        step = _direction(problem, constraints, at, -residual, accuracy)
        slope = float(residual @ step.ravel()[free])
        gradient = problem.gradient(step)
        length, inverted = 1.0, True
        while length > 1e-3:
            trial = problem.point(
                guess.H, guess.p, at.F + length * gradient - (np.eye(3) + guess.H)[:, :, None]
            )
            if trial.J.min() > 0:
                inverted = False
                trial_energy = problem.energy(trial)
                trial_stress = problem.stress(trial)
                trial_residual = problem.assemble(trial_stress).ravel()[free]
                trial_norm = float(np.linalg.norm(trial_residual))
                if trial_energy <= energy + ARMIJO * length * slope:
                    break
                # Near the solution Π stalls at round-off, and the residual is what still falls.
                if abs(slope) < 1e-9 * abs(energy) + 1e-14 and trial_norm < norm:
                    break
            length /= 2
        else:
            if norm <= 100 * goal:  # round-off, not a failure of the step
                return Equilibrium(guess.H, guess.p, u, at, iteration)
            raise StepFailed(Status.inverted if inverted else Status.not_converged)
        u, at = u + length * step, trial
        residual, norm, energy = trial_residual, trial_norm, trial_energy
    if norm <= goal:
        return Equilibrium(guess.H, guess.p, u, at, ITERATIONS)
    raise StepFailed(Status.not_converged)


def _force_scale(problem: SolidProblem, stress: Any) -> Any:
    """Nodal forces if nothing cancelled, with a floor of a strain of 1e-3; flat (3·nodes)."""
    size = np.sqrt((stress * stress).sum(axis=(0, 1)))
    size = np.maximum(size, 1e-3 * problem.material.mu) * problem.w
    nodal = abs(problem.B_T) @ np.tile(size, 3)
    return np.tile(nodal, 3) / 3


def _direction(problem: SolidProblem, constraints: Constraints, at: Point, rhs: Any, accuracy: float) -> Any:
    """K⁻¹ rhs as a field (3, nodes); with an indefinite K, of the least shifted K that is definite."""
    entries = constraints.restrict(problem.tangent(at))
    matrix = constraints.pattern.full(entries)
    try:
        solved = conjugate_gradients(
            matrix, rhs, constraints.precondition, tolerance=accuracy, limit=PATIENCE
        )
        if not solved.converged and constraints.renew(entries) <= 0:
            solved = conjugate_gradients(matrix, rhs, constraints.precondition, tolerance=accuracy)
        x = solved.x if solved.converged else _shifted(constraints, entries, rhs)
    except FactorError as error:
        raise StepFailed(Status.not_converged) from error
    field = np.zeros(3 * problem.n_nodes)
    field[constraints.free] = x
    return field.reshape(3, -1)


def _shifted(constraints: Constraints, entries: Any, rhs: Any) -> Any:
    diagonal = constraints.pattern.diagonal
    size = float(np.abs(entries[diagonal]).mean())
    shift = 1e-3
    while shift < 10:
        moved = entries.copy()
        moved[diagonal] += shift * size
        if constraints.renew(moved) <= 0:
            x = constraints.precondition(rhs)
            if x @ rhs > 0:
                return x
        shift *= 4
    raise StepFailed(Status.not_converged)
