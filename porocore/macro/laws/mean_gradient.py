"""Mean-gradient closure of Dehghani & Zilian: the solid responds to its average deformation gradient."""

from __future__ import annotations

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.materials.composite import Composite, Solid
from porocore.core.tensors.cofactors import cofactor_tangent
from porocore.errors import ConfigurationError
from porocore.interfaces.law import LawMemory, MacroResponse, MacroTangent, UndeformedCells
from porocore.interfaces.law_changes import MemoryChanges, ResponseChanges
from porocore.macro.laws.cell_changes import CellChanges
from porocore.macro.laws.closure import Closure
from porocore.macro.laws.pull_back import ConductivityLaw, PulledBack, at_points, deformation_tangent
from porocore.states import Array, CellResponse, CellTangent, MacroState


def _unfit(reason: str) -> str:
    return (
        "closure 'mean-gradient' takes the stress of the solid at its mean deformation, so the whole solid must have "
        f"one strain energy without a stress at rest, but {reason}; choose closure: potential"
    )


class MeanGradientClosure(Closure):
    """The mean-gradient closure (Dehghani & Zilian): the solid responds to its average deformation gradient.

    With m = <∇_Y u¹>_s(H, p), F̄ = I + H + m/φ_s and Ḡ = det F̄ F̄⁻¹ (so Ḡᵀ = cof F̄)::

        P_E       = φ_s ∂Ψ/∂F(F̄) − φ_f p Ḡᵀ
        Δstorage  = φ_f Ḡᵀ:ΔH − Ḡᵀ:Δm              (Ḡ at the new time: backward Euler)
        q         = −Ḡ K̂ F̄⁻ᵀ ∇_X p
        K_t       = (1/det F̄) Ḡ K̂ F̄⁻ᵀ

    K̂ = R̄ K R̄ᵀ with F̄ = R̄ Ū, or K itself with the conductivity law ``piola-unrotated``, which is the paper's. With the
    conductivity of the deformed pore q = −K_ref ∇_X p and K_t = K_ref/det F̄.

    The solid takes up the volume φ_s det F̄. Where φ_s changes with time by Δφ_s, as with a parameter that does, the
    fluid changes by −(det F̄ − Ḡᵀ:m/φ_s) Δφ_s besides.
    """

    name = "mean-gradient"
    responses = ("mean_grad",)
    derivatives = ("mean_grad_grad_u", "mean_grad_p")

    def __init__(
        self, solid_fraction: float, material: Solid, conductivity: Array, *, law: ConductivityLaw = "piola"
    ) -> None:
        super().__init__(solid_fraction, material, conductivity, law=law)
        if isinstance(material, Composite):
            raise ConfigurationError(_unfit("cell.materials gives each region its own"))
        if material.swells:
            raise ConfigurationError(_unfit("cell.material.swelling gives the cell a stress at rest"))
        self.energy = material

    @classmethod
    def unfit(cls, cell: Cell) -> str:
        """Return why it does not suit the solid of a cell; empty if it does."""
        if cell.materials is not None:
            return _unfit("cell.materials gives each region its own")
        varied = [parameter.key for parameter in cell.parameters if parameter.solid_key is not None]
        if varied:
            return _unfit(f"{varied[0]} is a range, which gives each point its own")
        if cell.solid.swells:
            return _unfit("cell.material.swelling gives the cell a stress at rest")
        return ""

    def respond(
        self,
        states: MacroState,
        cell: CellResponse,
        grad_p: Array,
        memory: LawMemory,
        *,
        tangent: bool,
        cells: UndeformedCells | None = None,
        before: UndeformedCells | None = None,
    ) -> MacroResponse:
        """Return the response at n points; NaN where det F̄ ≤ 0 or det(I + H) ≤ 0."""
        phi_s = self.solid_fraction_of(cells)
        share, p = at_points(phi_s, 2), states.p[:, None, None]
        phi_f = 1 - share
        pore = self.pull_back(states, cell, grad_p, cells)
        step = phi_f * (states.grad_u - memory.states.grad_u) - (cell.mean_grad - memory.mean_grad)
        storage, grown = np.einsum("nij,nij->n", pore.cof, step), None
        if before is not None and cells is not None:
            grown = (before.porosity - cells.porosity, cell.mean_grad / share)
            storage = storage - grown[0] * (pore.J - np.einsum("nij,nij->n", pore.cof, grown[1]))
        solid_stress = np.where(pore.missing, np.nan, self.energy.stress(self._solid(pore)))
        return MacroResponse(
            stress=share * solid_stress - phi_f * p * pore.cof,
            storage=storage,
            flux=pore.flux,
            memory=self.memory(states, cell),
            deformation=pore.F,
            volume_ratio=pore.J,
            transformed_conductivity=pore.transformed,
            outside_training_range=np.zeros(len(p), bool)
            if cell.outside_training_range is None
            else cell.outside_training_range,
            tangent=self._tangent(p, pore, step, grad_p, cell.tangent, phi_s, grown) if tangent else None,
        )

    def changes(
        self,
        states: MacroState,
        cell: CellResponse,
        grad_p: Array,
        memory: LawMemory,
        by: CellChanges,
        before: MemoryChanges,
        *,
        cells: UndeformedCells | None = None,
        cells_before: UndeformedCells | None = None,
    ) -> ResponseChanges:
        """Return the derivatives at fixed (H, p, ∇p); see :class:`Closure`.

        Raises
        ------
        ConfigurationError
            φ_s depends on an unknown, and changes with time.
        """
        assert before.mean_grad is not None
        tangent = cell.tangent
        assert tangent is not None
        n, k = by.modulus.shape
        share, p = at_points(self.solid_fraction_of(cells), 2), states.p[:, None, None]
        phi_f, pore = 1 - share, self.pull_back(states, cell, grad_p, cells)
        F, dF = self._solid(pore), self.deformation_changes(cell, by, cells)
        along, cof_F = dF.reshape(n, 9, k), cofactor_tangent(pore.F).reshape(n, 9, 9)
        cof_change, cof = cof_F @ along, pore.cof.reshape(n, 1, 9)
        solid = self.energy.stress(F)
        stress = share * (self.energy.tangent(F).reshape(n, 9, 9) @ along) - phi_f * p * cof_change
        stress += (share * solid).reshape(n, 9, 1) * by.modulus[:, None, :]
        stress -= (solid + p * pore.cof).reshape(n, 9, 1) * by.porosity[:, None, :]
        since = states.grad_u - memory.states.grad_u
        step = phi_f * since - (cell.mean_grad - memory.mean_grad)
        moved = (before.mean_grad - by.mean_grad).reshape(n, 9, k) - phi_f * before.grad_u.reshape(n, 9, k)
        moved += since.reshape(n, 9, 1) * by.porosity[:, None, :]
        storage: Array = np.matmul(step.reshape(n, 1, 9), cof_change) + np.matmul(cof, moved)
        if cells_before is not None and cells is not None:
            storage = storage - self._growth(
                cell, by, share, cells_before.porosity - cells.porosity, cof, cof_change
            )
        return ResponseChanges(
            stress=stress.reshape(n, 3, 3, k),
            storage=storage[:, 0],
            flux=pore.flux_changes(grad_p, dF, by.conductivity, self.law),
            mean_grad=by.mean_grad,
            mean_grad_grad_u=tangent.mean_grad_grad_u,
            mean_grad_p=tangent.mean_grad_p,
        )

    def _growth(
        self,
        cell: CellResponse,
        by: CellChanges,
        share: float | Array,
        grown: Array,
        cof: Array,
        cof_change: Array,
    ) -> Array:
        """Return the change (n, 1, k) of (det F̄ − Ḡᵀ:m/φ_s) Δφ_s, with Δφ_s = ``grown`` (n,)."""
        if by.porosity.any():
            raise ConfigurationError(
                "closure 'mean-gradient' gives no derivatives by parameters that change the porosity where these "
                "change with time; choose closure: potential"
            )
        mean = (cell.mean_grad / share).reshape(len(cell), 1, 9)
        # det F̄ changes by Ḡᵀ:δF̄, of which δm/φ_s is all.
        return np.asarray(-grown[:, None, None] * (mean @ cof_change))

    @staticmethod
    def _solid(pore: PulledBack) -> Array:
        """F̄, and the identity where there is none: Ψ is asked only where it exists."""
        return np.where(pore.missing, np.eye(3), pore.F)

    def _tangent(
        self,
        p: Array,
        pore: PulledBack,
        step: Array,
        grad_p: Array,
        cell: CellTangent | None,
        phi_s: float | Array,
        grown: tuple[Array, Array] | None,
    ) -> MacroTangent:
        """Chain rule through F̄(H, p); second-rank tensors are rows of 9, fourth-rank ones 9 × 9 matrices.

        ``grown`` is the change of φ_s (n,) and <∇u¹>_s/φ_s (n, 3, 3).
        """
        assert cell is not None
        assert cell.mean_grad_grad_u is not None
        assert cell.mean_grad_p is not None
        n, share = len(pore.J), at_points(phi_s, 2)
        phi_f = 1 - share
        M, Q = cell.mean_grad_grad_u.reshape(n, 9, 9), cell.mean_grad_p.reshape(n, 9, 1)
        dF_dH, dF_dp = deformation_tangent(cell, phi_s)
        cof_F = cofactor_tangent(pore.F).reshape(n, 9, 9)
        cof_row = pore.cof.reshape(n, 1, 9)

        by_F = np.empty((n, 10, 9))  # of the stress, and of the storage
        by_F[:, 9:] = step.reshape(n, 1, 9) @ cof_F
        by_m = cof_row
        if grown is not None:
            change = grown[0][:, None, None]
            by_F[:, 9:] -= change * (cof_row - grown[1].reshape(n, 1, 9) @ cof_F)
            by_m = cof_row * (1 - change / share)
        cof_F *= phi_f * p
        np.multiply(self.energy.tangent(self._solid(pore)).reshape(n, 9, 9), share, out=by_F[:, :9])
        by_F[:, :9] -= cof_F
        by_H, by_p = by_F @ dF_dH, (by_F @ dF_dp)[..., 0]
        flux_H, flux_p = pore.flux_tangent(grad_p, cell, phi_s, (dF_dH, dF_dp))
        return MacroTangent(
            stress_grad_u=by_H[:, :9].reshape(n, 3, 3, 3, 3),
            stress_p=by_p[:, :9].reshape(n, 3, 3) - phi_f * pore.cof,
            storage_grad_u=(by_H[:, 9:10] + phi_f * cof_row - by_m @ M).reshape(n, 3, 3),
            storage_p=by_p[:, 9] - (by_m @ Q)[:, 0, 0],
            flux_grad_u=flux_H.reshape(n, 3, 3, 3),
            flux_p=flux_p,
            flux_grad_p=-pore.conductivity,
        )
