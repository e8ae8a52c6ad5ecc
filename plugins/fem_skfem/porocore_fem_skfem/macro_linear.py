"""Linear systems of the u–p problem: direct if small, else GMRES with a factor, which may be that of an earlier one."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, gmres

from porocore.cell.equilibrium.discrete import FactorError
from porocore.macro.integration.discretisation import StepFailed
from porocore.states import Array
from porocore_fem_skfem import pardiso
from porocore_fem_skfem.factor import OutOfMemoryError, SingularError
from porocore_fem_skfem.linalg import superlu

#: Below this number of unknowns SuperLU is as fast: the columns of the benchmark, no more than a few elements in 3D.
SMALL = 3_000
#: Relative tolerance of the iteration, steps between two restarts, and number of restarts.
ACCURACY, STEPS, RESTARTS = 1e-10, 20, 3
NOT_HELD = "the body may not be held against rigid motions"


class SparseLinearSolver:
    """Solver of linear systems of one pattern.

    The factor of a large one is of single precision, which takes half the time and half the memory; the iteration makes
    up for it. A system for which that is not enough gets one of double precision, and so do those that follow.
    """

    def __init__(self) -> None:
        self._factor: pardiso.GeneralFactor | None = None
        self._single = True

    def solve(self, matrix: sparse.csr_matrix, right: Array, *, again: bool) -> Array:
        """Return x with A x = ``right``; with ``again`` the last factor may still serve.

        Parameters
        ----------
        matrix
            Square, CSR, with a sorted and symmetric pattern.

        Raises
        ------
        StepFailed
            The matrix is singular or not finite, or its factor does not fit into memory.
        """
        try:
            if not (np.isfinite(matrix.data).all() and np.isfinite(right).all()):
                raise FactorError("the tangent or the residual is not finite")
            if len(right) <= SMALL or pardiso.library() is None:
                x: Array | None = superlu(matrix).solve(right)
            else:
                x = self._by_factor(matrix, right, again)
            if x is None or not np.isfinite(x).all():
                raise SingularError("the tangent is singular")
        except FactorError as error:
            self._factor = None
            raise StepFailed(_message(error)) from error
        return x

    def _by_factor(self, matrix: sparse.csr_matrix, right: Array, again: bool) -> Array | None:
        if again and self._factor is not None:
            x = _iterate(matrix, right, self._factor)
            if x is not None:
                return x
        while True:
            if self._factor is None:
                self._factor = pardiso.GeneralFactor(matrix.indptr, matrix.indices, single=self._single)
            self._factor.factor(matrix.data)
            x = _iterate(matrix, right, self._factor)
            if x is not None or not self._single:
                return x
            self._factor, self._single = None, False


def _iterate(matrix: sparse.csr_matrix, right: Array, factor: pardiso.GeneralFactor) -> Array | None:
    """Return GMRES' solution with a factor as preconditioner, None if it does not converge."""
    inverse = LinearOperator(matrix.shape, matvec=factor.solve, dtype=float)
    try:
        x, info = gmres(matrix, right, rtol=ACCURACY, atol=0.0, restart=STEPS, maxiter=RESTARTS, M=inverse)
    except FactorError:  # what it would have to be applied to is not finite
        return None
    return x if info == 0 else None


def _message(error: FactorError) -> str:
    if isinstance(error, SingularError):
        return f"{error}: {NOT_HELD}"
    if isinstance(error, OutOfMemoryError):
        return f"{error}: take fewer elements, or dolfinx on several processes"
    return str(error)
