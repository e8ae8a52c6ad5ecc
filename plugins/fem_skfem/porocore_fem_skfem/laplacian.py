"""Inverses of the Laplacian of a velocity component in Stokes flow: a factor, or a cycle of multigrid."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from scipy import sparse

from porocore.states import Array
from porocore_fem_skfem.checks import Indices
from porocore_fem_skfem.linalg import SymmetricPattern, choose_factor, conjugate_gradients
from porocore_fem_skfem.multigrid import Multigrid
from porocore_fem_skfem.node_grid import NodeGrid, PaddedPattern


class LaplacianInverse(ABC):
    """The inverse of a symmetric matrix of fixed pattern, or a preconditioner for it."""

    @abstractmethod
    def set_up(self, data: Array) -> None:
        """Set up for the entries of an upper triangle; a FactorError says why it cannot be."""

    @abstractmethod
    def apply(self, rhs: Array) -> Array:
        """Return the inverse applied to the columns of (n, k)."""


class FactorInverse(LaplacianInverse):
    """The inverse itself, by a factor and conjugate gradients."""

    matrix: sparse.csr_matrix

    def __init__(self, indptr: Indices, indices: Indices, solver: str) -> None:
        self._pattern = SymmetricPattern(indptr, indices)
        self._factor = choose_factor(indptr, indices, solver=solver, single=False)

    def set_up(self, data: Array) -> None:
        self.matrix = self._pattern.full(data)
        self._factor.factor(data)

    def apply(self, rhs: Array) -> Array:
        return conjugate_gradients(self.matrix.dot, rhs, self._factor.solve, tolerance=1e-12, limit=100).x


class CycleInverse(LaplacianInverse):
    """One cycle of multigrid, in double precision for iterations that want a symmetric preconditioner."""

    def __init__(self, indptr: Indices, indices: Indices, grid: NodeGrid) -> None:
        self._pattern = PaddedPattern(indptr, indices, grid)
        self._multigrid = Multigrid(self._pattern, grid, np.float64)

    def set_up(self, data: Array) -> None:
        self._multigrid.set_up(self._pattern.matrix(data))

    def apply(self, rhs: Array) -> Array:
        return self._pattern.unpadded(self._multigrid.cycle(self._pattern.padded(rhs)))
