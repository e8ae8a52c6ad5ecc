"""Patterns of matrices that contact widens: touching walls couple unknowns that share no element."""

from __future__ import annotations

from collections import OrderedDict

import numpy as np

from porocore.states import Array, IntArray
from porocore_fem_skfem.constraints import Constraints
from porocore_fem_skfem.operators import Pattern

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
