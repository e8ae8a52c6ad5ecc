"""Weights of one step's solution, residual and response in sums over the histories (HistoryRows)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from porocore.core.echo import echo, suggestion
from porocore.errors import ConfigurationError
from porocore.interfaces.sensitivities import HISTORY_SERIES, HistoryWeights
from porocore.macro.integration.recorder import HistoryRecorder, extremes
from porocore.macro.sensitivities.point_weights import PointWeights
from porocore.states import Array


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
