"""The linear systems of the u–p problem: direct, and between two factors GMRES with the older one."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres, splu

from porocore.equilibrium.discrete import FactorError
from porocore.macro.discretisation import StepFailed
from porocore_fem_skfem import pardiso

#: Below this number of unknowns SuperLU is as fast, and a new factor cheaper than an iteration with an old one.
SMALL = 8_000
#: Of the residual, at which an iteration with an old factor stops, and how many steps it may take.
ACCURACY, ITERATIONS = 1e-10, 25


class LinearSolver:
    """Solves systems of one pattern."""

    def __init__(self) -> None:
        self._factor: Any = None

    def solve(self, matrix: Any, right: Any, *, again: bool) -> Any:
        """x with A x = ``right``; ``again``: the last factor may still serve.

        Parameters
        ----------
        matrix
            Square, CSR, with a symmetric pattern.

        Raises
        ------
        StepFailed
            The matrix is singular.
        """
        if again and self._factor is not None and len(right) > SMALL:
            x = self._iterate(matrix, right)
            if x is not None:
                return x
        try:
            x = self._direct(matrix, right)
        except (RuntimeError, FactorError) as error:
            self._factor = None
            raise StepFailed(f"{error}: the body may not be held against rigid motions") from error
        if not np.isfinite(x).all():
            raise StepFailed("the tangent is singular: the body may not be held against rigid motions")
        return x

    def _direct(self, matrix: Any, right: Any) -> Any:
        if len(right) <= SMALL or pardiso.library() is None:
            return splu(matrix.tocsc()).solve(right)
        if self._factor is None:
            self._factor = pardiso.GeneralFactor(matrix.indptr, matrix.indices)
        self._factor.factor(matrix.data)
        return self._factor.solve(right)

    def _iterate(self, matrix: Any, right: Any) -> Any:
        """None if it does not converge."""
        n = len(right)
        inverse = LinearOperator((n, n), matvec=self._factor.solve, dtype=float)
        x, info = gmres(matrix, right, rtol=ACCURACY, atol=0.0, restart=ITERATIONS, maxiter=1, M=inverse)
        return x if info == 0 else None
