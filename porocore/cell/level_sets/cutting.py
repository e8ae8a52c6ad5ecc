"""Tetrahedra of both phases, cut from a lattice along a level set, curved on the wall (LevelSet).

Isosurface stuffing [Labelle & Shewchuk, ACM Trans. Graph. 26 (2007) 57]: lattice nodes near the wall move onto it, and
tetrahedra across the wall are cut. A node moves to a close cut of one of its edges, so no small pieces are cut off.
Prisms are split through the corner with the lowest number, so neighbours and periodic images have the same diagonals.

The nodes of the lattice are corners and centres of n₁ × n₂ × n₃ equal cubes, or of bricks that are nearly cubes where
the box is none; each tetrahedron has one edge between the centres of two neighbouring cubes and one in their common
face. Tetrahedra across the sides of the box are halved. In cubes all others have one shape, with dihedral angles of
60° and 90°.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from porocore.cell.geometry.pore_geometry import PER_CUBE, PoreGeometry, require_few
from porocore.cell.meshing.connectivity import small_pieces
from porocore.cell.meshing.tetrahedra import (
    EDGES,
    FACETS,
    Element,
    Phase,
    Tetrahedra,
    least_stretch,
    order_by_place,
    oriented,
    used,
    volumes,
    with_middles,
)
from porocore.errors import PorocoreError
from porocore.states import Array, BoolArray, IntArray


@dataclass(frozen=True, eq=False)
class Lattice:
    """Tetrahedra of a box.

    Attributes
    ----------
    n : (3,)
        Cubes along each axis.
    low, high : (3,)
        Ends of the box along each axis.
    periodic
        True where opposite sides are identified.
    index : (N, 3)
        Place of each node in half edges of a cube, from 0 to 2n along each axis.
    cells : (M, 4)
        Tetrahedra, positively oriented.
    """

    n: IntArray
    low: Array
    high: Array
    periodic: bool
    index: IntArray
    cells: IntArray

    @property
    def spacing(self) -> Array:
        """Edges (3,) of the cubes."""
        return (self.high - self.low) / self.n

    @cached_property
    def points(self) -> Array:
        """Positions (N, 3) of the nodes, exactly on the sides."""
        return self.placed(self.low + self.index * (self.spacing / 2))

    def placed(self, points: Array) -> Array:
        """Return points (N, 3), one for each node, set exactly onto the sides of their nodes."""
        on_low = np.where(self.index == 0, self.low, points)
        return np.where(self.index == 2 * self.n, self.high, on_low)

    @cached_property
    def on_side(self) -> BoolArray:
        """True (N, 3) for a node on a side across each axis."""
        return np.asarray((self.index == 0) | (self.index == 2 * self.n))

    @cached_property
    def first(self) -> IntArray:
        """First periodic image (N,) of each node, with the lowest places; the node itself between mirrors."""
        wrapped = np.where((self.index == 2 * self.n) & self.periodic, 0, self.index)
        return np.asarray(self._numbers[tuple(wrapped.T)])

    @cached_property
    def edges(self) -> tuple[IntArray, IntArray, BoolArray]:
        """Edges of the tetrahedra, each once.

        Returns
        -------
        ends : (E, 2)
            The lower node first.
        image : (E, 2)
            Ends of its first periodic image, with the lowest places, in the same order.
        moved : (E, 3)
            True along the axes where the edge lies one period beyond its image.
        """
        ends = np.unique(np.sort(self.cells[:, EDGES].reshape(-1, 2), axis=1), axis=0)
        moved = (self.index[ends] == 2 * self.n).all(axis=1)
        if not self.periodic:
            moved[:] = False
        lower = self.index[ends] - 2 * self.n * moved[:, None]
        return ends, self._numbers[tuple(np.moveaxis(lower, -1, 0))], moved

    @cached_property
    def _numbers(self) -> IntArray:
        """Node at each place, (2n₁ + 1, 2n₂ + 1, 2n₃ + 1); −1 where there is none."""
        return _numbered(self.n, self.index)


def body_centred(
    counts: npt.ArrayLike, low: npt.ArrayLike, high: npt.ArrayLike, *, periodic: bool
) -> Lattice:
    """Return the lattice of n cubes (3,) along each axis in a box: 12 n₁ n₂ n₃ tetrahedra and the halves at the sides.

    One number for all axes stands for three.
    """
    n = np.broadcast_to(np.asarray(counts, dtype=np.int64), 3)
    even, odd = [np.arange(0, 2 * m + 1, 2) for m in n], [np.arange(1, 2 * m, 2) for m in n]
    index = [_grid(*even), _grid(*odd)]
    cells = []
    for axis in range(3):
        for side in (0, 2 * n[axis]):
            places = list(odd)
            places[axis] = np.array([side])
            index.append(_grid(*places))
    nodes = np.concatenate(index)
    numbers = _numbered(n, nodes)
    for axis in range(3):
        across = np.eye(3, dtype=np.int64)[axis]
        one, other = (np.eye(3, dtype=np.int64)[(axis + k) % 3] for k in (1, 2))
        places = list(odd)
        places[axis] = even[axis]
        face = _grid(*places)
        below = np.where(face[:, [axis]] > 0, face - across, face)
        above = np.where(face[:, [axis]] < 2 * n[axis], face + across, face)
        ring = [face - one - other, face + one - other, face + one + other, face - one + other]
        for k in range(4):
            corners = (below, above, ring[k], ring[(k + 1) % 4])
            cells.append(np.stack([numbers[tuple(corner.T)] for corner in corners], axis=1))
    found = np.concatenate(cells)
    first, last = (np.broadcast_to(np.asarray(end, dtype=np.float64), 3) for end in (low, high))
    return Lattice(n, first, last, periodic, nodes, oriented(nodes.astype(np.float64), found))


def _numbered(n: IntArray, index: IntArray) -> IntArray:
    """Return the row of each place in ``index`` (N, 3); −1 where there is none."""
    numbers = np.full(tuple(2 * n + 1), -1)
    numbers[tuple(index.T)] = np.arange(len(index))
    return numbers


def _grid(*places: IntArray) -> IntArray:
    return np.asarray(np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, 3))


#: Distance of a cut, as a share of its edge, within which a node moves to it: for edges between cubes, to the centre of
#: a cube, and of halved tetrahedra. The first two are Labelle and Shewchuk's for the best dihedral angles.
CLOSE_LONG, CLOSE_SHORT, CLOSE_HALVED = 0.25, 0.41, 0.3
#: Largest motion of a node along a side without a close cut of an edge in that side, in edges of a cube.
FARTHEST_NODE = 0.25
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
    solid: BoolArray
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

    def warped(self, movable: BoolArray) -> tuple[Array, BoolArray]:
        """Return the lattice's nodes (N, 3), moved onto the level set at close cuts, and which ones (N,) lie on it."""
        lattice, n = self.lattice, len(self.lattice.points)
        near: list[tuple[IntArray, Array, BoolArray]] = []
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
        step[missed | (np.linalg.norm(step, axis=1) > FARTHEST_NODE * self.lattice.spacing.min())] = np.nan
        return step

    def __call__(self, a: IntArray, b: IntArray) -> IntArray:
        """Return the numbers of the cuts of the edges between nodes a (n,) and b (n,), counted after the nodes."""
        n = len(self.lattice.points)
        if not len(a):
            return np.zeros(0, dtype=np.int64)
        codes = self.ends[:, 0] * n + self.ends[:, 1]  # ascending, as the ends are
        return np.asarray(n + np.searchsorted(codes, np.minimum(a, b) * n + np.maximum(a, b)))


