"""Values of the parameters that a body uses (UsedValues): the farthest of them, and distances from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from porocore.states import Array, IntArray

#: Values that are told apart at most; of more, the farthest.
MOST = 200
#: Parameters are as good as used within this distance of used ones, all of them as shares of their ranges.
NEAR = 0.05


@dataclass(frozen=True, eq=False)
class UsedValues:
    """Values of m parameters that a body uses, in the unit box of their ranges.

    Attributes
    ----------
    unit : (k, m)
        The values.
    """

    unit: Array

    def away(self, unit: Array) -> npt.NDArray[np.bool_]:
        """Return which values (n, m) of the parameters are not near to used ones, (n,)."""
        distance, _ = self._tree.query(unit, distance_upper_bound=self.reach)
        away: npt.NDArray[np.bool_] = ~(distance <= self.reach)
        return away

    @cached_property
    def reach(self) -> float:
        """Distance within which values count as used."""
        if len(self.unit) < MOST:
            return NEAR
        # Farthest points leave nothing farther from them than they are from one another.
        return NEAR + float(self._tree.query(self.unit, k=2)[0][:, 1].min())

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.unit)


def farthest(points: Array, count: int) -> IntArray:
    """Return at most ``count`` of the points (k, m) as indices: the one farthest from the middle, then the farthest.

    Points that are alike count once.
    """
    chosen: list[int] = []
    distance = np.linalg.norm(points - points.mean(axis=0), axis=1)
    away = np.full(len(points), np.inf)
    while len(chosen) < count and away.max() > 0:
        best = int(np.round(np.where(np.isinf(away), distance, away), 12).argmax())
        chosen.append(best)
        away = np.minimum(away, np.linalg.norm(points - points[best], axis=1))
    return np.array(chosen, dtype=np.int64)
