"""The time loop of every macro backend: step, Newton, record, checkpoint."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import monotonic

import numpy as np

from porocore.interfaces.law import LawMemory, MacroLaw
from porocore.interfaces.solution import MacroSolution, StepReport
from porocore.macro.integration import checkpoint as checkpoints
from porocore.macro.integration.adaptive import ErrorControl, Reached
from porocore.macro.integration.discretisation import Discretisation, StepFailed
from porocore.macro.integration.flagged import flagged
from porocore.macro.integration.newton import newton_step
from porocore.macro.integration.recorder import HistoryRecorder
from porocore.macro.integration.stepping import Stepper
from porocore.states import Array


def integrate_in_time(
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
    communicator, problem = d.communicator, d.problem
    stepper, control = Stepper(problem.time, problem.corners), ErrorControl()
    reached = Reached(d.boundary, problem) if problem.time.tolerance is not None else None
    owner = checkpoints.identity(problem, law)
    if checkpoint is not None and communicator.on_root(checkpoint.exists):
        x, memory, record = checkpoints.load(checkpoint, owner, stepper, control, d, law)
    else:
        x, memory, record = _at_rest(d, law)
    written = monotonic()
    while not stepper.done:
        time = stepper.next()
        dt, amplitudes = time - stepper.time, d.boundary.amplitudes(problem, time)
        finer = None
        try:
            step = newton_step(d, law, memory, x, dt, d.loads(amplitudes), problem.newton)
            changed = law.before_accept(step.response, memory)
            if changed is None and reached is not None and control.rate is None:
                finer = _halved(d, law, memory, x, stepper.time, time)
        except StepFailed as failure:
            stepper.reject(str(failure), partial(flagged, d, law, memory, x))
            continue
        if changed is not None:
            memory = changed
            continue
        error = None if reached is None else control.error(d, x, step.x, dt, finer, reached(time))
        if not stepper.tolerates(error):
            continue
        control.accept(x, step.x, dt)
        x, memory = step.x, step.response.memory
        record.add_step(step, time, dt, amplitudes)
        if stepper.is_profile(time):
            record.add_profile(step, time)
        stepper.accept(error)
        if stepper.at_corner:
            control.forget()
        if checkpoint is not None:
            # The clocks of two processes differ, so one of them decides.
            late = communicator.on_root(partial(_is_late, written + checkpoint_seconds))
            if stepper.done or late:
                checkpoints.save(checkpoint, owner, stepper, control, d, x, memory, record)
                written = monotonic()
        if on_step is not None:
            settlement = float(record.column("settlement")[-1])
            on_step(StepReport(time, problem.time.end, step.iterations, settlement))
    return record.solution(law.name)


def _halved(d: Discretisation, law: MacroLaw, memory: LawMemory, x: Array, begin: float, end: float) -> Array:
    """Return the unknowns at ``end`` after two steps of half the length from ``x`` at ``begin``.

    Raises
    ------
    StepFailed
        One of them fails.
    """
    dt = (end - begin) / 2
    for time in (begin + dt, end):
        loads = d.loads(d.boundary.amplitudes(d.problem, time))
        step = newton_step(d, law, memory, x, dt, loads, d.problem.newton)
        x, memory = step.x, step.response.memory
    return x


def _at_rest(d: Discretisation, law: MacroLaw) -> tuple[Array, LawMemory, HistoryRecorder]:
    """Return the unknowns of the initial state, the law's memory of it, and a recorder that begins with it."""
    start, mesh, record = d.problem.initial, d.mesh, HistoryRecorder(d)
    whole = np.concatenate(
        [(mesh.points @ np.array(start.gradient).T).ravel(), np.full(len(mesh.p_nodes), start.pressure)]
    )
    x = d.from_mesh(whole)
    states, grad_p = d.states(x)
    response = law.respond(states, grad_p, law.initial(d.n_points), tangent=False)
    record.add_start(x, response)
    return x, response.memory, record


def _is_late(due: float) -> bool:
    return monotonic() >= due