def onto(level_set: LevelSet, points: Array, held: BoolArray, steps: int = 20) -> Array:
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


#: A curved element gets straight edges if its smallest volume element is below this share of the straight one's.
LEAST_STRETCH = 0.2
#: Largest motion of a mid-edge node, as a share of its edge; one that would move farther stays.
FARTHEST_MID_EDGE = 0.35
#: Tolerance of a point on the wall, relative to the largest value of the level set.
FOUND = 1e-9


def phases(
    mesh: TwoPhases, lattice: Lattice, level_set: LevelSet, element: Element
) -> dict[Phase, Tetrahedra]:
    """Return both phases in linear elements, or in quadratic ones with mid-edge nodes on the wall.

    An element that would fold keeps straight edges, and so do its neighbours along those edges. Nodes on a side of the
    lattice stay there, and those on opposite sides of a periodic one move together.
    """
    points, cells = mesh.points, mesh.cells
    if element != "linear":
        points, cells, edges = with_middles(points, cells)
        if element == "quadratic-curved":
            points = _curved(mesh, points, cells, edges, lattice, level_set)
    return {"solid": _phase(points, cells[mesh.solid]), "fluid": _phase(points, cells[~mesh.solid])}


def _phase(points: Array, cells: IntArray) -> Tetrahedra:
    """Return the elements of a phase with their nodes, both numbered by place."""
    points, cells = used(points, cells)
    elements, nodes = order_by_place(points, cells)
    return Tetrahedra(points[nodes], np.argsort(nodes)[cells[elements]])


