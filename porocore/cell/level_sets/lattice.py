"""Body-centred cubic lattice of tetrahedra in a box, between mirror planes or periodic.

Its nodes are corners and centres of n₁ × n₂ × n₃ equal cubes, or of bricks that are nearly cubes where the box is none;
each tetrahedron has one edge between the centres of two neighbouring cubes and one in their common face. Tetrahedra
across the sides of the box are halved. In cubes all others have one shape, with dihedral angles of 60° and 90°.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from porocore.cell.meshing.shape_functions import EDGES
from porocore.cell.meshing.tetrahedra import oriented
from porocore.states import Array, IntArray


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
    def on_side(self) -> npt.NDArray[np.bool_]:
        """True (N, 3) for a node on a side across each axis."""
        return np.asarray((self.index == 0) | (self.index == 2 * self.n))

    @cached_property
    def first(self) -> IntArray:
        """First periodic image (N,) of each node, with the lowest places; the node itself between mirrors."""
        wrapped = np.where((self.index == 2 * self.n) & self.periodic, 0, self.index)
        return np.asarray(self._numbers[tuple(wrapped.T)])

    @cached_property
    def edges(self) -> tuple[IntArray, IntArray, npt.NDArray[np.bool_]]:
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
