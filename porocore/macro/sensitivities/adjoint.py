"""Gradients of sums over the histories of a run, by one pass backwards over its steps.

A step solves R_n(x_n, m_{n−1}, θ) = 0, and the law remembers m_n = M(x_n, m_{n−1}, θ). The adjoint unknowns λ_n solve
J_nᵀ λ_n = −g_n, where g_n are the weights of x_n in a sum, with those by way of m_n and all later steps. Each unknown
then takes its share of λ_n · ∂R_n/∂θ; so a sum costs one linear solve a step, whatever the number of unknowns.

A sum weighs a value by ∫ weight · value dX, so weights are densities over the undeformed body.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from porocore.core.echo import echo, suggestion
from porocore.core.fields import Batch, provided
from porocore.core.units import units_now
from porocore.errors import ConfigurationError, SolveError
from porocore.interfaces.law import (
    Interval,
    LawMemory,
    MacroLaw,
    MacroResponse,
    MacroTangent,
    MemoryChanges,
    PointChanges,
    ResponseChanges,
)
from porocore.interfaces.sensitivities import (
    HISTORY_SERIES,
    BoundaryChange,
    HistoryWeights,
    IndenterChange,
    LoadChange,
    MacroChange,
    ModulusChange,
    PointChange,
    ViscosityChange,
)
from porocore.interfaces.solution import CONTACT
from porocore.macro.boundary.conditions import Loads
from porocore.macro.composition.regions import BodyFields
from porocore.macro.integration.checkpoint import OUTFLOW, HistoryRecorder, extremes
from porocore.macro.integration.discretisation import (
    CoupledSystem,
    Discretisation,
    StepFailed,
    SurfaceTangent,
)
from porocore.macro.integration.free_swelling import FreeSwelling
from porocore.macro.integration.newton import ROUND_OFF, Linearisation, Linearisations, Step, largest_free
from porocore.macro.sensitivities.changes import Directions
from porocore.macro.sensitivities.direct import CORRECTIONS, SMALL, TOO_LARGE
from porocore.states import Array, MacroState


@dataclass(frozen=True, eq=False)
class PointWeights(Batch):
    """Weights of the stress (n, 3, 3), storage (n,) and flux (n, 3), or of H, p and ∇p in their places."""

    stress: Array
    storage: Array
    flux: Array

    @classmethod
    def zeros(cls, n: int) -> PointWeights:
        """Return the weights of nothing."""
        return cls(np.zeros((n, 3, 3)), np.zeros(n), np.zeros((n, 3)))

    def plus(self, other: PointWeights) -> PointWeights:
        """Return the sum of both."""
        return PointWeights(self.stress + other.stress, self.storage + other.storage, self.flux + other.flux)

    def of_states(self, tangent: MacroTangent) -> PointWeights:
        """Return the weights of H, p and ∇p, on which the response depends by the tangent."""
        n = len(self.storage)
        stress, storage, flux = self.stress.reshape(n, 1, 9), self.storage, self.flux[:, None, :]
        grad_u = stress @ tangent.stress_grad_u.reshape(n, 9, 9) + flux @ tangent.flux_grad_u.reshape(n, 3, 9)
        p = (stress @ tangent.stress_p.reshape(n, 9, 1) + flux @ tangent.flux_p[:, :, None])[:, 0, 0]
        grad_p = (flux @ tangent.flux_grad_p)[:, 0]
        if tangent.stress_grad_p is not None:
            grad_p = grad_p + (stress @ tangent.stress_grad_p.reshape(n, 9, 3))[:, 0]
        if tangent.storage_grad_p is not None:
            grad_p = grad_p + storage[:, None] * tangent.storage_grad_p
        return PointWeights(
            grad_u.reshape(n, 3, 3) + storage[:, None, None] * tangent.storage_grad_u,
            p + storage * tangent.storage_p,
            grad_p,
        )


@dataclass(frozen=True, eq=False)
class MemoryWeights(Batch):
    """Weights of what a :class:`~porocore.interfaces.law.MemoryChanges` has, without the unknowns' axis."""

    grad_u: Array
    fluid_volume: Array
    internal: Array

    @classmethod
    def zeros(cls, n: int, v: int) -> MemoryWeights:
        """Return the weights of nothing."""
        return cls(np.zeros((n, 3, 3)), np.zeros(n), np.zeros((n, v)))

    @property
    def of_points(self) -> PointWeights:
        """Weights of the response: what is taken up changes φ."""
        n = len(self.fluid_volume)
        return PointWeights(np.zeros((n, 3, 3)), self.fluid_volume, np.zeros((n, 3)))

    def of_states(self, fixed: ResponseChanges) -> PointWeights:
        """Return the weights of H, p and ∇p, on which the memory depends but for φ."""
        n, w = len(self.fluid_volume), self.internal[:, None, :]
        v = w.shape[2]
        grad_u = self.grad_u + (w @ fixed.internal_grad_u.reshape(n, v, 9)).reshape(n, 3, 3)
        p = (w @ fixed.internal_p[:, :, None])[:, 0, 0]
        by_grad_p = fixed.internal_grad_p
        return PointWeights(grad_u, p, np.zeros((n, 3)) if by_grad_p is None else (w @ by_grad_p)[:, 0])


