"""Shape functions of linear and quadratic tetrahedra."""

from __future__ import annotations

import numpy as np

from porocore.states import Array

#: Corners at the ends of the edges with mid-edge nodes.
EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))


def shape_functions(points: Array, nodes: int) -> tuple[Array, Array]:
    """Return N (q, a) and dN (q, a, 3) of a tetrahedron of 4 or 10 nodes (VTK order) at points (q, 3)."""
    L = np.column_stack([1 - points.sum(axis=1), points])
    dL = np.concatenate([[[-1.0, -1.0, -1.0]], np.eye(3)])
    if nodes == 4:
        return L, np.broadcast_to(dL, (len(points), 4, 3)).copy()
    N = np.column_stack([L * (2 * L - 1), *(4 * L[:, i] * L[:, j] for i, j in EDGES)])
    corners = (4 * L - 1)[:, :, None] * dL
    middles = [4 * (L[:, [i]] * dL[j] + L[:, [j]] * dL[i]) for i, j in EDGES]
    return N, np.concatenate([corners, np.stack(middles, axis=1)], axis=1)
