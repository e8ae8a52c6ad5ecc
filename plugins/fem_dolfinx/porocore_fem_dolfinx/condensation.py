"""Unknowns that are one (periodic images) or none (held), as a matrix from the free unknowns to all of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc
from scipy import sparse


class Condensation:
    """u = T x: ``images[i]`` numbers what dof i is an image of, ``held[i]`` says that it vanishes.

    Parameters
    ----------
    images : (n,) int
        Dofs with the same number are one.
    held : (n,) bool
        With every image of a held dof.
    """

    def __init__(self, images: Any, held: Any) -> None:
        classes = np.unique(images[~held])
        column = np.full(int(images.max()) + 1, -1, dtype=np.int64)
        column[classes] = np.arange(len(classes))
        rows = np.flatnonzero(~held)
        #: Number of free unknowns.
        self.size = len(classes)
        self.T = sparse.csr_matrix(
            (np.ones(len(rows)), (rows, column[images[rows]])), shape=(len(images), self.size)
        )
        self._petsc = to_petsc(self.T)
        # Multigrid wants to know that three unknowns belong to one node, where all three are free.
        whole = len(classes) % 3 == 0 and (classes.reshape(-1, 3) % 3 == np.arange(3)).all()
        self._block = 3 if whole and len(images) % 3 == 0 else 1
        self._matrix: PETSc.Mat | None = None

    def matrix(self, full: PETSc.Mat) -> PETSc.Mat:
        """Tᵀ A T, in a matrix that is used again by the next call."""
        if self._matrix is None:
            self._matrix = full.ptap(self._petsc)
            self._matrix.setBlockSize(self._block)
        else:
            full.ptap(self._petsc, result=self._matrix)
        return self._matrix

    def reduce(self, full: Any) -> Any:
        """Tᵀ f."""
        return self.T.T @ full

    def expand(self, free: Any) -> Any:
        """T x."""
        return self.T @ free

    def restrict(self, full: Any) -> Any:
        """x of a u = T x."""
        counts = np.asarray(self.T.sum(axis=0)).ravel()
        return (self.T.T @ full) / counts


def to_petsc(matrix: Any) -> PETSc.Mat:
    """A copy of a scipy matrix on this process."""
    matrix = matrix.tocsr()
    matrix.sort_indices()
    csr = (matrix.indptr.astype(PETSc.IntType), matrix.indices.astype(PETSc.IntType), matrix.data)
    return PETSc.Mat().createAIJ(matrix.shape, csr=csr, comm=PETSc.COMM_SELF)


def to_scipy(matrix: PETSc.Mat) -> Any:
    """A copy of a matrix that lives on this process."""
    indptr, indices, data = matrix.getValuesCSR()
    return sparse.csr_matrix((data, indices, indptr), shape=matrix.getSize())
