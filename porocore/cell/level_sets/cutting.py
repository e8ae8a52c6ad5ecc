"""Tetrahedra of both phases, cut from a lattice along a level set; projection of points onto it.

Isosurface stuffing [Labelle & Shewchuk, ACM Trans. Graph. 26 (2007) 57]: lattice nodes near the wall move onto it, and
tetrahedra across the wall are cut. A node moves to a close cut of one of its edges, so no small pieces are cut off.
Prisms are split through the corner with the lowest number, so neighbours and periodic images have the same diagonals.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from porocore.cell.level_sets.lattice import Lattice
from porocore.cell.meshing.tetrahedra import oriented, volumes
from porocore.errors import PorocoreError
from porocore.states import Array, IntArray

#: Distance of a cut, as a share of its edge, within which a node moves to it: for edges between cubes, to the centre of
#: a cube, and of halved tetrahedra. The first two are Labelle and Shewchuk's for the best dihedral angles.
CLOSE_LONG, CLOSE_SHORT, CLOSE_HALVED = 0.25, 0.41, 0.3
#: Largest motion of a node along a side without a close cut of an edge in that side, in edges of a cube.
FARTHEST = 0.25
#: Smallest distance of any other cut from the ends of its edge, as a share of the edge.
LEAST_SHARE = 0.05
#: Tolerance of a zero of the level set, relative to its largest value.
ZERO = 1e-12
STEPS = 60
#: Smallest volume of a tetrahedron over that of the lattice's; a node whose motion would leave less stays.
FLAT = 1e-3
#: Orders of the corners of a prism, two triangles, that put each corner first.
TURNED = np.array([
    [0, 1, 2, 3, 4, 5], [1, 2, 0, 4, 5, 3], [2, 0, 1, 5, 3, 4],
    [3, 5, 4, 0, 2, 1], [4, 3, 5, 1, 0, 2], [5, 4, 3, 2, 1, 0],
])  # fmt: skip


class LevelSet(Protocol):
    """Smooth function that is positive in the solid, zero on the wall and negative in the pores."""

    def value(self, points: Array) -> Array:
        """Return the values (n,) at points (n, 3)."""

    def gradient(self, points: Array) -> Array:
        """Return the gradients (n, 3) at points (n, 3)."""


@dataclass(frozen=True, eq=False)
class TwoPhases:
    """Tetrahedra of both phases, with common nodes on the wall.

    Attributes
    ----------
    points : (N, 3)
        Nodes.
    cells : (M, 4)
        Tetrahedra, positively oriented.
    solid : (M,)
        True for solid tetrahedra; the others are fluid.
    first : (N,)
        The periodic image that stands for each node.
    """

    points: Array
    cells: IntArray
    solid: npt.NDArray[np.bool_]
    first: IntArray


def cut(lattice: Lattice, level_set: LevelSet) -> TwoPhases:
    """Return the tetrahedra of a lattice, cut along a level set.

    Raises
    ------
    PorocoreError
        The lattice is too coarse for the level set.
    """
    values = level_set.value(lattice.points[np.unique(lattice.first)])
    scale = float(np.abs(values).max(initial=0.0)) or 1.0
    at_node = level_set.value(lattice.points)[lattice.first]
    signs = np.where(np.abs(at_node) <= ZERO * scale, 0, np.sign(at_node)).astype(np.int64)
    cuts = _Cuts(lattice, level_set, signs, scale)
    movable = np.ones(len(lattice.points), dtype=bool)
    while True:
        points, moved = cuts.warped(movable)
        found = _split(lattice, cuts, points, np.where(moved, 0, signs), level_set)
        share = volumes(found.points, found.cells) / lattice.spacing.prod() * 12
        flat = found.cells[share < FLAT]
        spoiled = np.intersect1d(flat, np.flatnonzero(moved))
        if not len(spoiled):
            break
        movable &= ~np.isin(lattice.first, lattice.first[spoiled])
    if not (share > 0).all():
        raise PorocoreError("the elements are too coarse for the pores; give a smaller size")
    return found


class _Cuts:
    """Cuts of the edges of a lattice by a level set, and the nodes close to a cut."""

    def __init__(self, lattice: Lattice, level_set: LevelSet, signs: IntArray, scale: float) -> None:
        self.lattice, self.level_set, self.signs, self.scale = lattice, level_set, signs, scale
        ends, image, moved = lattice.edges
        across = signs[ends[:, 0]] * signs[ends[:, 1]] < 0
        self.ends, moved = ends[across], moved[across]
        # Periodic images of an edge have the same cut, to the last bit.
        images, self.number = np.unique(image[across], axis=0, return_inverse=True)
        self.number = self.number.reshape(-1)
        a, b = lattice.points[images[:, 0]], lattice.points[images[:, 1]]
        self.share = _roots(level_set, a, b, signs[images[:, 0]], scale)[self.number]
        a, b = lattice.points[image[across, 0]], lattice.points[image[across, 1]]
        place = a + np.clip(self.share, LEAST_SHARE, 1 - LEAST_SHARE)[:, None] * (b - a)
        exact = a + self.share[:, None] * (b - a)
        self.step = exact - a, exact - b
        self.points = np.where(moved, lattice.high, place)
        length = np.linalg.norm((b - a) / lattice.spacing, axis=1)
        kinds = [np.isclose(length, 1.0), np.isclose(length, np.sqrt(0.75))]
        self.close = np.select(kinds, [CLOSE_LONG, CLOSE_SHORT], CLOSE_HALVED)

    def warped(self, movable: npt.NDArray[np.bool_]) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Return the lattice's nodes (N, 3), moved onto the level set at close cuts, and which ones (N,) lie on it."""
        lattice, n = self.lattice, len(self.lattice.points)
        near: list[tuple[IntArray, Array, npt.NDArray[np.bool_]]] = []
        for end, share in ((0, self.share), (1, 1 - self.share)):
            node, beyond = self.ends[:, end], self.ends[:, 1 - end]
            chosen = (share < self.close) & movable[node]
            within = (lattice.on_side[beyond] | ~lattice.on_side[node]).all(axis=1)
            near.append((lattice.first[node[chosen]], self.step[end][chosen], within[chosen]))
        node, step, within = (np.concatenate(part) for part in zip(*near, strict=True))
        moves = np.full((n, 3), np.nan)
        distance = np.linalg.norm(step, axis=1)
        # The farthest come first, so the closest remains; equal distances are ordered by their steps.
        order = np.lexsort((*step.T, -distance))
        order = order[within[order]]
        moves[node[order]] = step[order]
        rest = np.setdiff1d(node, np.flatnonzero(np.isfinite(moves[:, 0])))
        moves[rest] = self._along_sides(rest)
        zero = (self.signs == 0) & (lattice.first == np.arange(n))
        moves[zero] = 0.0
        moves = moves[lattice.first]
        moved = np.isfinite(moves[:, 0])
        return lattice.placed(lattice.points + np.where(moved[:, None], moves, 0.0)), moved

    def _along_sides(self, nodes: IntArray) -> Array:
        """Return the steps (n, 3) of nodes on sides onto the level set, along the sides; NaN where it is too far."""
        start = self.lattice.points[nodes]
        held = self.lattice.on_side[nodes]
        end = onto(self.level_set, start, held)
        step = end - start
        missed = np.abs(self.level_set.value(end)) > 1e-9 * self.scale
        step[missed | (np.linalg.norm(step, axis=1) > FARTHEST * self.lattice.spacing.min())] = np.nan
        return step

    def __call__(self, a: IntArray, b: IntArray) -> IntArray:
        """Return the numbers of the cuts of the edges between nodes a (n,) and b (n,), counted after the nodes."""
        n = len(self.lattice.points)
        if not len(a):
            return np.zeros(0, dtype=np.int64)
        codes = self.ends[:, 0] * n + self.ends[:, 1]  # ascending, as the ends are
        return np.asarray(n + np.searchsorted(codes, np.minimum(a, b) * n + np.maximum(a, b)))


