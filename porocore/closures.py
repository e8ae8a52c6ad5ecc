"""From the responses of a cell to stress, fluid storage and flux of the macroscale.

A closure is written once, here, in numpy, and serves every macro backend. With a cell law (a surrogate, the
linear limit: whatever predicts the responses of a batch of states) it makes a :class:`MacroLaw`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Protocol

import numpy as np

from porocore.cell.material import NeoHookean, cofactor, cofactor_tangent, determinant
from porocore.errors import ConfigurationError
from porocore.laws import LawMemory, MacroLaw, MacroResponse, MacroTangent, fingerprint
from porocore.states import Array, CellResponse, CellTangent, MacroState, Status


class CellLaw(Protocol):
    """Whatever predicts the responses of the cell; a fitted surrogate is one."""

    #: Hash of what it stands for.
    identity: str

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Responses of n states, with their exact derivatives if ``tangent``."""


class Closure(ABC):
    """How stress, storage and flux follow from the responses of the cell.

    Parameters
    ----------
    solid_fraction
        φ_s = 1 − φ_f of the undeformed cell.
    material
        Strain energy of the solid.
    conductivity : (3, 3)
        K of the undeformed cell.
    """

    #: What the user writes.
    name: ClassVar[str]
    #: Fields of :class:`CellResponse` that it reads.
    responses: ClassVar[tuple[str, ...]]
    #: Fields of :class:`CellTangent` that it reads.
    derivatives: ClassVar[tuple[str, ...]]

    def __init__(self, solid_fraction: float, material: NeoHookean, conductivity: Array) -> None:
        if not 0 < solid_fraction < 1:
            raise ValueError(f"expected a solid fraction between 0 and 1, got {solid_fraction:g}")
        self.solid_fraction = solid_fraction
        self.material = material
        self.conductivity = np.array(conductivity, dtype=float)
        if self.conductivity.shape != (3, 3):
            raise ValueError(f"expected a conductivity (3, 3), got {self.conductivity.shape}")

    @property
    def identity(self) -> str:
        """Hash of the closure and its constants."""
        return fingerprint(self.name, self.solid_fraction, self.material.model_dump_json(), self.conductivity)

    @abstractmethod
    def respond(
        self, states: MacroState, cell: CellResponse, grad_p: Array, memory: LawMemory, *, tangent: bool
    ) -> MacroResponse:
        """Response at n points, given the cell's responses there; see :class:`MacroLaw`."""

    def check(self, cell: CellResponse, law: str) -> None:
        """Refuse a cell law whose prediction lacks what this closure reads.

        Raises
        ------
        ConfigurationError
            A response or a derivative is missing.
        """
        missing = [name for name in self.responses if getattr(cell, name) is None]
        missing += [
            f"tangent.{name}" for name in self.derivatives if getattr(cell.tangent, name, None) is None
        ]
        if missing:
            raise ConfigurationError(
                f"closure '{self.name}' needs {', '.join(self.responses + self.derivatives)} of the cell, "
                f"but {law} does not provide {', '.join(missing)}; choose another closure or surrogate"
            )


