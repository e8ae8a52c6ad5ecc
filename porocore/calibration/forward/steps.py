"""Time steps of an experiment, the same at all values of the unknowns; the error of the curves by them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from porocore.core.models.bounds import MOST_TIMES
from porocore.errors import ConfigurationError
from porocore.macro.integration.stepping import Stepper
from porocore.macro.problem import MacroProblem, TimePlan
from porocore.states import Array

#: A step nearer than this share of its length to the time of a datum is left out, but for kinks of the loads.
NEAR = 0.5
#: Differences of curves whose steps are halved again and again fall by 1/2 each time for steps of the first order. A
#: ratio beyond this is one of steps that are far too long, of which nothing is known but that they are.
HALF, MOST_RATIO = 0.5, 0.8


def planned_times(problem: MacroProblem) -> Array:
    """Return the times of all steps of a plan without an error control, none of which fails."""
    stepper = Stepper(problem.time.model_copy(update={"tolerance": None}), problem.corners)
    times = []
    while not stepper.done:
        stepper.accept()
        times.append(stepper.time)
    return np.array(times)


def with_fixed_steps(
    problem: MacroProblem, data: Array, chosen: Callable[[], Array], hit: bool = True
) -> TimePlan:
    """Return the time plan of an experiment with steps that do not depend on the unknowns.

    Parameters
    ----------
    problem
        With the time plan of the study.
    data : (m,)
        Times of the data.
    chosen
        Returns the steps that an error control takes at the first values; asked only where there is one.
    hit
        Whether steps end at the times of the data.

    Raises
    ------
    ConfigurationError
        There are too many steps.
    """
    plan = problem.time
    steps = planned_times(problem) if plan.tolerance is None else chosen()
    steps = steps[steps > 0]
    if hit:
        steps = _meeting(steps, np.unique(data[(data > 0) & (data <= plan.end)]), _kinks(problem))
    if len(steps) > MOST_TIMES:
        raise ConfigurationError(
            f"macro.time: an experiment of a calibration takes at most {MOST_TIMES} steps, got {len(steps)}; "
            "give a longer 'step:'"
        )
    profiles = tuple(float(t) for t in steps[steps < plan.end])
    return plan.model_copy(update={"tolerance": None, "step": plan.end, "profiles": profiles})


def with_halved_steps(problem: MacroProblem, halvings: int) -> TimePlan:
    """Return the time plan with each step cut into 2^halvings equal ones, for a plan whose steps are fixed."""
    times = np.concatenate([[0.0], planned_times(problem)])
    parts = 2**halvings
    shares = np.arange(parts) / parts
    cut = (times[:-1, None] + np.diff(times)[:, None] * shares).ravel()
    return problem.time.model_copy(update={"profiles": tuple(float(t) for t in cut[1:])})


def error_of_steps(curves: Sequence[Array], deviations: Array) -> Array:
    """Return the error (m,) of the first of some curves, each with half the steps of the one before.

    The differences of neighbours are taken to go on falling by the ratio of the last two; of a single difference, by
    that of backward Euler steps.

    Parameters
    ----------
    curves : (m,) each
        Two or more.
    deviations : (m,)
        Standard deviations of the values, by which differences are compared.
    """
    differences = np.diff(np.stack(curves), axis=0)
    sizes = np.linalg.norm(differences / deviations, axis=1)
    ratio = HALF
    if len(sizes) > 1 and sizes[-2] > 0:
        ratio = min(float(sizes[-1] / sizes[-2]), MOST_RATIO)
    return np.asarray(-differences.sum(axis=0) - differences[-1] * ratio / (1 - ratio))


def _kinks(problem: MacroProblem) -> Array:
    """Return the times that every run hits: increments of the ramp, kinks of the loads, the end."""
    plan = problem.time
    stepper = Stepper(plan.model_copy(update={"tolerance": None}), problem.corners)
    increments = [k * plan.ramp_step for k in range(1, plan.ramp_increments + 1)]
    return np.array([*stepper.kinks, *increments, plan.end])


def _meeting(steps: Array, data: Array, kinks: Array) -> Array:
    """Return steps that end at the times of the data, and nowhere near them but at kinks of the loads."""
    if not len(data):
        return steps
    lengths = np.diff(steps, prepend=0.0)
    away = np.abs(steps[:, None] - data).min(axis=1)
    corner = np.abs(steps[:, None] - kinks).min(axis=1) <= 1e-9 * lengths
    kept = steps[(away > NEAR * lengths) | corner]
    merged = np.union1d(kept, data)
    # Two that round-off alone parts are one.
    distinct = np.diff(merged, prepend=-1.0) > 1e-9 * merged
    return np.asarray(merged[distinct])
