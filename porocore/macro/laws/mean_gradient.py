"""Mean-gradient closure of Dehghani & Zilian: the solid responds to its average deformation gradient."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.materials.composite import Composite, Solid
from porocore.core.tensors.cofactors import cofactor_tangent
from porocore.errors import ConfigurationError
from porocore.interfaces.law import MacroResponse, MacroTangent
from porocore.interfaces.law_changes import MemoryChanges, ResponseChanges, add_scaled
from porocore.macro.laws.cell_changes import CellChanges
from porocore.macro.laws.closure import Closure, ClosurePoints
from porocore.macro.laws.pull_back import ConductivityLaw, PulledBack, at_points, deformation_tangent
from porocore.states import Array, CellTangent


def _unfit(reason: str) -> str:
    return (
        "closure 'mean-gradient' takes the stress of the solid at its mean deformation, so the whole solid must have "
        f"one strain energy without a stress at rest, but {reason}; choose closure: potential"
    )


@dataclass(frozen=True, eq=False)
class _Deformed:
    """Kinematics and stress of n points; the change of φ_s (n,) with <∇u¹>_s/φ_s (n, 3, 3) is None without one."""

    phi_s: float | Array
    share: float | Array  #: φ_s, (n, 1, 1) or one number
    p: Array  #: (n, 1, 1)
    pore: PulledBack
    step: Array  #: (n, 3, 3)  φ_f ΔH − Δ<∇u¹>_s
    grown: tuple[Array, Array] | None
    solid: Array  #: (n, 3, 3)  F̄, and the identity where there is none
    solid_stress: Array  #: (n, 3, 3)  ∂Ψ/∂F(F̄)


@dataclass(frozen=True, eq=False)
class _Slopes:
    """Derivatives of the stress, and of the storage in the last row, by F̄ (n, 10, 9); −∂storage/∂<∇u¹>_s (n, 1, 9)."""

    by_deformation: Array
    by_mean_grad: Array


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

    def respond(self, at: ClosurePoints, *, tangent: bool) -> MacroResponse:
        """Return the response at n points; NaN where det F̄ ≤ 0 or det(I + H) ≤ 0."""
        now = self._deformed(at)
        return self._closed(at, now, self._slopes(now) if tangent else None)

    def respond_to_changes(
        self, at: ClosurePoints, by: CellChanges, before: MemoryChanges
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return the response and its derivatives; see :class:`Closure`.

        Raises
        ------
        ConfigurationError
            φ_s depends on an unknown, and changes with time.
        """
        tangent = at.cell.tangent
        assert before.mean_grad is not None
        assert tangent is not None
        if at.cells_before is not None and by.porosity.any():
            raise ConfigurationError(
                "closure 'mean-gradient' gives no derivatives by parameters that change the porosity where these "
                "change with time; choose closure: potential"
            )
        now, (n, k) = self._deformed(at), by.modulus.shape
        slopes, dF = self._slopes(now), self.deformation_changes(at.cell, by, at.cells)
        found: Array = np.matmul(slopes.by_deformation, dF.reshape(n, 9, k))
        stress, storage = found[:, :9], found[:, 9:]
        add_scaled(stress, (now.share * now.solid_stress).reshape(n, 9), by.modulus)
        add_scaled(stress, -(now.solid_stress + now.p * now.pore.cof).reshape(n, 9), by.porosity)
        moved = before.mean_grad.reshape(n, 9, k) - (1 - now.share) * before.grad_u.reshape(n, 9, k)
        add_scaled(moved, (at.states.grad_u - at.memory.states.grad_u).reshape(n, 9), by.porosity)
        storage += now.pore.cof.reshape(n, 1, 9) @ moved - slopes.by_mean_grad @ by.mean_grad.reshape(n, 9, k)
        return self._closed(at, now, slopes), ResponseChanges(
            stress=stress.reshape(n, 3, 3, k),
            storage=storage[:, 0],
            flux=now.pore.flux_changes(dF, by.conductivity, self.law),
            mean_grad=by.mean_grad,
            mean_grad_grad_u=tangent.mean_grad_grad_u,
            mean_grad_p=tangent.mean_grad_p,
        )

    def _deformed(self, at: ClosurePoints) -> _Deformed:
        states, cell, cells, memory = at.states, at.cell, at.cells, at.memory
        phi_s = self.solid_fraction_of(cells)
        share = at_points(phi_s, 2)
        pore = self.pull_back(states, cell, at.grad_p, cells)
        step = (1 - share) * (states.grad_u - memory.states.grad_u) - (cell.mean_grad - memory.mean_grad)
        grown = None
        if at.cells_before is not None and cells is not None:
            grown = (at.cells_before.porosity - cells.porosity, cell.mean_grad / share)
        # Ψ is asked only where there is a state.
        solid = np.where(pore.missing, np.eye(3), pore.F)
        stress = np.where(pore.missing, np.nan, self.energy.stress(solid))
        return _Deformed(phi_s, share, states.p[:, None, None], pore, step, grown, solid, stress)

    def _closed(self, at: ClosurePoints, now: _Deformed, slopes: _Slopes | None) -> MacroResponse:
        pore = now.pore
        storage = np.einsum("nij,nij->n", pore.cof, now.step)
        if now.grown is not None:
            storage = storage - now.grown[0] * (pore.J - np.einsum("nij,nij->n", pore.cof, now.grown[1]))
        stress = now.share * now.solid_stress - (1 - now.share) * now.p * pore.cof
        tangent = None if slopes is None else self._tangent(now, at.cell.tangent, slopes)
        return self._response(at, pore, stress, storage, tangent)

    def _slopes(self, at: _Deformed) -> _Slopes:
        """Return the derivatives by F̄ and by <∇u¹>; second-rank tensors are rows of 9, fourth-rank ones 9 × 9."""
        n, pore, share = len(at.pore.J), at.pore, at.share
        cof_F = cofactor_tangent(pore.F).reshape(n, 9, 9)
        cof_row = pore.cof.reshape(n, 1, 9)
        by_F = np.empty((n, 10, 9))
        by_F[:, 9:] = at.step.reshape(n, 1, 9) @ cof_F
        by_m = cof_row
        if at.grown is not None:
            change = at.grown[0][:, None, None]
            by_F[:, 9:] -= change * (cof_row - at.grown[1].reshape(n, 1, 9) @ cof_F)
            by_m = cof_row * (1 - change / share)
        cof_F *= (1 - share) * at.p
        np.multiply(self.energy.tangent(at.solid).reshape(n, 9, 9), share, out=by_F[:, :9])
        by_F[:, :9] -= cof_F
        return _Slopes(by_F, by_m)

    @staticmethod
    def _tangent(at: _Deformed, cell: CellTangent | None, slopes: _Slopes) -> MacroTangent:
        """Return the chain rule through F̄(H, p)."""
        assert cell is not None
        assert cell.mean_grad_grad_u is not None
        assert cell.mean_grad_p is not None
        n, pore, phi_f = len(at.pore.J), at.pore, 1 - at.share
        M, Q = cell.mean_grad_grad_u.reshape(n, 9, 9), cell.mean_grad_p.reshape(n, 9, 1)
        by_F, by_m = slopes.by_deformation, slopes.by_mean_grad
        dF_dH, dF_dp = deformation_tangent(cell, at.phi_s)
        by_H, by_p = by_F @ dF_dH, (by_F @ dF_dp)[..., 0]
        flux_H, flux_p = pore.flux_tangent(cell, at.phi_s, (dF_dH, dF_dp))
        return MacroTangent(
            stress_grad_u=by_H[:, :9].reshape(n, 3, 3, 3, 3),
            stress_p=by_p[:, :9].reshape(n, 3, 3) - phi_f * pore.cof,
            storage_grad_u=(by_H[:, 9:10] + phi_f * pore.cof.reshape(n, 1, 9) - by_m @ M).reshape(n, 3, 3),
            storage_p=by_p[:, 9] - (by_m @ Q)[:, 0, 0],
            flux_grad_u=flux_H.reshape(n, 3, 3, 3),
            flux_p=flux_p,
            flux_grad_p=-pore.conductivity,
        )
