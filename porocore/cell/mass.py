"""A lumped mass, by which the eigenvalues of a tangent become numbers that do not depend on the mesh."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from porocore.cell.quadrature import tetrahedron_rule
from porocore.states import Array

if TYPE_CHECKING:
    from porocore.cell.mesh import CellMesh

#: Of the rule: it integrates the square of a quadratic shape function on a straight tetrahedron.
DEGREE = 4
EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))


@lru_cache(maxsize=8)
def lumped_mass(mesh: CellMesh) -> Array:
    """Share of each node in the undeformed volume, (nodes,), all positive.

    The diagonal of each element's consistent mass matrix, scaled to the element's volume [Hinton, Rock & Zienkiewicz,
    Earthquake Eng. Struct. Dyn. 4 (1976) 245–249]; row sums would be negative at the corners of quadratic elements.
    """
    points, weights = tetrahedron_rule(DEGREE)
    N, dN = shape_functions(points, mesh.cells.shape[1])
    jacobian = np.einsum("eai,qaj->eqij", mesh.points[mesh.cells], dN, optimize=True)
    volume = np.linalg.det(jacobian) * weights
    diagonal = volume @ N**2
    share = diagonal * (volume.sum(axis=1) / diagonal.sum(axis=1))[:, None]
    nodal = np.bincount(mesh.cells.ravel(), share.ravel(), len(mesh.points))
    return nodal.astype(np.float64)


def shape_functions(points: Array, nodes: int) -> tuple[Array, Array]:
    """N (q, a) and dN (q, a, 3) of a tetrahedron of 4 or 10 nodes (VTK order) at points (q, 3) of the unit one."""
    L = np.column_stack([1 - points.sum(axis=1), points])
    dL = np.concatenate([[[-1.0, -1.0, -1.0]], np.eye(3)])
    if nodes == 4:
        return L, np.broadcast_to(dL, (len(points), 4, 3)).copy()
    N = np.column_stack([L * (2 * L - 1), *(4 * L[:, i] * L[:, j] for i, j in EDGES)])
    corners = (4 * L - 1)[:, :, None] * dL
    middles = [4 * (L[:, [i]] * dL[j] + L[:, [j]] * dL[i]) for i, j in EDGES]
    return N, np.concatenate([corners, np.stack(middles, axis=1)], axis=1)