@dataclass(frozen=True, eq=False)
class UnitDerivatives:
    """Response with its derivatives at fixed (H, p, ∇p).

    Attributes
    ----------
    response
        With its tangent.
    fixed
        Derivatives by the unit changes of the points.
    by_memory
        Derivatives by the numbers of the memory at the beginning: H, φ, internal variables.
    """

    response: MacroResponse
    fixed: ResponseChanges
    by_memory: ResponseChanges

    def of_memory(self, weights: PointWeights, memory: MemoryWeights) -> MemoryWeights:
        """Return the weights of the memory from which the step began."""
        found = weights_of(self.by_memory, weights, memory)
        return MemoryWeights(found[:, :9].reshape(-1, 3, 3), memory.fluid_volume + found[:, 9], found[:, 10:])


def weights_of(changes: ResponseChanges, weights: PointWeights, memory: MemoryWeights) -> Array:
    """Return the weights (n, k) of the unknowns of ``changes`` from those of the response and of the memory."""
    n, k = changes.storage.shape
    found = (weights.stress.reshape(n, 1, 9) @ changes.stress.reshape(n, 9, k))[:, 0]
    found = found + weights.storage[:, None] * changes.storage + (weights.flux[:, None] @ changes.flux)[:, 0]
    return np.asarray(found + (memory.internal[:, None] @ changes.internal)[:, 0])


