"""Shape functions of scikit-fem, tabulated at the quadrature points of a body."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from skfem import Element, ElementHex1, ElementHex2, ElementTetP1, ElementTetP2

from porocore.macro.body.mesh import BodyMesh
from porocore.states import Array

#: Elements of the displacement and of the pressure.
PAIRS = {"hexahedron": (ElementHex2(), ElementHex1()), "tetrahedron": (ElementTetP2(), ElementTetP1())}
#: Elements whose Jacobians differ by no more than this share are alike: the round-off of coordinates.
SAME = 1e-12


@dataclass(frozen=True, eq=False)
class Shapes:
    """Shape functions at the quadrature points, in the mesh's order of points and of an element's nodes."""

    weights: Array  #: (elements, q)  volume of each point
    grad_u: Array  #: (elements, q, a, 3)  ∇N of the displacement
    p: Array  #: (q, c)  N of the pressure
    grad_p: Array  #: (elements, q, c, 3)  ∇N of the pressure
    inverse: Array  #: (elements, q, 3, 3)  ∂ξ_j/∂X_i at [j, i]
    slopes: Array  #: (q, a, 3)  ∂N/∂ξ of the displacement, the same in all elements
    corner_slopes: Array  #: (q, c, 3)  ∂N/∂ξ of the pressure

    @cached_property
    def alike(self) -> bool:
        """True if all elements are alike but for their place, as in a straight column."""
        return all(
            np.ptp(values, axis=0).max() <= SAME * np.abs(values).max()
            for values in (self.inverse, self.weights)
        )


def make_shapes(mesh: BodyMesh) -> Shapes:
    """Return the shape functions of the elements of ``mesh``, on their isoparametric geometry."""
    reference = mesh.element
    u, p = PAIRS[reference.shape]
    xi, nodes = reference.points.T, 2 * reference.nodes
    _, slopes = _tabulate(u, xi, nodes)
    values, corner_slopes = _tabulate(p, xi, nodes[: reference.corners])
    jacobian = np.einsum("eai,aqj->eqij", mesh.points[mesh.cells], slopes, optimize=True)
    inverse = np.linalg.inv(jacobian)
    return Shapes(
        weights=np.linalg.det(jacobian) * reference.weights,
        grad_u=np.einsum("aqj,eqji->eqai", slopes, inverse, optimize=True),
        p=np.ascontiguousarray(values.T),
        grad_p=np.einsum("cqj,eqji->eqci", corner_slopes, inverse, optimize=True),
        inverse=inverse,
        slopes=np.ascontiguousarray(slopes.swapaxes(0, 1)),
        corner_slopes=np.ascontiguousarray(corner_slopes.swapaxes(0, 1)),
    )


def _tabulate(element: Element, xi: Array, nodes: Array) -> tuple[Array, Array]:
    """Return the values (a, q) and gradients (a, q, 3) of the functions of ``nodes``, given in half edges."""
    places = [tuple(place) for place in np.rint(2 * element.doflocs).astype(int)]
    order = [places.index(tuple(node)) for node in np.rint(nodes).astype(int)]
    pairs = [element.lbasis(xi, i) for i in order]
    values = [np.broadcast_to(value, xi.shape[1:]) for value, _ in pairs]
    slopes = [np.broadcast_to(slope, xi.shape).T for _, slope in pairs]
    return np.array(values), np.array(slopes)
