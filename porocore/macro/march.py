"""The time loop of every macro backend: step, Newton, record, checkpoint."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import monotonic

import numpy as np

from porocore.laws import MacroLaw
from porocore.macro import checkpoint as checkpoints
from porocore.macro.discretisation import Discretisation, StepFailed
from porocore.macro.newton import newton_step
from porocore.macro.record import Record
from porocore.solution import MacroSolution, StepReport
from porocore.stepping import Stepper


def march(
    d: Discretisation,
    law: MacroLaw,
    *,
    checkpoint: Path | None = None,
    on_step: Callable[[StepReport], None] | None = None,
    checkpoint_seconds: float = 5.0,
) -> MacroSolution:
    """Run through the time plan of the problem; see :meth:`porocore.MacroSolver.solve`.

    ``checkpoint_seconds`` is the wall time between two checkpoints; with 0 one is written after every step.
    Every process comes back with the whole solution; process 0 alone writes.

    Raises
    ------
    SolveError
        Newton's iteration fails at the smallest step.
    DataError
        The checkpoint is damaged, or belongs to another problem or law.
    """
    world, problem = d.world, d.problem
    stepper, x = Stepper(problem.time), np.zeros(len(d.unknowns))
    owner = checkpoints.identity(problem, law)
    if checkpoint is not None and world.first(checkpoint.exists):
        x, memory, record = checkpoints.load(checkpoint, owner, stepper, d, law)
    else:
        memory, record = law.initial(d.n_points), Record()
        states, grad_p = d.states(x)
        record.add_rest(d, law.respond(states, grad_p, memory, tangent=False))
    written = monotonic()
    while not stepper.done:
        time = stepper.next()
        dt, ramp = time - stepper.time, problem.ramp(time)
        try:
            step = newton_step(d, law, memory, x, dt, problem.load * ramp, problem.newton)
        except StepFailed as failure:
            stepper.reject(str(failure))
            continue
        changed = law.reconsider(step.response, memory)
        if changed is not None:
            memory = changed
            continue
        x, memory = step.x, step.response.memory
        record.add_step(d, step, time, dt, ramp)
        if stepper.is_profile(time):
            record.add_profile(d, step, time)
        stepper.accept()
        if checkpoint is not None:
            # The clocks of two processes differ, so one of them decides.
            late = world.first(partial(_is_late, written + checkpoint_seconds))
            if stepper.done or late:
                checkpoints.save(checkpoint, owner, stepper, d, x, memory, record)
                written = monotonic()
        if on_step is not None:
            settlement = float(record.column("settlement")[-1])
            on_step(StepReport(time, problem.time.end, step.iterations, settlement))
    return record.solution(d, law.name)


def _is_late(due: float) -> bool:
    return monotonic() >= due
