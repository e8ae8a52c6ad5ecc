"""Points of the unit box: sequences, corners, far ones; the members of a family that a sampling keeps to."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from porocore.core.inputs import InputSpace, farthest
from porocore.interfaces.sampler import Judgement
from porocore.states import Array, BoolArray, IntArray

#: Updates of the candidates' value within one round.
MOST_UPDATES = 8
#: Up to so many numbers a Latin hypercube is improved by exchanges: about two seconds.
MOST_OPTIMISED = 4000
#: Up to so many inputs a sampling begins with the corners of the box. With four they would be the first 16 states, of
#: which those of the largest compression are often unstable.
MOST_CORNER_INPUTS = 3
BLOCK = 10


def corner_count(d: int) -> int:
    """Return the number of corners of the box of d inputs with which a sampling begins."""
    return 2**d if d <= MOST_CORNER_INPUTS else 0


def hypercube_points(count: int, d: int, seed: int) -> Array:
    """Return the points (count, d) of a Latin hypercube, improved where it is small."""
    optimisation = "random-cd" if d > 1 and 1 < count * d <= MOST_OPTIMISED else None
    from scipy.stats import qmc  # slow to import

    points: Array = qmc.LatinHypercube(d, seed=seed, optimization=optimisation).random(count)
    return points


def sobol_points(d: int, count: int, seed: int) -> Array:
    """Return the first points (count, d) of a scrambled Sobol sequence."""
    power = max(0, int(np.ceil(np.log2(count))))
    from scipy.stats import qmc  # slow to import

    points: Array = qmc.Sobol(d, seed=seed).random_base2(power)[:count]
    return points


def halton_points(d: int, count: int, seed: int) -> Array:
    """Return the first points (count, d) of a scrambled Halton sequence (Halton 1960)."""
    from scipy.stats import qmc  # slow to import

    points: Array = qmc.Halton(d, seed=seed).random(count)
    return points


def box_corners(d: int) -> Array:
    """Return the corners (2^d, d) of the unit box."""
    return np.array(np.meshgrid(*[(0.0, 1.0)] * d, indexing="ij")).reshape(d, -1).T


class SobolStream:
    """New points of one scrambled Sobol sequence of ``d`` inputs at each call; round-off cannot move them.

    Attributes
    ----------
    taken
        Number of points that were taken; where it is raised, points are passed over.
    """

    def __init__(self, d: int, seed: int) -> None:
        self.taken = 0
        self._d, self._seed = d, seed
        self._sequence: Any = None
        #: Points that were drawn, the first of them with this index.
        self._ready, self._first = np.empty((0, d)), 0

    def take(self, count: int) -> Array:
        """Return the next points (count, d) in the unit box."""
        if self._sequence is None:
            from scipy.stats import qmc  # slow to import

            self._sequence = qmc.Sobol(self._d, seed=self._seed)
        begin = self.taken - self._first
        while len(self._ready) < begin + count:
            # In powers of two a Sobol sequence is balanced.
            self._ready = np.concatenate([self._ready, self._sequence.random(2**BLOCK)])
        points, self._ready = self._ready[begin : begin + count], self._ready[begin + count :]
        self.taken = self._first = self.taken + count
        return points


def distances(candidates: Array, known: Array) -> tuple[Array, Array]:
    """Return the distance (m,) of each candidate to the nearest of the ``known`` (n, d), and the index of that one."""
    if not len(known):
        return np.full(len(candidates), np.inf), np.zeros(len(candidates), dtype=np.int64)
    squares = (candidates**2).sum(axis=1)[:, None] - 2 * candidates @ known.T + (known**2).sum(axis=1)
    nearest = squares.argmin(axis=1)
    # Once more without the cancellation of the expanded square.
    return np.linalg.norm(candidates - known[nearest], axis=1), nearest


def spread_out(candidates: Array, worth: Array, known: Array, count: int) -> list[int]:
    """Return at most ``count`` of the candidates (m, d) as indices, one after the other.

    Each is the one with the largest worth times distance to the nearest point that is ``known`` or was chosen before.
    Candidates without worth and those on a known point are never chosen.
    """
    distance = np.minimum(distances(candidates, known)[0], np.sqrt(candidates.shape[1]))
    chosen: list[int] = []
    for _ in range(count):
        merit = worth * distance
        best = int(np.argmax(merit))
        if not merit[best] > 0:
            break
        chosen.append(best)
        distance = np.minimum(distance, np.linalg.norm(candidates - candidates[best], axis=1))
    return chosen


def most_worth(
    candidates: Array, judgement: Judgement, allowed: BoolArray, known: Array, count: int, apart: float
) -> list[int]:
    """Return at most ``count`` of the ``allowed`` candidates (m, d) as indices; each counts with those before it.

    They are ``apart`` from the ``known`` points (n, d) and from one another at least: a cell that is solved twice tells
    nothing new, whatever a committee believes. Of more than :data:`MOST_UPDATES` several are chosen at a time, of which
    the best stands for those around it.
    """
    chosen: list[int] = []
    distance, _ = distances(candidates, known)
    while len(chosen) < count:
        at_once = min(ceil(count / MOST_UPDATES), count - len(chosen))
        worth = np.where(allowed & (distance > apart), judgement.worth(), 0.0)
        new = spread_out(candidates, worth, candidates[chosen], at_once) if at_once > 1 else _best(worth)
        if not new:
            break
        chosen += new
        judgement.take(new[0])
        for candidate in new:
            distance = np.minimum(distance, np.linalg.norm(candidates - candidates[candidate], axis=1))
    return chosen


def _best(worth: Array) -> list[int]:
    best = int(np.argmax(worth))
    return [best] if worth[best] > 0 else []


def spacing(points: int, d: int) -> float:
    """Return the mean spacing of so many points in the unit box of d inputs."""
    return float(max(points, 1) ** (-1 / d))


def opening(d: int, count: int, seed: int) -> Array:
    """Return the first states of a sampling, when no response is known, (count, d) in the unit box.

    In a box of up to three inputs the corners, then always the point farthest from all before. Of more inputs, where
    farthest points all lie on the faces, a Sobol sequence.
    """
    if d > MOST_CORNER_INPUTS:
        return sobol_points(d, count, seed)
    begin = box_corners(d)[:count]
    cloud = sobol_points(d, 2**BLOCK, seed)
    rest = spread_out(cloud, np.ones(len(cloud)), begin, count - len(begin))
    return np.concatenate([begin, cloud[rest]])


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
