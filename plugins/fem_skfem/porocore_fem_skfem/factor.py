"""Interface of factors of sparse matrices (SparseFactor), and checks of their structure.

Nothing reaches a native library that is not checked here: it would read beyond arrays, or never end.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import sparse

from porocore.cell.equilibrium.discrete import FactorError
from porocore.states import Array

#: Row pointers and columns of a matrix in CSR.
Indices: TypeAlias = npt.NDArray[np.int32]
Mask: TypeAlias = npt.NDArray[np.bool_]
LARGEST = np.iinfo(np.int32).max


def check_upper(indptr: Indices, indices: Indices) -> None:
    """Check the pattern of an upper triangle in CSR with its whole diagonal; a ValueError says where it is none."""
    rows = _checked_rows(indptr, indices)
    _refuse(rows > indices, "upper triangle", rows, indices, "lies below the diagonal")
    first = indices[np.asarray(indptr[:-1])]
    _refuse_rows(first != np.arange(len(first)), "upper triangle", "has no entry on the diagonal")


def check_symmetric(indptr: Indices, indices: Indices) -> None:
    """Check a symmetric pattern in CSR with its whole diagonal; a ValueError says where it is none."""
    rows, n = _checked_rows(indptr, indices), len(indptr) - 1
    has_diagonal = np.zeros(n, dtype=bool)
    has_diagonal[rows[rows == indices]] = True
    _refuse_rows(~has_diagonal, "symmetric pattern", "has no entry on the diagonal")
    mirrored = sparse.csr_matrix((np.ones(len(indices), dtype=np.int8), indices, indptr), shape=(n, n))
    mirrored = mirrored.tocsc()
    # The columns of a symmetric pattern, sorted, are its rows.
    unequal = np.diff(mirrored.indptr) != np.diff(indptr)
    _refuse_rows(unequal, "symmetric pattern", "has not as many entries as the column of its number")
    _refuse(mirrored.indices != indices, "symmetric pattern", rows, indices, "has no mirror image")


def _checked_rows(indptr: Indices, indices: Indices) -> Indices:
    """Return the row of each entry of a square matrix whose rows are sorted and hold no column twice."""
    n, entries = len(indptr) - 1, len(indices)
    for name, array in (("row pointers", indptr), ("columns", indices)):
        if array.ndim != 1 or array.dtype.kind != "i":
            raise ValueError(f"CSR {name}: expected integers (k,), got {array.dtype} of shape {array.shape}")
    if not 1 <= n < LARGEST or entries > LARGEST:
        raise ValueError(f"CSR: {n} rows and {entries} entries are none, or too many for 32-bit integers")
    if indptr[0] != 0 or indptr[-1] != entries or (np.diff(indptr) < 0).any():
        raise ValueError(f"CSR row pointers: expected to ascend from 0 to the {entries} entries")
    rows = np.repeat(np.arange(n, dtype=np.int32), np.diff(indptr))
    _refuse((indices < 0) | (indices >= n), "CSR", rows, indices, f"lies outside the {n} columns")
    unsorted = np.zeros(entries, dtype=bool)
    unsorted[1:] = (np.diff(indices) <= 0) & (np.diff(rows) == 0)
    _refuse(unsorted, "CSR", rows, indices, "does not come after the one before: unsorted, or twice")
    return rows


def _refuse(bad: Mask, what: str, rows: Indices, columns: Indices, reason: str) -> None:
    if bad.any():
        at = int(bad.argmax())
        raise ValueError(f"{what}: the entry in row {rows[at]}, column {columns[at]} {reason}")


def _refuse_rows(bad: Mask, what: str, reason: str) -> None:
    if bad.any():
        raise ValueError(f"{what}: row {int(bad.argmax())} {reason}")


class SingularError(FactorError):
    """A pivot vanished: the matrix is singular, or as good as that."""


class OutOfMemoryError(FactorError):
    """The factor does not fit into memory."""


class SparseFactor(ABC):
    """An approximate inverse of a square matrix in CSR whose pattern is fixed.

    Parameters
    ----------
    indptr, indices
        Row pointers (n + 1,) and columns (nnz,).
    dtype
        Precision in which the matrix and the right-hand sides are handed on.

    Raises
    ------
    ValueError
        The pattern is not such as :attr:`check` wants.
    """

    #: Checks the pattern that the entries belong to.
    check: ClassVar[staticmethod[[Indices, Indices], None]]

    def __init__(self, indptr: Indices, indices: Indices, dtype: npt.DTypeLike = np.float64) -> None:
        type(self).check(indptr, indices)
        self.n, self.nnz, self.dtype = len(indptr) - 1, len(indices), dtype

    def factor(self, data: Array) -> None:
        """Set up for the entries (nnz,) of a matrix.

        Raises
        ------
        FactorError
            They are not finite, or the factorisation breaks down.
        """
        self._factor(self._checked(data, ((self.nnz,),), "matrix"))

    def solve(self, rhs: Array) -> Array:
        """Return the inverse applied to (n,) or (n, k).

        Raises
        ------
        FactorError
            The right-hand side is not finite, or the library fails.
        """
        b = self._checked(rhs, ((self.n,), (self.n, *np.shape(rhs)[1:2])), "right-hand side")
        return self._solve(b)

    def _checked(self, values: Array, shapes: tuple[tuple[int, ...], ...], what: str) -> Array:
        with np.errstate(over="ignore"):
            values = np.asarray(values).astype(self.dtype, copy=False)
        if values.shape not in shapes:
            raise ValueError(f"{what}: expected an array of shape {shapes[0]}, got {values.shape}")
        if not np.isfinite(values).all():
            raise FactorError(f"the {what} is not finite in {np.dtype(self.dtype).name}")
        return values

    @abstractmethod
    def _factor(self, data: Array) -> None:
        """Set up for entries that are checked."""

    @abstractmethod
    def _solve(self, rhs: Array) -> Array:
        """Return the inverse applied to right-hand sides that are checked."""


class SymmetricFactor(SparseFactor):
    """An approximate inverse of a symmetric matrix, given by its upper triangle."""

    check = staticmethod(check_upper)
    #: Number of negative pivots of the last factorisation; -1: this solver cannot tell.
    negative: int

    def factor_definite(self, data: Array) -> bool:
        """Set up for entries (nnz,) and return whether the matrix is definite or its inertia unknown.

        Where it is not, there may be nothing to solve with.

        Raises
        ------
        FactorError
            They are not finite, or the factorisation breaks down.
        """
        self.factor(data)
        return self.negative <= 0
