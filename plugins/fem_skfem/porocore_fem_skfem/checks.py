"""Checks of the patterns of sparse matrices; native libraries read beyond arrays if one is wrong."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import sparse

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
