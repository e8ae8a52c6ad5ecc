"""Point groups of cells (PointGroup): rotations of the cube, their products, names of groups.

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

from porocore.states import IntArray

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
