"""C, B, J, cofactor and principal stretches of many deformation gradients, computed when needed."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from porocore.core.tensors.cofactors import cofactor, determinant
from porocore.core.tensors.symmetric_functions import symmetric_eigen
from porocore.states import Array


class Kinematics:
    """Kinematic quantities of F (3, 3, n), points last; each is computed when it is first used."""

    def __init__(self, F: Array) -> None:
        self.F = F

    @cached_property
    def C(self) -> Array:
        """Right Cauchy–Green tensor FᵀF, (3, 3, n)."""
        return _symmetric_product(self.F.swapaxes(0, 1))

    @cached_property
    def B(self) -> Array:
        """Left Cauchy–Green tensor FFᵀ, (3, 3, n)."""
        return _symmetric_product(self.F)

    @cached_property
    def J(self) -> Array:
        """Volume ratio det F, (n,)."""
        return determinant(np.moveaxis(self.F, -1, 0))

    @cached_property
    def cofactor(self) -> Array:
        """Cofactor of F, (3, 3, n)."""
        return np.moveaxis(cofactor(np.moveaxis(self.F, -1, 0)), 0, -1)

    @cached_property
    def principal(self) -> tuple[Array, Array, Array]:
        """Squared stretches c_a (3, n), their reference axes N_ia (3, 3, n), and the logarithm of c_a, (3, n)."""
        squares, axes = symmetric_eigen(self.C)
        return squares, axes, np.log(squares)

    @cached_property
    def dyads(self) -> Array:
        """Dyads M_ab = (F N_a) ⊗ N_b, (3, 3, 3, 3, n), indices a, b, i, j."""
        _, N, _ = self.principal
        f = product(self.F, N)  # columns
        return np.asarray(np.einsum("ian,jbn->abijn", f, N))


def product(A: Array, B: Array) -> Array:
    """Return A_ik B_kj of (3, 3, n), by contiguous slices, which is faster than n small products."""
    rows = [[A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j] for j in range(3)] for i in range(3)]
    return np.array(rows)


def _symmetric_product(A: Array) -> Array:
    """Return A_ik A_jk of (3, 3, n)."""
    out = np.empty_like(A)
    for i in range(3):
        for j in range(i, 3):
            out[i, j] = out[j, i] = A[i, 0] * A[j, 0] + A[i, 1] * A[j, 1] + A[i, 2] * A[j, 2]
    return out
