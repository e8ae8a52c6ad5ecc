"""Weights of responses, states and memories at the points, in sums whose gradients are wanted (PointWeights).

A sum weighs a value by ∫ weight · value dX, so weights are densities over the undeformed body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.core.fields.batch import Batch
from porocore.interfaces.law import MacroTangent
from porocore.interfaces.law_changes import ResponseChanges
from porocore.states import Array


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
    """Weights of what a :class:`~porocore.interfaces.law_changes.MemoryChanges` has, without the unknowns' axis."""

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
