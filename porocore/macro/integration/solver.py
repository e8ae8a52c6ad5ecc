"""Base of macro solvers (TimeSteppingMacroSolver): loop over steps, state at rest, half steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from porocore.core.echo import echo
from porocore.core.fields import provided
from porocore.core.models.bounds import LARGEST_NUMBER
from porocore.core.parallel.memory import freed_memory_kept
from porocore.errors import ConfigurationError, SolveError
from porocore.interfaces.law import Interval, LawMemory, MacroLaw, MacroResponse
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.sensitivities import HistoryWeights, MacroChange, MacroSensitivities
from porocore.interfaces.solution import MacroSolution, StepReport, StepWork
from porocore.macro.boundary.contact import ContactScales
from porocore.macro.boundary.symmetry import ACROSS, across_plane
from porocore.macro.composition.regions import BodyFields, CellsAtPoints
from porocore.macro.integration.checkpoint import CheckpointFile, HistoryRecorder
from porocore.macro.integration.discretisation import Discretisation, StepFailed
from porocore.macro.integration.free_swelling import FreeSwelling, require_apart, starts_swollen
from porocore.macro.integration.newton import Linearisations, Predictor, Step, newton_step
from porocore.macro.integration.stepping import ErrorControl, Reached, Stepper, TimeState
from porocore.macro.laws.composed import TurnedLaw
from porocore.macro.sensitivities.adjoint import GradientPass, RunTape
from porocore.macro.sensitivities.direct import SensitivityTracker
from porocore.states import Array, BodyPlace, MacroState


class TimeSteppingMacroSolver(MacroSolver[Discretisation]):
    """Macro solver that integrates in time, with sensitivities; a subclass prepares its discretisation.

    Parameters
    ----------
    checkpoint_seconds
        Wall time between two checkpoints; 0 writes one after every step.

    Raises
    ------
    ConfigurationError
        It is no time.
    """

    sensitivities = True
    gradients = True

    def __init__(self, *, checkpoint_seconds: float = 5.0) -> None:
        if (
            isinstance(checkpoint_seconds, bool)
            or not isinstance(checkpoint_seconds, int | float)
            or not 0 <= checkpoint_seconds <= LARGEST_NUMBER
        ):
            raise ConfigurationError(
                f"macro.options.checkpoint_seconds: expected a number of at least 0, got {echo(checkpoint_seconds)}"
            )
        self.checkpoint_seconds = float(checkpoint_seconds)

    def remark(self, prepared: Discretisation) -> str:
        """Return the line that the backend gave its linear solver."""
        return prepared.linear.choice

    def solve(
        self,
        prepared: Discretisation,
        law: MacroLaw,
        *,
        checkpoint: Path | None = None,
        on_step: Callable[[StepReport], None] | None = None,
    ) -> MacroSolution:
        """Run through the time plan of the problem; see :meth:`porocore.MacroSolver.solve`.

        Every process comes back with the whole solution; process 0 alone writes.

        Raises
        ------
        SolveError
            Newton's iteration fails at the smallest step.
        DataError
            The checkpoint is damaged, or belongs to another problem or law.
        """
        body, law = _composed(prepared, law)
        with freed_memory_kept(prepared.mesh.size):
            return self._integrated(prepared, body, law, checkpoint, on_step)

    def solve_with_sensitivities(
        self,
        prepared: Discretisation,
        law: MacroLaw,
        changes: Sequence[MacroChange],
        *,
        profiles: bool = False,
        on_step: Callable[[StepReport], None] | None = None,
    ) -> tuple[MacroSolution, MacroSensitivities]:
        """Run through the time plan with derivatives; see :meth:`porocore.MacroSolver.solve_with_sensitivities`."""
        body, law = _composed(prepared, law)
        with prepared.communicator.united():
            tracker = SensitivityTracker(prepared, body, law, changes, profiles=profiles)
        with freed_memory_kept(prepared.mesh.size):
            solution = self._integrated(prepared, body, law, None, on_step, tracker)
        return solution, tracker.result()

    def solve_with_gradients(
        self,
        prepared: Discretisation,
        law: MacroLaw,
        changes: Sequence[MacroChange],
        weights: Callable[[MacroSolution], HistoryWeights],
        *,
        on_step: Callable[[StepReport], None] | None = None,
    ) -> tuple[MacroSolution, Array]:
        """Run through the time plan, and back; see :meth:`porocore.MacroSolver.solve_with_gradients`."""
        body, law = _composed(prepared, law)
        with prepared.communicator.united():
            back, tape = GradientPass(prepared, body, law, changes), RunTape()
        with freed_memory_kept(prepared.mesh.size):
            solution = self._integrated(prepared, body, law, None, on_step, tape)
            return solution, back.gradients(tape, weights(solution))

    def _integrated(
        self,
        d: Discretisation,
        body: BodyFields,
        law: MacroLaw,
        checkpoint: Path | None,
        on_step: Callable[[StepReport], None] | None,
        tracker: SensitivityTracker | RunTape | None = None,
    ) -> MacroSolution:
        """Return the solution of a law in the axes of its material; a ``tracker`` follows its steps."""
        problem, d.origin = d.problem, None
        if d.boundary.contacts:
            d.contact_scales = _contact_scales(d, law, body)
        saved = CheckpointFile(checkpoint, d, law, self.checkpoint_seconds, body)
        course = _Course(Stepper(problem.time, problem.corners), ErrorControl(d, law.internal), Predictor())
        if problem.time.tolerance is not None and course.control.follows_variables:
            rest = _fields_at(d, body, 0.0).given_to(MacroState.zeros(d.n_points))
            course.control.start = law.initial_at(rest).internal
        known = saved.load(course.stepper, course.control, course.predictor)
        if known is None and starts_swollen(problem):
            known = self._swollen(d, body, law, course.predictor, tracker)
        elif known is None:
            known = _at_rest(d, law, course.predictor, body)
            if tracker is not None:
                tracker.begin(*known)
        _run_through(d, body, law, course, known, saved, on_step, tracker)
        return known[2].solution(law.name, body)

    def _swollen(
        self,
        d: Discretisation,
        body: BodyFields,
        law: MacroLaw,
        predictor: Predictor,
        tracker: SensitivityTracker | RunTape | None,
    ) -> tuple[Array, LawMemory, HistoryRecorder]:
        """Return the state of free swelling in the bath, from which prescribed displacements are counted."""
        free = FreeSwelling.prepared(self.prepare, d, body, law)
        follower = None if tracker is None else tracker.of_swelling(free)
        course = _Course(Stepper(free.d.problem.time), ErrorControl(free.d, law.internal), Predictor())
        start = _at_rest(free.d, free.law, course.predictor, free.body)
        if follower is not None:
            follower.begin(*start)
        unsaved = CheckpointFile(None, free.d, free.law, 0.0)
        try:
            x, memory = _run_through(free.d, free.body, free.law, course, start, unsaved, None, follower)
        except SolveError as error:
            raise SolveError(f"the free swelling of the body in its bath is not found: {error}") from None
        d.origin = free.local(d, x)
        record = HistoryRecorder(d, law.internal)
        states, grad_p = d.states(d.origin)
        states = _fields_at(d, body, 0.0).given_to(states)
        response = law.respond(states, grad_p, memory, tangent=False)
        record.add_start(d.origin, response)
        require_apart(d)
        predictor.add(0.0, d.origin, kink=True)
        known = d.origin, response.memory, record
        if tracker is not None:
            tracker.begin(*known)
        return known


@dataclass
class _Course:
    """Course of a run in time: its steps, their error, and states that are continued."""

    stepper: Stepper
    control: ErrorControl
    predictor: Predictor


def _run_through(
    d: Discretisation,
    body: BodyFields,
    law: MacroLaw,
    course: _Course,
    start: tuple[Array, LawMemory, HistoryRecorder],
    saved: CheckpointFile,
    on_step: Callable[[StepReport], None] | None,
    tracker: SensitivityTracker | RunTape | None,
) -> tuple[Array, LawMemory]:
    """Take all steps that are left, record them, and return unknowns and memory at the end."""
    problem, stepper, control, predictor = d.problem, course.stepper, course.control, course.predictor
    x, memory, record = start
    reached = Reached(d.boundary, problem) if problem.time.tolerance is not None else None
    linearisations = Linearisations(d, law, varies=body.varies)
    newton = _newton(d, law, linearisations)
    d.begin()
    while not stepper.done:
        time = stepper.next()
        interval, loads = Interval(stepper.time, time), d.loads_at(time)
        finer = None
        try:
            here = {"guess": predictor.guess(time), "fields": _fields_at(d, body, time)}
            step = newton(memory, x, interval, loads, before=d.loads_at(stepper.time), **here)
            changed = law.before_accept(step.response, memory)
            if changed is None and reached is not None and control.rate is None:
                finer = _halved(newton, d, body, memory, x, stepper.time, time)
        except StepFailed as failure:
            stepper.reject(str(failure), partial(_flagged_points, d, law, memory, x, stepper.time))
            continue
        if changed is not None:
            memory = changed
            if tracker is not None:
                tracker.renew(memory, stepper.time)
            continue
        old, new = TimeState(x, memory.internal), TimeState(step.x, step.response.memory.internal)
        error = None
        if reached is not None:
            error = control.error(old, new, interval.length, finer, reached(time))
        if not stepper.tolerates(error):
            continue
        control.accept(old, new, interval.length)
        if tracker is not None:
            tracker.add(step, memory, interval, loads, linearisations)
        x, memory = step.x, step.response.memory
        work, notes = d.linear.take()
        record.add_step(step, time, interval.length, loads, work)
        if stepper.is_profile(time):
            record.add_profile(step.x, step.response, time, loads)
            if tracker is not None:
                tracker.add_profile()
        stepper.accept(error)
        if stepper.at_corner:
            control.reset()
        predictor.add(time, x, stepper.at_corner)
        saved.save_if_due(stepper, control, predictor, x, step.response, record)
        if on_step is not None:
            on_step(_report(record, step, time, work, notes))
    return x, memory


def _composed(d: Discretisation, law: MacroLaw) -> tuple[BodyFields, MacroLaw]:
    """Return the fields of the body at the points of this process, and the law in the axes of its material."""
    with d.communicator.united():
        body = BodyFields(d.problem, d.mesh, law, d.elements)
    return body, TurnedLaw(law) if body.turned else law


def _newton(d: Discretisation, law: MacroLaw, linearisations: Linearisations) -> Callable[..., Step]:
    """Return Newton's method for a step."""
    return partial(newton_step, d, law, settings=d.problem.newton, linearisations=linearisations)


