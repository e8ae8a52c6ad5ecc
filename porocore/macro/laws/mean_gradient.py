"""Mean-gradient closure of Dehghani & Zilian: the solid responds to its average deformation gradient."""

from __future__ import annotations

import numpy as np

from porocore.cell.materials.composite import Composite, Solid
from porocore.core.tensors.cofactors import cofactor_tangent
from porocore.errors import ConfigurationError
from porocore.interfaces.law import LawMemory, MacroResponse, MacroTangent
from porocore.macro.laws.closure import Closure
from porocore.macro.laws.pull_back import ConductivityLaw, PulledBack, deformation_tangent
from porocore.states import Array, CellResponse, CellTangent, MacroState


class MeanGradientClosure(Closure):
    """The mean-gradient closure (Dehghani & Zilian): the solid responds to its average deformation gradient.

    With m = <∇_Y u¹>_s(H, p), F̄ = I + H + m/φ_s and Ḡ = det F̄ F̄⁻¹ (so Ḡᵀ = cof F̄)::

        P_E       = φ_s ∂Ψ/∂F(F̄) − φ_f p Ḡᵀ
        Δstorage  = φ_f Ḡᵀ:ΔH − Ḡᵀ:Δm              (Ḡ at the new time: backward Euler)
        q         = −Ḡ K̂ F̄⁻ᵀ ∇_X p
        K_t       = (1/det F̄) Ḡ K̂ F̄⁻ᵀ

    K̂ = R̄ K R̄ᵀ with F̄ = R̄ Ū, or K itself with the conductivity law ``piola-unrotated``, which is the paper's. With the
    conductivity of the deformed pore q = −K_ref ∇_X p and K_t = K_ref/det F̄.
    """

    name = "mean-gradient"
    responses = ("mean_grad",)
    derivatives = ("mean_grad_grad_u", "mean_grad_p")
    #: Why it cannot be used.
    needs_one_energy = (
        "closure 'mean-gradient' takes the stress of the solid at its mean deformation, so the whole solid must have "
        "one strain energy, but cell.materials gives each region its own; choose closure: potential"
    )

    def __init__(
        self, solid_fraction: float, material: Solid, conductivity: Array, *, law: ConductivityLaw = "piola"
    ) -> None:
        super().__init__(solid_fraction, material, conductivity, law=law)
        if isinstance(material, Composite):
            raise ConfigurationError(self.needs_one_energy)
        self.energy = material

    def respond(
        self, states: MacroState, cell: CellResponse, grad_p: Array, memory: LawMemory, *, tangent: bool
    ) -> MacroResponse:
        """Return the response at n points; NaN where det F̄ ≤ 0 or det(I + H) ≤ 0."""
        phi_s = self.solid_fraction
        phi_f, p = 1 - phi_s, states.p[:, None, None]
        pore = self.pull_back(states, cell, grad_p)
        step = phi_f * (states.grad_u - memory.states.grad_u) - (cell.mean_grad - memory.mean_grad)
        solid_stress = np.where(pore.missing, np.nan, self.energy.stress(self._solid(pore)))
        return MacroResponse(
            stress=phi_s * solid_stress - phi_f * p * pore.cof,
            storage=np.einsum("nij,nij->n", pore.cof, step),
            flux=pore.flux,
            memory=self.memory(states, cell),
            deformation=pore.F,
            volume_ratio=pore.J,
            transformed_conductivity=pore.transformed,
            outside_training_range=np.zeros(len(p), bool)
            if cell.outside_training_range is None
            else cell.outside_training_range,
            tangent=self._tangent(p, pore, step, grad_p, cell.tangent) if tangent else None,
        )

    @staticmethod
    def _solid(pore: PulledBack) -> Array:
        """F̄, and the identity where there is none: Ψ is asked only where it exists."""
        return np.where(pore.missing, np.eye(3), pore.F)

    def _tangent(
        self, p: Array, pore: PulledBack, step: Array, grad_p: Array, cell: CellTangent | None
    ) -> MacroTangent:
        """Chain rule through F̄(H, p); second-rank tensors are rows of 9, fourth-rank ones 9 × 9 matrices."""
        assert cell is not None
        assert cell.mean_grad_grad_u is not None
        assert cell.mean_grad_p is not None
        n, phi_s = len(pore.J), self.solid_fraction
        phi_f = 1 - phi_s
        M, Q = cell.mean_grad_grad_u.reshape(n, 9, 9), cell.mean_grad_p.reshape(n, 9, 1)
        dF_dH, dF_dp = deformation_tangent(cell, phi_s)
        cof_F = cofactor_tangent(pore.F).reshape(n, 9, 9)
        cof_row = pore.cof.reshape(n, 1, 9)

        by_F = np.empty((n, 10, 9))  # of the stress, and of the storage
        by_F[:, 9:] = step.reshape(n, 1, 9) @ cof_F
        cof_F *= phi_f * p
        np.multiply(self.energy.tangent(self._solid(pore)).reshape(n, 9, 9), phi_s, out=by_F[:, :9])
        by_F[:, :9] -= cof_F
        by_H, by_p = by_F @ dF_dH, (by_F @ dF_dp)[..., 0]
        flux_H, flux_p = pore.flux_tangent(grad_p, cell, phi_s, (dF_dH, dF_dp))
        return MacroTangent(
            stress_grad_u=by_H[:, :9].reshape(n, 3, 3, 3, 3),
            stress_p=by_p[:, :9].reshape(n, 3, 3) - phi_f * pore.cof,
            storage_grad_u=(by_H[:, 9:10] + phi_f * cof_row - cof_row @ M).reshape(n, 3, 3),
            storage_p=by_p[:, 9] - (cof_row @ Q)[:, 0, 0],
            flux_grad_u=flux_H.reshape(n, 3, 3, 3),
            flux_p=flux_p,
            flux_grad_p=-pore.conductivity,
        )
