"""The mean deformation of the solid, and the flux through the pore that it carries along.

Both closures take the conductivity of the undeformed pore, pulled back with F̄ (Dehghani & Zilian).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.states import Array, CellTangent, MacroState
from porocore.tensors.cofactors import cofactor, cofactor_tangent, determinant


@dataclass(frozen=True, eq=False)
class PulledBack:
    """Kinematics and conductivity of n points; NaN where det F̄ ≤ 0 or det(I + H) ≤ 0.

    Attributes
    ----------
    F : (n, 3, 3)
        F̄ = I + H + <∇u¹>_s/φ_s.
    J : (n,)
        det F̄; NaN where there is no state of the solid or of the body.
    cof : (n, 3, 3)
        cof F̄ = Ḡᵀ.
    conductivity : (n, 3, 3)
        Ḡ K F̄⁻ᵀ, between ∇_X p and the flux through reference area.
    flux : (n, 3)
        q = −Ḡ K F̄⁻ᵀ ∇_X p.
    """

    F: Array
    J: Array
    cof: Array
    conductivity: Array
    flux: Array

    @classmethod
    def of(
        cls, states: MacroState, mean_grad: Array, grad_p: Array, solid_fraction: float, K: Array
    ) -> PulledBack:
        """From H, <∇u¹>_s and ∇_X p, φ_s, and K of the undeformed cell."""
        F = np.eye(3) + states.grad_u + mean_grad / solid_fraction
        J = determinant(F)
        J = np.where((J > 0) & (determinant(np.eye(3) + states.grad_u) > 0), J, np.nan)
        cof = np.ascontiguousarray(cofactor(F))
        pulled = cof.swapaxes(1, 2) @ K @ cof / J[:, None, None]
        return cls(F, J, cof, pulled, -(pulled @ grad_p[:, :, None])[..., 0])

    @property
    def missing(self) -> Array:
        """Where there is no response, (n, 1, 1) bool."""
        return np.isnan(self.J)[:, None, None]

    def flux_by_deformation(self, grad_p: Array, K: Array, cof_F: Array | None = None) -> Array:
        """∂q/∂F̄ (n, 3, 9); ``cof_F`` is ∂cof F̄/∂F̄ (n, 9, 9) where it is known already."""
        n = len(self.J)
        if cof_F is None:
            cof_F = cofactor_tangent(self.F).reshape(n, 9, 9)
        # q = −(1/J) cofᵀ K cof ∇p: first by cof, then by J.
        direct = np.einsum("ib,na->niab", np.eye(3), (self.cof @ grad_p[:, :, None])[..., 0] @ K.T)
        direct += np.einsum("nia,nb->niab", self.cof.swapaxes(1, 2) @ K, grad_p)
        by_J = self.flux[:, :, None] * self.cof.reshape(n, 1, 9)
        flux_F: Array = -(direct.reshape(n, 3, 9) @ cof_F + by_J) / self.J[:, None, None]
        return flux_F


def deformation_slopes(tangent: CellTangent, solid_fraction: float) -> tuple[Array, Array]:
    """∂F̄/∂H (n, 9, 9) and ∂F̄/∂p (n, 9, 1)."""
    assert tangent.mean_grad_grad_u is not None
    assert tangent.mean_grad_p is not None
    n = len(tangent.mean_grad_p)
    return (
        np.eye(9) + tangent.mean_grad_grad_u.reshape(n, 9, 9) / solid_fraction,
        tangent.mean_grad_p.reshape(n, 9, 1) / solid_fraction,
    )