def _report(
    record: HistoryRecorder, step: Step, time: float, work: StepWork, notes: tuple[str, ...]
) -> StepReport:
    settlement, heave, moved = (
        float(record.column(name)[-1]) for name in ("settlement", "heave", "displacement")
    )
    return StepReport(time, record.d.problem.time.end, step.iterations, settlement, work, notes, heave, moved)


def _fields_at(d: Discretisation, body: BodyFields, time: float) -> CellsAtPoints:
    """Return parameters and places at ``time``; a formula without a value on one process ends all."""
    if not body.varies:
        return body.at(time)
    with d.communicator.united():
        return body.at(time)


def _halved(
    newton: Callable[..., Step],
    d: Discretisation,
    body: BodyFields,
    memory: LawMemory,
    x: Array,
    begin: float,
    end: float,
) -> TimeState:
    """Return what is reached at ``end`` after two steps of half the length from ``x`` at ``begin``."""
    middle = begin + (end - begin) / 2
    before = d.loads_at(begin)
    for interval in (Interval(begin, middle), Interval(middle, end)):
        loads = d.loads_at(interval.end)
        fields = _fields_at(d, body, interval.end)
        step = newton(memory, x, interval, loads, fields=fields, before=before)
        x, memory, before = step.x, step.response.memory, loads
    return TimeState(x, memory.internal)


