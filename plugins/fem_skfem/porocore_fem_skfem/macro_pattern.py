"""Sparsity of the u–p tangent in blocks of nodes, into which the blocks of elements are summed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from porocore.states import Array, IntArray


class _Sum(NamedTuple):
    """Sum of the pairs of some elements."""

    slots: npt.NDArray[np.int32] | slice  #: blocks that they belong to
    matrix: sparse.csr_matrix  #: (slots, pairs), ones


class BlockPattern:
    """Blocks of a sparse matrix that couple the nodes of an element with one another.

    By pairs of nodes, and not by pairs of unknowns, it takes 1 kB an unknown of quadratic tetrahedra to make, not 24.

    Parameters
    ----------
    rows, columns : (elements, a), (elements, b)
        Nodes of each element.
    shape
        Numbers of nodes (n, m).
    parts
        Slices of elements that are summed together.
    """

    def __init__(
        self, rows: IntArray, columns: IntArray, shape: tuple[int, int], parts: Sequence[slice]
    ) -> None:
        width = max(shape[1], 1)
        pairs = (rows.astype(np.int64)[:, :, None] * width + columns[:, None, :]).reshape(len(rows), -1)
        unique, slot = np.unique(pairs, return_inverse=True)
        slot = slot.astype(np.int32).reshape(pairs.shape)
        self.shape = shape
        self.indices = (unique % width).astype(np.int32)
        self.indptr = np.searchsorted(unique // width, np.arange(shape[0] + 1)).astype(np.int32)
        ones = np.ones(pairs.shape[1] * max((part.stop - part.start for part in parts), default=0))
        self._sums = [_sum(slot[part].ravel(), ones, len(unique), len(parts) == 1) for part in parts]

    def zeros(self, *block: int) -> Array:
        """Return blocks of zeros (blocks, ...)."""
        return np.zeros((len(self.indices), *block))

    def add(self, blocks: Array, part: int, values: Array) -> None:
        """Add the values (elements, a, b, ...) of a part of the elements, by its number, to ``blocks``."""
        slots, matrix = self._sums[part]
        flat = blocks.reshape(len(blocks), -1)
        flat[slots] += matrix @ values.reshape(matrix.shape[1], flat.shape[1])

    def matrix(self, blocks: Array) -> sparse.bsr_matrix:
        """Return the matrix of blocks (blocks, r, c), which it does not copy."""
        r, c = blocks.shape[1:]
        shape = (r * self.shape[0], c * self.shape[1])
        return sparse.bsr_matrix((blocks, self.indices, self.indptr), shape=shape)

    def transposed(self, blocks: Array, of: BlockPattern) -> Array:
        """Return the blocks of this pattern that are the transpose of the ``blocks`` of another one, ``of``."""
        rows = np.repeat(np.arange(self.shape[0]), np.diff(self.indptr))
        return np.ascontiguousarray(blocks[of.find(self.indices, rows)].swapaxes(1, 2))

    def find(self, rows: IntArray, columns: IntArray) -> IntArray:
        """Return the numbers of the blocks at pairs of nodes, all of which must be there."""
        width = max(self.shape[1], 1)
        keys = (
            np.repeat(np.arange(self.shape[0], dtype=np.int64), np.diff(self.indptr)) * width + self.indices
        )
        return np.asarray(np.searchsorted(keys, rows.astype(np.int64) * width + columns))


def _sum(slot: npt.NDArray[np.int32], ones: Array, size: int, all_of_them: bool) -> _Sum:
    """Return the sum of pairs into their slots; ``ones`` serves all sums as data."""
    if all_of_them:
        slots: npt.NDArray[np.int32] | slice = slice(None)
        count, place = size, slot
    else:
        slots, place = np.unique(slot, return_inverse=True)
        count = len(slots)
    order = np.argsort(place, kind="stable").astype(np.int32)
    starts = np.concatenate([[0], np.cumsum(np.bincount(place.ravel(), minlength=count))]).astype(np.int32)
    return _Sum(slots, sparse.csr_matrix((ones[: len(slot)], order, starts), shape=(count, len(slot))))


class EquationPattern:
    """Rows and columns of the equations, taken out of the blocks as one sorted compressed matrix for a factor.

    Parameters
    ----------
    uu, up, pu, pp
        Patterns of the four parts.
    equation : (unknowns,)
        Equation of each unknown; -1: prescribed. Those of a plate share one, and their entries are summed.
    """

    def __init__(
        self, uu: BlockPattern, up: BlockPattern, pu: BlockPattern, pp: BlockPattern, equation: IntArray
    ) -> None:
        parts, first = [], 1
        for pattern, r, c in ((uu, 3, 3), (up, 3, 1), (pu, 1, 3), (pp, 1, 1)):
            count = len(pattern.indices) * r * c
            parts.append(pattern.matrix(np.arange(first, first + count, dtype=float).reshape(-1, r, c)))
            first += count
        numbers = sparse.bmat([parts[:2], parts[2:]], format="coo")
        row, column = equation[numbers.row], equation[numbers.col]
        kept = np.flatnonzero((row >= 0) & (column >= 0))
        n = int(equation.max(initial=-1)) + 1
        keys = row[kept].astype(np.int64) * n + column[kept]
        order = np.argsort(keys, kind="stable")
        keys = keys[order]
        #: Place of each entry among those of all blocks, and where the entries of one place begin.
        self._source = numbers.data[kept[order]].astype(np.int64) - 1
        starts = np.flatnonzero(np.diff(keys, prepend=-1))
        self._starts = None if len(starts) == len(keys) else starts
        self._indices = (keys[starts] % max(n, 1)).astype(np.int32)
        self._indptr = np.searchsorted(keys[starts] // max(n, 1), np.arange(n + 1)).astype(np.int32)
        self._shape = (n, n)

    def matrix(self, blocks: Sequence[Array]) -> sparse.csr_matrix:
        """Return the matrix in CSR from the blocks of the four parts."""
        data = np.concatenate([block.ravel() for block in blocks])[self._source]
        if self._starts is not None:
            data = np.add.reduceat(data, self._starts)
        return sparse.csr_matrix((data, self._indices, self._indptr), shape=self._shape)
