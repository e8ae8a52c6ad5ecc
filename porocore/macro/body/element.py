"""Reference elements of a body, hexahedron and tetrahedron: shape functions, quadrature, facets.

Displacement and geometry are quadratic, the pressure is linear on the same corners (Taylor–Hood), so a hexahedron has
27 nodes and 8 corners, a tetrahedron 10 and 4. Nodes are in VTK's order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from porocore.cell.meshing.quadrature import tetrahedron_rule, triangle_rule
from porocore.states import Array, IntArray

Shape = Literal["hexahedron", "tetrahedron"]
#: Nodes of the 27-node hexahedron in half edges; the first 8 are the corners.
VTK_NODES = np.array(
    [
        *[(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)],
        *[(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)],
        *[(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)],
        *[(0, 1, 1), (2, 1, 1), (1, 0, 1), (1, 2, 1), (1, 1, 0), (1, 1, 2), (1, 1, 1)],
    ]
)
#: The same of the 10-node tetrahedron.
TETRAHEDRON_NODES = np.array(
    [
        *[(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2)],
        *[(1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)],
    ]
)
#: Outward facets by their nodes: corners, middles of their edges, middle.
_QUADRILATERALS = np.array(
    [
        [0, 4, 7, 3, 16, 15, 19, 11, 20],
        [1, 2, 6, 5, 9, 18, 13, 17, 21],
        [0, 1, 5, 4, 8, 17, 12, 16, 22],
        [3, 7, 6, 2, 19, 14, 18, 10, 23],
        [0, 3, 2, 1, 11, 10, 9, 8, 24],
        [4, 5, 6, 7, 12, 13, 14, 15, 25],
    ]
)
_TRIANGLES = np.array([[0, 2, 1, 6, 5, 4], [0, 1, 3, 4, 8, 7], [0, 3, 2, 7, 9, 6], [1, 2, 3, 5, 9, 8]])


@dataclass(frozen=True, eq=False)
class ReferenceElement:
    """Unit cube, or the unit tetrahedron below x + y + z = 1.

    Attributes
    ----------
    shape
        Which of the two.
    nodes : (n, 3)
        Of the displacement.
    corners
        How many of them, from the first, carry a pressure.
    facets : (f, m)
        Nodes of each facet, outward.
    points, weights : (q, 3), (q,)
        Quadrature of the volume: 3 × 3 × 3 Gauss points, exact to degree 5 in each direction, or four points of degree
        2, by which gradients of a quadratic displacement are multiplied exactly.
    degree
        By which other libraries find the same rule.
    """

    shape: Shape
    nodes: Array
    corners: int
    facets: IntArray
    points: Array
    weights: Array
    degree: int

    @property
    def facet_corners(self) -> int:
        """Corners of a facet."""
        return 4 if self.shape == "hexahedron" else 3

    def values(self, x: Array) -> Array:
        """(k, n) shape functions of the displacement at ``x`` (k, 3)."""
        return self._quadratic(x)[0]

    def gradients(self, x: Array) -> Array:
        """(k, n, 3) their derivatives by the reference coordinates."""
        return self._quadratic(x)[1]

    def corner_values(self, x: Array) -> Array:
        """(k, corners) shape functions of the pressure at ``x`` (k, 3)."""
        if self.shape == "tetrahedron":
            return _barycentric(x)
        ends = np.stack([1 - x, x], axis=-1)
        i, j, k = (VTK_NODES[:8] // 2).T
        return np.asarray(ends[:, 0, i] * ends[:, 1, j] * ends[:, 2, k])

    def _quadratic(self, x: Array) -> tuple[Array, Array]:
        if self.shape == "tetrahedron":
            return _quadratic_simplex(_barycentric(x), TETRAHEDRON_EDGES)
        return _quadratic_product(x, VTK_NODES)

    @cached_property
    def facet(self) -> ReferenceFacet:
        """Reference facet, the same for all facets."""
        if self.shape == "hexahedron":
            x, w = _gauss(2)
            N, dN = _quadratic_product(x, QUADRILATERAL_NODES)
            ends = np.stack([1 - x, x], axis=-1)
            i, j = (QUADRILATERAL_NODES[:4] // 2).T
            return ReferenceFacet(w, N, dN, ends[:, 0, i] * ends[:, 1, j])
        x, w = triangle_rule(4)
        b = _barycentric(x)
        return ReferenceFacet(w, *_quadratic_simplex(b, TRIANGLE_EDGES), b)


@dataclass(frozen=True, eq=False)
class ReferenceFacet:
    """Shape functions at the quadrature points of a facet.

    Attributes
    ----------
    weights : (q,)
        Their sum is the area of the reference facet.
    values, gradients : (q, m), (q, m, 2)
        Of the displacement.
    corner_values : (q, corners)
        Of the pressure.
    """

    weights: Array
    values: Array
    gradients: Array
    corner_values: Array


TETRAHEDRON_EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
TRIANGLE_EDGES = ((0, 1), (1, 2), (0, 2))
QUADRILATERAL_NODES = np.array([(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1)])


def _barycentric(x: Array) -> Array:
    return np.concatenate([1 - x.sum(axis=1, keepdims=True), x], axis=1)


def _quadratic_simplex(b: Array, edges: tuple[tuple[int, int], ...]) -> tuple[Array, Array]:
    """Values and gradients from the barycentric coordinates ``b`` (k, d + 1)."""
    d = b.shape[1] - 1
    slope = np.vstack([-np.ones(d), np.eye(d)])
    i, j = np.array(edges).T
    values = np.concatenate([b * (2 * b - 1), 4 * b[:, i] * b[:, j]], axis=1)
    corner = (4 * b - 1)[:, :, None] * slope
    edge = 4 * (b[:, i, None] * slope[j] + b[:, j, None] * slope[i])
    return values, np.concatenate([corner, edge], axis=1)


def _quadratic_product(x: Array, nodes: Any) -> tuple[Array, Array]:
    """Values and gradients of products of quadratic functions along each axis."""
    N = np.stack([(1 - x) * (1 - 2 * x), 4 * x * (1 - x), x * (2 * x - 1)], axis=-1)
    dN = np.stack([4 * x - 3, 4 - 8 * x, 4 * x - 1], axis=-1)
    axes = range(x.shape[1])
    along = [N[:, a, nodes[:, a]] for a in axes]
    values = np.prod(along, axis=0)
    gradients = [np.prod([dN[:, a, nodes[:, a]] if a == b else along[a] for a in axes], axis=0) for b in axes]
    return np.asarray(values), np.stack(gradients, axis=-1)


def _gauss(dimension: int) -> tuple[Array, Array]:
    """Three Gauss points along each axis of the unit square or cube, the first axis running fastest."""
    along = np.array([0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15)])
    share = np.array([5 / 18, 8 / 18, 5 / 18])
    index = lattice(np.full(dimension, 3))
    return along[index], share[index].prod(axis=1)


def lattice(ends: Any) -> IntArray:
    """(n, d) all (i, j, …) below ``ends`` (d,), i running fastest."""
    index = np.indices(tuple(ends)[::-1])[::-1]
    return np.stack([part.ravel() for part in index], axis=1)


HEXAHEDRON = ReferenceElement("hexahedron", VTK_NODES / 2, 8, _QUADRILATERALS, *_gauss(3), 5)
TETRAHEDRON = ReferenceElement("tetrahedron", TETRAHEDRON_NODES / 2, 4, _TRIANGLES, *tetrahedron_rule(2), 2)
ELEMENTS = {27: HEXAHEDRON, 10: TETRAHEDRON}