def _curved(
    mesh: TwoPhases, points: Array, cells: IntArray, edges: IntArray, lattice: Lattice, level_set: LevelSet
) -> Array:
    n = len(mesh.points)
    on_wall = _wall_edges(mesh, edges)
    if lattice.periodic:
        on_wall = _with_images(points[n:], on_wall, lattice)
    straight = points[n:][on_wall]
    low, high = lattice.low, lattice.high
    wrapped = np.where(straight == high, low, straight) if lattice.periodic else straight
    places, image = np.unique(wrapped, axis=0, return_inverse=True)
    image = image.reshape(-1)
    ends = onto(level_set, places, (places == low) | (places == high))
    moves = ends - places
    length = np.linalg.norm(mesh.points[edges[on_wall, 0]] - mesh.points[edges[on_wall, 1]], axis=1)
    longest = np.full(len(places), np.inf)
    np.minimum.at(longest, image, FARTHEST_MID_EDGE * length)
    # Beside a ridge of the wall the projection onto it may fail.
    found = np.abs(level_set.value(ends)) <= FOUND * np.abs(level_set.value(mesh.points)).max()
    kept = found & (np.linalg.norm(moves, axis=1) < longest)
    number = np.full(len(points), -1)
    number[n:][on_wall] = image
    touched = cells[(number[cells] >= 0).any(axis=1)]
    while True:
        curved = points.copy()
        curved[n:][on_wall] += np.where(kept[:, None], moves, 0.0)[image]
        curved[n:] = np.where(points[n:] == low, low, np.where(points[n:] == high, high, curved[n:]))
        folded = touched[least_stretch(curved, touched) < LEAST_STRETCH]
        spoiled = np.unique(number[folded])
        spoiled = spoiled[(spoiled >= 0) & kept[spoiled]]
        if not len(spoiled):
            return curved
        kept[spoiled] = False


def _with_images(middles: Array, chosen: IntArray, lattice: Lattice) -> IntArray:
    """Return the chosen rows of ``middles`` (E, 3) and all their periodic images.

    Beside the sides of the box an edge may belong to the wall while its image lies within one phase.
    """
    side = np.flatnonzero(((middles == lattice.low) | (middles == lattice.high)).any(axis=1))
    wrapped = np.where(middles[side] == lattice.high, lattice.low, middles[side])
    _, image = np.unique(wrapped, axis=0, return_inverse=True)
    image = image.reshape(-1)
    of_chosen = image[np.isin(side, chosen)]
    return np.union1d(chosen, side[np.isin(image, of_chosen)])


