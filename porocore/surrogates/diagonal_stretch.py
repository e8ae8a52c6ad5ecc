"""What :class:`porocore.surrogates.stretch.LogStretch` computes, where every F is diagonal: few entries are not zero.

One-dimensional consolidation asks for nothing else. For the second derivatives the potential must couple no shear
with anything else. All arrays are component-first; s (3, n) are the stretches, the diagonal of F.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from porocore.states import Array
from porocore.surrogates.components import PAIRS

#: Derivatives by L, (n,) or constant, by (place, component).
Slopes = Mapping[tuple[int, int], Array | float]


def stress(s: Array, T: Array) -> Array:
    """∂W/∂F (n, 3, 3) from T = ∂W/∂L (6, n), whose shears are zero."""
    out = np.zeros((s.shape[1], 9))
    out[:, ::4] = (T[:3] / s).T
    return out.reshape(-1, 3, 3)


def is_orthotropic(T: Array, K: Array) -> bool:
    """Whether ∂W/∂L (6, n) and ∂²W/∂L² (6, 6, n) leave every shear to itself."""
    return not (T[3:].any() or K[:3, 3:].any() or K[3, 4:].any() or K[4, 5].any())


def tangent(s: Array, differences: tuple[Array, Array, Array], T: Array, K: Array) -> Array:
    """∂²W/∂F² (n, 3, 3, 3, 3) of an orthotropic W; ``differences`` are those of the three pairs of λ²."""
    g, left, right = differences
    out = np.zeros((s.shape[1], 3, 3, 3, 3))
    inverse = 1 / s
    S = T[:3] * inverse * inverse
    for i in range(3):
        out[:, i, i, i, i] = inverse[i] * inverse[i] * (K[i, i] - T[i])
        for j in range(i + 1, 3):
            out[:, i, i, j, j] = out[:, j, j, i, i] = inverse[i] * inverse[j] * K[i, j]
    for pair, (i, j, shear) in enumerate(PAIRS):
        # The curvature of ln C and that of W in the shear, for dC_ij = λ_i dF_ij + λ_j dF_ji.
        inner = T[i] * left[pair] + T[j] * right[pair] + g[pair] * g[pair] / 4 * K[shear, shear]
        once = s[i] * inner
        out[:, i, j, i, j] = s[i] * once + S[j]
        out[:, j, i, j, i] = s[j] * s[j] * inner + S[i]
        out[:, i, j, j, i] = out[:, j, i, i, j] = s[j] * once
    return out


def rotated_gradient(s: Array, first: Array, A: Array, slopes: Slopes) -> Array:
    """∂(R A(L))/∂F (n, 9, 9) of A (3, 3, n) with these ∂A/∂L; ``first`` are ln[λ_i², λ_j²] (6, n)."""
    out = np.zeros((s.shape[1], 9, 9))
    there = A.any(axis=2)
    inverse = 1 / s
    half = first[3:] / 2
    for (output, component), slope in slopes.items():
        if component < 3:
            out[:, output, 4 * component] = slope * inverse[component]
        else:
            i, j, _ = PAIRS[component - 3]
            by_shear = slope * half[component - 3]
            out[:, output, 3 * i + j] = by_shear * s[i]
            out[:, output, 3 * j + i] = by_shear * s[j]
    for i, j, _ in PAIRS:
        # dR_ij = (dF_ij − dF_ji)/(λ_i + λ_j) = −dR_ji.
        weight = 1 / (s[i] + s[j])
        for k in range(3):
            for row, other, one, two in ((i, j, 3 * i + j, 3 * j + i), (j, i, 3 * j + i, 3 * i + j)):
                if there[other, k]:
                    spin = weight * A[other, k]
                    out[:, 3 * row + k, one] += spin
                    out[:, 3 * row + k, two] -= spin
    return out
