"""Interface of a sparse factor as an approximate inverse; errors of a singular matrix and of memory.

Nothing reaches a native library that is not checked here: it would read beyond arrays, or never end.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from porocore.cell.equilibrium.discrete import FactorError
from porocore.states import Array
from porocore_fem_skfem.checks import Indices, check_upper


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