class MeanGradientClosure(Closure):
    """The mean-gradient closure (Dehghani & Zilian): the solid responds to its average deformation gradient.

    With m = <∇_Y u¹>_s(H, p), F̄ = I + H + m/φ_s and Ḡ = det F̄ F̄⁻¹ (so Ḡᵀ = cof F̄)::

        P_E       = φ_s ∂Ψ/∂F(F̄) − φ_f p Ḡᵀ
        Δstorage  = φ_f Ḡᵀ:ΔH − Ḡᵀ:Δm              (Ḡ at the new time: backward Euler)
        q         = −Ḡ K F̄⁻ᵀ ∇_X p
        K_t       = (1/det F̄) Ḡ K F̄⁻ᵀ
    """

    name = "mean-gradient"
    responses = ("mean_grad",)
    derivatives = ("mean_grad_grad_u", "mean_grad_p")

    def respond(
        self, states: MacroState, cell: CellResponse, grad_p: Array, memory: LawMemory, *, tangent: bool
    ) -> MacroResponse:
        """Response at n points; NaN where det F̄ ≤ 0 or det(I + H) ≤ 0, which is no state of the solid or body."""
        phi_s, K = self.solid_fraction, self.conductivity
        phi_f, p = 1 - phi_s, states.p[:, None, None]
        F = np.eye(3) + states.grad_u + cell.mean_grad / phi_s
        J = determinant(F)
        J = np.where((J > 0) & (determinant(np.eye(3) + states.grad_u) > 0), J, np.nan)
        cof = np.ascontiguousarray(cofactor(F))
        step = phi_f * (states.grad_u - memory.states.grad_u) - (cell.mean_grad - memory.mean_grad)
        solid_stress = np.where(np.isnan(J)[:, None, None], np.nan, self._solid(F, J))
        pulled = cof.swapaxes(1, 2) @ K @ cof / J[:, None, None]  # Ḡ K F̄⁻ᵀ
        flux = -(pulled @ grad_p[:, :, None])[..., 0]
        return MacroResponse(
            stress=phi_s * solid_stress - phi_f * p * cof,
            storage=np.einsum("nij,nij->n", cof, step),
            flux=flux,
            memory=LawMemory(states, cell.mean_grad),
            deformation=F,
            volume_ratio=J,
            transformed_conductivity=pulled / J[:, None, None],
            outside=np.zeros(len(p), bool) if cell.outside is None else cell.outside,
            tangent=self._tangent(p, F, J, cof, step, grad_p, pulled, flux, cell.tangent)
            if tangent
            else None,
        )

    def _solid(self, F: Array, J: Array) -> Array:
        """∂Ψ/∂F, asked only where there is one."""
        return self.material.stress(np.where(np.isnan(J)[:, None, None], np.eye(3), F))

    def _tangent(
        self,
        p: Array,
        F: Array,
        J: Array,
        cof: Array,
        step: Array,
        grad_p: Array,
        pulled: Array,
        flux: Array,
        cell: CellTangent | None,
    ) -> MacroTangent:
        """Chain rule through F̄(H, p); second-rank tensors are rows of 9, fourth-rank ones 9 × 9 matrices."""
        assert cell is not None
        assert cell.mean_grad_grad_u is not None
        assert cell.mean_grad_p is not None
        n, phi_s, K = len(J), self.solid_fraction, self.conductivity
        phi_f = 1 - phi_s
        M, Q = cell.mean_grad_grad_u.reshape(n, 9, 9), cell.mean_grad_p.reshape(n, 9, 1)
        dF_dH, dF_dp = np.eye(9) + M / phi_s, Q / phi_s
        cof_F = cofactor_tangent(F).reshape(n, 9, 9)
        cof_row = cof.reshape(n, 1, 9)

        solid = self.material.tangent(np.where(np.isnan(J)[:, None, None], np.eye(3), F)).reshape(n, 9, 9)
        stress_F = phi_s * solid - phi_f * p * cof_F
        storage_F = step.reshape(n, 1, 9) @ cof_F
        # q = −(1/J) cofᵀ K cof ∇p: first by cof, then by J.
        direct = np.einsum("ib,na->niab", np.eye(3), (cof @ grad_p[:, :, None])[..., 0] @ K.T)
        direct += np.einsum("nia,nb->niab", cof.swapaxes(1, 2) @ K, grad_p)
        flux_F = -(direct.reshape(n, 3, 9) @ cof_F + flux[:, :, None] * cof_row) / J[:, None, None]
        by_F = np.concatenate([stress_F, storage_F, flux_F], axis=1)  # (n, 13, 9)
        by_H, by_p = by_F @ dF_dH, (by_F @ dF_dp)[..., 0]
        return MacroTangent(
            stress_grad_u=by_H[:, :9].reshape(n, 3, 3, 3, 3),
            stress_p=by_p[:, :9].reshape(n, 3, 3) - phi_f * cof,
            storage_grad_u=(by_H[:, 9:10] + phi_f * cof_row - cof_row @ M).reshape(n, 3, 3),
            storage_p=by_p[:, 9] - (cof_row @ Q)[:, 0, 0],
            flux_grad_u=by_H[:, 10:].reshape(n, 3, 3, 3),
            flux_p=by_p[:, 10:],
            flux_grad_p=-pulled,
        )


