"""Sensitivities of a run, followed from step to step.

With backward Euler a step solves R(x, m, θ) = 0 for the unknowns x, with m what the law remembers of the last accepted
state. So J δx = −∂R/∂θ − ∂R/∂m δm for each unknown θ, with the tangent J at the solution and the total derivative δm
of the memory.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from porocore.core.fields import provided
from porocore.core.units import units_now
from porocore.errors import SolveError
from porocore.interfaces.law import (
    Interval,
    LawMemory,
    MacroLaw,
    MacroResponse,
    MemoryChanges,
    ResponseChanges,
)
from porocore.interfaces.sensitivities import (
    HISTORY_SERIES,
    MacroChange,
    MacroSensitivities,
    ModulusChange,
    PointChange,
)
from porocore.interfaces.solution import CONTACT
from porocore.macro.boundary.conditions import Loads
from porocore.macro.composition.regions import BodyFields
from porocore.macro.integration.checkpoint import OUTFLOW, HistoryRecorder, extremes
from porocore.macro.integration.discretisation import Discretisation, Residual, StepFailed, SurfaceTangent
from porocore.macro.integration.free_swelling import FreeSwelling
from porocore.macro.integration.newton import (
    ROUND_OFF,
    Linearisation,
    Linearisations,
    Step,
    largest_free,
    misfit_of,
)
from porocore.macro.sensitivities.changes import Directions
from porocore.states import Array, MacroState

#: Relative residual of a solution that is small enough, one that is too large, and the corrections at most.
SMALL, TOO_LARGE, CORRECTIONS = 1e-10, 1e-7, 3


@dataclass(frozen=True, eq=False)
class UnknownChange:
    """Derivatives of stress (n, 3, 3), storage (n,) and flux (n, 3) at the points by one unknown."""

    stress: Array
    storage: Array
    flux: Array

    @classmethod
    def each(cls, changes: ResponseChanges) -> list[UnknownChange]:
        """Return those by each of k unknowns."""
        parts = (
            np.ascontiguousarray(np.moveaxis(part, -1, 0))
            for part in (changes.stress, changes.storage, changes.flux)
        )
        return [cls(*each) for each in zip(*parts, strict=True)]


def changes_at_points(d: Discretisation, x: list[Array]) -> tuple[Array, Array, Array]:
    """Return the changes of H (n, 3, 3, k), p (n, k) and ∇p (n, 3, k) under changes of the unknowns."""
    found = [d.states(each) for each in x]
    return (
        np.stack([states.grad_u for states, _ in found], axis=-1),
        np.stack([states.p for states, _ in found], axis=-1),
        np.stack([grad_p for _, grad_p in found], axis=-1),
    )


@dataclass(frozen=True, eq=False)
class StepEquations:
    """Equations J δx = −∂R of one step for k unknowns, with the tangent J at its solution.

    Attributes
    ----------
    d
        Discretisation.
    linear
        The tangent.
    response, fixed, before
        Of the law at the solution, with its tangent; its derivatives at fixed (H, p, ∇p); those of the memory.
    x : (local unknowns,)
        The solution.
    dt, loads
        Of the step.
    own
        Changes of the loads, one for each unknown.
    """

    d: Discretisation
    linear: Linearisation
    response: MacroResponse
    fixed: ResponseChanges
    before: MemoryChanges
    x: Array
    dt: float
    loads: Loads
    own: list[Loads]

    def solved(self) -> tuple[list[Array], list[UnknownChange], MemoryChanges, list[Array]]:
        """Return the derivatives of the unknowns, of what is integrated, of the memory, and of the residual.

        Raises
        ------
        StepFailed
            A system has no solution.
        """
        d = self.d
        x = [self._prescribed(own) for own in self.own]
        lifted = d.communicator.max(float(any(each.any() for each in x))) > 0
        parts = self._moved(x)[0] if lifted else UnknownChange.each(self.fixed)
        residuals = [self._residual(*each) for each in zip(parts, self.own, x, strict=True)]
        misfits, still = [np.inf] * len(x), np.zeros(len(d.prescribed))
        for _ in range(1 + CORRECTIONS):
            for j, misfit in enumerate(misfits):
                if misfit > SMALL:
                    x[j] = x[j] - self.linear.system.solve(residuals[j].values, still, again=True)
            parts, memory = self._moved(x)
            residuals = [self._residual(*each) for each in zip(parts, self.own, x, strict=True)]
            misfits = [self._misfit(*each) for each in zip(residuals, x, strict=True)]
            if max(misfits) <= SMALL:
                break
        if not max(misfits) <= TOO_LARGE:
            raise StepFailed(f"the linear solver leaves {max(misfits):.2g} of the right-hand side")
        return x, parts, memory, [residual.values for residual in residuals]

    def _prescribed(self, own: Loads) -> Array:
        """Return the changes of the prescribed unknowns, and zero elsewhere."""
        x = np.zeros(len(self.d.unknowns))
        x[self.d.prescribed] = own.values
        return x

    def _moved(self, x: list[Array]) -> tuple[list[UnknownChange], MemoryChanges]:
        """Return the total derivatives of what is integrated and of the memory where the unknowns change by ``x``."""
        moved = changes_at_points(self.d, x)
        total, memory = self.fixed.moved(provided(self.response.tangent), self.before, *moved)
        return UnknownChange.each(total), memory

    def _misfit(self, residual: Residual, x: Array) -> float:
        """Return the largest residual over its scale; zero where only round-off is left, as of a rigid motion."""
        d, misfit = self.d, misfit_of(self.d, residual)
        if misfit <= SMALL:
            return misfit
        force, volume = largest_free(d, self.linear.system.magnitudes(x))
        return misfit_of(d, residual, (ROUND_OFF * force, ROUND_OFF * volume))

    @cached_property
    def _surface(self) -> SurfaceTangent | None:
        return self.d.surface_tangent(self.x, self.loads, self.dt)

    @cached_property
    def _surface_changes(self) -> dict[int, Array]:
        """Derivatives of the forces on the surface by each change of the loads."""
        return {id(own): self.d.surface_change(self.x, self.loads, own, self.dt) for own in self.own}

    def _residual(self, change: UnknownChange, own: Loads, x: Array) -> Residual:
        """Return the total derivative of the residual by one unknown, which is zero in the equations."""
        d, surface = self.d, self._surface
        found = d.residual(change, self.dt, own)
        if surface is None:
            return found
        moved = self._surface_changes[id(own)] + d.surface_product(surface, x)
        return replace(found, values=found.values + moved)


DRAINED = HISTORY_SERIES.index("drained")


class SensitivityTracker:
    """Derivatives of a run by its unknowns, followed from step to step, and those of its histories.

    Parameters
    ----------
    d, body, law
        Of the run.
    changes
        The unknowns.
    profiles
        Whether the derivatives of the nodal fields in the profiles are kept.

    Raises
    ------
    ConfigurationError
        An unknown is of what the problem does not have.
    """

    _record: HistoryRecorder
    _chosen: list[int]

    def __init__(
        self,
        d: Discretisation,
        body: BodyFields,
        law: MacroLaw,
        changes: Sequence[MacroChange],
        *,
        profiles: bool = False,
    ) -> None:
        self._d, self._law, self._changes = d, law, tuple(changes)
        self._directions = Directions(d, body, law, changes)
        self._x = self._directions.start()
        self._memory = MemoryChanges.zeros(d.n_points, law.memory_size, len(self._x))
        #: Values by unknown of each step: series of the history; probes; reactions and inflows.
        self._rows: list[Array] = []
        self._profiles: list[Array] | None = [] if profiles else None
        #: The swelling with which the run begins, and what follows it.
        self._swelling: tuple[FreeSwelling, SensitivityTracker] | None = None
        self._origin: list[Array] | None = None

    def of_swelling(self, free: FreeSwelling) -> SensitivityTracker:
        """Return what follows the swelling with which the run begins, by those unknowns that change the points."""
        self._chosen = [j for j, each in enumerate(self._changes) if isinstance(each, PointChange)]
        chosen = [self._changes[j] for j in self._chosen] or [ModulusChange()]
        self._swelling = free, SensitivityTracker(free.d, free.body, free.law, chosen)
        return self._swelling[1]

    def begin(self, x: Array, memory: LawMemory, record: HistoryRecorder) -> None:
        """Take the initial state, t = 0, and the memory of it."""
        self._record, boundary = record, self._d.boundary
        if self._swelling is not None:
            self._begin_swollen(*self._swelling)
        forces, nothing = (
            self._first_forces(),
            np.zeros(len(boundary.drains) + len(CONTACT) * len(boundary.contacts)),
        )
        nodal = self._nodal(x, [0.0] * len(self._x))
        self._rows.append(
            np.stack(
                [np.concatenate([*each, force, nothing]) for each, force in zip(nodal, forces, strict=True)]
            )
        )
        if self._swelling is None:
            states, points = memory.states, self._directions.points(memory.states)
            before = replace(self._memory, fluid_volume=self._law.rest_changes(states, points))
            self._remember(self._law.initial_at(states), states, before, None)
        self.add_profile()

    def _begin_swollen(self, free: FreeSwelling, swelling: SensitivityTracker) -> None:
        """Take the derivatives of the swollen state."""
        known, memory = swelling._memory, self._memory
        for place, j in enumerate(self._chosen):
            self._x[j] = free.local(self._d, swelling._x[place])
            memory.grad_u[..., j] = known.grad_u[..., place]
            memory.fluid_volume[:, j] = known.fluid_volume[:, place]
            memory.internal[..., j] = known.internal[..., place]
        self._origin = [each.copy() for each in self._x]

    def _first_forces(self) -> Array:
        """Return the derivatives (k, 3 · supports) of the forces with which a run begins, those of a swollen state."""
        supports = list(self._d.boundary.supports)
        found = np.zeros((len(self._x), len(supports), 3))
        if self._swelling is not None:
            reactions = self._swelling[1].result().reactions
            for place, name in enumerate(supports):
                if name in reactions:
                    found[self._chosen, place] = reactions[name][-1].T[: len(self._chosen)]
        return found.reshape(len(self._x), -1)

    def add_profile(self) -> None:
        """Keep the derivatives of the nodal fields of the last accepted state, of which there is a profile."""
        if self._profiles is not None:
            self._profiles.append(np.stack([self._d.to_mesh(each) for each in self._x], axis=1))

    def renew(self, memory: LawMemory, time: float) -> None:
        """Take another memory of the same state at ``time``, as of a law that has learned more."""
        self._remember(memory, memory.states, self._memory, Interval(time, time))

    def _remember(
        self, memory: LawMemory, states: MacroState, before: MemoryChanges, step: Interval | None
    ) -> None:
        """Take the derivatives of the law's memory of the present state, which it comes to from ``memory``."""
        points, still = self._directions.points(states), np.zeros((len(states), 3))
        response, fixed = self._law.respond_to_changes(states, still, memory, points, before, step=step)
        moved = changes_at_points(self._d, self._x)
        self._memory = fixed.moved(provided(response.tangent), before, *moved)[1]

    def add(
        self,
        step: Step,
        memory: LawMemory,
        interval: Interval,
        loads: Loads,
        linearisations: Linearisations,
    ) -> None:
        """Follow an accepted step that began from ``memory``.

        Raises
        ------
        SolveError
            A linear system has no solution.
        """
        d, record, states = self._d, self._record, step.response.memory.states
        time, dt = interval.end, interval.length
        points, own = self._directions.points(states), self._directions.loads(time)
        if self._origin is not None:  # from which prescribed displacements are counted
            moved = zip(own, self._origin, strict=True)
            own = [replace(each, values=each.values + x[d.prescribed]) for each, x in moved]
        response, fixed = self._law.respond_to_changes(
            states, d.states(step.x)[1], memory, points, self._memory, step=interval
        )
        try:
            linear = linearisations.begin(dt, loads) or linearisations.at(response, dt, step.x, loads)
            equations = StepEquations(d, linear, response, fixed, self._memory, step.x, dt, loads, own)
            self._x, total, self._memory, residuals = equations.solved()
        except StepFailed as failure:
            raise SolveError(
                f"the derivatives at t = {units_now().text(time, 'time', 6)} have no solution: {failure}"
            ) from failure
        touched = d.contact_changes(step.x, loads, self._x, own)
        left = [
            before + record.outflow(residual, each, dt) + dt * float(measured[OUTFLOW :: len(CONTACT)].sum())
            for before, residual, each, measured in zip(
                self._rows[-1][:, DRAINED], residuals, own, touched, strict=True
            )
        ]
        rows = zip(self._nodal(step.x, left), residuals, total, touched, strict=True)
        self._rows.append(
            np.stack(
                [
                    np.concatenate([*nodal, *record.sums(residual, at_points, dt), measured])
                    for nodal, residual, at_points, measured in rows
                ]
            )
        )

    def _nodal(self, x: Array, drained: Sequence[float]) -> list[tuple[Array, Array]]:
        """Return for each unknown the derivatives of the series of the history, and those of the probes."""
        d, found = self._d, []
        places = extremes(d.to_mesh(x), d.mesh.n_u)
        for change, left in zip(self._x, drained, strict=True):
            moved = d.to_mesh(change)
            series = {"drained": left} | {name: sign * moved[i] for name, (i, sign) in places.items()}
            found.append((np.array([series[name] for name in HISTORY_SERIES]), self._record.probe @ moved))
        return found

    def result(self) -> MacroSensitivities:
        """Return the derivatives of the histories."""
        rows, boundary = np.swapaxes(np.array(self._rows), 1, 2), self._d.boundary
        first, found = len(HISTORY_SERIES), []
        contacts, seven = [each.name for each in boundary.contacts], len(CONTACT)
        groups: tuple[tuple[Collection[str], int], ...] = (
            (self._d.problem.probes, 4),
            (boundary.supports, 3),
            (boundary.drains, 1),
            (contacts, seven),
        )
        for names, width in groups:
            found.append(
                {name: rows[:, first + i * width : first + (i + 1) * width] for i, name in enumerate(names)}
            )
            first += width * len(names)
        return MacroSensitivities(
            self._changes,
            **{name: rows[:, i] for i, name in enumerate(HISTORY_SERIES)},
            probes=found[0],
            reactions=found[1],
            inflow={name: values[:, 0] for name, values in found[2].items()},
            compression={},
            profiles=None if self._profiles is None else np.array(self._profiles),
            contact=found[3],
        )
