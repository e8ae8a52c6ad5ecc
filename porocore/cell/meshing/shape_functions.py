"""Shape functions of linear and quadratic triangles and tetrahedra, nodes in VTK order."""

from __future__ import annotations

import numpy as np

from porocore.states import Array

#: Corners at the ends of the edges with mid-edge nodes; a triangle has the first three edges.
EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
#: Corners, then mid-edge nodes, of the facets of a tetrahedron, outward; facet k is opposite to corner k.
FACETS = np.array([[1, 2, 3, 5, 9, 8], [0, 3, 2, 7, 9, 6], [0, 1, 3, 4, 8, 7], [0, 2, 1, 6, 5, 4]])


def shape_functions(points: Array, nodes: int) -> tuple[Array, Array]:
    """Return N (q, a) and dN (q, a, d) of a triangle (d = 2) or a tetrahedron (d = 3) of ``nodes`` at points (q, d)."""
    count, d = points.shape
    L = np.column_stack([1 - points.sum(axis=1), points])
    dL = np.concatenate([-np.ones((1, d)), np.eye(d)])
    if nodes == d + 1:
        return L, np.broadcast_to(dL, (count, nodes, d)).copy()
    edges = EDGES[: nodes - d - 1]
    N = np.column_stack([L * (2 * L - 1), *(4 * L[:, i] * L[:, j] for i, j in edges)])
    corners = (4 * L - 1)[:, :, None] * dL
    middles = [4 * (L[:, [i]] * dL[j] + L[:, [j]] * dL[i]) for i, j in edges]
    return N, np.concatenate([corners, np.stack(middles, axis=1)], axis=1)
