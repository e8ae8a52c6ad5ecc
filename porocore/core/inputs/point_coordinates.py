"""Coordinates of points, and which points share theirs (Coordinates, PointSets)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.states import Array, IntArray

#: As many sets of coordinates are evaluated one after the other, if each has so many points.
MOST_SETS, LEAST_POINTS = 32, 16


@dataclass(frozen=True, eq=False)
class PointSets:
    """Sets of n points.

    Attributes
    ----------
    number : (n,)
        Set of each point.
    count
        Number of sets, of which some may have no point.
    """

    number: IntArray
    count: int

    @cached_property
    def in_order(self) -> bool:
        """True where the points come one set after the other."""
        return bool((self.number[1:] >= self.number[:-1]).all())

    @cached_property
    def order(self) -> IntArray:
        """Points one set after the other, (n,)."""
        return np.argsort(self.number, kind="stable")

    @cached_property
    def back(self) -> IntArray:
        """Place of each point in that order, (n,)."""
        found = np.empty_like(self.order)
        found[self.order] = np.arange(len(found))
        return found

    @cached_property
    def first(self) -> IntArray:
        """A point of each set, (sets,)."""
        found = np.zeros(self.count, dtype=np.int64)
        found[self.number[::-1]] = np.arange(len(self.number))[::-1]
        return found

    @cached_property
    def _ends(self) -> list[int]:
        """Numbers of points up to each set, from 0."""
        ends: list[int] = np.cumsum([0, *np.bincount(self.number, minlength=self.count)]).tolist()
        return ends

    def parts(self, start: int, stop: int) -> Iterator[tuple[int, slice]]:
        """Yield the sets that have points from ``start`` to ``stop`` in their order, each with these."""
        for i in range(self.count):
            first, last = max(self._ends[i], start), min(self._ends[i + 1], stop)
            if first < last:
                yield i, slice(first, last)

    def take(self, points: IntArray) -> PointSets:
        """Return the sets of some of the points."""
        return PointSets(self.number[points], self.count)


class Coordinates:
    """Coordinates of n points.

    Parameters
    ----------
    x : (l, n)
        The coordinates; (l, 1) where all points have the same.
    """

    def __init__(self, x: Array) -> None:
        self.x = x

    @property
    def same(self) -> bool:
        """True where they are given once for all points."""
        return self.x.shape[1] == 1

    @cached_property
    def sets(self) -> PointSets | None:
        """Points that share their coordinates where these are few; None where they are many."""
        n = self.x.shape[1]
        if n == 0 or (self.x == self.x[:, :1]).all():
            return PointSets(np.zeros(n, dtype=np.int16), 1)
        # The first points tell most fields without a sort of all.
        if len(np.unique(self.x[:, : 4 * MOST_SETS], axis=1).T) > MOST_SETS:
            return None
        _, first, number = np.unique(self.x, axis=1, return_index=True, return_inverse=True)
        if len(first) > min(MOST_SETS, n // LEAST_POINTS):
            return None
        # Numbered as they come, so that points of one set after the other are in order; small integers, which are
        # sorted in linear time.
        rank = np.empty(len(first), dtype=np.int16)
        rank[np.argsort(first)] = np.arange(len(first))
        return PointSets(rank[number.reshape(-1)], len(first))

    def take(self, points: IntArray) -> Coordinates:
        """Return those of some of the points."""
        if self.same:
            return self
        found = Coordinates(self.x[:, points])
        found.__dict__["sets"] = None if self.sets is None else self.sets.take(points)
        return found