def _at_rest(
    d: Discretisation, law: MacroLaw, predictor: Predictor, body: BodyFields
) -> tuple[Array, LawMemory, HistoryRecorder]:
    """Return the unknowns of the initial state, the law's memory of it, and a recorder that begins with it.

    The predictor begins with it, too.
    """
    start, mesh, record = d.problem.initial, d.mesh, HistoryRecorder(d, law.internal)
    whole = np.concatenate(
        [(mesh.points @ np.array(start.gradient).T).ravel(), np.full(len(mesh.p_nodes), start.pressure)]
    )
    x = d.from_mesh(whole)
    states, grad_p = d.states(x)
    states = _fields_at(d, body, 0.0).given_to(states)
    response = law.respond(states, grad_p, law.initial_at(states), tangent=mesh.flat)
    if mesh.flat:
        _require_in_plane(d, response)
    record.add_start(x, response)
    predictor.add(0.0, x, kink=True)
    return x, response.memory, record


def _require_in_plane(d: Discretisation, response: MacroResponse) -> None:
    """Refuse a cell that would shear a body in two dimensions out of its plane.

    Raises
    ------
    ConfigurationError
        It is no mirror image of itself in the plane z = 0.
    """
    share = d.communicator.max(across_plane(response))
    if share > ACROSS:
        kind, about = (
            ("an axisymmetric body", "turns it about its axis")
            if d.mesh.revolved
            else ("a body in plane strain", "shears it out of its plane")
        )
        raise ConfigurationError(
            f"macro.body: {kind} needs a cell that is its own mirror image in the plane z = 0, "
            f"but what happens in the plane {about}: a stress P_13 or P_23 of {100 * share:.2g} % of the stiffness; "
            "turn the material axes (macro.fields.axes), or take a body of three dimensions"
        )


