"""Lumped mass of the nodes, which makes the eigenvalues of a tangent independent of the mesh."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.quadrature import tetrahedron_rule
from porocore.cell.meshing.shape_functions import shape_functions
from porocore.cell.meshing.tetrahedra import determinants
from porocore.states import Array

#: Degree of the rule; it integrates the square of a quadratic shape function on a straight tetrahedron.
DEGREE = 4


@lru_cache(maxsize=8)
def lumped_mass(mesh: CellMesh) -> Array:
    """Return the share of each node in the undeformed volume, (nodes,), all positive.

    The diagonal of each element's consistent mass matrix, scaled to the element's volume [Hinton, Rock & Zienkiewicz,
    Earthquake Eng. Struct. Dyn. 4 (1976) 245–249]; row sums would be negative at the corners of quadratic elements.
    """
    points, weights = tetrahedron_rule(DEGREE)
    N, _ = shape_functions(points, mesh.cells.shape[1])
    volume = determinants(mesh.points, mesh.cells, points) * weights
    diagonal = volume @ N**2
    share = diagonal * (volume.sum(axis=1) / diagonal.sum(axis=1))[:, None]
    nodal = np.bincount(mesh.cells.ravel(), share.ravel(), len(mesh.points))
    return nodal.astype(np.float64)
