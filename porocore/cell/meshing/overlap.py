"""Overlap of the deformed pore wall with a mirror plane or the solid: smallest gap, nodes inside.

Under strong compression the ridges where two channels meet crease and fold through their mirror plane while J stays
positive everywhere; without contact such a state has no meaning.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.shape_functions import shape_functions
from porocore.states import Array

#: Subdivision of a quadratic tetrahedron (VTK order) into eight linear ones.
SUBDIVISION = np.array([
    [0, 4, 6, 7], [4, 1, 5, 8], [6, 5, 2, 9], [7, 8, 9, 3],
    [4, 5, 6, 8], [4, 6, 7, 8], [6, 5, 9, 8], [6, 9, 7, 8],
])  # fmt: skip
#: Intervals along the edge of a facet in the grid of points on the wall.
FACET_GRID = 8
#: A node lies inside a tetrahedron if all its barycentric coordinates exceed this.
DEPTH = 0.02


def mirror_gap(mesh: CellMesh, grad_u: Array, u: Array) -> float:
    """Return the smallest distance of the deformed wall to a mirror plane of the eighth over the undeformed one.

    It is 1 in the undeformed state, and negative where the wall has passed the plane. It is evaluated on a grid of
    points on every facet, since a crease begins as a fold within the facets next to the plane. The mesh is that of the
    solid on the eighth, ``grad_u`` (3, 3) is a diagonal H and u (nodes, 3) is u¹.
    """
    X, weights = _wall_points(mesh)
    x = X * (1 + np.diag(grad_u)) + np.einsum("sa,kai->ksi", weights, u[mesh.wall]).reshape(-1, 3)
    edge = (1 + np.diag(grad_u)) * mesh.high
    gap = np.inf
    for axis in range(3):
        below, above = X[:, axis], mesh.high[axis] - X[:, axis]
        off = below > 1e-12
        gap = min(gap, (x[off, axis] / below[off]).min(initial=np.inf))
        off = above > 1e-12
        gap = min(gap, ((edge[axis] - x[off, axis]) / above[off]).min(initial=np.inf))
    return float(gap)


@lru_cache(maxsize=8)
def _wall_points(mesh: CellMesh) -> tuple[Array, Array]:
    """Return grid points on the wall's facets (points, 3), and their shape functions (samples, 3 or 6)."""
    n = FACET_GRID
    grid = np.array([(j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    weights, _ = shape_functions(grid, mesh.wall.shape[1])
    return np.einsum("sa,kai->ksi", weights, mesh.points[mesh.wall]).reshape(-1, 3), weights


def nodes_inside(mesh: CellMesh, grad_u: Array, u: Array) -> npt.NDArray[np.int64]:
    """Return the nodes of the deformed wall that, or a periodic image of which, lie inside the deformed solid.

    The domain is the whole cell under any load; arguments as of :func:`mirror_gap`.
    """
    F0 = np.eye(3) + grad_u
    x = mesh.points @ F0.T + u
    tetrahedra = mesh.cells if mesh.order == 1 else mesh.cells[:, SUBDIVISION].reshape(-1, 4)
    # Sums over short last axes are slow, so components come first.
    corners = x.T[:, tetrahedra.T]
    centres = corners.mean(axis=1)
    radii = np.sqrt(((corners - centres[:, None]) ** 2).sum(axis=0).max(axis=0))
    low, high = x.min(axis=0), x.max(axis=0)
    nodes = np.unique(mesh.wall)
    queries, names = [], []
    for shift in product((-1.0, 0.0, 1.0), repeat=3):
        moved = x[nodes] + F0 @ (np.array(shift) * mesh.spans)
        near = ((moved > low) & (moved < high)).all(axis=1)
        queries.append(moved[near])
        names.append(nodes[near])
    points, origin = np.concatenate(queries), np.concatenate(names)
    reach = float(radii.max(initial=0.0))
    near = cKDTree(points, balanced_tree=False).sparse_distance_matrix(
        cKDTree(centres.T, balanced_tree=False), reach, output_type="ndarray"
    )
    point, tetrahedron = near["i"], near["j"]
    within = near["v"] < radii[tetrahedron]
    point, tetrahedron = point[within], tetrahedron[within]
    same = mesh.periodic_class[tetrahedra[tetrahedron]] == mesh.periodic_class[origin[point]][:, None]
    apart = ~same.any(axis=1)
    point, tetrahedron = point[apart], tetrahedron[apart]
    inside = _depth(x[tetrahedra[tetrahedron]], points[point]) > DEPTH
    return np.asarray(np.unique(origin[point[inside]]))


def _depth(corners: Array, points: Array) -> npt.NDArray[np.float64]:
    """Return the smallest barycentric coordinate of each point (n, 3) in its tetrahedron (n, 4, 3).

    It is −1 for a tetrahedron that is flat or turned inside out.
    """
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    # A curved tetrahedron may be sound where one of the straight ones that divide it is turned inside out.
    flat = np.linalg.det(edges) < 1e-14
    edges[flat] = np.eye(3)
    inner = np.linalg.solve(edges, (points - corners[:, 0])[:, :, None])[:, :, 0]
    depth: npt.NDArray[np.float64] = np.minimum(inner.min(axis=1), 1 - inner.sum(axis=1))
    depth[flat] = -1.0
    return depth
