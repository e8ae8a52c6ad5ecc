"""Constraints of a solid: periodic nodes, known rotations, and tangents widened by contact."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from porocore.cell.equilibrium.discrete import FactorError, LoadStepFailed
from porocore.cell.equilibrium.responses import PATIENCE, least_shifted
from porocore.states import Array, IntArray, Status
from porocore_fem_skfem.factor import SymmetricFactor
from porocore_fem_skfem.linalg import SymmetricPattern, choose_factor, conjugate_gradients, refine
from porocore_fem_skfem.node_grid import NodeGrid
from porocore_fem_skfem.operators import Pattern

SENSITIVITY_TOLERANCE = 1e-11
#: Residual of the known answer to a rotation, of the largest load's. Newton's iteration leaves about 1e-12.
ROTATION_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class LinearResponse:
    """Answer of the equilibrium to k loads.

    Attributes
    ----------
    U : (n, k)
        −K⁻¹ R; NaN where the linear solver did not reach its tolerance.
    curvature : (k, k)
        RᵀU + UᵀR + UᵀKU, the part of the second derivatives that is due to U. It equals RᵀU, but its error is of
        second order in that of U, and it is symmetric.
    negative : int
        Number of negative eigenvalues of K as found on the way, 1 for one or more without a factor, -1 where unknown.
    """

    U: Array
    curvature: Array
    negative: int

    def at(self, places: IntArray) -> LinearResponse:
        """Return the same with some of the rows of U."""
        return replace(self, U=self.U[places])


class Constraints:
    """Free unknowns of one parity class with the pattern of their matrix and its factors.

    ``base`` is the undeformed cell's and never changes, so that a solve does not depend on the one before it;
    ``own`` is renewed within a solve. ``active`` is the one in use, ``shift`` what last made an indefinite tangent
    definite. ``grid`` has the nodes of all unknowns ``free``, one component after the other.
    """

    shift = 0.0

    def __init__(self, places: Pattern, free: IntArray, grid: NodeGrid, solver: str) -> None:
        self.free, self._grid, self._solver = free, grid, solver
        self.indptr, self.indices, self._kept = places.restricted(free)
        #: Places of the diagonal among the entries.
        self.diagonal = np.asarray(self.indptr[:-1])
        self._base: SymmetricFactor | None = None
        self._own: SymmetricFactor | None = None
        self._factored: Array | None = None
        self.active: SymmetricFactor | None = None

    @cached_property
    def pattern(self) -> SymmetricPattern:
        """Pattern of the constrained matrix."""
        return SymmetricPattern(self.indptr, self.indices)

    def _make(self) -> SymmetricFactor:
        return choose_factor(self.indptr, self.indices, solver=self._solver)

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
        """Return the same unknowns with further places of the matrix, which begin by :meth:`take_over`."""
        return type(self)(places, self.free, self._grid, self._solver)

    def take_over(self, narrow: Constraints) -> None:
        """Begin with the undeformed cell's factor and the shift of the narrower matrix."""
        self._base, self.active, self.shift, self._factored = narrow._base, narrow._base, narrow.shift, None

    def factorise(self, entries: Array) -> int:
        """Factorise ``entries`` for the active factor, and return its negative pivots, -1 where unknown."""
        if self._factored is not entries:
            own = self._renewed()
            own.factor(entries)
            self.active, self._factored = own, entries
        assert self._own is not None
        return self._own.negative

    def factorise_definite(self, entries: Array) -> bool:
        """Factorise ``entries`` for the active factor if they are definite, and return whether they are."""
        own = self._renewed()
        definite = own.factor_definite(entries)
        if definite:
            self.active, self._factored = own, entries
        return definite

    def _renewed(self) -> SymmetricFactor:
        if self._own is None:
            self._own = self._make()
        # Should the factorisation break down, what is left of it must not be used.
        self.active, self._factored = self._base, None
        return self._own

    def precondition(self, rhs: Array) -> Array:
        """Return the active factor applied to ``rhs``."""
        assert self.active is not None
        return self.active.solve(rhs)

    def direction(self, entries: Array, rhs: Array, accuracy: float) -> Array:
        """Return K⁻¹ rhs to a relative accuracy, as :meth:`DiscreteSolid.solve` does; it may raise LoadStepFailed."""
        apply, precondition = self.pattern.full(entries).dot, self.precondition

        def shifted(shift: float) -> Array | None:
            moved = entries.copy()
            moved[self.diagonal] += shift * float(np.abs(entries[self.diagonal]).mean())
            return precondition(rhs) if self.factorise_definite(moved) else None

        try:
            solved = conjugate_gradients(apply, rhs, precondition, tolerance=accuracy, limit=PATIENCE)
            if not solved.converged and self.factorise_definite(entries):
                solved = conjugate_gradients(apply, rhs, precondition, tolerance=accuracy)
            if solved.converged:
                return solved.x
            x, self.shift = least_shifted(shifted, rhs, self.shift)
        except FactorError as error:
            raise LoadStepFailed(Status.not_converged) from error
        return x

    def sensitivities(self, entries: Array, R: Array, known: Array) -> LinearResponse:
        """Return the answer to loads with the residuals R (n, k), the last of which ``known`` (n, r) ought to solve.

        Raises
        ------
        FactorError
            The factor cannot be applied.
        """
        negative = self.factorise(entries)
        matrix = self.pattern.full(entries)
        rotations = KnownRotations(R, known, matrix @ known)
        # A direct factor serves indefinite matrices.
        solved = refine(matrix, -rotations.R, self.precondition, tolerance=SENSITIVITY_TOLERANCE)
        U = solved.x if solved.converged else np.full_like(solved.x, np.nan)
        product = solved.product if solved.converged and solved.product is not None else matrix @ U
        return rotations.response(U, product, negative)


