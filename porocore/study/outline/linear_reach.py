"""Linear solutions of a study's body in few steps, before any cell but the one at rest is solved."""

from __future__ import annotations

import math
from itertools import pairwise

from porocore.interfaces.law import MacroLaw
from porocore.interfaces.solution import MacroSolution
from porocore.macro.integration.stepping import SAME, Stepper
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.macro.problem import TimePlan, body_mesh
from porocore.plugins.border import body_solution_of
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig

#: Steps after the ramp at least, beside those to the kinks of what is prescribed.
STEPS = 3
#: Equal steps from each kink to the next at most, none shorter than the run's own. One step for an unloading that
#: takes about as long as the consolidation told a suction of 7.6 kPa instead of 9.7, eight steps tell 9.4.
PARTS = 8
#: Unknowns times steps under all loads beyond which a check would take long.
MOST = 200_000


def too_large(config: RunConfig) -> str:
    """Return in words why the body is not solved before a run; empty where it is."""
    size, steps = body_mesh(config.macro).size, len(_times(config, 1)) * len(_loads(config))
    if size * steps <= MOST:
        return ""
    return f"{size:,} unknowns of the body times {steps} time steps are more than the {MOST:,} of a check"


def linear_solutions(config: RunConfig, linear: LinearCoefficients | MacroLaw) -> list[MacroSolution]:
    """Return the body's linear solutions on its own mesh under the lowest and the highest load, kept at every step.

    ``linear`` are the coefficients of its cell, or the linear law of a body of many cells.

    Raises
    ------
    SolveError
        A step fails, as one under a follower may.
    """
    law = LinearPoroelasticity(linear) if isinstance(linear, LinearCoefficients) else linear
    solver, plan, found = make_backend("macro solver", config), _plan(config), []
    for load in _loads(config):
        problem = config.macro.problem(load).model_copy(update={"time": plan})
        found.append(body_solution_of(solver, solver.prepare(problem), law, problem))
    return found


def _loads(config: RunConfig) -> list[float]:
    """Return the ends of the loads and of zero that are not zero."""
    return [load for load in (min(0.0, *config.macro.loads), max(0.0, *config.macro.loads)) if load != 0]


def _plan(config: RunConfig) -> TimePlan:
    """Return a time plan of as many steps as a check may take, with fields kept after each."""
    most = MOST // (body_mesh(config.macro).size * max(1, len(_loads(config))))
    parts = next((n for n in range(PARTS, 1, -1) if len(_times(config, n)) <= most), 1)
    return TimePlan.model_validate(_whole_segments(config) | {"profiles": _times(config, parts)})


def _times(config: RunConfig, parts: int) -> tuple[float, ...]:
    """Return the ends of steps, ``parts`` from each kink to the next, but none shorter than steps that are given."""
    time = config.macro.time
    ramp = time.ramp_increments * time.ramp_step
    stepper, times = Stepper(TimePlan.model_validate(_whole_segments(config)), config.macro.corners), [0.0]
    while not stepper.done:
        stepper.accept()
        times.append(stepper.time)
    found = []
    for begin, end in pairwise(times):
        own = time.ramp_step if end <= ramp * (1 + SAME) else time.step
        least, most = (math.ceil((end - begin) / step - SAME) for step in ((time.end - ramp) / STEPS, own))
        count = max(least, parts if time.tolerance else min(parts, most), 1)
        found += [begin + (end - begin) * k / count for k in range(1, count)] + [end]
    return tuple(found)


def _whole_segments(config: RunConfig) -> dict[str, object]:
    """Return settings of time whose only stops are the kinks of what is prescribed, the end of the ramp and the end."""
    time = config.macro.time
    ramp = time.ramp_increments * time.ramp_step
    settings = time.model_dump() | {"ramp_increments": 1, "ramp_step": ramp, "tolerance": None}
    return settings | {"step": time.end, "profiles": ()}
