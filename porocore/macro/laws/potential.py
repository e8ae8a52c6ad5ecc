"""Potential closure, exact: stress and fluid volume are derivatives of the cell's effective potential."""

from __future__ import annotations

import numpy as np

from porocore.interfaces.law import LawMemory, MacroResponse, MacroTangent
from porocore.interfaces.law_changes import MemoryChanges, ResponseChanges
from porocore.macro.laws.cell_changes import CellChanges
from porocore.macro.laws.closure import Closure, ClosurePoints
from porocore.macro.laws.pull_back import PulledBack
from porocore.states import Array, CellResponse, CellTangent, MacroState


class PotentialClosure(Closure):
    """Stress and fluid volume of the cell itself, the derivatives of W(H, p) = <Ψ + pJ>_s − p J₀.

    With φ = −∂W/∂p the current fluid volume per reference volume, and F̄ = I + H + <∇u¹>_s/φ_s as in the
    mean-gradient closure::

        P_E       = ∂W/∂H
        Δstorage  = φ(new) − φ(old)
        q         = −Ḡ K̂ F̄⁻ᵀ ∇_X p
        K_t       = (1/det F̄) Ḡ K̂ F̄⁻ᵀ

    Nothing is approximated in stress and storage, so dW = P_E:dH − φ dp and no closed cycle of (H, p) does
    work; ∂P_E/∂H has major symmetry and ∂P_E/∂p = −∂φ/∂H. Only the conductivity is that of the undeformed pore,
    carried along (K̂ = R̄ K R̄ᵀ with F̄ = R̄ Ū, or K itself with the law ``piola-unrotated``); or that of the deformed pore,
    q = −K_ref ∇_X p and K_t = K_ref/det F̄.
    """

    name = "potential"
    responses = ("mean_grad", "stress", "fluid_volume")
    derivatives = (
        "mean_grad_grad_u",
        "mean_grad_p",
        "stress_grad_u",
        "stress_p",
        "fluid_volume_grad_u",
        "fluid_volume_p",
    )

    def respond(self, at: ClosurePoints, *, tangent: bool) -> MacroResponse:
        """Return the response at n points; NaN where det F̄ ≤ 0 or det(I + H) ≤ 0.

        A cell that changes with time takes up fluid by its φ; the cells before are not needed.
        """
        return self._closed(at, self.pull_back(at.states, at.cell, at.grad_p, at.cells), tangent)

    def respond_to_changes(
        self, at: ClosurePoints, by: CellChanges, before: MemoryChanges
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return the response and its derivatives; see :class:`Closure`."""
        assert by.stress is not None
        assert by.fluid_volume is not None
        assert before.fluid_volume is not None
        pore = self.pull_back(at.states, at.cell, at.grad_p, at.cells)
        found = ResponseChanges(
            stress=by.stress,
            storage=by.fluid_volume - before.fluid_volume,
            flux=pore.flux_changes(
                self.deformation_changes(at.cell, by, at.cells), by.conductivity, self.law
            ),
            fluid_volume=by.fluid_volume,
        )
        return self._closed(at, pore, True), found

    def _closed(self, at: ClosurePoints, pore: PulledBack, tangent: bool) -> MacroResponse:
        cell, before = at.cell, at.memory.fluid_volume
        assert cell.stress is not None
        assert cell.fluid_volume is not None
        stress = np.where(pore.missing, np.nan, cell.stress)
        storage = np.where(np.isnan(pore.J), np.nan, cell.fluid_volume - before)
        slopes = self._tangent(pore, cell.tangent, self.solid_fraction_of(at.cells)) if tangent else None
        return self._response(at, pore, stress, storage, slopes)

    def memory(self, states: MacroState, cell: CellResponse, summed: Array | None = None) -> LawMemory:
        """Return the memory with φ of the cell in this state."""
        assert cell.fluid_volume is not None
        return LawMemory(states, cell.mean_grad, cell.fluid_volume)

    @staticmethod
    def _tangent(pore: PulledBack, cell: CellTangent | None, solid_fraction: float | Array) -> MacroTangent:
        assert cell is not None
        assert cell.stress_grad_u is not None
        assert cell.stress_p is not None
        assert cell.fluid_volume_grad_u is not None
        assert cell.fluid_volume_p is not None
        flux_H, flux_p = pore.flux_tangent(cell, solid_fraction)
        return MacroTangent(
            stress_grad_u=cell.stress_grad_u,
            stress_p=cell.stress_p,
            storage_grad_u=cell.fluid_volume_grad_u,
            storage_p=cell.fluid_volume_p,
            flux_grad_u=flux_H.reshape(-1, 3, 3, 3),
            flux_p=flux_p,
            flux_grad_p=-pore.conductivity,
        )
