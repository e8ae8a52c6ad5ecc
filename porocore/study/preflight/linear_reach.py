"""Linear solutions of a study's body in few steps, before any cell but the one at rest is solved."""

from __future__ import annotations

from porocore.interfaces.solution import MacroSolution
from porocore.macro.integration.stepping import Stepper
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.macro.problem import TimePlan, body_mesh
from porocore.plugins.border import body_solution_of
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig

#: Steps after the ramp, beside those to the kinks of what is prescribed.
STEPS = 3
#: Unknowns times steps under all loads beyond which a check would take long.
MOST = 200_000


def too_large(config: RunConfig) -> str:
    """Return in words why the body is not solved before a run; empty where it is."""
    size, steps = body_mesh(config.macro).size, len(_plan(config).profiles) * len(_loads(config))
    if size * steps <= MOST:
        return ""
    return f"{size:,} unknowns of the body times {steps} time steps are more than the {MOST:,} of a check"


def linear_solutions(config: RunConfig, coefficients: LinearCoefficients) -> list[MacroSolution]:
    """Return the body's linear solutions on its own mesh under the lowest and the highest load, kept at every step.

    The first step is as long as the ramp, so that it is nearly undrained, and the last ends with the run.

    Raises
    ------
    SolveError
        A step fails, as one under a follower may.
    """
    solver, law = make_backend("macro solver", config), LinearPoroelasticity(coefficients)
    plan, found = _plan(config), []
    for load in _loads(config):
        problem = config.macro.problem(load).model_copy(update={"time": plan})
        found.append(body_solution_of(solver, solver.prepare(problem), law, problem))
    return found


def _loads(config: RunConfig) -> list[float]:
    """Return the ends of the loads and of zero that are not zero."""
    return [load for load in (min(0.0, *config.macro.loads), max(0.0, *config.macro.loads)) if load != 0]


def _plan(config: RunConfig) -> TimePlan:
    """Return a time plan of few steps, with fields kept after each."""
    time = config.macro.time
    ramp = time.ramp_increments * time.ramp_step
    settings = time.model_dump() | {"ramp_increments": 1, "ramp_step": ramp, "tolerance": None}
    settings |= {"step": (time.end - ramp) / STEPS, "profiles": ()}
    stepper, times = Stepper(TimePlan.model_validate(settings), config.macro.corners), []
    while not stepper.done:
        stepper.accept()
        times.append(stepper.time)
    return TimePlan.model_validate(settings | {"profiles": tuple(times)})