#: The closures by the name that the user writes.
CLOSURES: dict[str, type[Closure]] = {closure.name: closure for closure in (MeanGradientClosure,)}


class ClosedLaw(MacroLaw):
    """A cell law with a closure.

    Parameters
    ----------
    cell_law
        Predicts the responses of the cell.
    closure
        Makes stress, storage and flux of them.
    identity
        Hash that tells this cell law from every other, such as that of the file it was loaded from; without
        it the cell law's own is taken (for a surrogate that is the cell's, whatever its weights).
    name
        For reports.

    Raises
    ------
    ConfigurationError
        The cell law does not provide what the closure needs.
    """

    def __init__(
        self, cell_law: CellLaw, closure: Closure, *, identity: str | None = None, name: str | None = None
    ) -> None:
        self.cell_law, self.closure = cell_law, closure
        self.name = closure.name if name is None else name
        self.identity = fingerprint(closure.identity, cell_law.identity if identity is None else identity)
        self._rest = cell_law.predict(MacroState.zeros(1))
        closure.check(self._rest, type(cell_law).__name__)

    def initial(self, n: int) -> LawMemory:
        """At rest, with the <∇u¹>_s that the cell law itself gives there: its error there stores no fluid."""
        return LawMemory(MacroState.zeros(n), np.repeat(self._rest.mean_grad, n, axis=0))

    def respond(
        self, states: MacroState, grad_p: Array, memory: LawMemory, *, tangent: bool = True
    ) -> MacroResponse:
        """See :class:`MacroLaw`; NaN where the cell law has no values."""
        cell = self.cell_law.predict(states, tangent=tangent)
        return self.closure.respond(states, cell, grad_p, memory, tangent=tangent)


class LinearCellLaw:
    """<∇u¹>_s = M:H + Q p with the tangents of the undeformed cell; a cell law for small deformations.

    Parameters
    ----------
    reference
        Response at H = 0, p = 0 with its tangent (one row).
    """

    def __init__(self, reference: CellResponse) -> None:
        self.M, self.Q = reference_tangents(reference)
        self.identity = fingerprint("linear", self.M, self.Q)

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """``mean_grad`` and its derivatives; no other response."""
        n = len(states)
        mean_grad = states.grad_u.reshape(n, 9) @ self.M.reshape(9, 9).T
        return CellResponse(
            mean_grad=mean_grad.reshape(n, 3, 3) + states.p[:, None, None] * self.Q,
            status=np.full(n, int(Status.converged)),
            outside=np.zeros(n, bool),
            tangent=CellTangent(
                mean_grad_grad_u=np.broadcast_to(self.M, (n, 3, 3, 3, 3)),
                mean_grad_p=np.broadcast_to(self.Q, (n, 3, 3)),
            )
            if tangent
            else None,
        )


def reference_tangents(reference: CellResponse) -> tuple[Array, Array]:
    """M (3, 3, 3, 3) and Q (3, 3) of the undeformed cell.

    Raises
    ------
    ValueError
        The response is not one solved row with its tangent.
    """
    tangent = reference.tangent
    if (
        len(reference) != 1
        or not reference.valid.all()
        or tangent is None
        or tangent.mean_grad_grad_u is None
        or tangent.mean_grad_p is None
    ):
        raise ValueError("expected the solved response of one undeformed cell, with its tangent")
    return tangent.mean_grad_grad_u[0].copy(), tangent.mean_grad_p[0].copy()
