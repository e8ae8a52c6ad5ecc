"""Connected pieces of a phase, the axes along which they percolate, and why a solid has no stiffness.

Tetrahedra that share a facet belong to one piece, also across opposite faces of the cell. A closed path through a piece
has the winding (a, b, c): the net number of crossings of the faces across x, y and z. The piece percolates in the
directions that the windings of all its closed paths span.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.tetrahedra import FACETS, curved_volumes, facet_classes
from porocore.states import Array, BoolArray, IntArray


@dataclass(frozen=True)
class Piece:
    """Connected piece of a phase, with all its periodic images.

    Attributes
    ----------
    volume
        Volume in one cell, with the curved edges.
    rank
        Number of independent directions in which it percolates, 0 for an isolated piece.
    axes
        Axes out of "xyz" along which it percolates.
    inside
        Centre of its largest tetrahedron.
    """

    volume: float
    rank: int
    axes: str
    inside: tuple[float, ...] = ()


@lru_cache(maxsize=8)
def pieces(mesh: CellMesh) -> tuple[Piece, ...]:
    """Return the connected pieces of the mesh of a whole cell, the largest first.

    Raises
    ------
    ValueError
        The mesh is not that of a whole cell.
    """
    if mesh.domain != "whole":
        raise ValueError("connectivity is that of a whole cell")
    if not len(mesh.cells):
        return ()
    inner, across, shifts = _neighbours(mesh)
    count = len(mesh.cells)
    graph = coo_matrix((np.ones(len(inner)), (inner[:, 0], inner[:, 1])), shape=(count, count))
    # First the pieces within the cell; those that meet across its faces are then joined.
    number, part = connected_components(graph, directed=False)
    links = np.unique(np.column_stack([part[across], shifts]), axis=0)
    roots, windings = joined(number, links)
    each, of_root = np.abs(curved_volumes(mesh.points, mesh.cells)), np.array(roots)
    sizes = np.bincount(part, each, number)
    # The last one in this order is the largest of its part.
    order = np.lexsort((each, of_root[part]))
    largest = dict(zip(of_root[part][order].tolist(), order.tolist(), strict=True))
    found = []
    for root in sorted(set(roots)):
        ways = np.array(windings.get(root, [(0, 0, 0)]))
        axes = "".join(axis for axis, moves in zip("xyz", ways.any(axis=0), strict=True) if moves)
        volume = float(sizes[of_root == root].sum())
        inside = mesh.points[mesh.cells[largest[root], :4]].mean(axis=0)
        found.append(Piece(volume, int(np.linalg.matrix_rank(ways)), axes, tuple(inside.tolist())))
    return tuple(sorted(found, key=lambda piece: -piece.volume))


def small_pieces(cells: IntArray, first: IntArray, solid: BoolArray, sizes: Array, least: float) -> BoolArray:
    """Return which tetrahedra belong to a piece of their phase below a volume; the largest of each phase never does.

    Parameters
    ----------
    cells : (M, 4)
        Linear tetrahedra of both phases.
    first : (N,)
        The periodic image that stands for each node.
    solid, sizes : (M,)
        Phases and volumes of the tetrahedra.
    least
        Smallest volume of a piece that is none.
    """
    corners = np.sort(first[cells][:, FACETS[:, :3]].reshape(-1, 3), axis=1)
    order = np.lexsort(corners.T)
    same = (np.diff(corners[order], axis=0) == 0).all(axis=1)
    one, other = order[:-1][same] // 4, order[1:][same] // 4
    inner = solid[one] == solid[other]
    graph = coo_matrix((np.ones(inner.sum()), (one[inner], other[inner])), shape=(len(cells),) * 2)
    number, part = connected_components(graph, directed=False)
    volume = np.bincount(part, sizes, number)
    small = volume < least
    for phase in (True, False):
        if len(of_phase := np.unique(part[solid == phase])):
            small[of_phase[volume[of_phase].argmax()]] = False
    found: BoolArray = small[part]
    return found


def joined_by_nodes(mesh: CellMesh) -> IntArray:
    """Return the number (N,) of the part of the phase that each node belongs to; parts that share a node are one.

    Periodic images are one node. A continuous field is connected on each part; a pressure is fixed once for each.
    """
    nodes = mesh.periodic_class
    count = int(nodes.max(initial=-1)) + 1
    first, rest = np.repeat(nodes[mesh.cells[:, 0]], 3), nodes[mesh.cells[:, 1:4]].ravel()
    graph = coo_matrix((np.ones(len(first)), (first, rest)), shape=(count, count))
    part: IntArray = connected_components(graph, directed=False)[1].astype(np.int64)
    return part[nodes]


def blocked(found: Iterable[Piece]) -> str:
    """Return the axes out of "xyz" along which no piece percolates."""
    open_axes = {axis for piece in found for axis in piece.axes}
    return "".join(axis for axis in "xyz" if axis not in open_axes)


def why_disconnected(found: tuple[Piece, ...]) -> str:
    """Return the reason why a solid of these pieces has no stiffness; empty if it has."""
    if not found:
        return "there is no solid"
    if len(found) > 1:
        sizes = ", ".join(f"{piece.volume:.3g}" for piece in found[:6]) + (", …" if len(found) > 6 else "")
        return (
            f"it falls into {len(found)} pieces that do not touch, of the volumes {sizes}; join them, remove those "
            "that float (of an image: 'drop_grains: true' under cell.geometry), or give a smaller cell.mesh.size if "
            "they should be connected"
        )
    if found[0].rank == 3:
        return ""
    if axes := blocked(found):
        return f"it does not reach the next cell along {' and '.join(axes)}"
    return "it runs on in some directions only, oblique to the axes"


def _neighbours(mesh: CellMesh) -> tuple[IntArray, IntArray, IntArray]:
    """Return pairs of tetrahedra with a common facet: within the cell; across its faces, and the cell of the second."""
    facets = mesh.cells[:, FACETS[:, :3]].reshape(-1, 3)
    owner = np.repeat(np.arange(len(mesh.cells)), 4)
    classes = facet_classes(mesh.points, facets, mesh.low, mesh.high)
    order = np.argsort(classes, kind="stable")
    same = np.diff(classes[order]) == 0
    first, second = order[:-1][same], order[1:][same]
    step = mesh.points[facets[first]].mean(axis=1) - mesh.points[facets[second]].mean(axis=1)
    shifts = np.rint(step / mesh.spans).astype(np.int64)
    within = ~shifts.any(axis=1)
    pairs = np.column_stack([owner[first], owner[second]])
    return pairs[within], pairs[~within], shifts[~within]


def joined(count: int, links: IntArray) -> tuple[list[int], dict[int, list[tuple[int, ...]]]]:
    """Return the root of each of ``count`` parts, and the windings of closed paths by root.

    A link (a, b, x, y, z) joins part b of the cell at (x, y, z) and part a of the cell at the origin.
    """
    parent = list(range(count))
    offset = [np.zeros(3, dtype=np.int64) for _ in range(count)]  # cell of a part relative to its parent

    def root(part: int) -> tuple[int, IntArray]:
        total = np.zeros(3, dtype=np.int64)
        while parent[part] != part:
            total = total + offset[part]
            part = parent[part]
        return part, total

    closed: list[tuple[int, tuple[int, ...]]] = []
    for a, b, *shift in links.tolist():
        (root_a, at_a), (root_b, at_b) = root(a), root(b)
        way = at_a + np.array(shift) - at_b
        if root_a == root_b:
            closed.append((a, tuple(way.tolist())))
        else:
            parent[root_b], offset[root_b] = root_a, way
    roots = [root(part)[0] for part in range(count)]
    windings: dict[int, list[tuple[int, ...]]] = {}
    for part, way in closed:
        windings.setdefault(roots[part], []).append(way)
    return roots, windings
