"""Gradients of nodal fields at the quadrature points of a mesh, and their integrals (ElementGradients)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.quadrature import tetrahedron_rule
from porocore.cell.meshing.shape_functions import shape_functions
from porocore.states import Array

#: Meshes whose gradients are kept: the eighth and the whole of one member.
KEPT = 2


class ElementGradients:
    """Isoparametric gradients at the q quadrature points of each of M elements, those of every backend.

    Parameters
    ----------
    mesh
        Linear or quadratic tetrahedra with a nodes each.
    degree
        Degree of the quadrature rule.
    points : (nodes, 3)
        Positions of the nodes; those of the mesh by default.

    Attributes
    ----------
    grad_N : (M, q, a, 3)
        ∇N of each shape function.
    weights : (M, q)
        Volume of each point.
    """

    def __init__(self, mesh: CellMesh, degree: int, points: Array | None = None) -> None:
        self.cells, self.count = mesh.cells, len(mesh.points)
        at, weights = tetrahedron_rule(degree)
        dN = shape_functions(at, mesh.cells.shape[1])[1]
        nodes = (mesh.points if points is None else points)[mesh.cells]
        jacobian = np.einsum("eai,qaj->eqij", nodes, dN, optimize=True)
        self.grad_N = np.einsum("qaj,eqji->eqai", dN, np.linalg.inv(jacobian), optimize=True)
        self.weights = np.linalg.det(jacobian) * weights

    def gradient(self, u: Array) -> Array:
        """Return ∂u_i/∂Y_j (M, q, 3, 3) of u (nodes, 3)."""
        return np.asarray(u[self.cells].swapaxes(1, 2)[:, None] @ self.grad_N)

    def integral(self, values: Array) -> Array:
        """Return the integral (...) of values (M, q, ...)."""
        return np.tensordot(self.weights, values, axes=2)

    def forces(self, stress: Array) -> Array:
        """Return ∫ S:∇v for all nodal v, (nodes, 3), of S (M, q, 3, 3)."""
        weighted = self.weights[:, :, None, None] * stress
        blocks = (self.grad_N @ weighted.swapaxes(2, 3)).sum(axis=1)
        flat = self.cells.ravel()
        return np.stack(
            [np.bincount(flat, blocks[:, :, i].ravel(), self.count) for i in range(3)], axis=1
        ).astype(float)


@lru_cache(maxsize=KEPT)
def element_gradients(mesh: CellMesh, degree: int) -> ElementGradients:
    """Return the gradients on an undeformed mesh, which all states of a cell share."""
    return ElementGradients(mesh, degree)