def _contact_scales(d: Discretisation, law: MacroLaw, body: BodyFields) -> ContactScales:
    """Return the largest stiffness and conductivity of the undeformed elements behind contacts."""
    near = np.unique(np.concatenate([contact.facets.elements for contact in d.boundary.contacts]))
    own = np.flatnonzero(np.repeat(np.isin(d.elements, near), d.n_points // max(len(d.elements), 1)))
    largest, states = np.zeros(2), _fields_at(d, body, 0.0).given_to(MacroState.zeros(d.n_points))
    if len(own):
        states = states[own]
        tangent = provided(law.respond(states, np.zeros((len(own), 3)), law.initial_at(states)).tangent)
        largest = np.array([np.abs(each).max() for each in (tangent.stress_grad_u, tangent.flux_grad_p)])
    return ContactScales.rounded(*(d.communicator.max(float(each)) for each in largest))


def _flagged_points(d: Discretisation, law: MacroLaw, memory: LawMemory, x: Array, time: float) -> str:
    """Return how many points are flagged at the unknowns ``x``, and why one of them is; empty where none is.

    It is the one with the largest displacement gradient.
    """
    local, grad_p = d.states(x)
    local = replace(local, parameters=memory.states.parameters, place=memory.states.place)
    flagged = law.respond(local, grad_p, memory, step=Interval(time, time), tangent=False).flagged
    outside = d.points_to_mesh(flagged.astype(float)) > 0
    if not outside.any():
        return ""
    states = _on_all(d, local)
    worst = int(np.where(outside, np.abs(states.grad_u).max(axis=(1, 2)), -1.0).argmax())
    (why,) = law.reasons(states[[worst]])
    flags = f"; before it {int(outside.sum())} of {len(outside)} points are flagged"
    return flags + (why and f", one of them for {why}")


def _on_all(d: Discretisation, states: MacroState) -> MacroState:
    """Return the states of all points on every process."""
    theta, place = states.parameters, states.place
    if place is not None:
        region = np.rint(d.points_to_mesh(place.region.astype(float))).astype(np.int64)
        tensors = (None if part is None else d.points_to_mesh(part) for part in (place.axes, place.position))
        place = BodyPlace(region, *tensors)
    theta = None if theta is None else d.points_to_mesh(theta)
    return MacroState(d.points_to_mesh(states.grad_u), d.points_to_mesh(states.p), theta, place)
