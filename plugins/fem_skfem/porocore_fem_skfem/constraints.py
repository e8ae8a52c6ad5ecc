"""Free unknowns of the parity classes, and the factors that precondition their tangents."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from porocore.states import Array, IntArray
from porocore_fem_skfem.factor import SymmetricFactor
from porocore_fem_skfem.linalg import SymmetricPattern, choose_factor
from porocore_fem_skfem.operators import Pattern


class Constraints:
    """Free unknowns of one parity class with the pattern of their matrix and its factors.

    ``base`` is the undeformed cell's and never changes, so that a solve does not depend on the one before it;
    ``own`` is renewed within a solve. ``active`` is the one in use, ``shift`` what last made an indefinite tangent
    definite.
    """

    shift = 0.0

    def __init__(self, places: Pattern, free: IntArray, solver: str) -> None:
        self.free, self._solver = free, solver
        indptr, indices, self._kept = places.restricted(free)
        self.pattern = SymmetricPattern(indptr, indices)
        translations = np.zeros((len(free), 3))
        translations[np.arange(len(free)), free // (places.n // 3)] = 1.0

        def make() -> SymmetricFactor:
            return choose_factor(indptr, indices, solver=solver, near_kernel=translations)

        self._make = make
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
        wider = Constraints(places, self.free, self._solver)
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