class UnitChanges:
    """Unit changes of modulus, viscosity and parameters of all points, as far as unknowns change them.

    Parameters
    ----------
    changes
        Of all unknowns, at all points.
    """

    def __init__(self, changes: PointChanges) -> None:
        #: Names of what changes, of parameters with their place.
        self.parts: list[tuple[str, int | None]] = []
        self._count = 0
        if changes.modulus.any():
            self.parts.append(("modulus", None))
        if changes.viscosity.any():
            self.parts.append(("viscosity", None))
        if changes.parameters is not None:
            self._count = changes.parameters.shape[1]
            changed = np.flatnonzero(changes.parameters.any(axis=(0, 2))).tolist()
            self.parts += [("parameters", i) for i in changed]

    def _points(self, n: int, columns: int) -> PointChanges:
        parameters = np.zeros((n, self._count, columns)) if self._count else None
        found = PointChanges(np.zeros((n, columns)), np.zeros((n, columns)), parameters)
        for column, part in enumerate(self.parts):
            _part(found, part)[:, column] = 1.0
        return found

    def at_step(
        self, law: MacroLaw, states: MacroState, grad_p: Array, memory: LawMemory, interval: Interval
    ) -> UnitDerivatives:
        """Return the derivatives by the unit changes and by the memory."""
        n, c, size = len(states), len(self.parts), 9 + 1 + law.memory_size
        rows = np.zeros((size, c + size))
        rows[:, c:] = np.eye(size)
        everywhere = np.broadcast_to(rows, (n, *rows.shape))
        before = MemoryChanges(everywhere[:, :9].reshape(n, 3, 3, -1), everywhere[:, 9], everywhere[:, 10:])
        points = self._points(n, c + size)
        response, found = law.respond_to_changes(states, grad_p, memory, points, before, step=interval)
        return UnitDerivatives(response, _columns(found, slice(c)), _columns(found, slice(c, None)))

    def at_rest(self, law: MacroLaw, states: MacroState) -> UnitDerivatives:
        """Return the derivatives by the unit changes of a law's own memory of a state."""
        n, still = len(states), np.zeros((len(states), 3))
        # One column at least, so that laws are asked for something.
        c = max(len(self.parts), 1)
        points, rest = self._points(n, c), law.initial_at(states)
        before = replace(
            MemoryChanges.zeros(n, law.memory_size, c), fluid_volume=law.rest_changes(states, points)
        )
        response, found = law.respond_to_changes(states, still, rest, points, before)
        found = replace(found, storage=before.fluid_volume + found.storage)
        return UnitDerivatives(response, _columns(found, slice(len(self.parts))), _columns(found, slice(0)))

    def of_unknowns(self, weights: Array, changes: PointChanges) -> Array:
        """Return the gradient (k,) from the integrated weights (n, c) of the unit changes."""
        total = np.zeros(changes.modulus.shape[1])
        for column, part in enumerate(self.parts):
            total += weights[:, column] @ _part(changes, part)
        return total


def _part(changes: PointChanges, part: tuple[str, int | None]) -> Array:
    """Return the changes (n, k) of modulus, of viscosity, or of the parameter at a place."""
    name, place = part
    values: Array = getattr(changes, name)
    return values if place is None else values[:, place]


def _columns(found: ResponseChanges, of: slice) -> ResponseChanges:
    """Return the derivatives by some changes, in arrays of their own."""
    parts = (found.stress, found.storage, found.flux, found.internal)
    stress, storage, flux, internal = (np.ascontiguousarray(part[..., of]) for part in parts)
    return replace(found, stress=stress, storage=storage, flux=flux, internal=internal)


@dataclass(frozen=True, eq=False)
class AdjointEquations:
    """Equations Jᵀ λ = −g of one step, with the tangent J at its solution.

    Attributes
    ----------
    d
        Discretisation.
    system
        The transposed tangent of all unknowns.
    tangent
        Of the law at the solution.
    x : (local unknowns,)
        The solution.
    dt, loads
        Of the step.
    still
        Loads that are zero.
    """

    d: Discretisation
    system: CoupledSystem
    tangent: MacroTangent
    x: Array
    dt: float
    loads: Loads
    still: Loads

    def of_residual(self, rows: Array) -> PointWeights:
        """Return the weights of the response where the residual's values weigh ``rows`` (local unknowns,)."""
        tests, grad = self.d.states(rows)
        return PointWeights(tests.grad_u, tests.p, -self.dt * grad)

    def of_unknowns(self, states: PointWeights) -> Array:
        """Return the weights (local unknowns,), where owned, from those of H, p and ∇p at the points."""
        # A step of the length −1 has ∫ flux · ∇N.
        return self.d.residual(states, -1.0, self.still).values

    def following(self, rows: Array) -> Array:
        """Return the weights of the unknowns by which forces and fluxes on the surface change the residual."""
        if self._surface is None:
            return np.zeros(len(rows))
        return self.d.surface_product(self._surface, rows)

    @cached_property
    def _surface(self) -> SurfaceTangent | None:
        found = self.d.surface_tangent(self.x, self.loads, self.dt)
        return None if found is None else found.transposed()

    def solved(self, weights: Array, *, again: bool) -> tuple[Array, PointWeights, Array]:
        """Return λ, the weights of the response by it, and the weights of the unknowns with it.

        The latter vanish in the equations; at prescribed unknowns they are the derivatives by their values.

        Parameters
        ----------
        weights : (local unknowns,)
            Weights g of the solution, where owned.
        again
            The transposed system has been solved with before.

        Raises
        ------
        StepFailed
            It has no solution.
        """
        d, still = self.d, np.zeros(len(self.d.prescribed))
        rows, total = np.zeros(len(d.unknowns)), weights
        at_points = PointWeights.zeros(d.n_points)
        misfit = np.inf
        for _ in range(1 + CORRECTIONS):
            rows = rows - self.system.solve(total, still, again=again)
            again = True
            at_points = self.of_residual(rows)
            total = weights + self.of_unknowns(at_points.of_states(self.tangent)) + self.following(rows)
            misfit = self._misfit(total, weights, rows)
            if misfit <= SMALL:
                break
        if not misfit <= TOO_LARGE:
            raise StepFailed(f"the linear solver leaves {misfit:.2g} of the right-hand side")
        return rows, at_points, total

    def _misfit(self, total: Array, weights: Array, rows: Array) -> float:
        """Return the largest weight that is left over those that met; zero where only round-off is left."""
        d = self.d
        left, given = largest_free(d, total), largest_free(d, weights)
        terms = largest_free(d, self.system.magnitudes(rows))
        return max(
            value / max(right, each) if value > ROUND_OFF * max(right, each) else 0.0
            for value, right, each in zip(left, given, terms, strict=True)
        )


