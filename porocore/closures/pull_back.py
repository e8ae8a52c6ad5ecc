"""The mean deformation of the solid, and the flux through the pore.

Both closures take the flux from here. Its conductivity is either that of the undeformed pore, pulled back with F̄
(Dehghani & Zilian), or that of the deformed pore, which is a response of the cell.
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
        K_ref, between ∇_X p and the flux through reference area: Ḡ K F̄⁻ᵀ, or that of the deformed pore.
    transformed : (n, 3, 3)
        K_t = K_ref/det F̄ (Dehghani & Zilian's transformed conductivity), F̄⁻¹ K F̄⁻ᵀ where K is carried along.
    flux : (n, 3)
        q = −conductivity ∇_X p.
    undeformed : (3, 3)
        K; None where the conductivity is that of the deformed pore.
    """

    F: Array
    J: Array
    cof: Array
    conductivity: Array
    transformed: Array
    flux: Array
    undeformed: Array | None

    @classmethod
    def of(
        cls,
        states: MacroState,
        mean_grad: Array,
        grad_p: Array,
        solid_fraction: float,
        K: Array,
        deformed: Array | None = None,
    ) -> PulledBack:
        """From H, <∇u¹>_s, ∇_X p, φ_s, and K of the undeformed cell or K_ref (n, 3, 3) of the ``deformed`` pores."""
        F = np.eye(3) + states.grad_u + mean_grad / solid_fraction
        J, J0 = determinant(F), determinant(np.eye(3) + states.grad_u)
        J = np.where((J > 0) & (J0 > 0), J, np.nan)
        cof = np.ascontiguousarray(cofactor(F))
        if deformed is None:
            conductivity = cof.swapaxes(1, 2) @ K @ cof / J[:, None, None]
        else:
            conductivity = np.where(np.isnan(J)[:, None, None], np.nan, deformed)
        transformed = conductivity / J[:, None, None]
        flux = -(conductivity @ grad_p[:, :, None])[..., 0]
        return cls(F, J, cof, conductivity, transformed, flux, K if deformed is None else None)

    @property
    def missing(self) -> Array:
        """Where there is no response, (n, 1, 1) bool."""
        return np.isnan(self.J)[:, None, None]

    def flux_slopes(
        self, grad_p: Array, cell: CellTangent, solid_fraction: float, cof_F: Array | None = None
    ) -> tuple[Array, Array]:
        """∂q/∂H (n, 3, 9) and ∂q/∂p (n, 3).

        A cell that does not tell how its own conductivity changes is taken as if it did not: a Newton iteration with
        that tangent converges to the same solution, linearly.

        Parameters
        ----------
        cof_F
            ∂cof F̄/∂F̄ (n, 9, 9) where it is known already.
        """
        n = len(self.J)
        if self.undeformed is not None:
            by_F = self._flux_by_deformation(grad_p, self.undeformed, cof_F)
            dF_dH, dF_dp = deformation_slopes(cell, solid_fraction)
            return by_F @ dF_dH, (by_F @ dF_dp)[..., 0]
        if cell.conductivity_grad_u is None or cell.conductivity_p is None:
            return np.zeros((n, 3, 9)), np.zeros((n, 3))
        by_H = np.einsum("nijk,nj->nik", cell.conductivity_grad_u.reshape(n, 3, 3, 9), grad_p)
        return -by_H, -(cell.conductivity_p @ grad_p[:, :, None])[..., 0]

    def _flux_by_deformation(self, grad_p: Array, K: Array, cof_F: Array | None) -> Array:
        """∂q/∂F̄ (n, 3, 9)."""
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
