"""Macroscopic law of a clay of constant compressibility at finite strain (Xie & Leo 2004)."""

from __future__ import annotations

import numpy as np

from porocore.core.tensors.cofactors import cofactor, cofactor_tangent, determinant
from porocore.interfaces.law import LawMemory, MacroLaw, MacroResponse, MacroTangent, fingerprint
from porocore.macro.analytic.xie_leo import XieLeo
from porocore.states import Array, MacroState


class ClayLaw(MacroLaw):
    """The clay at finite strain: isotropic and hyperelastic, in uniaxial motion as the paper has it.

    With J = det F, and G a shear modulus that uniaxial motion does not feel::

        Ψ = G/2 (tr FᵀF − 3) − G ln J + h(J),   h′ = (ln J)/m − G (J − 1/J)
        P_E = ∂Ψ/∂F − p cof F,   Δstorage = ΔJ,   q = −(k₀/γ_w) J³ F⁻¹F⁻ᵀ ∇_X p

    so that P_E,22 = (ln J)/m − p in uniaxial motion. H and p are counted from rest.

    Parameters
    ----------
    layer
        m and k₀/γ_w are taken from it.
    shear
        G in units of 1/m; below 1/2 the law is stable at rest.
    """

    name = "xie-leo"

    def __init__(self, layer: XieLeo, shear: float = 0.3) -> None:
        self.m, self.k = layer.compressibility, layer.conductivity
        self.G = shear / self.m
        self.identity = fingerprint(self.name, self.m, self.k, self.G)

    def initial(self, n: int) -> LawMemory:
        """Return the state at rest; the fluid volume is counted as J."""
        return LawMemory(MacroState.zeros(n), np.zeros((n, 3, 3)), np.ones(n))

    def respond(
        self, states: MacroState, grad_p: Array, memory: LawMemory, *, tangent: bool = True
    ) -> MacroResponse:
        """See :class:`~porocore.interfaces.law.MacroLaw`; NaN where det F ≤ 0."""
        n = len(states)
        F = np.eye(3) + states.grad_u
        J = determinant(F)
        J = np.where(J > 0, J, np.nan)
        cof = np.ascontiguousarray(cofactor(F))
        # ∂Ψ/∂F = G F + s cof F
        s = np.log(J) / self.m - self.G * J
        # cofᵀcof = J² F⁻¹F⁻ᵀ
        pulled = self.k * J[:, None, None] * (cof.swapaxes(1, 2) @ cof)
        flux = -(pulled @ grad_p[:, :, None])[..., 0]
        return MacroResponse(
            stress=self.G * F + (s - states.p)[:, None, None] * cof,
            storage=J - memory.fluid_volume,
            flux=flux,
            memory=LawMemory(states, np.zeros((n, 3, 3)), J),
            deformation=F,
            volume_ratio=J,
            transformed_conductivity=pulled / J[:, None, None],
            outside_training_range=np.zeros(n, bool),
            tangent=self._tangent(states, grad_p, F, J, cof, s, pulled, flux) if tangent else None,
        )

    def _tangent(
        self,
        states: MacroState,
        grad_p: Array,
        F: Array,
        J: Array,
        cof: Array,
        s: Array,
        pulled: Array,
        flux: Array,
    ) -> MacroTangent:
        n = len(J)
        cof_F, row = cofactor_tangent(F).reshape(n, 9, 9), cof.reshape(n, 1, 9)
        by_J = 1 / (self.m * J) - self.G
        stress = self.G * np.eye(9) + (s - states.p)[:, None, None] * cof_F
        stress = stress + by_J[:, None, None] * (row.swapaxes(1, 2) @ row)
        # q = −k J cofᵀ cof ∇p: first by cof, then by J.
        turned = (cof @ grad_p[:, :, None])[..., 0]
        direct = np.einsum("ib,na->niab", np.eye(3), turned) + np.einsum("nai,nb->niab", cof, grad_p)
        flux_F = -self.k * J[:, None, None] * (direct.reshape(n, 3, 9) @ cof_F)
        flux_F = flux_F + (flux / J[:, None])[:, :, None] * row
        return MacroTangent(
            stress_grad_u=stress.reshape(n, 3, 3, 3, 3),
            stress_p=-cof,
            storage_grad_u=cof,
            storage_p=np.zeros(n),
            flux_grad_u=flux_F.reshape(n, 3, 3, 3),
            flux_p=np.zeros((n, 3)),
            flux_grad_p=-pulled,
        )
