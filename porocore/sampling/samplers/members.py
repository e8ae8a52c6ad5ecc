"""Members of a family of cells that a sampling keeps to, each prepared once for several states (MemberChoice)."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np

from porocore.core.inputs.input_space import InputSpace
from porocore.core.inputs.used_values import farthest
from porocore.sampling.samplers.candidates import BoolArray, distances, spread_out
from porocore.sampling.samplers.designs import box_corners, halton_points
from porocore.states import Array, IntArray


@dataclass(frozen=True, eq=False)
class MemberChoice:
    """Members at which the states of a sampling are solved, in the unit box of the m parameters of the cell.

    Of a cell without parameters there is one, and states stay as they are.

    Attributes
    ----------
    values : (k, m)
        Parameters of the members, those of the first states first.
    states_per_member
        Number of states that are solved at one member before another is prepared.
    """

    values: Array
    states_per_member: int

    @classmethod
    def for_states(cls, inputs: InputSpace, count: int, states_per_member: int, seed: int) -> MemberChoice:
        """Return the members for ``count`` states: a Halton sequence over the ranges, then some of their corners.

        Where a body uses some values of the parameters alone, they are farthest ones of these, the ends first.
        """
        m, members = len(inputs.parameters), ceil(count / states_per_member)
        if not m:
            return cls(np.empty((1, 0)), states_per_member)
        if (used := inputs.used_values) is not None:
            return cls(used.unit[farthest(used.unit, members)], states_per_member)
        corners = box_corners(m) if 2 ** (m + 1) <= members else np.empty((0, m))
        within = halton_points(m, members - len(corners), seed)
        return cls(np.concatenate([within, corners]), states_per_member)

    @property
    def m(self) -> int:
        """Number of parameters."""
        return self.values.shape[1]

    def in_rows(self, states: Array) -> Array:
        """Return points (n, d) of states (n, d − m), :attr:`states_per_member` in a row at each member."""
        which = np.arange(len(states)) // self.states_per_member % len(self.values)
        return np.concatenate([states, self.values[which]], axis=1)

    def with_each(self, states: Array) -> Array:
        """Return points (n k, d): states (n, d − m) at every member."""
        k = len(self.values)
        return np.concatenate([np.repeat(states, k, axis=0), np.tile(self.values, (len(states), 1))], axis=1)

    def snapped(self, points: Array) -> Array:
        """Return points (n, d) with the parameters of the nearest member."""
        return np.concatenate([points[:, : points.shape[1] - self.m], self.values[self._of(points)]], axis=1)

    def few(self, points: Array, merit: Array, known: Array, count: int) -> BoolArray:
        """Return which points (n, d) are at the few members that a round of ``count`` states keeps to, (n,).

        They are those of the points with the largest ``merit`` (n,) times distance to the ``known`` ones, as many as
        ``states_per_member`` asks for.
        """
        if not self.m:
            return np.ones(len(points), dtype=bool)
        of_point, chosen = self._of(points), set[int]()
        left = merit.copy()
        for _ in range(ceil(count / self.states_per_member)):
            best = spread_out(points, left, known, 1)
            if not best:
                break
            chosen.add(int(of_point[best[0]]))
            left[of_point == of_point[best[0]]] = 0.0
        return np.isin(of_point, list(chosen))

    def together(self, points: Array) -> Array:
        """Return the points (n, d) with those of one member in a row."""
        return points[np.argsort(self._of(points), kind="stable")]

    def _of(self, points: Array) -> IntArray:
        """Return the number of the nearest member of each point (n, d)."""
        if not self.m:
            return np.zeros(len(points), dtype=np.int64)
        nearest: IntArray = distances(points[:, points.shape[1] - self.m :], self.values)[1].astype(np.int64)
        return nearest
