"""Linear solves of large cells: conjugate gradients around multigrid, and definiteness without a factor.

A tangent is definite if conjugate gradients solve for a random right-hand side and meet no negative curvature. While
all Ritz values are positive, the residual polynomial exceeds 1 at every negative eigenvalue. So the residual cannot
fall below the share of its mode, which is about 1/√n of a random vector.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from porocore.cell.equilibrium.discrete import FactorError, LoadStepFailed
from porocore.cell.equilibrium.responses import least_shifted
from porocore.macro.linear_systems import available_bytes, factor_bytes, fits
from porocore.states import Array, IntArray, Status
from porocore_fem_skfem import pardiso
from porocore_fem_skfem.constraints import SENSITIVITY_TOLERANCE, Constraints, KnownRotations, LinearResponse
from porocore_fem_skfem.linalg import FACTOR_LIMIT, Iteration, block_conjugate_gradients, conjugate_gradients
from porocore_fem_skfem.multigrid import IndefiniteError, Multigrid
from porocore_fem_skfem.node_grid import NodeGrid, PaddedPattern
from porocore_fem_skfem.operators import Pattern
from porocore_fem_skfem.products import Product

#: Iterations with multigrid; 30 are usual to 1e-11.
LIMIT = 400
#: A cycle of an earlier tangent serves for so many iterations, and so many times those a digit that one took for its
#: own tangent: 2.8, but 10 where the solid is nearly incompressible. To set one up costs as much as four iterations.
AT_LEAST, TIMES = 4, 1.5
#: A solve to this accuracy shows how many iterations a digit takes.
A_DIGIT = 0.1
#: Unknowns of a factor that was measured, its GiB, and the exponent of its growth.
FACTOR_MEMORY = (314_000, 4.3, 1.2)
#: Relative residual of a random right-hand side that no indefinite tangent reaches: 1/√n is above it by 1e-5.
DEFINITE = 1e-8
#: Accuracy of Newton's direction with a shifted tangent.
SHIFTED_ACCURACY = 1e-2


class IterativeConstraints(Constraints):
    """Free unknowns of one parity class, and multigrid for their matrix, which is set up within a load path.

    A factor takes over where the tangent is indefinite or the iteration stagnates, if there is a solver for that and it
    does not take too much memory.
    """

    def __init__(self, places: Pattern, free: IntArray, grid: NodeGrid, solver: str) -> None:
        super().__init__(places, free, grid, solver)
        indptr, indices = self.indptr, self.indices
        self._padded = PaddedPattern(indptr, indices, grid)
        self._multigrid = Multigrid(self._padded, grid)
        #: Entries for which the cycle is set up, and their matrix.
        self._of: Array | None = None
        self._product: Product | None = None
        self._per_digit = 0.0
        self._has_factors = solver == "auto" and len(free) <= FACTOR_LIMIT and pardiso.library() is not None
        self._places = places
        self._direct: Constraints | None = None

    def reset(self, undeformed: Callable[[], Array]) -> None:
        """Discard the cycle and the factor of the last load path."""
        self._of, self._product, self._direct, self.shift = None, None, None, 0.0

    def take_over(self, narrow: Constraints) -> None:
        """Begin without a cycle, with the shift of the narrower matrix."""
        super().take_over(narrow)
        self._of, self._product = None, None

    def factorise(self, entries: Array) -> int:
        """Set up the cycle for ``entries``; return 1 if they prove indefinite thereby, else -1."""
        try:
            self._set_up(entries)
        except IndefiniteError:
            return 1
        return -1

    def precondition(self, rhs: Array) -> Array:
        """Return the solution for ``rhs`` with the entries that were set up.

        Raises
        ------
        FactorError
            They are indefinite, or the iteration does not converge.
        """
        if self._of is None or self._product is None:
            raise FactorError("the tangent is indefinite")
        solved = self._iterate(self._product, self._padded.padded(rhs), SENSITIVITY_TOLERANCE)
        if not solved.converged:
            raise FactorError("conjugate gradients did not converge")
        return solved.x[self._padded.places]

    def direction(self, entries: Array, rhs: Array, accuracy: float) -> Array:
        """Return K⁻¹ rhs to a relative accuracy, as :meth:`DiscreteSolid.solve` does; it may raise LoadStepFailed."""
        right = self._padded.padded(rhs)

        def shifted(shift: float) -> Array | None:
            moved = entries.copy()
            moved[self.diagonal] += shift * float(np.abs(entries[self.diagonal]).mean())
            found = self._fresh(moved, right, SHIFTED_ACCURACY)
            return found.x[self._padded.places] if found is not None and found.converged else None

        try:
            solved = self._worn(entries, right, accuracy)
            if solved is None or not solved.converged:
                solved = self._fresh(entries, right, accuracy, solved)
            if solved is not None and solved.converged:
                return solved.x[self._padded.places]
            if (direct := self._by_factor()) is not None:
                direct.factorise(entries)
                return direct.direction(entries, rhs, accuracy)
            if solved is not None and not solved.indefinite:
                raise LoadStepFailed(Status.not_converged)
            x, self.shift = least_shifted(shifted, rhs, self.shift)
        except FactorError as error:
            raise LoadStepFailed(Status.not_converged) from error
        return x

    def sensitivities(self, entries: Array, R: Array, known: Array) -> LinearResponse:
        """Return −K⁻¹ R, and whether K is definite, by one iteration for all columns and a random one."""
        solved = None
        if self.factorise(entries) <= 0:
            assert self._product is not None
            padded = self._padded.padded(known)
            rotations = KnownRotations(self._padded.padded(R), padded, self._product @ padded)
            right = np.column_stack([-rotations.R, self._random()])
            tolerance = np.array([SENSITIVITY_TOLERANCE] * rotations.R.shape[1] + [DEFINITE])
            # A random column shows whether K is definite only where the loads take no part in its iteration.
            group = np.append(np.zeros(rotations.R.shape[1], np.int64), 1)
            solved = block_conjugate_gradients(
                self._product.__matmul__,
                right,
                self._multigrid.cycle,
                group=group,
                tolerance=tolerance,
                limit=LIMIT,
            )
            if solved.converged:
                U = solved.x[:, :-1]
                return rotations.response(U, self._product @ U, 0).at(self._padded.places)
        if (direct := self._by_factor()) is not None:
            return direct.sensitivities(entries, R, known)
        unknown = np.full_like(R, np.nan)
        return LinearResponse(unknown, R.T @ unknown, 1 if solved is None or solved.indefinite else -1)

    def negative(self, entries: Array) -> int:
        """Return the number of negative eigenvalues; without a factor 1 for one or more, -1 if it is not known."""
        indefinite = self.factorise(entries) > 0
        if not indefinite:
            assert self._product is not None
            solved = self._iterate(self._product, self._random(), DEFINITE)
            if solved.converged:
                return 0
            indefinite = solved.indefinite
        if (direct := self._by_factor()) is not None:
            return direct.factorise(entries)
        return 1 if indefinite else -1

    def _by_factor(self) -> Constraints | None:
        """Return the same unknowns with a factor; None where there is no solver for it, or it would be too large."""
        needed = factor_bytes(len(self.free), *FACTOR_MEMORY)
        if self._direct is None and self._has_factors and fits(needed, available_bytes()):
            self._direct = Constraints(self._places, self.free, self._grid, self._solver)
        return self._direct

    def _set_up(self, entries: Array) -> None:
        if self._of is not entries:
            self._of, self._product, matrix = None, None, self._padded.matrix(entries)
            if not np.isfinite(matrix.data).all():
                raise FactorError("the matrix is not finite")
            self._multigrid.set_up(matrix)
            self._of, self._product = entries, Product(matrix)

    def _worn(self, entries: Array, right: Array, accuracy: float) -> Iteration | None:
        """Return the solution with the cycle of an earlier tangent, as far as it serves; None where there is none."""
        if self._of is None or self._of is entries:
            return None
        limit = AT_LEAST + round(TIMES * self._per_digit * -np.log10(accuracy))
        return self._iterate(Product(self._padded.matrix(entries)), right, accuracy, limit)

    def _fresh(
        self, entries: Array, right: Array, accuracy: float, begun: Iteration | None = None
    ) -> Iteration | None:
        """Return the solution with a cycle of these entries; None where that proves them indefinite.

        What an earlier cycle has begun is gone on with, unless it met a direction of negative curvature.
        """
        if self.factorise(entries) > 0:
            return None
        assert self._product is not None
        x, left, missing = np.zeros_like(right), right, accuracy
        if begun is not None and not begun.indefinite:
            rest = right - self._product @ begun.x
            reached = float(np.linalg.norm(rest) / np.linalg.norm(right))
            if reached < 1:
                x, left, missing = begun.x, rest, accuracy / reached
        solved = self._iterate(self._product, left, missing)
        if missing < A_DIGIT:
            self._per_digit = solved.iterations / -np.log10(missing)
        return replace(solved, x=x + solved.x)

    def _iterate(
        self, product: Product, right: Array, tolerance: float | Array, limit: int | None = None
    ) -> Iteration:
        return conjugate_gradients(
            product.__matmul__, right, self._multigrid.cycle, tolerance=tolerance, limit=limit or LIMIT
        )

    def _random(self) -> Array:
        return np.where(self._padded.free, np.random.default_rng(0).normal(size=self._padded.size), 0.0)
