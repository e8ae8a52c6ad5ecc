"""Material with a neo-Hookean energy, compressible, E = 1, in closed form."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from porocore.cell.materials.material import Material
from porocore.core.models.strict import CalledByUsers
from porocore.core.tensors.cofactors import cofactor, determinant
from porocore.states import Array, IntArray


class NeoHookean(Material, metaclass=CalledByUsers):
    """Compressible neo-Hookean solid with E = 1.

    Ψ = μ/2 (tr FᵀF − 3) − μ ln J + λ/2 (ln J)², μ = 1/(2(1+ν)), λ = ν/((1+ν)(1−2ν))
    (Dehghani & Zilian, eq. Neo_Hookean). All methods work on arrays (..., 3, 3).

    Examples
    --------
    >>> from porocore import NeoHookean
    >>> solid = NeoHookean(poisson_ratio=0.3)
    >>> solid.stress(np.diag([1.1, 1.0, 1.0])).diagonal().round(4)
    array([0.1234, 0.055 , 0.055 ])
    """

    kind: Literal["neo-hookean"] = "neo-hookean"
    """Ψ = μ/2 (tr FᵀF − 3) − μ ln J + λ/2 (ln J)² with E = 1."""
    poisson_ratio: Annotated[float, Field(gt=-1, lt=0.5)] = 0.35
    """Poisson's ratio of the solid; μ and λ follow with E = 1."""

    @property
    def mu(self) -> float:
        """Shear modulus μ [E]."""
        return 1 / (2 * (1 + self.poisson_ratio))

    @property
    def lam(self) -> float:
        """First Lamé constant λ [E]."""
        return self.poisson_ratio / ((1 + self.poisson_ratio) * (1 - 2 * self.poisson_ratio))

    @property
    def isotropic(self) -> bool:
        """True: no direction is preferred."""
        return True

    @property
    def description(self) -> str:
        """Kind and Poisson's ratio."""
        return f"{self.kind} solid with Poisson's ratio {self.poisson_ratio:g}"

    def mean_moduli(self, elements: IntArray | None = None) -> tuple[float, float]:
        """Return E = 1 and μ, the same everywhere."""
        return 1.0, self.mu

    def volumetric(self, log_J: Array) -> tuple[Array, Array, Array]:
        """Return U = −μ ln J + λ/2 (ln J)² and its first and second derivative by ln J."""
        return (
            (self.lam / 2 * log_J - self.mu) * log_J,
            self.lam * log_J - self.mu,
            np.full(log_J.shape, self.lam),
        )

    def energy_density(self, F: Array) -> Array:
        """Return Ψ (...) [E]."""
        of_shape = self.mu / 2 * ((F * F).sum(axis=(-2, -1)) - 3)
        return np.asarray(of_shape + self.volumetric(np.log(determinant(F)))[0])

    def stress(self, F: Array) -> Array:
        """Return P = ∂Ψ/∂F (..., 3, 3), first Piola–Kirchhoff, tension positive [E]."""
        J = determinant(F)
        return self.mu * F + (self.volumetric(np.log(J))[1] / J)[..., None, None] * cofactor(F)

    def tangent(self, F: Array) -> Array:
        """Return A_ijkl = ∂P_ij/∂F_kl (..., 3, 3, 3, 3) [E]."""
        J = determinant(F)
        G = cofactor(F) / J[..., None, None]  # F⁻ᵀ
        _, first, second = self.volumetric(np.log(J))
        G_T = G.swapaxes(-1, -2)
        tangent: Array = second[..., None, None, None, None] * (
            G[..., :, :, None, None] * G[..., None, None, :, :]
        )
        tangent -= first[..., None, None, None, None] * (
            G[..., :, None, None, :] * G_T[..., None, :, :, None]  # G_il G_kj
        )
        tangent += self.mu * np.eye(9).reshape(3, 3, 3, 3)
        return tangent
