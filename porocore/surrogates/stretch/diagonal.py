"""Stress and tangent through ln U where every F is diagonal, in fewer operations.

One-dimensional consolidation asks for nothing else. For the second derivatives the potential must couple no shear
with anything else. All arrays are component-first; s (3, n) are the stretches, the diagonal of F.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from porocore.states import Array
from porocore.surrogates.stretch.components import PAIRS
from porocore.surrogates.stretch.divided_differences import pair_differences

#: Derivatives by L, (n,) or constant, by (place, component).
Gradients = Mapping[tuple[int, int], Array | float]


def stress(s: Array, T: Array) -> Array:
    """Return ∂W/∂F (n, 3, 3) from T = ∂W/∂L (6, n), whose shears are zero."""
    out = np.zeros((s.shape[1], 9))
    for i in range(3):
        np.divide(T[i], s[i], out=out[:, 4 * i])
    return out.reshape(-1, 3, 3)


def is_orthotropic(T: Array, K: Array) -> bool:
    """Return whether ∂W/∂L (6, n) and ∂²W/∂L² (6, 6, n) couple no shear to anything else."""
    blocks = (T[3:], K[0, 3:], K[1, 3:], K[2, 3:], K[3, 4:], K[4, 5:])
    return all(vanishes(block) for block in blocks)


def vanishes(block: Array) -> bool:
    """Return whether all entries are zero; NaN is not."""
    flat = block.reshape(-1)
    return bool(flat @ flat == 0)


def uniaxial_differences(c: Array, axis: int) -> tuple[Array, Array, Array]:
    """Return ln[c_i, c_j], ln[c_i, c_i, c_j] and ln[c_i, c_j, c_j] of the three ``PAIRS`` of c (3, n), (3, n) each.

    All entries of c but those of ``axis`` are equal, state by state.
    """
    other = (axis + 1) % 3
    g, twice_other, twice_axis = pair_differences(c[other], c[axis])
    pair, left, right = np.empty_like(c), np.empty_like(c), np.empty_like(c)
    for k, (i, _, _) in enumerate(PAIRS):
        if k == axis:  # the pair of the other two
            pair[k] = 1 / c[other]
            left[k] = right[k] = -0.5 * pair[k] * pair[k]
        else:
            pair[k] = g
            left[k], right[k] = (twice_axis, twice_other) if i == axis else (twice_other, twice_axis)
    return pair, left, right


def tangent(s: Array, differences: tuple[Array, Array, Array], T: Array, K: Array) -> Array:
    """Return ∂²W/∂F² (n, 3, 3, 3, 3) of an orthotropic W; ``differences`` are those of the three pairs of λ²."""
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


def rotated_gradient(s: Array, first: Array, A: Array, gradients: Gradients) -> Array:
    """Return ∂(R A(L))/∂F (n, 9, 9) of A (3, 3, n) with these ∂A/∂L; ``first`` are ln[λ_i², λ_j²] (6, n)."""
    out = np.zeros((s.shape[1], 9, 9))
    inverse = 1 / s
    for (output, component), gradient in gradients.items():
        if component < 3:
            np.multiply(gradient, inverse[component], out=out[:, output, 4 * component])
    nine = A.reshape(9, -1)
    is_diagonal = vanishes(nine[1:4]) and vanishes(nine[5:8])
    turned = [divmod(place, 3) for place in range(0, 9, 4 if is_diagonal else 1)]
    for i, j, shear in PAIRS:
        by_shear = {
            output: gradient for (output, component), gradient in gradients.items() if component == shear
        }
        half = first[shear] / 2
        # dR_ij = (dF_ij − dF_ji)/(λ_i + λ_j) = −dR_ji.
        weight = 1 / (s[i] + s[j])
        spins = {3 * i + k: weight * A[j, k] for row, k in turned if row == j}
        spins |= {3 * j + k: -weight * A[i, k] for row, k in turned if row == i}
        for output in by_shear.keys() | spins.keys():
            stretching, spin = by_shear.get(output, 0.0) * half, spins.get(output, 0.0)
            np.add(stretching * s[i], spin, out=out[:, output, 3 * i + j])
            np.subtract(stretching * s[j], spin, out=out[:, output, 3 * j + i])
    return out
