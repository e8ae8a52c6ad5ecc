"""Tensors: logarithm and exponential, polar decomposition, cofactor, point groups of cells (PointGroup).

Tensors of second order, all that is exchanged with a cell, do not feel an inversion: (−Q) A (−Q)ᵀ = Q A Qᵀ. So an
operation counts as the same as its product with the inversion, and each is represented by the rotation of the two.
The 48 operations of the cube become its 24 rotations, the 32 point groups become Laue classes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations, product
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from porocore.states import Array, IntArray

#: Of Jacobi's rotations at most; entries off the diagonal count as zero below this share of the trace.
SWEEPS, ROUND_OFF = 8, 1e-18
#: Keeps 0/0 away.
TINY = 1e-300


def symmetric_eigen(A: Array) -> tuple[Array, Array]:
    """Return eigenvalues (3, n) and eigenvectors (3, 3, n), in columns, of symmetric A (3, 3, n).

    By Jacobi's rotations, which converge quadratically; for thousands of matrices at once they are faster than a
    call of LAPACK for each.
    """
    d = np.stack([A[i, i] for i in range(3)])
    off = np.stack([A[1, 2], A[0, 2], A[0, 1]])  # by the third axis
    Q = np.zeros_like(A)  # eigenvectors in rows, so that a rotation mixes two blocks of memory
    Q[0, 0] = Q[1, 1] = Q[2, 2] = 1.0
    smallest = ROUND_OFF * d.sum(axis=0)
    for _ in range(SWEEPS):
        if (np.abs(off).max(axis=0) <= smallest).all():
            break
        for i, j, k in ((0, 1, 2), (0, 2, 1), (1, 2, 0)):
            e = off[k]
            gap = d[j] - d[i]
            gap *= 0.5
            t = np.sqrt(gap * gap + e * e)
            t += np.abs(gap)
            t += TINY
            t = e / np.copysign(t, gap, out=t)
            c = t * t
            c += 1.0
            np.sqrt(c, out=c)
            np.divide(1.0, c, out=c)
            s = t * c
            t *= e
            d[i] -= t
            d[j] += t
            off[k] = 0.0
            before = off[j].copy()
            off[j] *= c
            off[j] -= s * off[i]
            off[i] *= c
            off[i] += s * before
            turned = s * Q[i]
            Q[i] *= c
            Q[i] -= s * Q[j]
            Q[j] *= c
            Q[j] += turned
    return d, Q.swapaxes(0, 1)


def logarithm(A: Array) -> Array:
    """Return ln A (..., r, r) of symmetric A; NaN where A is not positive definite."""
    values, vectors = np.linalg.eigh(A)
    with np.errstate(invalid="ignore", divide="ignore"):
        logs = np.where(values > 0, np.log(values), np.nan)
    return _composed(logs, vectors)


def exponential(A: Array) -> Array:
    """Return exp A (..., r, r) of symmetric A, symmetric and positive definite."""
    values, vectors = np.linalg.eigh(A)
    return _composed(np.exp(values), vectors)


def symmetric_exponential(A: Array, directions: Array) -> tuple[Array, Array]:
    """Return exp A (n, r, r) of symmetric A, and its derivatives (n, d, r, r) along symmetric ``directions``.

    In the eigenbasis a derivative is the direction times the divided differences of exp, entry by entry (Daleckii &
    Krein 1965; Higham, Functions of Matrices, ch. 3): (eˣ − eʸ)/(x − y) = e^((x+y)/2) sinh(z)/z with z = (x − y)/2.
    """
    values, vectors = np.linalg.eigh(A)
    half = (values[:, :, None] - values[:, None, :]) / 2
    mean = (values[:, :, None] + values[:, None, :]) / 2
    size = np.maximum(np.abs(half), 1e-150)
    differences = np.exp(mean) * np.sinh(size) / size
    turned = vectors.swapaxes(-1, -2)[:, None] @ directions @ vectors[:, None]
    slopes: Array = vectors[:, None] @ (differences[:, None] * turned) @ vectors.swapaxes(-1, -2)[:, None]
    return _composed(np.exp(values), vectors), slopes


def _composed(values: Array, vectors: Array) -> Array:
    composed: Array = (vectors * values[..., None, :]) @ vectors.swapaxes(-1, -2)
    return composed


def symmetric_logarithm(A: Array, directions: Array) -> tuple[Array, Array]:
    """Return ln A (n, r, r) of symmetric positive definite A, and its derivatives (n, d, r, r) along ``directions``.

    (ln x − ln y)/(x − y) = (z/tanh z)/mean with z = (ln x − ln y)/2 and the arithmetic mean of x and y is exact where
    x and y are close: tanh z = (x − y)/(x + y).
    """
    values, vectors = np.linalg.eigh(A)
    logs = np.log(values)
    half = (logs[:, :, None] - logs[:, None, :]) / 2
    mean = (values[:, :, None] + values[:, None, :]) / 2
    size = np.maximum(np.abs(half), 1e-150)
    differences = size / np.tanh(size) / mean
    turned = vectors.swapaxes(-1, -2)[:, None] @ directions @ vectors[:, None]
    slopes: Array = vectors[:, None] @ (differences[:, None] * turned) @ vectors.swapaxes(-1, -2)[:, None]
    return _composed(logs, vectors), slopes


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


#: Steps of Newton's iteration at most; it converges quadratically.
MOST_STEPS = 60
#: A step that changes no entry by more than this was the last; and two places of a symmetric tensor differ by no more.
POLAR_ROUND_OFF = 1e-14
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
        if change <= POLAR_ROUND_OFF:
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
    stretch: Array = (skew <= POLAR_ROUND_OFF * size) & (F[:, 0, 0] > 0) & (minor > 0)
    return stretch


#: A rotation of the cube, row by row.
Rotation = tuple[int, ...]
IDENTITY: Rotation = (1, 0, 0, 0, 1, 0, 0, 0, 1)
#: Hermann–Mauguin symbols of the Laue classes within the cube's, by the number of rotations and the highest order.
LAUE = {
    (1, 1): "-1",
    (2, 2): "2/m",
    (3, 3): "-3",
    (4, 2): "mmm",
    (4, 4): "4/m",
    (6, 3): "-3m",
    (8, 4): "4/mmm",
    (12, 3): "m-3",
    (24, 4): "m-3m",
}


@dataclass(frozen=True)
class PointGroup:
    """A group of rotations of the cube; make it with :meth:`generated`.

    Attributes
    ----------
    rotations
        All of them, each once and in ascending order; the identity is among them.
    """

    rotations: tuple[Rotation, ...]

    @classmethod
    def generated(cls, operations: Iterable[npt.ArrayLike]) -> Self:
        """Return the smallest group that holds signed permutation matrices Q (3, 3), proper or not.

        Raises
        ------
        ValueError
            A matrix is no signed permutation.
        """
        generators = {as_rotation(Q) for Q in operations}
        found, fresh = {IDENTITY}, {IDENTITY}
        while fresh:
            fresh = {_product(a, b) for a in fresh for b in generators} - found
            found |= fresh
        return cls(tuple(sorted(found)))

    @cached_property
    def matrices(self) -> IntArray:
        """Rotations as matrices Q (g, 3, 3)."""
        return np.array(self.rotations, dtype=np.int64).reshape(-1, 3, 3)

    @property
    def name(self) -> str:
        """Hermann–Mauguin symbol of the Laue class, such as ``m-3m``, without the directions of the axes."""
        return LAUE[len(self), max(_order(Q) for Q in self.matrices)]

    def __len__(self) -> int:
        return len(self.rotations)

    def __contains__(self, Q: npt.ArrayLike) -> bool:
        """Return whether a signed permutation (3, 3), or its product with the inversion, is an operation."""
        return as_rotation(Q) in self.rotations

    def __and__(self, other: PointGroup) -> PointGroup:
        """Return the operations that both groups have."""
        return PointGroup(tuple(sorted(set(self.rotations) & set(other.rotations))))

    def __le__(self, other: PointGroup) -> bool:
        """Return whether the other group has all operations of this one."""
        return set(self.rotations) <= set(other.rotations)

    def kept(self, keeps: Callable[[IntArray], Any]) -> PointGroup:
        """Return the group of the rotations Q (3, 3) for which ``keeps(Q)`` is true."""
        return PointGroup.generated([Q for Q in self.matrices if keeps(Q)])


def as_rotation(Q: npt.ArrayLike) -> Rotation:
    """Return the rotation that stands for a signed permutation matrix Q (3, 3).

    Raises
    ------
    ValueError
        It is none.
    """
    matrix = np.asarray(Q)
    found = matrix.astype(np.int64)
    if matrix.shape != (3, 3) or not np.array_equal(found, matrix):
        raise ValueError(f"expected a signed permutation (3, 3) of whole numbers, got {Q!r}")
    if not ((np.abs(found).sum(axis=0) == 1).all() and (np.abs(found).sum(axis=1) == 1).all()):
        raise ValueError(f"expected one entry 1 or −1 in each row and column, got {Q!r}")
    return tuple(int(x) for x in (found * round(np.linalg.det(found))).ravel())


def _product(a: Rotation, b: Rotation) -> Rotation:
    return tuple(sum(a[3 * i + k] * b[3 * k + j] for k in range(3)) for i in range(3) for j in range(3))


def _order(Q: IntArray) -> int:
    """Return the order of a rotation of the cube: 1, 2, 3 or 4."""
    return {3: 1, -1: 2, 0: 3, 1: 4}[int(np.trace(Q))]


#: All operations of the cube, (48, 3, 3).
CUBE_OPERATIONS: IntArray = np.array(
    [
        np.eye(3, dtype=np.int64)[list(order)] * np.array(signs)
        for order, signs in product(permutations(range(3)), product((1, -1), repeat=3))
    ]
)
#: Of a cell without symmetry, of one with the mirrors of the three axes, and of the cube.
TRIVIAL = PointGroup.generated([])
MIRRORS = PointGroup.generated([np.diag(signs) for signs in product((1, -1), repeat=3)])
CUBIC = PointGroup.generated(CUBE_OPERATIONS)