class KnownRotations:
    """Loads of which the last ones rotate the deformed cell, so that their answer is known.

    Attributes
    ----------
    R : (n, m)
        Residuals of the loads that are to be solved for: all, if what is known is no answer.
    """

    def __init__(self, R: Array, known: Array, product: Array) -> None:
        self._all, self._known, self._product = R, known, product
        k, r = R.shape[1], known.shape[1]
        left = np.linalg.norm(R[:, k - r :] + product, axis=0)
        goal = ROTATION_TOLERANCE * np.linalg.norm(R, axis=0).max(initial=0.0)
        self._solves = bool((left <= goal).all())
        self.R = R[:, : k - r] if self._solves else R

    def response(self, U: Array, product: Array, negative: int) -> LinearResponse:
        """Return the answer to all loads from that to ``R`` and its product with the matrix."""
        if self._solves:
            U, product = np.hstack([U, self._known]), np.hstack([product, self._product])
        mixed = self._all.T @ U
        return LinearResponse(U, np.asarray(mixed + mixed.T + U.T @ product), negative)


#: Places of all kept patterns together. The states of one cell add few different sets of places, eight among 85 states
#: in contact of the benchmark's cell, and to order the unknowns anew takes seven times as long as a factor.
MOST_KEPT = 5_000_000


class Widening:
    """Pattern of a matrix with further places, and the constraints of one parity class on it."""

    def __init__(self, inner: Pattern, places: Pattern, constraints: Constraints) -> None:
        self.places, self.constraints = places, constraints
        self._at = np.searchsorted(places.keys, inner.keys)

    def entries(self, entries: Array, keys: IntArray, values: Array) -> Array:
        """Return the constrained entries of the sum of a narrow matrix and of values at some of the places."""
        out = self.places.sum(keys, values)
        out[self._at] += entries
        return self.constraints.restrict(out)


class Widenings:
    """Widened patterns of a solid by parity class and further places.

    A factor depends on its pattern by round-off, and the pattern on the state and its load path alone; so results do
    not depend on what is kept.
    """

    def __init__(self, inner: Pattern) -> None:
        self.inner = inner
        self._kept: OrderedDict[tuple[str, bytes], Widening] = OrderedDict()
        self._added: dict[str, IntArray] = {}

    def reset(self) -> None:
        """Begin a load path, whose matrices are as narrow as its contact allows."""
        self._added = {}
        self._drop(MOST_KEPT)

    def release(self, parity: str) -> None:
        """Release the matrices of a class."""
        self._added.pop(parity, None)
        for key in [key for key in self._kept if key[0] == parity]:
            del self._kept[key]

    def add(self, parity: str, keys: IntArray, constraints: Constraints) -> Widening | None:
        """Return the matrix of a class with ``keys`` and those that its load path needed before; None: a narrow one."""
        added = self._added.get(parity)
        lacking = self.inner.lacks(keys)
        if added is not None:
            lacking = np.union1d(added, lacking)
        if not len(lacking):
            return None
        name = parity, lacking.tobytes()
        if name not in self._kept:
            places = self.inner.widened(lacking)
            # Those of large cells go before another one is set up: each comes with a factor.
            self._drop(MOST_KEPT - len(places.keys))
            self._kept[name] = Widening(self.inner, places, constraints.widened(places))
        self._kept.move_to_end(name)
        found = self._kept[name]
        if added is None or len(lacking) > len(added):
            self._added[parity] = lacking
            found.constraints.take_over(constraints)
        return found

    def _drop(self, most: int) -> None:
        while self._kept and sum(len(each.places.keys) for each in self._kept.values()) > most:
            self._kept.popitem(last=False)
