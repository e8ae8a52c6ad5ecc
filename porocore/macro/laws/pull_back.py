"""Mean deformation of the solid, transformed conductivity and flux through the pore; laws of conductivity.

Both closures take the flux from here. Its conductivity is that of the undeformed pore, carried along with F̄, or that of
the deformed pore, which is a response of the cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from porocore.core.tensors.cofactors import cofactor, determinant
from porocore.core.tensors.polar import cross_matrix, polar_rotation, spin
from porocore.states import Array, CellTangent, MacroState

#: ``piola``: K of the undeformed cell, turned with the solid and pulled back, R̄ K R̄ᵀ for K; ``piola-unrotated``: pulled
#: back only (Dehghani & Zilian); ``deformed``: that of the flow through every deformed pore.
ConductivityLaw = Literal["piola", "piola-unrotated", "deformed"]
CONDUCTIVITY_LAWS: tuple[str, ...] = get_args(ConductivityLaw)
#: A conductivity that differs between directions by no more than this share is the same in all: it has nothing to turn.
ISOTROPIC = 1e-12


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
        K_ref, between ∇_X p and the flux through reference area: Ḡ K̂ F̄⁻ᵀ, or that of the deformed pore.
    transformed : (n, 3, 3)
        K_t = K_ref/det F̄ (Dehghani & Zilian's transformed conductivity), F̄⁻¹ K̂ F̄⁻ᵀ where K is carried along.
    grad_p, flux : (n, 3)
        ∇_X p, and q = −conductivity ∇_X p.
    undeformed : (3, 3) or (n, 3, 3)
        K; None where the conductivity is that of the deformed pore.
    rotation : (n, 3, 3)
        R̄ of F̄ = R̄ Ū, by which K is turned, K̂ = R̄ K R̄ᵀ; None where K̂ = K.
    """

    F: Array
    J: Array
    cof: Array
    conductivity: Array
    transformed: Array
    grad_p: Array
    flux: Array
    undeformed: Array | None
    rotation: Array | None = None

    @classmethod
    def from_states(
        cls,
        states: MacroState,
        mean_grad: Array,
        grad_p: Array,
        solid_fraction: float | Array,
        K: Array,
        law: ConductivityLaw = "piola",
        deformed: Array | None = None,
    ) -> PulledBack:
        """Return the kinematics of H, <∇u¹>_s, ∇_X p, φ_s and K of the undeformed cell, or of each point's own (n, …).

        With the law ``deformed`` K_ref (n, 3, 3) of the ``deformed`` pores is in the place of K.

        Raises
        ------
        ValueError
            The law is ``deformed`` and there is no such K_ref.
        """
        F = np.eye(3) + states.grad_u + mean_grad / at_points(solid_fraction, 2)
        J, J0 = determinant(F), determinant(np.eye(3) + states.grad_u)
        J = np.where((J > 0) & (J0 > 0), J, np.nan)
        cof = np.ascontiguousarray(cofactor(F))
        rotation = None
        if law == "deformed":
            if deformed is None:
                raise ValueError("expected the conductivity of the deformed pores")
            conductivity = np.where(np.isnan(J)[:, None, None], np.nan, deformed)
        else:
            carried = K
            if law == "piola" and not is_isotropic(K):
                rotation = polar_rotation(np.where(np.isnan(J)[:, None, None], np.eye(3), F))
                carried = rotation @ K @ rotation.swapaxes(1, 2)
            conductivity = cof.swapaxes(1, 2) @ carried @ cof / J[:, None, None]
        transformed = conductivity / J[:, None, None]
        flux = -(conductivity @ grad_p[:, :, None])[..., 0]
        undeformed = None if law == "deformed" else K
        return cls(F, J, cof, conductivity, transformed, grad_p, flux, undeformed, rotation)

    @property
    def missing(self) -> Array:
        """Points without a response, (n, 1, 1) bool."""
        return np.isnan(self.J)[:, None, None]

    def flux_tangent(
        self,
        cell: CellTangent,
        solid_fraction: float | Array,
        deformation: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:
        """Return ∂q/∂H (n, 3, 9) and ∂q/∂p (n, 3).

        A cell that does not tell how its own conductivity changes is taken as if it did not: a Newton iteration with
        that tangent converges to the same solution, linearly.

        Parameters
        ----------
        deformation
            :func:`deformation_tangent` where it is known already.
        """
        n = len(self.J)
        if self.undeformed is not None:
            by_F = self.flux_by_deformation
            dF_dH, dF_dp = deformation or deformation_tangent(cell, solid_fraction)
            return by_F @ dF_dH, (by_F @ dF_dp)[..., 0]
        if cell.conductivity_grad_u is None or cell.conductivity_p is None:
            return np.zeros((n, 3, 9)), np.zeros((n, 3))
        by_H = np.einsum("nijk,nj->nik", cell.conductivity_grad_u.reshape(n, 3, 3, 9), self.grad_p)
        return -by_H, -(cell.conductivity_p @ self.grad_p[:, :, None])[..., 0]

    def flux_changes(self, deformation: Array, K: Array, law: ConductivityLaw) -> Array:
        """Return the changes (n, 3, k) of q at fixed ∇p.

        Parameters
        ----------
        deformation : (n, 3, 3, k)
            Change of F̄.
        K : (n, 3, 3, k)
            Change of K of the undeformed pore, or of K_ref with the law ``deformed``.
        law
            By which the flux goes.
        """
        n, k = len(K), K.shape[-1]
        if self.undeformed is None:
            return -_along(K, self.grad_p)
        R = self.rotation
        if R is None and law == "piola" and not is_isotropic(np.moveaxis(K, -1, 1)):
            R = polar_rotation(np.where(self.missing, np.eye(3), self.F))
        pulled = (self.cof @ self.grad_p[:, :, None])[..., 0]
        turned = pulled if R is None else (pulled[:, None, :] @ R)[:, 0]
        flow = _along(K, turned)
        if R is not None:
            flow = R @ flow
        moved = self.flux_by_deformation @ deformation.reshape(n, 9, k)
        return np.asarray(moved - self.cof.swapaxes(1, 2) @ flow / self.J[:, None, None])

    @cached_property
    def flux_by_deformation(self) -> Array:
        """∂q/∂F̄ (n, 3, 9) of a K that is carried along.

        For R̄ held it is q_i F̄⁻¹_lk − F̄⁻¹_ik q_l + (K_ref)_il (F̄⁻ᵀ ∇_X p)_k.
        """
        n, R, q, K, grad_p = len(self.J), self.rotation, self.flux, self.undeformed, self.grad_p
        assert K is not None
        inverse = np.ascontiguousarray(self.cof.swapaxes(1, 2)) / self.J[:, None, None]
        pulled = (grad_p[:, None, :] @ inverse)[:, 0]
        by_F = q[:, :, None, None] * inverse.swapaxes(1, 2)[:, None]
        by_F -= inverse[:, :, :, None] * q[:, None, None, :]
        by_F += self.conductivity[:, :, None, :] * pulled[:, None, :, None]
        found: Array = by_F.reshape(n, 3, 9)
        if R is not None:
            # dK̂ = R̄ (Ω K − K Ω) R̄ᵀ, and Ω v = ω × v.
            v = (pulled[:, None, :] @ R)[:, 0]
            turned = v @ K.T if K.ndim == 2 else (K @ v[:, :, None])[..., 0]
            by_spin = K @ cross_matrix(v) - cross_matrix(turned)
            found -= self.cof.swapaxes(1, 2) @ R @ by_spin @ spin(self._states_of(R), R)
        return found

    def _states_of(self, R: Array) -> Array:
        """Return F̄ (n, 3, 3), and R where there is none."""
        return np.where(self.missing, R, self.F)


def _along(K: Array, vectors: Array) -> Array:
    """Return K v (n, 3, k) of tensors (n, 3, 3, k) and vectors (n, 3)."""
    found = np.zeros((len(K), 3, K.shape[-1]))
    for j in np.flatnonzero(K.any(axis=(0, 1, 2))):
        found[..., j] = (K[..., j] @ vectors[:, :, None])[..., 0]
    return found


def is_isotropic(K: Array) -> bool:
    """Tell whether K (3, 3), or each of K (n, 3, 3), is the same in all directions, so that no rotation changes it."""
    mean = at_points(np.trace(K, axis1=-2, axis2=-1) / 3, 2)
    return bool((np.abs(K - mean * np.eye(3)) <= ISOTROPIC * np.abs(mean)).all())


def at_points(value: float | Array, axes: int) -> float | Array:
    """Return a number as it is, and numbers (n,) with so many further axes of length 1."""
    return value.reshape(*value.shape, *(1,) * axes) if isinstance(value, np.ndarray) else value


def deformation_tangent(tangent: CellTangent, solid_fraction: float | Array) -> tuple[Array, Array]:
    """Return ∂F̄/∂H (n, 9, 9) and ∂F̄/∂p (n, 9, 1)."""
    assert tangent.mean_grad_grad_u is not None
    assert tangent.mean_grad_p is not None
    n, share = len(tangent.mean_grad_p), at_points(solid_fraction, 2)
    return (
        np.eye(9) + tangent.mean_grad_grad_u.reshape(n, 9, 9) / share,
        tangent.mean_grad_p.reshape(n, 9, 1) / share,
    )
