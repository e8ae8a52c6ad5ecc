"""Determinant and cofactor of 3 × 3 tensors in closed form, and the derivative of the cofactor."""

from __future__ import annotations

import numpy as np

from porocore.states import Array


def determinant(F: Array) -> Array:
    """Return det F of F (..., 3, 3) in closed form."""
    det: Array = (
        F[..., 0, 0] * (F[..., 1, 1] * F[..., 2, 2] - F[..., 1, 2] * F[..., 2, 1])
        + F[..., 0, 1] * (F[..., 1, 2] * F[..., 2, 0] - F[..., 1, 0] * F[..., 2, 2])
        + F[..., 0, 2] * (F[..., 1, 0] * F[..., 2, 1] - F[..., 1, 1] * F[..., 2, 0])
    )
    return det


def cofactor(F: Array) -> Array:
    """Return cof F = J F⁻ᵀ = ∂J/∂F of F (..., 3, 3) in closed form."""
    cof = np.moveaxis(
        np.empty((3, 3, *F.shape[:-2]), F.dtype), (0, 1), (-2, -1)
    )  # component-first in memory: fast slices
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for m in range(3):
            n, o = (m + 1) % 3, (m + 2) % 3
            cof[..., i, m] = F[..., j, n] * F[..., k, o] - F[..., j, o] * F[..., k, n]
    return cof


def add_cofactor_tangent(A: Array, F: Array) -> None:
    """Add ∂cof F_ij/∂F_kl, which is linear in F (3, 3, n), to A (3, 3, 3, 3, n), points last."""
    for i, k, m, row in _PERMUTATIONS:
        for j, l, n, column in _PERMUTATIONS:
            if row == column:
                A[i, j, k, l] += F[m, n]
            else:
                A[i, j, k, l] -= F[m, n]


def cofactor_tangent(F: Array) -> Array:
    """Return ∂cof F_ij/∂F_kl = ε_ikm ε_jln F_mn, (..., 3, 3, 3, 3)."""
    tangent = np.zeros((*F.shape[:-2], 3, 3, 3, 3))
    for i, k, m, row in _PERMUTATIONS:
        for j, l, n, column in _PERMUTATIONS:
            tangent[..., i, j, k, l] = row * column * F[..., m, n]
    return tangent


#: (i, j, k, ε_ijk) wherever ε is not zero.
_PERMUTATIONS = [(0, 1, 2, 1), (1, 2, 0, 1), (2, 0, 1, 1), (0, 2, 1, -1), (2, 1, 0, -1), (1, 0, 2, -1)]
