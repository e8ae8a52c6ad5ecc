"""Free unknowns of the parity classes, and linear solves: conjugate gradients around a factor that is kept."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy import sparse

from porocore.cell.equilibrium.discrete import FactorError, FactorisedTangent, LoadStepFailed
from porocore.cell.equilibrium.path import PATIENCE, least_shifted
from porocore.states import Array, IntArray, Status
from porocore_fem_skfem.factor import SymmetricFactor
from porocore_fem_skfem.linalg import SymmetricPattern, choose_factor, conjugate_gradients, refine
from porocore_fem_skfem.operators import Pattern

SENSITIVITY_TOLERANCE = 1e-11
#: Iterations with multigrid.
LIMIT = 400


class Constraints:
    """Free unknowns of one parity class with the pattern of their matrix and its factors.

    ``base`` is the undeformed cell's and never changes, so that a solve does not depend on the one before it;
    ``own`` is renewed within a solve. ``active`` is the one in use, ``shift`` what last made an indefinite tangent
    definite. ``points`` (nodes, 3) are those of the nodes, of which ``places`` has one component after the other.
    """

    shift = 0.0

    def __init__(self, places: Pattern, free: IntArray, points: Array, solver: str) -> None:
        self.free, self._points, self._solver = free, points, solver
        indptr, indices, self._kept = places.restricted(free)
        self.pattern = SymmetricPattern(indptr, indices)
        component, node = np.divmod(free, len(points))
        self._make = partial(
            choose_factor,
            indptr,
            indices,
            solver=solver,
            near_kernel=_rigid_motions(points)[component, node],
            places=3 * node + component,
        )
        self._base: SymmetricFactor | None = None
        self._own: SymmetricFactor | None = None
        self._factored: Array | None = None
        self.active: SymmetricFactor | None = None

    def restrict(self, data: Array) -> Array:
        """Return the entries of the constrained matrix from those of the whole one."""
        return data[self._kept]

    def reset(self, undeformed: Callable[[], Array]) -> None:
        """Use the undeformed cell's factor, which the first call makes of ``undeformed()``."""
        if self._base is None:
            self._base = self._make()
            self._base.factor(self.restrict(undeformed()))
        self.active, self._factored = self._base, None
        self.shift = 0.0

    def widened(self, places: Pattern) -> Constraints:
        """Return the same unknowns with further places of the matrix and the same undeformed cell's factor."""
        wider = Constraints(places, self.free, self._points, self._solver)
        wider._base, wider.active, wider.shift = self._base, self._base, self.shift
        return wider

    def factorise(self, entries: Array) -> int:
        """Factorise ``entries`` for the active factor, and return its negative pivots, -1 where unknown."""
        if self._factored is not entries:
            if self._own is None:
                self._own = self._make()
            # Should the factorisation break down, what is left of it must not be used.
            self.active, self._factored = self._base, None
            self._own.factor(entries)
            self.active, self._factored = self._own, entries
        assert self._own is not None
        return self._own.negative

    def precondition(self, rhs: Array) -> Array:
        """Return the active factor applied to ``rhs``."""
        assert self.active is not None
        return self.active.solve(rhs)

    def direction(self, entries: Array, rhs: Array, accuracy: float) -> Array:
        """Return K⁻¹ rhs to a relative accuracy, as :meth:`DiscreteSolid.solve` does; it may raise LoadStepFailed."""
        apply, precondition = self.pattern.full(entries).dot, self.precondition
        diagonal = self.pattern.diagonal

        def shifted(shift: float) -> Array | None:
            moved = entries.copy()
            moved[diagonal] += shift * float(np.abs(entries[diagonal]).mean())
            return precondition(rhs) if self.factorise(moved) <= 0 else None

        # Multigrid is no better for being set up anew: it only comes near to any tangent.
        limit = PATIENCE if self.active is not None and self.active.negative >= 0 else LIMIT
        try:
            solved = conjugate_gradients(apply, rhs, precondition, tolerance=accuracy, limit=limit)
            if not solved.converged and self.factorise(entries) <= 0:
                solved = conjugate_gradients(apply, rhs, precondition, tolerance=accuracy)
            if solved.converged:
                return solved.x
            x, self.shift = least_shifted(shifted, rhs, self.shift)
        except FactorError as error:
            raise LoadStepFailed(Status.not_converged) from error
        return x


def sensitivities(
    matrix: sparse.csr_matrix, factor: FactorisedTangent, R: Array
) -> tuple[Array, Array, bool]:
    """Return U = −K⁻¹ R (n, k), RᵀU + UᵀR + UᵀKU (k, k), and whether K proved indefinite.

    The second is the part of the second derivatives that is due to U. It equals RᵀU, but its error is of second order
    in that of U, and it is symmetric. U is NaN where the linear solver does not reach its tolerance.

    Raises
    ------
    FactorError
        The factor cannot be applied.
    """
    if factor.negative >= 0:  # a direct one, which serves indefinite matrices
        solved = refine(matrix, -R, factor.solve, tolerance=SENSITIVITY_TOLERANCE)
    else:
        solved = conjugate_gradients(
            matrix.dot, -R, factor.solve, tolerance=SENSITIVITY_TOLERANCE, limit=LIMIT
        )
    U = solved.x if solved.converged else np.full_like(solved.x, np.nan)
    mixed = R.T @ U
    return U, mixed + mixed.T + U.T @ (matrix @ U), solved.indefinite


def _rigid_motions(points: Array) -> Array:
    """Return the translations and the rotations about the middle as (components, nodes, 6)."""
    x = points - points.mean(axis=0)
    turned = np.cross(np.eye(3)[:, None], x)  # (axes, nodes, components)
    moved = np.broadcast_to(np.eye(3)[:, None], (3, len(x), 3))
    return np.concatenate([moved, turned]).transpose(2, 1, 0)
