"""Rotation R of the polar decomposition F = R U of many tensors, and its derivative."""

from __future__ import annotations

import numpy as np

from porocore.core.tensors.cofactors import cofactor, determinant
from porocore.states import Array

#: Steps of Newton's iteration at most; it converges quadratically.
MOST_STEPS = 60
#: A step that changes no entry by more than this was the last; and two places of a symmetric tensor differ by no more.
ROUND_OFF = 1e-14
#: ε_kij.
PERMUTATION = np.zeros((3, 3, 3))
for _k, _i, _j in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    PERMUTATION[_k, _i, _j], PERMUTATION[_k, _j, _i] = 1.0, -1.0


def polar_rotation(F: Array) -> Array:
    """Return R (n, 3, 3) of F = R U, det F > 0; exactly I where F is symmetric and positive definite.

    By Newton's iteration R ← (R + R⁻ᵀ)/2, which begins at F (Higham, Functions of Matrices, ch. 8).
    """
    R = np.where(_is_stretch(F)[:, None, None], np.eye(3), F)
    for _ in range(MOST_STEPS):
        following = (R + cofactor(R) / determinant(R)[:, None, None]) / 2
        change = np.abs(following - R).max(initial=0.0)
        R = following
        if change <= ROUND_OFF:
            break
    return R


def spin(F: Array, R: Array) -> Array:
    """Return ∂ω/∂F (n, 3, 9) of the rotation R of F, where dR = R Ω and Ω v = ω × v.

    From Rᵀ dF − dFᵀ R = Ω U + U Ω, which is the skew tensor of (tr U I − U) ω.
    """
    U = R.swapaxes(1, 2) @ F
    turning = np.trace(U, axis1=1, axis2=2)[:, None, None] * np.eye(3) - U
    driving = np.einsum("kij,nmj->nkmi", PERMUTATION, R).reshape(-1, 3, 9)
    rate: Array = np.linalg.solve(turning, driving)
    return rate


def cross_matrix(v: Array) -> Array:
    """Return [v]× (n, 3, 3) of v (n, 3), with [v]× w = v × w."""
    matrix: Array = -np.einsum("kij,nk->nij", PERMUTATION, v)
    return matrix


def _is_stretch(F: Array) -> Array:
    """Return which of F (n, 3, 3), with det F > 0, are symmetric and positive definite, (n,) bool."""
    size = np.abs(F).max(axis=(1, 2), initial=0.0)
    skew = np.abs(F - F.swapaxes(1, 2)).max(axis=(1, 2), initial=0.0)
    minor = F[:, 0, 0] * F[:, 1, 1] - F[:, 0, 1] * F[:, 1, 0]
    stretch: Array = (skew <= ROUND_OFF * size) & (F[:, 0, 0] > 0) & (minor > 0)
    return stretch