def _wall_edges(mesh: TwoPhases, edges: IntArray) -> IntArray:
    """Return the rows of edges (E, 2) that belong to facets between the two phases."""
    facets = np.sort(mesh.cells[:, FACETS[:, :3]].reshape(-1, 3), axis=1)
    solid = np.repeat(mesh.solid, 4)
    unique, inverse = np.unique(facets, axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    of_solid = np.bincount(inverse[solid], minlength=len(unique))
    of_fluid = np.bincount(inverse[~solid], minlength=len(unique))
    wall = unique[(of_solid > 0) & (of_fluid > 0)]
    ends = np.unique(wall[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2), axis=0)
    n = int(mesh.cells.max()) + 1
    return np.flatnonzero(np.isin(edges[:, 0] * n + edges[:, 1], ends[:, 0] * n + ends[:, 1]))


#: Smallest piece of a phase that the mesh keeps, in cubes: four tetrahedra. At a neck as narrow as an element single
#: ones come off.
LEAST_PIECE = 1 / 3
#: Share of the solid up to which pieces that came loose are taken for islands. Of 22 images of smoothed noise with such
#: pieces, at three voxels a tetrahedron, they were at most 2 % of the solid in 19, and 4 to 7 % in three.
SPECKS = 0.02
#: Smallest number of cubes along any side of the meshed part; with fewer, a periodic node may meet its own image.
FEWEST = 3


class LevelSetGeometry(PoreGeometry):
    """Geometry of a level set, on the eighth between its mirror planes or on the whole periodic cell."""

    @abstractmethod
    def level_set(self) -> LevelSet:
        """Return the level set, positive in the solid, with the mirrors or the period of the cell."""

    def tetrahedra(self, size: float, element: Element) -> dict[Phase, Tetrahedra]:
        return mesh_level_set(self, self.level_set(), size, element)


def mesh_level_set(
    geometry: PoreGeometry, level_set: LevelSet, size: float, element: Element, *, drop_specks: bool = False
) -> dict[Phase, Tetrahedra]:
    """Return both phases of the eighth of a geometry with mirrors, or of its whole cell.

    Pieces below LEAST_PIECE belong to the other phase. With ``drop_specks`` all pieces of the solid but its largest
    belong to the fluid, unless they are larger than islands.

    Raises
    ------
    PorocoreError
        The size is too coarse for the pores.
    """
    periodic = geometry.unfolding == "whole"
    high = np.array(geometry.sides) / 2
    low = -high if periodic else np.zeros(3)
    n = _counts(high - low, size)
    if size > (high - low).min() / FEWEST:  # more elements than were expected of the size
        require_few(PER_CUBE * float(n.prod()), "cell.geometry: its box is too flat")
    lattice = body_centred(n, low, high, periodic=periodic)
    try:
        mesh = cut(lattice, level_set)
    except PorocoreError as error:
        raise PorocoreError(f"cannot mesh {geometry.description} at size {size:g}: {error}") from error
    sizes = volumes(mesh.points, mesh.cells)
    flipped = small_pieces(mesh.cells, mesh.first, mesh.solid, sizes, LEAST_PIECE * lattice.spacing.prod())
    mesh = replace(mesh, solid=mesh.solid ^ flipped)
    if drop_specks:
        loose = mesh.solid & small_pieces(mesh.cells, mesh.first, mesh.solid, sizes, np.inf)
        if sizes[loose].sum() <= SPECKS * sizes[mesh.solid].sum():
            mesh = replace(mesh, solid=mesh.solid & ~loose)
    return phases(mesh, lattice, level_set, element)


def lattice_edges(geometry: PoreGeometry, size: float) -> tuple[float, float]:
    """Return the edge of the lattice's cubes, the longest one, and the size below which all sizes give this lattice.

    A whole number of cubes fills each side of the meshed part, so their edge is at most the size; it is itself the
    smallest size of this lattice. The second number is infinite where the lattice is the coarsest one.
    """
    span = np.array(geometry.sides) / (1 if geometry.unfolding == "whole" else 2)
    n = _counts(span, size)
    coarser = float((span / np.maximum(n - 1, 1)).min())
    return float((span / n).max()), coarser if coarser <= span.min() / FEWEST * (1 + 1e-9) else np.inf


def _counts(span: Array, size: float) -> IntArray:
    """Return the number of cubes (3,) along each side of the meshed part."""
    edge = min(size, float(span.min()) / FEWEST)
    return np.asarray(np.ceil(span / edge - 1e-9), dtype=np.int64)
