"""Equations of the sensitivities of one time step, direct and adjoint; weights of sums over histories.

A sum weighs a value by ∫ weight · value dX, so weights are densities over the undeformed body.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

from porocore.core.echo import echo, suggestion
from porocore.core.fields import Batch
from porocore.errors import ConfigurationError
from porocore.interfaces.law import MacroResponse, MacroTangent, MemoryChanges, ResponseChanges
from porocore.interfaces.sensitivities import HISTORY_SERIES, HistoryWeights
from porocore.macro.boundary.conditions import Loads
from porocore.macro.integration.checkpoint import HistoryRecorder, extremes
from porocore.macro.integration.discretisation import Discretisation, Residual, StepFailed
from porocore.macro.integration.newton import ROUND_OFF, Linearisation, largest_free, misfit_of
from porocore.states import Array

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
    response, fixed
        Of the law at the solution, with its tangent, and its derivatives at fixed (H, p, ∇p).
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
                    x[j] = x[j] - d.solve(self.linear.system, residuals[j].values, still, again=True)
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
        assert self.response.tangent is not None
        total, memory = self.fixed.moved(self.response.tangent, *changes_at_points(self.d, x))
        return UnknownChange.each(total), memory

    def _misfit(self, residual: Residual, x: Array) -> float:
        """Return the largest residual over its scale; zero where only round-off is left, as of a rigid motion."""
        d, misfit = self.d, misfit_of(self.d, residual)
        if misfit <= SMALL:
            return misfit
        force, volume = largest_free(d, d.magnitudes(self.linear.system, x))
        return misfit_of(d, residual, (ROUND_OFF * force, ROUND_OFF * volume))

    @cached_property
    def _follower(self) -> sparse.csr_matrix | None:
        return self.d.follower_tangent(self.x, self.loads)

    def _residual(self, change: UnknownChange, own: Loads, x: Array) -> Residual:
        """Return the total derivative of the residual by one unknown, which is zero in the equations."""
        d, found, follower = self.d, self.d.residual(change, self.dt, own, self.x), self._follower
        if follower is None:
            return found
        whole = np.zeros(d.mesh.size)
        whole[: d.mesh.n_u] = follower @ d.to_mesh(x)[: d.mesh.n_u]
        moved = np.where(np.arange(len(d.unknowns)) < d.owned, d.from_mesh(whole), 0.0)
        return Residual(found.values + moved, found.force_scale, found.volume_scale)


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
        return PointWeights(
            grad_u.reshape(n, 3, 3) + storage[:, None, None] * tangent.storage_grad_u,
            p + storage * tangent.storage_p,
            (flux @ tangent.flux_grad_p)[:, 0],
        )


@dataclass(frozen=True, eq=False)
class MemoryWeights(Batch):
    """Weights of what a :class:`~porocore.interfaces.law.MemoryChanges` has, without the unknowns' axis."""

    grad_u: Array
    mean_grad: Array
    fluid_volume: Array

    @classmethod
    def zeros(cls, n: int) -> MemoryWeights:
        """Return the weights of nothing."""
        return cls(np.zeros((n, 3, 3)), np.zeros((n, 3, 3)), np.zeros(n))

    def of_states(self, tangent: MacroTangent, fixed: ResponseChanges) -> PointWeights:
        """Return the weights of H and p, on which the memory depends; transposes :meth:`ResponseChanges.moved`."""
        n = len(self.fluid_volume)
        grad_u, p = self.grad_u, np.zeros(n)
        if fixed.fluid_volume is not None:
            grad_u = grad_u + self.fluid_volume[:, None, None] * tangent.storage_grad_u
            p = p + self.fluid_volume * tangent.storage_p
        if fixed.mean_grad is not None:
            assert fixed.mean_grad_grad_u is not None
            assert fixed.mean_grad_p is not None
            mean = self.mean_grad.reshape(n, 1, 9)
            grad_u = grad_u + (mean @ fixed.mean_grad_grad_u.reshape(n, 9, 9)).reshape(n, 3, 3)
            p = p + (mean @ fixed.mean_grad_p.reshape(n, 9, 1))[:, 0, 0]
        return PointWeights(grad_u, p, np.zeros((n, 3)))


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
    system: Any
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
        """Return the weights of the displacements by which follower pressures change the residual."""
        if self._follower is None:
            return np.zeros(len(rows))
        d, whole = self.d, np.zeros(self.d.mesh.size)
        whole[: d.mesh.n_u] = self._follower.T @ d.to_mesh(rows)[: d.mesh.n_u]
        return np.where(np.arange(len(rows)) < d.owned, d.from_mesh(whole), 0.0)

    @cached_property
    def _follower(self) -> sparse.csr_matrix | None:
        return self.d.follower_tangent(self.x, self.loads)

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
            rows = rows - d.solve(self.system, total, still, again=again)
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
        terms = largest_free(d, d.magnitudes(self.system, rows))
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
    begun : (f,)
        True for the sums that weigh anything of the step, on any process.
    """

    x: Array
    residual: Array
    points: list[PointWeights] | None
    outflow: Array
    begun: npt.NDArray[np.bool_]


class HistoryRows:
    """Weights of each step, the transpose of what a recorder makes of a step's derivatives.

    Parameters
    ----------
    record
        Recorder of the run.
    weights
        Of the histories.

    Raises
    ------
    ConfigurationError
        Weights are of a series that the run does not have, or have another shape than they should.
    """

    def __init__(self, record: HistoryRecorder, weights: HistoryWeights) -> None:
        _require_series(record, weights)
        self._record, self._weights, self.count = record, weights, weights.count
        #: Later values of the drained volume include the outflow of a step.
        self._drained = None if weights.drained is None else np.cumsum(weights.drained[::-1], axis=0)[::-1]

    def start(self, x: Array) -> Array:
        """Return the weights (local unknowns, f) of the initial state."""
        return self._local(self._of_solution(0, x))

    def step(self, number: int, x: Array, dt: float) -> RowWeights:
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
        return RowWeights(self._local(solution), local, self._points(stress, flux), outflow, begun)

    def _of_solution(self, number: int, x: Array) -> Array:
        """Return the weights (unknowns, f) of the extremes and probes, in the mesh's order."""
        record, weights, d = self._record, self._weights, self._record.d
        whole, found = d.to_mesh(x), np.zeros((d.mesh.size, self.count))
        for name, (unknown, sign) in extremes(whole, d.mesh.n_u).items():
            weight: Array | None = getattr(weights, name)
            if weight is not None:
                found[unknown] += sign * weight[number]
        for place, name in enumerate(d.problem.probes):
            if name in weights.probes:
                found += record.probe[4 * place : 4 * place + 4].T @ weights.probes[name][number]
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
    groups = (
        ("probes", weights.probes, list(d.problem.probes), (4,)),
        ("reactions", weights.reactions, list(d.boundary.supports), (3,)),
        ("inflow", weights.inflow, list(d.boundary.drains), ()),
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
