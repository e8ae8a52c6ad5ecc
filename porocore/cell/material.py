"""Strain energies of the solid."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from porocore.states import Array


class NeoHookean(BaseModel):
    """Compressible neo-Hookean solid with E = 1.

    Ψ = μ/2 (tr FᵀF − 3) − μ ln J + λ/2 (ln J)², μ = 1/(2(1+ν)), λ = ν/((1+ν)(1−2ν))
    (Dehghani & Zilian, eq. Neo_Hookean). All methods work on arrays (..., 3, 3).
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["neo-hookean"] = "neo-hookean"
    poisson_ratio: Annotated[float, Field(gt=-1, lt=0.5)] = 0.35

    @property
    def mu(self) -> float:
        """Shear modulus μ [E]."""
        return 1 / (2 * (1 + self.poisson_ratio))

    @property
    def lam(self) -> float:
        """First Lamé constant λ [E]."""
        return self.poisson_ratio / ((1 + self.poisson_ratio) * (1 - 2 * self.poisson_ratio))

    def energy(self, F: Array) -> Array:
        """Ψ (...) [E]."""
        log_J = np.log(determinant(F))
        energy: Array = (
            self.mu / 2 * ((F * F).sum(axis=(-2, -1)) - 3) - self.mu * log_J + self.lam / 2 * log_J**2
        )
        return energy

    def stress(self, F: Array) -> Array:
        """P = ∂Ψ/∂F (..., 3, 3), first Piola–Kirchhoff, tension positive [E]."""
        J = determinant(F)
        return self.mu * F + ((self.lam * np.log(J) - self.mu) / J)[..., None, None] * cofactor(F)

    def tangent(self, F: Array) -> Array:
        """A_ijkl = ∂P_ij/∂F_kl (..., 3, 3, 3, 3) [E]."""
        J = determinant(F)
        F_inverse_T = cofactor(F) / J[..., None, None]
        c = self.lam * np.log(J) - self.mu
        eye = np.eye(3)
        outer = F_inverse_T[..., :, :, None, None] * F_inverse_T[..., None, None, :, :]
        swapped = np.einsum("...il,...kj->...ijkl", F_inverse_T, F_inverse_T)
        identity = np.einsum("ik,jl->ijkl", eye, eye)
        tangent: Array = self.lam * outer - c[..., None, None, None, None] * swapped + self.mu * identity
        return tangent


def determinant(F: Array) -> Array:
    """det F of (..., 3, 3), in closed form."""
    det: Array = (
        F[..., 0, 0] * (F[..., 1, 1] * F[..., 2, 2] - F[..., 1, 2] * F[..., 2, 1])
        + F[..., 0, 1] * (F[..., 1, 2] * F[..., 2, 0] - F[..., 1, 0] * F[..., 2, 2])
        + F[..., 0, 2] * (F[..., 1, 0] * F[..., 2, 1] - F[..., 1, 1] * F[..., 2, 0])
    )
    return det


def cofactor(F: Array) -> Array:
    """cof F = J F⁻ᵀ of (..., 3, 3), in closed form; ∂J/∂F."""
    a, b, c = F[..., 0, :], F[..., 1, :], F[..., 2, :]
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-2)


def cofactor_tangent(F: Array) -> Array:
    """∂cof F_ij / ∂F_kl = ε_ikm ε_jln F_mn, (..., 3, 3, 3, 3)."""
    permutation = np.zeros((3, 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        permutation[i, j, k], permutation[i, k, j] = 1.0, -1.0
    tangent: Array = np.einsum("ikm,jln,...mn->...ijkl", permutation, permutation, F)
    return tangent
