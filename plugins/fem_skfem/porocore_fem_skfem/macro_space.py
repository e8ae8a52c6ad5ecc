"""Shape functions of a body at its quadrature points (Shapes), and frames of its nodes (Frames)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from skfem import (
    Element,
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
)

from porocore.macro.body.mesh import BodyMesh
from porocore.states import Array, IntArray

#: Elements of the displacement and of the pressure.
PAIRS: dict[str, tuple[Element, Element]] = {
    "hexahedron": (ElementHex2(), ElementHex1()),
    "tetrahedron": (ElementTetP2(), ElementTetP1()),
    "quadrilateral": (ElementQuad2(), ElementQuad1()),
    "triangle": (ElementTriP2(), ElementTriP1()),
}
#: Elements whose Jacobians differ by no more than this share are alike: the round-off of coordinates.
SAME = 1e-12


@dataclass(frozen=True, eq=False)
class Shapes:
    """Shape functions at the quadrature points, in the mesh's order of points and of an element's nodes.

    In a meridian the third component of ∇N is N/r for the displacement: what a radial displacement adds to H_33.
    """

    weights: Array  #: (elements, q)  volume of each point
    grad_u: Array  #: (elements, q, a, 3)  ∇N of the displacement
    p: Array  #: (q, c)  N of the pressure
    grad_p: Array  #: (elements, q, c, 3)  ∇N of the pressure
    inverse: Array  #: (elements, q, 3, 3)  ∂ξ_j/∂X_i at [j, i]
    slopes: Array  #: (q, a, 3)  ∂N/∂ξ of the displacement, the same in all elements
    corner_slopes: Array  #: (q, c, 3)  ∂N/∂ξ of the pressure
    revolved: bool = False  #: whether it is a meridian

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
    u_values, slopes = _tabulate(u, xi, nodes)
    values, corner_slopes = _tabulate(p, xi, nodes[: reference.corners])
    jacobian = np.einsum("eai,aqj->eqij", mesh.points[mesh.cells], slopes, optimize=True)
    if mesh.flat:
        jacobian[..., 2, 2] = 1.0
    inverse = np.linalg.inv(jacobian)
    weights = np.linalg.det(jacobian) * reference.weights
    grad_u = np.einsum("aqj,eqji->eqai", slopes, inverse, optimize=True)
    if mesh.flat:
        places = np.einsum("eai,aq->eqi", mesh.points[mesh.cells], u_values, optimize=True)
        weights = weights * mesh.measure(places)
        if mesh.revolved:
            grad_u[..., 2] = u_values.T / places[..., :1]
    return Shapes(
        weights=weights,
        grad_u=grad_u,
        p=np.ascontiguousarray(values.T),
        grad_p=np.einsum("cqj,eqji->eqci", corner_slopes, inverse, optimize=True),
        inverse=inverse,
        slopes=np.ascontiguousarray(slopes.swapaxes(0, 1)),
        corner_slopes=np.ascontiguousarray(corner_slopes.swapaxes(0, 1)),
        revolved=mesh.revolved,
    )


def _tabulate(element: Element, xi: Array, nodes: Array) -> tuple[Array, Array]:
    """Return the values (a, q) and gradients (a, q, 3) of the functions of ``nodes``, given in half edges."""
    places = [tuple(place) for place in np.rint(2 * element.doflocs).astype(int)]
    d = len(places[0])
    order = [places.index(tuple(node)) for node in np.rint(nodes[:, :d]).astype(int)]
    pairs = [element.lbasis(xi[:d], i) for i in order]
    values = [np.broadcast_to(value, xi.shape[1:]) for value, _ in pairs]
    slopes = [np.broadcast_to(slope, (d, *xi.shape[1:])).T for _, slope in pairs]
    return np.array(values), np.pad(slopes, ((0, 0), (0, 0), (0, 3 - d)))


_I = np.arange(3)[:, None]


class Frames:
    """Rotation of the entries of elements that have nodes with frames of their own.

    Parameters
    ----------
    rotation
        Sparse (unknowns, unknowns), the components of each node among themselves.
    cells : (elements, a)
        Nodes of each element.
    """

    def __init__(self, rotation: sparse.csr_matrix, cells: IntArray) -> None:
        n = int(cells.max()) + 1
        node = np.arange(n)[:, None, None]
        rows, columns = (np.broadcast_to(3 * node + i, (n, 3, 3)).ravel() for i in (_I, _I.T))
        of_nodes = np.asarray(rotation[rows, columns]).reshape(n, 3, 3)
        oblique = (of_nodes != np.eye(3)).any(axis=(1, 2))
        self._elements = np.flatnonzero(oblique[cells].any(axis=1))
        #: (turned elements, a, 3, 3)
        self._of_nodes = of_nodes[cells[self._elements]]

    def turn(self, blocks: list[Array], part: slice) -> None:
        """Rotate, in place, the blocks of the elements in ``part``.

        These are (elements, ...) of (e, a, i, k, b), (e, a, i, c), (e, c, k, b) and (e, c, d), each made flat.
        """
        which = slice(*np.searchsorted(self._elements, [part.start, part.stop]))
        elements, Q = self._elements[which] - part.start, self._of_nodes[which]
        e, a = Q.shape[:2]
        if not e:
            return
        stiffness, by_p, by_u = (block[elements] for block in blocks[:3])
        stiffness = np.matmul(Q, stiffness.reshape(e, a, 3, 3 * a)).reshape(e, 3 * a, 3, a)
        blocks[0][elements] = _columns(Q, stiffness).reshape(e, -1)
        blocks[1][elements] = np.matmul(Q, by_p.reshape(e, a, 3, -1)).reshape(e, -1)
        blocks[2][elements] = _columns(Q, by_u.reshape(e, -1, 3, a)).reshape(e, -1)


def _columns(Q: Array, values: Array) -> Array:
    """Return Q_b applied to the components k of (e, rows, k, b)."""
    return np.asarray(np.einsum("ebkl,erlb->erkb", Q, values, optimize=True))