def onto(level_set: LevelSet, points: Array, held: npt.NDArray[np.bool_], steps: int = 20) -> Array:
    """Return points (n, 3) projected onto the level set along its gradient, without the components held (n, 3)."""
    points = points.copy()
    for _ in range(steps):
        value = level_set.value(points)
        gradient = np.where(held, 0.0, level_set.gradient(points))
        square = np.maximum((gradient**2).sum(axis=1), 1e-30)
        points -= (value / square)[:, None] * gradient
    return points


def _roots(level_set: LevelSet, a: Array, b: Array, sign: IntArray, scale: float) -> Array:
    """Return the shares (n,) of the lines from a to b (n, 3) at which a level set of the given sign at a vanishes.

    The Illinois method is a regula falsi that halves the value of an end that stays.
    """
    low, high = np.zeros(len(a)), np.ones(len(a))
    f_low, f_high = level_set.value(a) * sign, level_set.value(b) * sign
    middle = low
    kept = np.zeros(len(a), dtype=np.int64)
    for _ in range(STEPS):
        middle = np.clip(low + f_low / (f_low - f_high) * (high - low), low, high)
        value = level_set.value(a + middle[:, None] * (b - a)) * sign
        if (np.abs(value) <= 1e-15 * scale).all():
            break
        above = value > 0
        f_high = np.where(above & (kept == 1), f_high / 2, f_high)
        f_low = np.where(~above & (kept == -1), f_low / 2, f_low)
        low, f_low = np.where(above, middle, low), np.where(above, value, f_low)
        high, f_high = np.where(above, high, middle), np.where(above, f_high, value)
        f_high = np.where(f_high < 0, f_high, -1e-300)
        kept = np.where(above, 1, -1)
    return middle


