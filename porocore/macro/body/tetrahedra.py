"""Elements as tetrahedra with straight edges, and the one in which a place lies."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from porocore.states import Array, IntArray

_OF_A_HEXAHEDRON = np.array(
    [(0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)]
)
#: Tetrahedra that are tried for a place, the nearest first; more of them where none of the first holds it.
NEAREST = (20, 500)
#: So far outside a tetrahedron, as a share of its size, a place counts as within.
SLACK = 1e-6


def tetrahedra(points: Array, cells: IntArray) -> tuple[Array, IntArray]:
    """Return the corners (k, 4, 3) of tetrahedra that make up elements, and the element of each (k,).

    Parameters
    ----------
    points : (nodes, 3)
        Nodes of the mesh.
    cells : (elements, 4 or 8)
        Corners of the elements in VTK order.
    """
    split = _OF_A_HEXAHEDRON if cells.shape[1] == 8 else np.array([(0, 1, 2, 3)])
    corners = np.asarray(points, float)[cells[:, split]].reshape(-1, 4, 3)
    return corners, np.repeat(np.arange(len(cells)), len(split))


def tetrahedron_at(corners: Array, places: Array) -> IntArray:
    """Return the tetrahedron (n,), by its number, in which each place (n, 3) lies, or -1."""
    tree = cKDTree(corners.mean(axis=1))
    inverse = np.linalg.pinv((corners[:, 1:] - corners[:, :1]).swapaxes(1, 2))
    found = np.full(len(places), -1)
    for count in NEAREST:
        left = np.flatnonzero(found < 0)
        if not len(left):
            break
        _, near = tree.query(places[left], k=min(count, len(corners)))
        for column in np.asarray(near).reshape(len(left), -1).T:
            open_ = found[left] < 0
            rows, tried = left[open_], column[open_]
            share = (inverse[tried] @ (places[rows] - corners[tried, 0])[:, :, None])[..., 0]
            inside = (share.min(axis=1) >= -SLACK) & (share.sum(axis=1) <= 1 + SLACK)
            found[rows[inside]] = tried[inside]
    return found
