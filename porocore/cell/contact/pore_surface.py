"""The pore surface: the wall's facets of a solid mesh, with quadrature points, weights and area."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.quadrature import triangle_rule
from porocore.cell.meshing.shape_functions import shape_functions
from porocore.states import Array, IntArray

#: Degree of the rule on a facet: a crease begins as a fold within the facets next to a mirror plane.
DEGREE = 7


@dataclass(frozen=True, eq=False)
class PoreSurface:
    """The pore wall as F facets of a nodes each, with q quadrature points.

    Attributes
    ----------
    facets : (F, a)
        Nodes, outward from the solid.
    N : (q, a), dN : (q, a, 2)
        Shape functions and their derivatives by the two coordinates of a facet.
    weights : (F, q)
        Undeformed area of each point.
    """

    facets: IntArray
    N: Array
    dN: Array
    weights: Array

    @property
    def area(self) -> float:
        """Undeformed area of the wall."""
        return float(self.weights.sum())


@lru_cache(maxsize=8)
def pore_surface(mesh: CellMesh) -> PoreSurface:
    """Return the pore surface of a mesh of the solid."""
    points, weights = triangle_rule(DEGREE)
    N, dN = shape_functions(points, mesh.wall.shape[1])
    tangents = np.einsum("qas,fai->fqsi", dN, mesh.points[mesh.wall])
    area = np.linalg.norm(np.cross(tangents[:, :, 0], tangents[:, :, 1]), axis=2)
    return PoreSurface(mesh.wall, N, dN, area * weights)
