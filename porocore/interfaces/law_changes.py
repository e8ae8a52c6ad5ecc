"""Changes of a macroscopic law under unknowns: of points, memory, and response at fixed (H, p, ∇p).

Every array holds derivatives by k unknowns along its last axis, behind the batch axis of n points and the indices of
the value.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from porocore.core.fields.batch import Batch
from porocore.states import Array

if TYPE_CHECKING:
    from porocore.interfaces.law import MacroTangent


@dataclass(frozen=True, eq=False)
class PointChanges(Batch):
    """Changes of n points under k unknowns.

    Attributes
    ----------
    modulus : (n, k)
        Relative change of the modulus of the whole solid, with W = E w(H, p/E).
    viscosity : (n, k)
        Relative change of the viscosity of the fluid.
    parameters : (n, m, k)
        Change of the parameters of the cell; None for a law without.
    """

    modulus: Array
    viscosity: Array
    parameters: Array | None = None


@dataclass(frozen=True, eq=False)
class MemoryChanges(Batch):
    """Derivatives of a :class:`~porocore.interfaces.law.LawMemory`, as far as the law's storage depends on it.

    Attributes
    ----------
    grad_u : (n, 3, 3, k)
        Of H, for a law whose φ is no function of the state, but summed over the steps.
    mean_grad : (n, 3, 3, k)
        Of <∇u¹>_s, for such a law.
    fluid_volume : (n, k)
        Of φ, for any other.
    """

    grad_u: Array
    mean_grad: Array | None = None
    fluid_volume: Array | None = None

    @classmethod
    def zeros(cls, n: int, k: int) -> MemoryChanges:
        """Return the changes of n points that nothing changes."""
        tensors = np.zeros((n, 3, 3, k))
        return cls(tensors, tensors, np.zeros((n, k)))


@dataclass(frozen=True, eq=False)
class ResponseChanges(Batch):
    """Derivatives of a :class:`~porocore.interfaces.law.MacroResponse` at fixed (H, p, ∇p), changes of the memory too.

    Attributes
    ----------
    stress : (n, 3, 3, k)
        Of P_E.
    storage : (n, k)
        Of the fluid taken up, less what the fluid at the memory's time changes.
    flux : (n, 3, k)
        Of q.
    fluid_volume : (n, k)
        Of φ, for a law of which it is a function of the state; its derivatives by (H, p) are those of the storage.
    mean_grad : (n, 3, 3, k)
        Of <∇u¹>_s, for a law that sums φ over the steps.
    mean_grad_grad_u : (n, 3, 3, 3, 3)
        Derivative of <∇u¹>_s by H, for such a law.
    mean_grad_p : (n, 3, 3)
        Derivative of <∇u¹>_s by p, for such a law.
    """

    stress: Array
    storage: Array
    flux: Array
    fluid_volume: Array | None = None
    mean_grad: Array | None = None
    mean_grad_grad_u: Array | None = None
    mean_grad_p: Array | None = None

    def moved(
        self, tangent: MacroTangent, grad_u: Array, p: Array, grad_p: Array
    ) -> tuple[ResponseChanges, MemoryChanges]:
        """Return the total derivatives of response and memory, where the state moves too.

        Parameters
        ----------
        tangent
            Of the response.
        grad_u, p, grad_p : (n, 3, 3, k), (n, k), (n, 3, k)
            Derivatives of H, p and ∇p.
        """
        n, k = p.shape
        H = grad_u.reshape(n, 9, k)

        def along(by_H: Array, by_p: Array, *shape: int) -> Array:
            slopes: Array = np.matmul(by_H.reshape(n, -1, 9), H)
            add_scaled(slopes, by_p.reshape(n, -1), p)
            return slopes.reshape(n, *shape, k)

        stored = along(tangent.storage_grad_u, tangent.storage_p)
        mean_grad = self.mean_grad
        if mean_grad is not None:
            assert self.mean_grad_grad_u is not None
            assert self.mean_grad_p is not None
            mean_grad = mean_grad + along(self.mean_grad_grad_u, self.mean_grad_p, 3, 3)
        fluid = None if self.fluid_volume is None else self.fluid_volume + stored
        flux = self.flux + along(tangent.flux_grad_u, tangent.flux_p, 3)
        total = ResponseChanges(
            self.stress + along(tangent.stress_grad_u, tangent.stress_p, 3, 3),
            self.storage + stored,
            flux + np.matmul(tangent.flux_grad_p, grad_p),
        )
        return total, MemoryChanges(grad_u, mean_grad, fluid)


def add_scaled(total: Array, values: Array, factors: Array) -> None:
    """Add values (n, r) times factors (n, k), many of them zero, to ``total`` (n, r, k) in place."""
    for j in np.flatnonzero(factors.any(axis=0)):
        total[..., j] += values * factors[:, j, None]
