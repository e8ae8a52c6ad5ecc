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
    # Filled row by row and turned at the end: writing columns would touch all of the memory again for each entry.
    out = np.zeros((3, 3, 3, 3, s.shape[1]))
    inverse = 1 / s
    S = T[:3] * inverse**2
    for i in range(3):
        for j in range(i, 3):
            np.multiply(inverse[i] * inverse[j], K[i, j] - T[i] if i == j else K[i, j], out=out[i, i, j, j])
            out[j, j, i, i] = out[i, i, j, j]
    for pair, (i, j, shear) in enumerate(PAIRS):
        # The curvature of ln C and that of W in the shear, for dC_ij = λ_i dF_ij + λ_j dF_ji.
        inner = T[i] * left[pair] + T[j] * right[pair] + g[pair] ** 2 / 4 * K[shear, shear]
        out[i, j, i, j] = s[i] ** 2 * inner + S[j]
        out[j, i, j, i] = s[j] ** 2 * inner + S[i]
        out[i, j, j, i] = out[j, i, i, j] = s[i] * s[j] * inner
    return np.ascontiguousarray(out.reshape(81, -1).T).reshape(-1, 3, 3, 3, 3)


def rotated_gradient(s: Array, first: Array, A: Array, slopes: Slopes) -> Array:
    """∂(R A(L))/∂F (n, 9, 9) of A (3, 3, n) with these ∂A/∂L; ``first`` are ln[λ_i², λ_j²] (6, n)."""
    n = s.shape[1]
    entries: dict[tuple[int, int], Array] = {}

    def add(output: int, place: int, value: Array) -> None:
        at = output, place
        entries[at] = entries[at] + value if at in entries else value

    there = A.any(axis=2)
    inverse = 1 / s
    half = first[3:] / 2
    for (output, component), slope in slopes.items():
        if component < 3:
            add(output, 4 * component, slope * inverse[component])
        else:
            i, j, _ = PAIRS[component - 3]
            by_shear = slope * half[component - 3]
            add(output, 3 * i + j, by_shear * s[i])
            add(output, 3 * j + i, by_shear * s[j])
    for i, j, _ in PAIRS:
        # dR_ij = (dF_ij − dF_ji)/(λ_i + λ_j) = −dR_ji.
        weight = 1 / (s[i] + s[j])
        for k in range(3):
            for row, other, sign in ((i, j, 1.0), (j, i, -1.0)):
                if there[other, k]:
                    spin = sign * weight * A[other, k]
                    add(3 * row + k, 3 * i + j, spin)
                    add(3 * row + k, 3 * j + i, -spin)
    out = np.zeros((81, n))
    for (output, place), value in entries.items():
        out[9 * output + place] = value
    return np.ascontiguousarray(out.T).reshape(n, 9, 9)