def _split(lattice: Lattice, cuts: _Cuts, points: Array, signs: IntArray, level_set: LevelSet) -> TwoPhases:
    """Split every tetrahedron by the signs of its nodes; nodes on the level set belong to either phase."""
    n = len(points)
    everything = np.concatenate([points, cuts.points])
    key = np.concatenate([lattice.first, n + cuts.number])
    cells, at = lattice.cells, signs[lattice.cells]
    positive, negative = (at > 0).sum(axis=1), (at < 0).sum(axis=1)
    pieces: list[tuple[IntArray, bool]] = [
        (cells[(negative == 0) & (positive > 0)], True),
        (cells[(positive == 0) & (negative > 0)], False),
    ]
    flat = cells[(positive == 0) & (negative == 0)]  # all nodes moved onto the wall
    inside = level_set.value(lattice.points[flat].mean(axis=1)) > 0
    pieces += [(flat[inside], True), (flat[~inside], False)]

    def prism(one: list[IntArray], other: list[IntArray], solid: bool) -> None:
        pieces.append((_prisms(np.stack(one + other, axis=1), key), solid))

    tips_of = ((positive == 1) & (negative > 0), True), ((negative == 1) & (positive > 1), False)
    for alone, solid in tips_of:
        chosen, own = cells[alone], at[alone] == (1 if solid else -1)
        a, *rest = _first(chosen, own.argmax(axis=1)).T
        # A node on the level set is the cut of the edge to it.
        tips = [_where_cut(cuts, signs, a, b) for b in rest]
        pieces.append((np.stack([a, *tips], axis=1), solid))
        prism(tips, rest, not solid)
    halved = (positive == 2) & (negative == 2)
    order = np.argsort(-at[halved], axis=1, kind="stable")
    a, b, c, d = np.take_along_axis(cells[halved], order, axis=1).T
    prism([a, cuts(a, c), cuts(a, d)], [b, cuts(b, c), cuts(b, d)], True)
    prism([c, cuts(a, c), cuts(b, c)], [d, cuts(a, d), cuts(b, d)], False)
    found = np.concatenate([part for part, _ in pieces])
    solid_ = np.concatenate([np.full(len(part), solid) for part, solid in pieces])
    whole = (np.diff(np.sort(found, axis=1), axis=1) > 0).all(axis=1)
    return TwoPhases(everything, oriented(everything, found[whole]), solid_[whole], key)


def _where_cut(cuts: _Cuts, signs: IntArray, a: IntArray, b: IntArray) -> IntArray:
    found = b.copy()
    between = signs[b] != 0
    found[between] = cuts(a[between], b[between])
    return found


def _first(cells: IntArray, which: IntArray) -> IntArray:
    """Return the tetrahedra with the given corner first."""
    orders = np.array([[0, 1, 2, 3], [1, 0, 3, 2], [2, 0, 1, 3], [3, 0, 2, 1]])
    return np.take_along_axis(cells, orders[which], axis=1)


def _prisms(corners: IntArray, key: IntArray) -> IntArray:
    """Return three tetrahedra of each prism (n, 6), some of them empty where corners coincide.

    Each quadrilateral is split from its corner of the lowest key [Dompierre et al., Proc. 8th Int. Meshing Roundtable
    (1999) 195–204].
    """
    turned = np.take_along_axis(corners, TURNED[key[corners].argmin(axis=1)], axis=1)
    keys = key[turned]
    rising = np.minimum(keys[:, 1], keys[:, 5]) < np.minimum(keys[:, 2], keys[:, 4])
    one = turned[:, [[0, 1, 2, 5], [0, 1, 5, 4], [0, 4, 5, 3]]]
    other = turned[:, [[0, 1, 2, 4], [0, 4, 2, 5], [0, 4, 5, 3]]]
    return np.where(rising[:, None, None], one, other).reshape(-1, 4)