@dataclass(frozen=True, eq=False)
class RowWeights:
    """Weights of one step in f sums.

    Attributes
    ----------
    x : (local unknowns, f)
        Of the solution.
    residual : (local unknowns, f)
        Of the residual's values.
    points
        Of the response at the points, one for each sum; None: nothing.
    outflow : (f,)
        Of the volume that leaves through prescribed fluxes.
    contact : (7 · indenters, f)
        Of what is measured of the indenters.
    begun : (f,)
        True for the sums that weigh anything of the step, on any process.
    """

    x: Array
    residual: Array
    points: list[PointWeights] | None
    outflow: Array
    contact: Array
    begun: npt.NDArray[np.bool_]


class HistoryRows:
    """Weights of each step, the transpose of what a recorder makes of a step's derivatives.

    Parameters
    ----------
    record
        Recorder of the run.
    profiles
        Numbers of the steps of which there are profiles, 0 for the state at rest.
    weights
        Of the histories.

    Raises
    ------
    ConfigurationError
        Weights are of a series that the run does not have, or have another shape than they should.
    """

    def __init__(self, record: HistoryRecorder, profiles: Sequence[int], weights: HistoryWeights) -> None:
        _require_series(record, weights)
        self._profiles = {number: place for place, number in enumerate(profiles)}
        self._record, self._weights, self.count = record, weights, weights.count
        #: Later values of the drained volume include the outflow of a step.
        self._drained = None if weights.drained is None else np.cumsum(weights.drained[::-1], axis=0)[::-1]

    def start(self, x: Array) -> Array:
        """Return the weights (local unknowns, f) of the initial state."""
        return self._local(self._of_solution(0, x))

    def step(self, number: int, x: Array, dt: float, loads: Loads) -> RowWeights:
        """Return the weights of a step, the first of which has the number 1."""
        d, weights = self._record.d, self._weights
        residual = np.zeros((d.mesh.size, self.count))
        stress: Array | None = None
        flux: Array | None = None
        for name, values in weights.reactions.items():
            share = d.boundary.supports[name]
            rows, field = share.weights(values[number])
            residual += rows
            if share.needs_field:
                stress = field if stress is None else stress + field
        for name, values in weights.inflow.items():
            share = d.boundary.drains[name]
            rows, field = share.weights(values[number][None])
            residual += rows / dt
            if share.needs_field:
                flux = -field if flux is None else flux - field
        solution, local = self._of_solution(number, x), self._local(residual)
        begun = solution.any(axis=0) | residual.any(axis=0)
        for means in (stress, flux):
            if means is not None:
                begun |= means.any(axis=0)
        outflow = np.zeros(self.count)
        if self._drained is not None:
            outflow = self._drained[number]
            held = d.prescribed[~d.is_force[d.prescribed]]
            local[held] -= outflow
            begun |= outflow != 0
        touched = self._of_contacts(number, outflow * dt)
        begun |= touched.any(axis=0)
        if touched.any():
            states = d.contact_states(d.to_mesh(x), loads)
            solution += np.concatenate([state.total_slopes for state in states]).T @ touched
        return RowWeights(self._local(solution), local, self._points(stress, flux), outflow, touched, begun)

    def _of_contacts(self, number: int, outflow: Array) -> Array:
        """Return the weights (7 · indenters, f) of what is measured of the indenters, the drained volume included."""
        contacts, width = self._record.d.boundary.contacts, len(CONTACT)
        found = np.zeros((width * len(contacts), self.count))
        for place, contact in enumerate(contacts):
            if contact.name in self._weights.contact:
                found[width * place : width * (place + 1)] += self._weights.contact[contact.name][number]
        found[OUTFLOW::width] += outflow
        return found

    def _of_solution(self, number: int, x: Array) -> Array:
        """Return the weights (unknowns, f) of the extremes, probes and profiles, in the mesh's order."""
        record, weights, d = self._record, self._weights, self._record.d
        whole, found = d.to_mesh(x), np.zeros((d.mesh.size, self.count))
        for name, (unknown, sign) in extremes(whole, d.mesh.n_u).items():
            weight: Array | None = getattr(weights, name)
            if weight is not None:
                found[unknown] += sign * weight[number]
        for place, name in enumerate(d.problem.probes):
            if name in weights.probes:
                found += record.probe[4 * place : 4 * place + 4].T @ weights.probes[name][number]
        if weights.profiles is not None and number in self._profiles:
            found += weights.profiles[self._profiles[number]]
        return found

    def _local(self, whole: Array) -> Array:
        """Return the weights of the local unknowns from those of all, Cartesian ones."""
        d = self._record.d
        if not whole.any():
            return np.zeros((len(d.unknowns), self.count))
        return np.stack([d.from_mesh(column) for column in whole.T], axis=1)

    def _points(self, stress: Array | None, flux: Array | None) -> list[PointWeights] | None:
        """Return the weights at the points from those of the elements' means (elements · components, f)."""
        if stress is None and flux is None:
            return None
        d = self._record.d
        element = np.repeat(d.elements, d.n_points // max(len(d.elements), 1))
        volume = d.mesh.weights.sum(axis=1)

        def at_points(means: Array | None, i: int, *shape: int) -> Array:
            if means is None:
                return np.zeros((d.n_points, *shape))
            density = means[:, i].reshape(len(volume), -1) / volume[:, None]
            return np.asarray(density[element].reshape(-1, *shape))

        return [
            PointWeights(at_points(stress, i, 3, 3), np.zeros(d.n_points), at_points(flux, i, 3))
            for i in range(self.count)
        ]


class _LastState(HistoryRows):
    """Weights of the last state of a run alone: of its unknowns (local unknowns, f), and of forces (3, f)."""

    def __init__(self, tape: RunTape, weights: Array, forces: Mapping[str, Array]) -> None:
        supports, f = tape.history.d.boundary.supports, weights.shape[1]
        reactions = {name: np.zeros((len(tape.history.rows), 3, f)) for name in forces if name in supports}
        for name, each in reactions.items():
            each[-1] = forces[name]
        super().__init__(tape.history, tape.profiles, HistoryWeights(f, reactions=reactions))
        self._last, self._of_last = len(tape.steps), weights

    def start(self, x: Array) -> Array:
        """Return no weights of the initial state."""
        return np.zeros_like(self._of_last)

    def step(self, number: int, x: Array, dt: float, loads: Loads) -> RowWeights:
        """Return the weights of a step, of which the last alone has some."""
        found = super().step(number, x, dt, loads)
        mine = self._of_last if number == self._last else 0.0
        return replace(found, x=found.x + mine, begun=np.ones(self.count, bool))


def _require_series(record: HistoryRecorder, weights: HistoryWeights) -> None:
    """Refuse weights of series that the run does not have, and those of another shape."""
    d, steps, count = record.d, len(record.rows), weights.count
    if weights.compression:
        raise ConfigurationError(
            "gradients: expected weights of the forces in reactions, got some in compression; give those"
        )
    for name in HISTORY_SERIES:
        values: Array | None = getattr(weights, name)
        if values is not None:
            _require_shape(name, values, (steps, count))
    if weights.profiles is not None:
        _require_shape("profiles", weights.profiles, (len(record.profiles), d.mesh.size, count))
    groups = (
        ("probes", weights.probes, list(d.problem.probes), (4,)),
        ("reactions", weights.reactions, list(d.boundary.supports), (3,)),
        ("inflow", weights.inflow, list(d.boundary.drains), ()),
        ("contact", weights.contact, [each.name for each in d.boundary.contacts], (len(CONTACT),)),
    )
    for group, given, known, width in groups:
        for name, each in given.items():
            if name not in known:
                advice = suggestion(name, known, "there are", "the run has none")
                raise ConfigurationError(f"gradients: weights of {group}: no series {echo(name)}; {advice}")
            _require_shape(f"{group}/{name}", each, (steps, *width, count))


def _require_shape(name: str, values: Array, shape: tuple[int, ...]) -> None:
    if np.shape(values) != shape:
        raise ConfigurationError(
            f"gradients: weights of {name}: expected the shape {shape}, got {np.shape(values)}"
        )


@dataclass(frozen=True, eq=False)
class TapedStep:
    """Accepted step of a run, as a tape keeps it.

    Attributes
    ----------
    x : (local unknowns,)
        Its solution.
    states
        Of the points there, with parameters and places.
    memory
        From which it began.
    interval, loads
        Its beginning and end, and its loads.
    """

    x: Array
    states: MacroState
    memory: LawMemory
    interval: Interval
    loads: Loads

    @property
    def time(self) -> float:
        """End of the step."""
        return self.interval.end

    @property
    def dt(self) -> float:
        """Length of the step."""
        return self.interval.length


class RunTape:
    """Record of a run, some 20 numbers for each point and step.

    Attributes
    ----------
    start : (local unknowns,)
        Initial state.
    steps
        Accepted steps.
    profiles
        Numbers of those of which there are profiles, 0 for the initial state.
    history
        Recorder of the histories.
    """

    start: Array
    history: HistoryRecorder

    def __init__(self) -> None:
        self.steps: list[TapedStep] = []
        self.profiles: list[int] = []
        #: The swelling with which the run begins, and its own tape.
        self.swelling: tuple[FreeSwelling, RunTape] | None = None

    def of_swelling(self, free: FreeSwelling) -> RunTape:
        """Return the tape of the swelling with which the run begins."""
        self.swelling = free, RunTape()
        return self.swelling[1]

    def begin(self, x: Array, memory: LawMemory, record: HistoryRecorder) -> None:
        """Take the initial state."""
        self.start, self.history = x, record
        self.add_profile()

    def add_profile(self) -> None:
        """Take note that there is a profile of the last accepted state."""
        self.profiles.append(len(self.steps))

    def renew(self, memory: LawMemory, time: float) -> None:
        """Refuse a law that learns during the run: earlier steps cannot be gone over with what it was then.

        Raises
        ------
        ConfigurationError
            Always.
        """
        raise ConfigurationError(
            "gradients: the law learns during the run, so that no pass goes back over its steps; let it learn before, "
            "or ask for sensitivities"
        )

    def add(
        self,
        step: Step,
        memory: LawMemory,
        interval: Interval,
        loads: Loads,
        linearisations: Linearisations,
    ) -> None:
        """Add an accepted step that began from ``memory``."""
        self.steps.append(TapedStep(step.x, step.response.memory.states, memory, interval, loads))


class GradientPass:
    """Gradients of sums over the histories of one run by its unknowns.

    Parameters
    ----------
    d, body, law
        Of the run.
    changes
        The unknowns.

    Raises
    ------
    ConfigurationError
        An unknown is of what the problem does not have.
    """

    def __init__(
        self, d: Discretisation, body: BodyFields, law: MacroLaw, changes: Sequence[MacroChange]
    ) -> None:
        self._d, self._body, self._law, self._changes = d, body, law, tuple(changes)
        self._directions = Directions(d, body, law, changes)
        self._unit = UnitChanges(self._directions.at_first)
        self._loaded = [
            j
            for j, each in enumerate(changes)
            if isinstance(each, LoadChange | BoundaryChange | IndenterChange)
            or (d.boundary.contacts and isinstance(each, ModulusChange | ViscosityChange))
        ]
        self._still = d.loads(0.0 * d.boundary.amplitudes(d.problem, 0.0))
        self._linearisations = Linearisations(d, law, varies=body.varies)
        self._transposed: tuple[Linearisation, CoupledSystem] | None = None

    def gradients(self, tape: RunTape, weights: HistoryWeights) -> Array:
        """Return the gradients (f, k) of f sums.

        Raises
        ------
        SolveError
            A linear system has no solution.
        """
        d, f = self._d, weights.count
        end = [MemoryWeights.zeros(d.n_points, self._law.memory_size)] * f
        first = self._back(tape, HistoryRows(tape.history, tape.profiles, weights), end, np.zeros(f, bool))
        if tape.swelling is not None:
            forces = {name: values[0] for name, values in weights.reactions.items()}
            self._shared += self._of_swelling(*tape.swelling, first, forces)
        else:
            first = first + (self._at_rest(tape.steps[0]) if tape.steps else 0.0)
            for j, start in enumerate(self._directions.start()):
                if start.any():
                    self._own[:, j] += start[: d.owned] @ first[: d.owned]
        return np.asarray(self._shared + d.communicator.sum(self._own))

    def _back(
        self,
        tape: RunTape,
        rows: HistoryRows,
        memory: list[MemoryWeights],
        begun: npt.NDArray[np.bool_],
    ) -> Array:
        """Go back over all steps from the weights of the memory at the end; return those of the initial state."""
        f = len(begun)
        #: Shares of this process, and of all together.
        self._own = np.zeros((f, len(self._directions)))
        self._shared = np.zeros_like(self._own)
        self._memory, self._begun = memory, begun
        #: Weights of the state from which prescribed displacements are counted.
        self._origin = np.zeros((len(self._d.unknowns), f))
        for number in range(len(tape.steps), 0, -1):
            step = tape.steps[number - 1]
            try:
                self._step(step, rows.step(number, step.x, step.dt, step.loads))
            except StepFailed as failure:
                when = units_now().text(step.time, "time", 6)
                raise SolveError(f"the gradients at t = {when} have no solution: {failure}") from failure
        return np.asarray(rows.start(tape.start) + self._origin)

    def _of_swelling(
        self, free: FreeSwelling, tape: RunTape, first: Array, forces: Mapping[str, Array]
    ) -> Array:
        """Return the gradients (f, k) by way of the swollen state.

        Its unknowns weigh ``first``, and so do the forces (3, f) on surfaces that hold it by their names.
        """
        chosen = [j for j, each in enumerate(self._changes) if isinstance(each, PointChange)]
        found = np.zeros_like(self._own)
        if not chosen:
            return found
        back = GradientPass(free.d, free.body, free.law, [self._changes[j] for j in chosen])
        local = np.stack([free.weights(self._d, column) for column in first.T], axis=1)
        rows = _LastState(tape, local, forces)
        back._back(tape, rows, self._memory, np.ones(len(found), bool))
        back._at_rest(tape.steps[0])
        found[:, chosen] = back._shared + free.d.communicator.sum(back._own)
        return found

    def _step(self, step: TapedStep, rows: RowWeights) -> None:
        """Go back over one step."""
        d = self._d
        self._begun |= rows.begun
        begun = np.flatnonzero(self._begun)
        if not len(begun):
            return
        found = self._unit.at_step(self._law, step.states, d.states(step.x)[1], step.memory, step.interval)
        equations, changes = self._equations(step, found), self._directions.points(step.states)
        loads = self._loads(step)
        for i, sum_ in enumerate(begun):
            memory = self._memory[sum_]
            known = equations.of_residual(rows.residual[:, sum_])
            if rows.points is not None:
                known = known.plus(rows.points[sum_])
            known = known.plus(memory.of_points)
            states = known.of_states(equations.tangent).plus(memory.of_states(found.fixed))
            weights = rows.x[:, sum_] + equations.of_unknowns(states)
            weights = weights + equations.following(rows.residual[:, sum_])
            solution, by_solution, total = equations.solved(weights, again=i > 0)
            at_points = known.plus(by_solution)
            self._add_loads(
                sum_,
                loads,
                solution + rows.residual[:, sum_],
                total,
                rows.outflow[sum_] * step.dt,
                rows.contact[:, sum_],
            )
            shares = weights_of(found.fixed, at_points, memory)
            self._own[sum_] += self._unit.of_unknowns(d.weights[:, None] * shares, changes)
            self._memory[sum_] = found.of_memory(at_points, memory)

    def _equations(self, step: TapedStep, found: UnitDerivatives) -> AdjointEquations:
        d, known = self._d, self._linearisations
        linear = known.begin(step.dt, step.loads) or known.at(found.response, step.dt, step.x, step.loads)
        if self._transposed is None or self._transposed[0] is not linear:
            self._transposed = linear, linear.system.transposed()
        return AdjointEquations(
            d, self._transposed[1], provided(found.response.tangent), step.x, step.dt, step.loads, self._still
        )

    def _loads(self, step: TapedStep) -> list[tuple[int, Array, Array, float, Array]]:
        """Return for each unknown of the loads its values, part of the residual, outflow, and changes of contacts."""
        d, nothing = self._d, PointWeights.zeros(self._d.n_points)
        found = []
        for j in self._loaded:
            own = self._directions.loads_of(j, step.time)
            external = d.residual(nothing, step.dt, own).values
            external = external + d.surface_change(step.x, step.loads, own, step.dt)
            still = [np.zeros(len(d.unknowns))]
            (touched,) = d.contact_changes(step.x, step.loads, still, [own])
            found.append((j, own.values, external, d.outflow(own), touched))
        return found

    def _add_loads(
        self,
        sum_: int,
        loads: list[tuple[int, Array, Array, float, Array]],
        rows: Array,
        total: Array,
        outflow: float,
        contact: Array,
    ) -> None:
        """Add the shares of the unknowns of the loads; ``total`` are derivatives by prescribed values."""
        d = self._d
        owned = d.prescribed < d.owned
        self._origin[d.prescribed, sum_] += np.where(d.is_force[d.prescribed], total[d.prescribed], 0.0)
        for j, values, external, flow, touched in loads:
            self._own[sum_, j] += total[d.prescribed[owned]] @ values[owned]
            self._own[sum_, j] += external[: d.owned] @ rows[: d.owned]
            self._shared[sum_, j] += outflow * flow + float(contact @ touched)

    def _at_rest(self, first: TapedStep) -> Array:
        """Return the weights (local unknowns, f) of the initial state by way of its memory, the law's answer to it."""
        d, states = self._d, first.memory.states
        found, changes = self._unit.at_rest(self._law, states), self._directions.points(states)
        tangent = provided(found.response.tangent)
        weights = np.zeros((len(d.unknowns), len(self._memory)))
        for sum_, memory in enumerate(self._memory):
            by_states = memory.of_points.of_states(tangent).plus(memory.of_states(found.fixed))
            weights[:, sum_] = d.residual(by_states, -1.0, self._still).values
            shares = weights_of(found.fixed, memory.of_points, memory)
            self._own[sum_] += self._unit.of_unknowns(d.weights[:, None] * shares, changes)
        return weights
