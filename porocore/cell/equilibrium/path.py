"""Following a load from a known equilibrium to the wanted one.

Each step: a predictor along the exact tangent, then Newton on Π with a line search that keeps J > 0 and
lowers the energy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.cell.equilibrium.discrete import DiscreteSolid, Iterate, StepFailed
from porocore.cell.meshing.overlap import mirror_gap, nodes_inside
from porocore.states import Array, IntArray, Status

ITERATIONS = 50
#: After so many the pairs that touch stay as they are: at an edge a point may change to and fro for ever.
PAIRINGS = 12
#: In any component of H, and in p over Young's modulus of the solid; a step beyond it seldom converges.
LARGEST_STEP = 0.16
SMALLEST_STEP = 1 / 300
#: A load of more than a thousand of the largest steps is not followed.
SHORTEST_SHARE = 1e-3
#: Steps of one path that may fail; behind a bifurcation every further one would.
FAILURES = 6
ARMIJO = 1e-4
#: Of the linear system that predicts the next state.
PREDICTOR_ACCURACY = 1e-3


@dataclass(frozen=True, eq=False)
class Outcome:
    """Where a load path ended: the equilibrium, None unless the wanted load was reached, and the status."""

    status: Status
    equilibrium: Iterate | None
    steps: int
    iterations: int


def follow(problem: DiscreteSolid, start: Iterate, H: Array, p: float, tolerance: float) -> Outcome:
    """From ``start`` to (H, p) in adaptive steps, to a residual of ``tolerance`` times the force scale.

    A state on the way whose walls overlap ends the path: what lies behind it is not reached without contact.
    """
    here, share = start, 0.0
    pressure = abs(p - start.p) / problem.material.mean_moduli()[0]
    largest = LARGEST_STEP / max(float(np.abs(H - start.H).max()), pressure, 1e-12)
    if largest < SHORTEST_SHARE:
        return Outcome(Status.not_converged, None, 0, 0)
    step = min(1.0, largest)
    steps = iterations = failures = 0
    while share < 1:
        goal = min(1.0, share + step)
        H_goal, p_goal = start.H + goal * (H - start.H), start.p + goal * (p - start.p)
        try:
            reached, taken = _newton(problem, _predict(problem, here, H_goal, p_goal), tolerance)
        except StepFailed as failed:
            step, failures = (goal - share) / 4, failures + 1
            if step < SMALLEST_STEP or failures > FAILURES:
                return Outcome(failed.status, None, steps, iterations)
            continue
        here, step, share = reached, min(2 * (goal - share), largest), goal
        steps, iterations = steps + 1, iterations + taken
        if _overlaps(problem, here):
            return Outcome(Status.overlap, None, steps, iterations)
    return Outcome(Status.converged, here, steps, iterations)


def gap(problem: DiscreteSolid, here: Iterate) -> float:
    """Of the wall to the mirror planes; NaN where the domain has none."""
    if problem.mesh.domain == "whole":
        return float("nan")
    return mirror_gap(problem.mesh, here.H, here.displacement)


def _overlaps(problem: DiscreteSolid, here: Iterate) -> bool:
    """Whether the wall has passed through something that contact, if there is any, does not hold."""
    touching = here.touching
    if touching is not None and problem.contact is not None and touching.depth > problem.contact.deepest:
        return True
    if problem.mesh.domain == "eighth":
        return problem.contact is None and gap(problem, here) < 0
    inside = nodes_inside(problem.mesh, here.H, here.displacement)
    held: IntArray = np.unique(touching.forces.nodes) if touching is not None else np.zeros(0, dtype=np.int64)
    # A node that contact holds lies a little inside; any other has jumped through a wall unseen.
    images = problem.mesh.periodic_class
    return len(np.setdiff1d(images[inside], images[held])) > 0


def _predict(problem: DiscreteSolid, here: Iterate, H: Array, p: float) -> Iterate:
    """The equilibrium's first-order continuation to (H, p)."""
    change = -problem.load_change(here, H - here.H, p - here.p)
    if change.any():
        change = problem.solve(here, change, PREDICTOR_ACCURACY)
    there = problem.moved(here, change, H, p)
    if there.min_jacobian <= 0:
        raise StepFailed(Status.inverted)
    return there


def _longest(problem: DiscreteSolid, change: Array) -> float:
    """The share of a change that moves no node by more than contact can see."""
    if problem.contact is None or not problem.contact.pairs_move:  # planes are seen from anywhere
        return 1.0
    moved = float(np.linalg.norm(problem.expanded(change, ""), axis=1).max())
    return min(1.0, problem.contact.deepest / max(moved, 1e-300))


def _newton(problem: DiscreteSolid, here: Iterate, tolerance: float) -> tuple[Iterate, int]:
    """The equilibrium near a first guess, and the number of linear systems solved."""
    scale = problem.force_scale(here)
    goal = tolerance * scale
    for iteration in range(ITERATIONS):
        norm = float(np.linalg.norm(here.residual))
        if norm <= goal:
            return here, iteration
        accuracy = min(1e-2, max(1e-7, 0.1 * goal / norm, norm / scale))
        change = problem.solve(here, -here.residual, accuracy)
        slope = float(here.residual @ change)
        length, inverted = _longest(problem, change), True
        while length > 1e-3:
            trial = problem.moved(here, length * change, here.H, here.p)
            trial.pair_like(here)
            if trial.min_jacobian > 0:
                inverted = False
                if trial.energy <= here.energy + ARMIJO * length * slope:
                    break
                # Near the solution Π stalls at round-off, and the residual is what still falls.
                stalled = abs(slope) < 1e-9 * abs(here.energy) + 1e-14
                if stalled and float(np.linalg.norm(trial.residual)) < norm:
                    break
            length /= 2
        else:
            if norm <= 100 * goal:  # round-off, not a failure of the step
                return here, iteration
            raise StepFailed(Status.inverted if inverted else Status.not_converged)
        here = trial
        if iteration < PAIRINGS:
            here.pair_again()
    if float(np.linalg.norm(here.residual)) <= goal:
        return here, ITERATIONS
    raise StepFailed(Status.not_converged)
