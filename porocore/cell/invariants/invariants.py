"""Invariants of C = FᵀF with their derivatives by F: I₁, I₂, I₃, J, fibres' I₄ and I₅, power sums.

I₁ = tr C, I₂ = (I₁² − tr C²)/2, J = det F; of a fibre along the unit vector a, I₄ = a·Ca and I₅ = a·C²a (Spencer 1984,
Constitutive theory for strongly anisotropic solids); of the principal stretches, T_α = λ₁^α + λ₂^α + λ₃^α.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from porocore.cell.materials.kinematics import Kinematics, product
from porocore.core.tensors.cofactors import add_cofactor_tangent
from porocore.states import Array

#: Below this |t| two terms of the series of sinh(kt)/sinh(t) are exact to round-off for |k| up to 100.
SMALL = 1e-5


class Invariant(ABC):
    """Scalar invariant I(F); points are the last axis of every array."""

    #: Value at F = I, and the factor of its slope there: of the unit tensor, or of a ⊗ a for a fibre.
    rest: ClassVar[int]
    gradient_at_rest: ClassVar[int]

    @abstractmethod
    def value(self, at: Kinematics) -> Array:
        """Return I, (n,)."""

    @abstractmethod
    def gradient(self, at: Kinematics) -> Array:
        """Return ∂I/∂F_ij, (3, 3, n)."""

    @abstractmethod
    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        """Add weight (n,) times ∂²I/∂F_ij∂F_kl to A (3, 3, 3, 3, n)."""


@dataclass(frozen=True)
class Trace(Invariant):
    """First invariant I₁."""

    rest, gradient_at_rest = 3, 2

    def value(self, at: Kinematics) -> Array:
        return np.asarray((at.F * at.F).sum(axis=(0, 1)))

    def gradient(self, at: Kinematics) -> Array:
        return 2 * at.F

    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        for i in range(3):
            for j in range(3):
                A[i, j, i, j] += 2 * weight


@dataclass(frozen=True)
class Second(Invariant):
    """Second invariant I₂."""

    rest, gradient_at_rest = 3, 4

    def value(self, at: Kinematics) -> Array:
        C = at.C
        return np.asarray(
            C[0, 0] * C[1, 1] + C[1, 1] * C[2, 2] + C[2, 2] * C[0, 0]
            - C[0, 1] * C[0, 1] - C[1, 2] * C[1, 2] - C[0, 2] * C[0, 2]
        )  # fmt: skip

    def gradient(self, at: Kinematics) -> Array:
        """Return 2 (I₁ F − F C)."""
        return np.asarray(2 * (np.trace(at.C) * at.F - product(at.F, at.C)))

    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        """Add 2 (2 F_ij F_kl − F_il F_kj + I₁ δ_ik δ_jl − δ_ik C_jl − B_ik δ_jl)."""
        F, twice = at.F, 2 * weight
        for i in range(3):
            for j in range(3):
                left, across = 2 * twice * F[i, j], twice * F[:, j]
                for k in range(3):
                    for l in range(3):
                        A[i, j, k, l] += left * F[k, l] - F[i, l] * across[k]
        inner = twice * (np.trace(at.C) * np.eye(3)[:, :, None] - at.C)
        outer = twice * at.B
        for i in range(3):
            A[i, :, i, :] += inner
            A[:, i, :, i] -= outer


@dataclass(frozen=True)
class Volume(Invariant):
    """Volume ratio J."""

    rest, gradient_at_rest = 1, 1

    def value(self, at: Kinematics) -> Array:
        return at.J

    def gradient(self, at: Kinematics) -> Array:
        return at.cofactor

    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        """Add ε_ikm ε_jln F_mn."""
        add_cofactor_tangent(A, weight * at.F)


@dataclass(frozen=True)
class Third(Volume):
    """Third invariant I₃ = det C = J²."""

    rest, gradient_at_rest = 1, 2

    def value(self, at: Kinematics) -> Array:
        return np.asarray(at.J * at.J)

    def gradient(self, at: Kinematics) -> Array:
        """Return 2 J cof F."""
        return 2 * at.J * at.cofactor

    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        """Add 2 cof F ⊗ cof F + 2 J ∂cof F/∂F."""
        add_outer(A, 2 * weight * at.cofactor, at.cofactor)
        super().add_hessian(A, 2 * at.J * weight, at)


@dataclass(frozen=True)
class Fibre(Invariant):
    """Invariant I₄, the squared stretch along a unit vector of the reference configuration."""

    direction: tuple[float, float, float]
    rest, gradient_at_rest = 1, 2

    def _pushed(self, at: Kinematics) -> Array:
        """Return F a, (3, n)."""
        return np.asarray(np.tensordot(at.F, np.array(self.direction), axes=(1, 0)))

    def value(self, at: Kinematics) -> Array:
        f = self._pushed(at)
        return np.asarray((f * f).sum(axis=0))

    def gradient(self, at: Kinematics) -> Array:
        """Return 2 (F a) ⊗ a."""
        return np.asarray(2 * self._pushed(at)[:, None] * np.array(self.direction)[None, :, None])

    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        """Add 2 δ_ik a_j a_l."""
        a = np.array(self.direction)
        added = 2 * np.outer(a, a)[:, :, None] * weight
        for i in range(3):
            A[i, :, i, :] += added


@dataclass(frozen=True)
class SecondFibre(Fibre):
    """Invariant I₅ of a unit vector of the reference configuration."""

    rest, gradient_at_rest = 1, 4

    def value(self, at: Kinematics) -> Array:
        c = np.tensordot(at.C, np.array(self.direction), axes=(1, 0))
        return np.asarray((c * c).sum(axis=0))

    def _vectors(self, at: Kinematics) -> tuple[Array, Array, Array]:
        """Return F a, C a and F C a, (3, n)."""
        c = np.tensordot(at.C, np.array(self.direction), axes=(1, 0))
        return self._pushed(at), c, np.asarray((at.F * c).sum(axis=1))

    def gradient(self, at: Kinematics) -> Array:
        """Return 2 (F a ⊗ C a + F C a ⊗ a)."""
        f, c, g = self._vectors(at)
        a = np.array(self.direction)
        return np.asarray(2 * (f[:, None] * c + g[:, None] * a[:, None]))

    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        """Add 2 [δ_ik (c_j a_l + a_j c_l) + f_i f_k δ_jl + f_i a_l F_kj + a_j f_k F_il + B_ik a_j a_l]."""
        f, c, _ = self._vectors(at)
        a, twice = np.array(self.direction), 2 * weight
        mixed = twice * (c[:, None] * a[:, None] + a[:, None, None] * c)
        for i in range(3):
            A[i, :, i, :] += mixed
            A[:, i, :, i] += twice * f[:, None] * f
        fa = f[:, None] * a[:, None]  # f_i a_l
        A += twice * np.einsum("iln,kjn->ijkln", fa, at.F)
        A += twice * np.einsum("kjn,iln->ijkln", fa, at.F)
        A += twice * np.einsum("ikn,j,l->ijkln", at.B, a, a)


@dataclass(frozen=True)
class PowerSum(Invariant):
    """Power sum T_α = tr C^(α/2) of real α; equal stretches are regular, since no eigenvector is differentiated."""

    exponent: float
    rest = 3

    def value(self, at: Kinematics) -> Array:
        _, _, log = at.principal
        return np.asarray(np.exp(self.exponent / 2 * log).sum(axis=0))

    def gradient(self, at: Kinematics) -> Array:
        """Return 2 F h(C) = Σ_a 2 h(c_a) M_aa with h(c) = α/2 c^(α/2 − 1)."""
        h = self._slope(at)
        return np.asarray(2 * sum(h[a] * at.dyads[a, a] for a in range(3)))

    def add_hessian(self, A: Array, weight: Array, at: Kinematics) -> None:
        """Add 2 δ_ik h(C)_jl + 4 Σ_a h[a,a] M_aa⊗M_aa + 2 Σ_a<b h[a,b] (M_ab + M_ba)⊗(M_ab + M_ba).

        h[a,b] are the divided differences of h in the derivative of h(C) (Daleckii & Krein 1965).
        """
        _, N, log = at.principal
        k = self.exponent / 2 - 1
        inner = np.asarray(np.einsum("jan,lan,an->jln", N, N, 2 * weight * self._slope(at)))
        for i in range(3):
            A[i, :, i, :] += inner
        for a in range(3):
            for b in range(a, 3):
                h = self.exponent / 2 * power_difference(log[a], log[b], k)
                M = at.dyads[a, a] if a == b else at.dyads[a, b] + at.dyads[b, a]
                add_outer(A, (4 if a == b else 2) * weight * h * M, M)

    def _slope(self, at: Kinematics) -> Array:
        return np.asarray(self.exponent / 2 * np.exp((self.exponent / 2 - 1) * at.principal[2]))


def add_outer(A: Array, left: Array, right: Array) -> None:
    """Add left_ij right_kl to A (3, 3, 3, 3, n)."""
    rows, l, r = A.reshape(9, 9, -1), left.reshape(9, -1), right.reshape(9, -1)
    for i in range(9):
        rows[i] += l[i] * r


def power_difference(log_x: Array, log_y: Array, k: float) -> Array:
    """Return (x^k − y^k)/(x − y), and k x^(k−1) where x = y, of positive numbers given by their logarithms.

    With t = (ln x − ln y)/2 it is (xy)^((k−1)/2) sinh(kt)/sinh(t), without a difference of nearly equal powers. The
    quotient is an even, smooth function of t, so round-off in t has no effect. Below |t| = 1e-5 its
    series k (1 + (k² − 1) t²/6) is summed instead.
    """
    t = (log_x - log_y) / 2
    small = np.abs(t) < SMALL
    safe = np.where(small, 1.0, t)
    quotient = np.where(small, k * (1 + (k * k - 1) / 6 * t * t), np.sinh(k * safe) / np.sinh(safe))
    return np.asarray(np.exp((k - 1) / 2 * (log_x + log_y)) * quotient)
