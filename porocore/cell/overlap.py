"""Whether the pore wall has passed through something, which J > 0 does not tell.

Under strong compression the ridges where two channels meet crease and fold through their mirror plane
while J stays positive everywhere; without wall contact such a state is no valid data.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from porocore.cell.mesh import CellMesh
from porocore.states import Array

#: The eight tetrahedra of a quadratic one (VTK order of its ten nodes).
SUBDIVISION = np.array(
    [
        [0, 4, 6, 7],
        [4, 1, 5, 8],
        [6, 5, 2, 9],
        [7, 8, 9, 3],
        [4, 5, 6, 8],
        [4, 6, 7, 8],
        [6, 5, 9, 8],
        [6, 9, 7, 8],
    ]
)
#: A node counts as inside a tetrahedron when all its barycentric coordinates exceed this.
DEPTH = 0.02


def mirror_gap(mesh: CellMesh, grad_u: Array, u: Array) -> float:
    """Smallest distance of the deformed wall to the mirror planes of the eighth; negative: it has passed one.

    Parameters
    ----------
    mesh
        Solid mesh of the eighth.
    grad_u : (3, 3)
        Diagonal H.
    u : (nodes, 3)
        u¹.
    """
    nodes = np.unique(mesh.wall)
    X = mesh.points[nodes]
    stretch = 1 + np.diag(grad_u)
    x = stretch * X + u[nodes]
    gap = np.inf
    for axis in range(3):
        below, above = X[:, axis] > 0, X[:, axis] < 0.5
        gap = min(gap, x[below, axis].min(initial=np.inf), (stretch[axis] / 2 - x[above, axis]).min(initial=np.inf))
    return float(gap)


def walls_overlap(mesh: CellMesh, grad_u: Array, u: Array) -> bool:
    """Whether a node of the deformed wall, or of a periodic image of it, lies inside the deformed solid.

    For the whole cell under any load; the arguments are those of :func:`mirror_gap`.
    """
    F0 = np.eye(3) + grad_u
    x = mesh.points @ F0.T + u
    tetrahedra = mesh.cells if mesh.order == 1 else mesh.cells[:, SUBDIVISION].reshape(-1, 4)
    corners = x[tetrahedra]
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    low, high = x.min(axis=0), x.max(axis=0)
    nodes = np.unique(mesh.wall)
    queries, names = [], []
    for shift in product((-1.0, 0.0, 1.0), repeat=3):
        moved = x[nodes] + F0 @ np.array(shift)
        near = ((moved > low) & (moved < high)).all(axis=1)
        queries.append(moved[near])
        names.append(nodes[near])
    points, origin = np.concatenate(queries), np.concatenate(names)
    neighbours = cKDTree(centres).query_ball_point(points, radii.max())
    counts = np.fromiter((len(n) for n in neighbours), dtype=np.int64, count=len(points))
    if not counts.sum():
        return False
    point = np.repeat(np.arange(len(points)), counts)
    tetrahedron = np.concatenate([np.asarray(n, dtype=np.int64) for n in neighbours if n])
    close = np.linalg.norm(points[point] - centres[tetrahedron], axis=1) < radii[tetrahedron]
    point, tetrahedron = point[close], tetrahedron[close]
    same = mesh.periodic_class[tetrahedra[tetrahedron]] == mesh.periodic_class[origin[point]][:, None]
    apart = ~same.any(axis=1)
    return bool((_depth(corners[tetrahedron[apart]], points[point[apart]]) > DEPTH).any())


def _depth(corners: Array, points: Array) -> npt.NDArray[np.float64]:
    """Smallest barycentric coordinate of each point (n, 3) in its tetrahedron (n, 4, 3)."""
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    flat = np.abs(np.linalg.det(edges)) < 1e-14
    edges[flat] = np.eye(3)
    inner = np.linalg.solve(edges, (points - corners[:, 0])[:, :, None])[:, :, 0]
    depth = np.minimum(inner.min(axis=1), 1 - inner.sum(axis=1))
    depth[flat] = -1.0
    return depth
