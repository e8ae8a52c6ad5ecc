"""scikit-fem's shape functions on one element of the box; all elements are congruent, so one stands for all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from skfem import Basis, ElementHex1, ElementHex2, MeshHex

from porocore.macro.mesh import VTK_NODES, BoxMesh, gauss_points, gauss_weights


@dataclass(frozen=True, eq=False)
class Reference:
    """Shape functions at the quadrature points, in the mesh's order of points and of an element's nodes.

    Attributes
    ----------
    weights : (q,)
        Of the quadrature, with the element's volume in them.
    grad_u : (q, 27, 3)
        ∇N of the quadratic displacement.
    p, grad_p : (q, 8), (q, 8, 3)
        N and ∇N of the linear pressure.
    """

    weights: Any
    grad_u: Any
    p: Any
    grad_p: Any


def make_reference(mesh: BoxMesh) -> Reference:
    """Of the elements of ``mesh``."""
    corner, far = np.zeros(3), mesh.edges
    vertices = np.where(MeshHex.elem.refdom.p.T > 0, far, corner)
    element = MeshHex(vertices.T, np.arange(8)[:, None])
    rule = (gauss_points().T, gauss_weights())
    u_basis = Basis(element, ElementHex2(), quadrature=rule)
    p_basis = Basis(element, ElementHex1(), quadrature=rule)
    u_order, p_order = _in_vtk_order(ElementHex2(), 27), _in_vtk_order(ElementHex1(), 8)
    return Reference(
        weights=u_basis.dx[0].copy(),
        grad_u=np.stack([u_basis.basis[a][0].grad[:, 0].T for a in u_order], axis=1),
        p=np.stack([np.asarray(p_basis.basis[a][0])[0] for a in p_order], axis=1),
        grad_p=np.stack([p_basis.basis[a][0].grad[:, 0].T for a in p_order], axis=1),
    )


def _in_vtk_order(element: Any, nodes: int) -> list[int]:
    """For each node of VTK's order its number in scikit-fem's, by where they lie."""
    places = [tuple(place) for place in np.rint(2 * element.doflocs).astype(int)]
    return [places.index(tuple(node)) for node in VTK_NODES[:nodes]]
