"""Condensation of periodic images and held unknowns by a matrix T; copies between PETSc and scipy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc
from scipy import sparse

from porocore.states import Array, IntArray
from porocore_fem_dolfinx import compat


class Condensation:
    """All unknowns u = T x from the free ones x.

    Parameters
    ----------
    images : (n,) int
        Number of the unknown that a dof is an image of; dofs with the same number are one.
    held : (n,) bool
        Dofs that vanish, with all their images.
    """

    def __init__(self, images: IntArray, held: npt.NDArray[np.bool_]) -> None:
        classes = np.unique(images[~held])
        column = np.full(int(images.max()) + 1, -1, dtype=np.int64)
        column[classes] = np.arange(len(classes))
        rows = np.flatnonzero(~held)
        #: Number of free unknowns.
        self.size = len(classes)
        self.T = sparse.csr_matrix(
            (np.ones(len(rows)), (rows, column[images[rows]])), shape=(len(images), self.size)
        )
        self._petsc = compat.freed_with(self, to_petsc(self.T))
        # The block size tells multigrid that three unknowns belong to one node, if all three are free.
        whole = len(classes) % 3 == 0 and (classes.reshape(-1, 3) % 3 == np.arange(3)).all()
        self._block = 3 if whole and len(images) % 3 == 0 else 1
        self._matrix: PETSc.Mat | None = None
        self._keys: IntArray | None = None

    def matrix(self, full: PETSc.Mat, entries: tuple[IntArray, IntArray, Array] | None = None) -> PETSc.Mat:
        """Return Tᵀ A T, in a matrix that the next call overwrites; ``entries`` (rows, columns, values) are added to A.

        Entries that the pattern of A has no room for make another matrix.
        """
        if self._matrix is None:
            self._matrix = compat.freed_with(self, full.ptap(self._petsc))
            self._matrix.setBlockSize(self._block)
        else:
            full.ptap(self._petsc, result=self._matrix)
        if entries is None:
            return self._matrix
        rows, columns, values = entries
        more = self.T.T @ sparse.csr_matrix((values, (rows, columns)), shape=full.getSize()) @ self.T
        if self._has_room(self._matrix, more):
            self._matrix.axpy(1.0, to_petsc(more), PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            return self._matrix
        wider = self._matrix.duplicate(copy=True)
        wider.axpy(1.0, to_petsc(more), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        return wider

    def _has_room(self, matrix: PETSc.Mat, more: sparse.csr_matrix) -> bool:
        """Return whether every entry of ``more`` lies within the pattern of Tᵀ A T."""
        if self._keys is None:
            indptr, indices, _ = matrix.getValuesCSR()
            rows = np.repeat(np.arange(self.size), np.diff(indptr))
            self._keys = np.sort(rows * self.size + indices)
        more = more.tocoo()
        return bool(np.isin(more.row.astype(np.int64) * self.size + more.col, self._keys).all())

    def reduce(self, full: Array) -> Array:
        """Return Tᵀ f."""
        return np.asarray(self.T.T @ full)

    def expand(self, free: Array) -> Array:
        """Return T x."""
        return np.asarray(self.T @ free)

    def restrict(self, full: Array) -> Array:
        """Return x of a u = T x."""
        counts = np.asarray(self.T.sum(axis=0)).ravel()
        return np.asarray((self.T.T @ full) / counts)


def to_petsc(matrix: sparse.csr_matrix) -> PETSc.Mat:
    """Return a copy of a scipy matrix as a PETSc matrix of this process."""
    matrix = matrix.tocsr()
    matrix.sort_indices()
    return compat.make_matrix(PETSc.COMM_SELF, matrix.shape, matrix.indptr, matrix.indices, matrix.data)


def to_scipy(matrix: PETSc.Mat) -> sparse.csr_matrix:
    """Return a copy of a PETSc matrix of this process as a scipy matrix."""
    indptr, indices, data = matrix.getValuesCSR()
    return sparse.csr_matrix((data, indices, indptr), shape=matrix.getSize())
