"""Mesh of a body (BodyMesh): its elements, structured meshes, named surfaces and patches.

Displacement and geometry are quadratic, the pressure is linear on the same corners (Taylor–Hood), so a hexahedron has
27 nodes and 8 corners, a tetrahedron 10 and 4. Nodes are in VTK's order.

Elements of a body in two dimensions are quadrilaterals and triangles in the plane z = 0, those of a body of revolution
in the meridian, x the distance from the axis and z around it. They have shape functions of three coordinates that do
not change along the third, so that nothing beyond this file needs to know how many there are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import model_validator
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from porocore.cell.meshing.tetrahedra import tetrahedron_rule, triangle_rule
from porocore.core.echo import did_you_mean, joined
from porocore.core.models.strict import Name, StrictModel
from porocore.core.units import Dimension
from porocore.errors import ConfigurationError
from porocore.interfaces.solution import MacroSolution
from porocore.states import Array, IntArray

Shape = Literal["hexahedron", "tetrahedron", "quadrilateral", "triangle"]
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
    """Unit cube or square, or the unit tetrahedron or triangle below x + y + z = 1.

    Attributes
    ----------
    shape
        Which of them.
    nodes : (n, 3)
        Of the displacement.
    corners
        How many of them, from the first, carry a pressure.
    facets : (f, m)
        Nodes of each facet, outward; edges in two dimensions, counter-clockwise.
    points, weights : (q, 3), (q,)
        Quadrature of the volume: 3 × 3 × 3 or 3 × 3 Gauss points, exact to degree 5 in each direction, or in a
        tetrahedron four points of degree 2, by which gradients of a quadratic displacement are multiplied exactly.
        Triangles have six of degree 4, since the distance from an axis may be a factor.
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
    def dimension(self) -> int:
        """Coordinates of which the shape functions are."""
        return 2 if self.shape in ("quadrilateral", "triangle") else 3

    @property
    def is_product(self) -> bool:
        """True for a cube or square."""
        return self.shape in ("hexahedron", "quadrilateral")

    @property
    def facet_corners(self) -> int:
        """Corners of a facet."""
        return 2 if self.dimension == 2 else 4 if self.is_product else 3

    def beyond(self, x: Array) -> Array:
        """(k,) how far places ``x`` (k, 3) lie outside, negative inside."""
        inside = x[:, : self.dimension]
        last = inside.max(axis=1) if self.is_product else inside.sum(axis=1)
        found = np.maximum(-inside.min(axis=1), last - 1)
        across = np.abs(x[:, self.dimension :]).max(axis=1, initial=0.0)
        return np.asarray(np.maximum(found, across) if self.dimension < 3 else found)

    def values(self, x: Array) -> Array:
        """(k, n) shape functions of the displacement at ``x`` (k, 3)."""
        return self._quadratic(x)[0]

    def gradients(self, x: Array) -> Array:
        """(k, n, 3) their derivatives by the reference coordinates."""
        return self._quadratic(x)[1]

    def corner_values(self, x: Array) -> Array:
        """(k, corners) shape functions of the pressure at ``x`` (k, 3)."""
        x = x[:, : self.dimension]
        if not self.is_product:
            return _barycentric(x)
        return _linear_product(x, (2 * self.nodes[: self.corners, : self.dimension]).astype(int))

    def _quadratic(self, x: Array) -> tuple[Array, Array]:
        d = self.dimension
        if self.is_product:
            values, gradients = _quadratic_product(x[:, :d], (2 * self.nodes[:, :d]).astype(int))
        else:
            edges = TETRAHEDRON_EDGES if d == 3 else TRIANGLE_EDGES
            values, gradients = _quadratic_simplex(_barycentric(x[:, :d]), edges)
        return values, np.pad(gradients, ((0, 0), (0, 0), (0, 3 - d)))

    @cached_property
    def facet(self) -> ReferenceFacet:
        """Reference facet, the same for all facets."""
        if self.dimension == 2 or self.is_product:
            nodes = QUADRILATERAL_NODES if self.dimension == 3 else EDGE_NODES
            x, w = _gauss(self.dimension - 1)
            return ReferenceFacet(
                w, *_quadratic_product(x, nodes), _linear_product(x, nodes[: self.facet_corners])
            )
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
    values, gradients : (q, m), (q, m, 2 or 1)
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
TRIANGLE_NODES = np.array([(0, 0), (2, 0), (0, 2), (1, 0), (1, 1), (0, 1)])
EDGE_NODES = np.array([(0,), (2,), (1,)])


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


def _linear_product(x: Array, corners: Any) -> Array:
    """Values of products of linear functions along each axis."""
    ends = np.stack([1 - x, x], axis=-1)
    return np.asarray(np.prod([ends[:, a, corners[:, a] // 2] for a in range(x.shape[1])], axis=0))


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
    """Three Gauss points along each axis of the unit interval, square or cube, the first axis running fastest."""
    along = np.array([0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15)])
    share = np.array([5 / 18, 8 / 18, 5 / 18])
    index = lattice(np.full(dimension, 3))
    return along[index], share[index].prod(axis=1)


#: Six points on the unit triangle, exact to degree 4 [Dunavant 1985, Int. J. Numer. Methods Eng. 21, 1129–1148].
_FIRST, _SECOND = 0.44594849091596489, 0.09157621350977073
_SIX_POINTS = (
    np.array([p for a in (_FIRST, _SECOND) for p in ((a, a), (a, 1 - 2 * a), (1 - 2 * a, a))]),
    np.repeat([0.22338158967801147, 0.10995174365532187], 3) / 2,
)


def lattice(ends: Any) -> IntArray:
    """(n, d) all (i, j, …) below ``ends`` (d,), i running fastest."""
    index = np.indices(tuple(ends)[::-1])[::-1]
    return np.stack([part.ravel() for part in index], axis=1)


HEXAHEDRON = ReferenceElement("hexahedron", VTK_NODES / 2, 8, _QUADRILATERALS, *_gauss(3), 5)
TETRAHEDRON = ReferenceElement("tetrahedron", TETRAHEDRON_NODES / 2, 4, _TRIANGLES, *tetrahedron_rule(2), 2)


def _flat_element(
    shape: Shape, nodes: IntArray, corners: int, rule: tuple[Array, Array], degree: int
) -> ReferenceElement:
    """Return an element in the plane z = 0, with its edges counter-clockwise."""
    around = np.arange(corners)
    edges = np.column_stack([around, (around + 1) % corners, corners + around])
    at, points = np.pad(nodes / 2, ((0, 0), (0, 1))), np.pad(rule[0], ((0, 0), (0, 1)))
    return ReferenceElement(shape, at, corners, edges, points, rule[1], degree)


QUADRILATERAL = _flat_element("quadrilateral", QUADRILATERAL_NODES, 4, _gauss(2), 5)
TRIANGLE = _flat_element("triangle", TRIANGLE_NODES, 3, _SIX_POINTS, 4)
ELEMENTS = {27: HEXAHEDRON, 10: TETRAHEDRON, 9: QUADRILATERAL, 6: TRIANGLE}


#: Corners of a facet by its nodes.
FACET_CORNERS = {9: 4, 6: 3, 3: 2}
#: Of the width of a meridian, up to which a distance from the axis is none.
ON_AXIS = 1e-12
#: Components of H and of a stress that there are in a body of revolution without a twist: radius, axis, hoop.
MERIDIAN = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class BodyMesh:
    """Isoparametric elements that carry the displacement at all their nodes and the pressure at their corners.

    Unknowns are numbered displacements first, 3 · node + component, then the pressures. Every backend reports in
    this order of nodes, elements and quadrature points.

    Attributes
    ----------
    points : (nodes, 3)
        Nodes of the displacement, X.
    cells : (elements, 27, 10, 9 or 6)
        Nodes of each element in VTK's order: triquadratic hexahedra or quadratic tetrahedra, and in two dimensions
        biquadratic quadrilaterals or quadratic triangles.
    surfaces
        Outward facets (facets, 9, 6 or 3) of each named part of the surface, by their nodes.
    volumes
        Elements (k,) of each named volume.
    unusable
        Why nothing can be prescribed on a surface that a file names.
    unusable_volumes
        Why a volume that a file names cannot be a region.
    numbers, volume_numbers
        Names of the surfaces and volumes that have a number in the file too, by that.
    revolved
        Whether a body in two dimensions is the meridian of a body of revolution about the y axis.
    depth
        Else the length that it stands for along the third axis.
    """

    points: Array
    cells: IntArray
    surfaces: Mapping[str, IntArray] = field(default_factory=dict)
    volumes: Mapping[str, IntArray] = field(default_factory=dict)
    unusable: Mapping[str, str] = field(default_factory=dict)
    unusable_volumes: Mapping[str, str] = field(default_factory=dict)
    numbers: Mapping[str, str] = field(default_factory=dict)
    volume_numbers: Mapping[str, str] = field(default_factory=dict)
    revolved: bool = False
    depth: float = 1.0

    @classmethod
    def of(cls, solution: MacroSolution) -> BodyMesh:
        """Return the mesh of a solution, without the names of its surfaces."""
        return cls(solution.points, solution.cells, revolved=solution.revolved, depth=solution.depth)

    @property
    def flat(self) -> bool:
        """True for a body in two dimensions."""
        return self.element.dimension == 2

    @property
    def is_section(self) -> bool:
        """True for a section of a long body, in plane strain."""
        return self.flat and not self.revolved

    def measure(self, places: Array) -> Array:
        """Return the length (...) across the plane that places (..., 3) of a body in two dimensions stand for."""
        return 2 * np.pi * places[..., 0] if self.revolved else np.full(places.shape[:-1], self.depth)

    @property
    def on_axis(self) -> IntArray:
        """Nodes on the axis of a body of revolution, which no radial displacement moves; none of others."""
        x = self.points[:, 0]
        return np.flatnonzero(np.abs(x) <= ON_AXIS * np.ptp(x)) if self.revolved else np.empty(0, np.int64)

    @property
    def element(self) -> ReferenceElement:
        """Reference element of the mesh."""
        return ELEMENTS[self.cells.shape[1]]

    @cached_property
    def p_nodes(self) -> IntArray:
        """(p_nodes,) which nodes are corners and carry a pressure, ascending."""
        return np.asarray(np.unique(self.cells[:, : self.element.corners]))

    @cached_property
    def p_cells(self) -> IntArray:
        """(elements, 8 or 4) places in ``p_nodes`` of the corners of each element."""
        return np.asarray(np.searchsorted(self.p_nodes, self.cells[:, : self.element.corners]))

    @property
    def n_u(self) -> int:
        """Number of displacement unknowns."""
        return 3 * len(self.points)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.n_u + len(self.p_nodes)

    @cached_property
    def straight(self) -> bool:
        """True if the elements are the images of their corners, without curved edges."""
        corners = self.points[self.cells[:, : self.element.corners]]
        placed = np.einsum(
            "na,eai->eni", self.element.corner_values(self.element.nodes), corners, optimize=True
        )
        return bool(np.abs(placed - self.points[self.cells]).max() < 1e-12 * np.ptp(self.points))

    @cached_property
    def pieces(self) -> IntArray:
        """(nodes,) number of the piece of the body to which each node belongs, from 0; pieces share no node."""
        e, corners = len(self.cells), self.cells[:, : self.element.corners]
        rows, columns = np.repeat(np.arange(e), corners.shape[1]), e + corners.ravel()
        size = e + len(self.points)
        links = coo_matrix((np.ones(corners.size, dtype=bool), (rows, columns)), shape=(size, size))
        of_elements = connected_components(links, directed=False)[1][:e]
        found = np.empty(len(self.points), dtype=np.int64)
        found[self.cells] = np.unique(of_elements, return_inverse=True)[1].reshape(-1, 1)
        return found

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points)

    def node_at(self, places: Array) -> IntArray:
        """(n,) numbers of the nodes at, or nearest to, ``places`` (n, 3)."""
        return np.asarray(self._tree.query(places)[1], dtype=np.int64)

    @cached_property
    def jacobians(self) -> Array:
        """(elements, q, 3, 3) ∂X_i/∂ξ_j at the quadrature points."""
        gradients = self.element.gradients(self.element.points)
        found = np.einsum("eai,qaj->eqij", self.points[self.cells], gradients, optimize=True)
        if self.flat:
            found[..., 2, 2] = 1.0
        return np.asarray(found)

    @cached_property
    def weights(self) -> Array:
        """(elements, q) volume of each quadrature point, of the whole revolution or depth in two dimensions."""
        areas = np.linalg.det(self.jacobians) * self.element.weights
        return np.asarray(areas * self.measure(self.quadrature_points) if self.flat else areas)

    def gradients(self, elements: Any = slice(None)) -> Array:
        """(elements, q, a, 3) ∂N_a/∂X_i of the displacement's shape functions, of all elements or some.

        In a meridian the third is N_a/r, by which a radial displacement stretches the circle around.
        """
        reference = self.element.gradients(self.element.points)
        inverse = np.linalg.inv(self.jacobians[elements])
        found = np.einsum("qak,eqkj->eqaj", reference, inverse, optimize=True)
        if self.revolved:
            r = self.quadrature_points[elements][..., :1]
            found[..., 2] = self.element.values(self.element.points) / r
        return np.asarray(found)

    def displacement_gradients(self, u: Array, elements: Any = slice(None)) -> Array:
        """(elements, q, 3, 3) H_ij = ∂u_i/∂X_j of a displacement ``u`` (nodes, 3), of all elements or some.

        In a meridian the rows and columns are those of the radius, the axis and the hoop: H_33 = u_r/r.
        """
        local = u[self.cells[elements]]
        if self.revolved:
            local[..., 2] = local[..., 0]
        H = np.einsum("eai,eqaj->eqij", local, self.gradients(elements), optimize=True)
        return np.asarray(H * MERIDIAN if self.revolved else H)

    @cached_property
    def quadrature_points(self) -> Array:
        """(elements, q, 3) places of the quadrature points."""
        return np.asarray(self.element.values(self.element.points) @ self.points[self.cells])

    @cached_property
    def centres(self) -> Array:
        """(elements, 3) centres of volume."""
        return self.means(self.quadrature_points.reshape(-1, 3))

    def means(self, values: Array, elements: Any = slice(None)) -> Array:
        """Return means (elements, ...) over elements, all or some, of values at their points (points, ...)."""
        weights = self.weights[elements]
        shares = weights / weights.sum(axis=1, keepdims=True)
        by_element = values.reshape(*shares.shape, *values.shape[1:])
        return np.asarray(np.einsum("eq,eq...->e...", shares, by_element))

    @cached_property
    def stretch(self) -> float:
        """Largest ∫ Σ_j |∂N/∂X_j| dX over the body of a displacement node's shape function N."""
        local = np.einsum("eq,eqaj->ea", self.weights, np.abs(self.gradients()))
        return float(np.bincount(self.cells.ravel(), local.ravel()).max())

    @cached_property
    def share_of_volume(self) -> float:
        """Largest ∫ N dX over the body of a pressure node's shape function N."""
        local = self.weights @ self.element.corner_values(self.element.points)
        return float(np.bincount(self.p_cells.ravel(), local.ravel()).max())

    def pressure_everywhere(self, p: Array) -> Array:
        """(nodes,) the linear pressure at all nodes, from its values (p_nodes,) at the corners."""
        everywhere = np.empty(len(self.points))
        everywhere[self.cells] = p[self.p_cells] @ self.element.corner_values(self.element.nodes).T
        return everywhere

    @cached_property
    def unnamed(self) -> int:
        """Number of facets of the boundary that belong to no named surface."""
        named = [self.corners_of(facets) for facets in self.surfaces.values()]
        facets = boundary_facets(self.cells)
        # A body of revolution goes on beyond its axis.
        outer = facets[~np.isin(facets, self.on_axis).all(axis=1)]
        return len(outer) - len(set[tuple[int, ...]]().union(*named).intersection(self.corners_of(outer)))

    def corners_of(self, facets: IntArray) -> list[tuple[int, ...]]:
        """Return the corners of facets (k, m) in ascending order, by which they are known."""
        corners = np.sort(facets[:, : self.element.facet_corners], axis=1)
        return [tuple(key) for key in corners.tolist()]

    def surface(self, name: str, key: str) -> IntArray:
        """Facets of a named part.

        Raises
        ------
        ConfigurationError
            There is none of that name, or nothing can be prescribed on it; the message begins with ``key``.
        """
        if name in self.unusable:
            raise ConfigurationError(f"{key}: {self.unusable[name]}")
        if name not in self.surfaces:
            listed = (
                each
                if not each.isdecimal()
                else f"{each} ('{self.numbers[each]}')"
                if each in self.numbers
                else f"{each} (a number, without a name)"
                for each in self.surfaces
            )
            names = ", ".join(listed) or "none; give the surfaces of the mesh file names"
            near = did_you_mean(name, self.surfaces)
            advice = f"{near} its surfaces are {names}".lstrip()
            raise ConfigurationError(f"{key}: the body has no surface '{name}'; {advice}")
        return self.surfaces[name]

    def require_surfaces(self, names: Iterable[str], key: str) -> None:
        """Check that the body has all surfaces of these names.

        Raises
        ------
        ConfigurationError
            It has not; the message begins with ``key`` and a name, and has all names that are wrong.
        """
        wrong = [name for name in names if name not in self.surfaces or name in self.unusable]
        if not wrong:
            return
        try:
            self.surface(wrong[0], f"{key}.{wrong[0]}")
        except ConfigurationError as error:
            asked = [" ".join([f"'{name}'", *self._near(name)]) for name in wrong[1:]]
            also = f"; also wrong: {joined(asked)}" if asked else ""
            raise ConfigurationError(f"{error}{also}") from None

    def _near(self, name: str) -> tuple[str, ...]:
        asked = "" if name in self.unusable else did_you_mean(name, self.surfaces)
        return (f"({asked})",) if asked else ()

    def check(self, what: str) -> BodyMesh:
        """Return this mesh.

        Raises
        ------
        ConfigurationError
            An element is turned inside out, or a meridian crosses its axis; the message begins with ``what``.
        """
        if self.revolved and self.points[:, 0].min() < -ON_AXIS * np.ptp(self.points[:, 0]):
            raise ConfigurationError(
                f"{what}: the meridian reaches to x = {self.points[:, 0].min():.4g}, beyond the axis of revolution "
                "x = 0; expected x ≥ 0 everywhere: draw one half of the section through the axis"
            )
        bad = int((self.weights <= 0).any(axis=1).sum())
        if bad:
            raise ConfigurationError(
                f"{what}: {bad} of {len(self.cells)} elements are turned inside out or flat; mesh the body anew, "
                "finer where it is curved"
            )
        return self


def counted_facets(cells: IntArray) -> tuple[IntArray, IntArray]:
    """Return all facets (k, 9, 6 or 3), each once and outward of its first element, and how many have it (k,)."""
    element = ELEMENTS[cells.shape[1]]
    facets = cells[:, element.facets].reshape(-1, element.facets.shape[1])
    corners = np.sort(facets[:, : element.facet_corners], axis=1)
    _, first, count = np.unique(corners, axis=0, return_index=True, return_counts=True)
    order = np.argsort(first)
    return np.asarray(facets[first[order]]), count[order]


def boundary_facets(cells: IntArray) -> IntArray:
    """Facets (k, 9, 6 or 3) that belong to one element only, outward."""
    facets, count = counted_facets(cells)
    return np.asarray(facets[count == 1])


def facet_middles(points: Array, facets: IntArray) -> Array:
    """(k, 3) means of the corners."""
    return np.asarray(points[facets[:, : FACET_CORNERS[facets.shape[1]]]].mean(axis=1))


def box(lines: tuple[Array, Array, Array]) -> BodyMesh:
    """Nodes, elements and points run along x first, then y, then z.

    Parameters
    ----------
    lines
        Edges of the elements along each axis, ascending.
    """
    counts = np.array([len(line) - 1 for line in lines])
    ends = 2 * counts + 1
    fine = [np.interp(np.arange(n), np.arange(0, n, 2), line) for n, line in zip(ends, lines, strict=True)]
    index = lattice(ends)
    points = np.stack([fine[a][index[:, a]] for a in range(3)], axis=1)
    strides = np.array([1, ends[0], ends[0] * ends[1]])
    cells = (2 * lattice(counts)[:, None] + VTK_NODES) @ strides
    facets = boundary_facets(cells)
    middles = facet_middles(points, facets)
    surfaces = {}
    for axis, name in enumerate("xyz"):
        for side, place in (("-", lines[axis][0]), ("+", lines[axis][-1])):
            surfaces[name + side] = facets[middles[:, axis] == place]
    return BodyMesh(points, cells, surfaces)


def graded(length: float, count: int, ratio: float) -> Array:
    """(count + 1,) edges from 0 to ``length`` whose last element is ``ratio`` times as long as the first."""
    if ratio == 1:
        # One multiplication for each, so that the last lies exactly at the length.
        return np.arange(count + 1) / count * length
    steps = np.geomspace(1.0, ratio, count)
    edges = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(edges / edges[-1] * length)


def rectangle(lines: tuple[Array, Array], *, revolved: bool = False, depth: float = 1.0) -> BodyMesh:
    """Biquadratic quadrilaterals in the plane z = 0; nodes, elements and points run along x first, then y.

    Parameters
    ----------
    lines
        Edges of the elements along x and y, ascending.
    revolved, depth
        As of :class:`BodyMesh`; the side on the axis of a body of revolution is no surface.
    """
    counts = np.array([len(line) - 1 for line in lines])
    ends = 2 * counts + 1
    fine = [np.interp(np.arange(n), np.arange(0, n, 2), line) for n, line in zip(ends, lines, strict=True)]
    index = lattice(ends)
    points = np.stack([fine[0][index[:, 0]], fine[1][index[:, 1]], np.zeros(len(index))], axis=1)
    cells = (2 * lattice(counts)[:, None] + QUADRILATERAL_NODES) @ np.array([1, ends[0]])
    facets = boundary_facets(cells)
    middles = facet_middles(points, facets)
    at = {
        name + side: facets[middles[:, axis] == lines[axis][end]]
        for axis, name in enumerate("xy")
        for side, end in (("-", 0), ("+", -1))
    }
    if revolved:
        inner, side = at.pop("x-"), at.pop("x+")
        at |= {"side": side} | ({"inner": inner} if lines[0][0] > 0 else {})
    return BodyMesh(points, cells, at, revolved=revolved, depth=depth)


def sector(
    radius: float, height: float, angle: float, elements: tuple[int, int, int], grading: float
) -> BodyMesh:
    """About the y axis, from the plane z = 0 (angle 0) toward z > 0; a full turn gives the whole cylinder.

    A quarter is a block of squares round the axis and two blocks between it and the mantle; other sectors are
    quarters whose polar angle is stretched, and the whole cylinder is four quarters. The inner block takes as much of
    the radius as makes all elements equally long along it.

    Parameters
    ----------
    radius, height, angle
        The angle in radians, at most π/2, or 2π.
    elements
        Toward the mantle outside the inner block, along y, and around each block.
    grading
        Length of the outermost element over that of the innermost outside the inner block.
    """
    whole = angle > np.pi
    quarters = 4 if whole else 1
    part = np.pi / 2 if whole else angle
    n_r, n_y, n_t = elements
    core = n_t / (n_t + n_r)
    plane = [
        _flat(lambda s, t: _core(core, s, t), n_t, n_t, np.linspace(0, 1, n_t + 1)),
        _flat(lambda s, t: _shell(core, s, t, 0), n_r, n_t, graded(1.0, n_r, grading)),
        _flat(lambda s, t: _shell(core, s, t, 1), n_r, n_t, graded(1.0, n_r, grading)),
    ]
    points: list[Array] = []
    cells: list[IntArray] = []
    for turn in range(quarters):
        for nodes, quads in plane:
            r, polar = np.hypot(*nodes.T), np.arctan2(nodes[:, 1], nodes[:, 0])
            polar = polar * part / (np.pi / 2) + turn * np.pi / 2
            cells.append(quads + sum(len(part) for part in points))
            points.append(radius * np.column_stack([r * np.cos(polar), r * np.sin(polar)]))
    flat, quads = _merged(np.concatenate(points), np.concatenate(cells), radius)
    return _extruded(flat, quads, height, n_y, radius, None if whole else angle)


def _core(share: float, s: Array, t: Array) -> Array:
    """The inner block of the unit quarter: its outer corner is pulled in, so that angles stay moderate."""
    bulge = 1 - 0.12 * s * t
    return share * np.column_stack([s * bulge, t * bulge])


def _shell(share: float, s: Array, t: Array, which: int) -> Array:
    """One of the two blocks from the inner one (s = 0) to the mantle (s = 1); t runs with the polar angle."""
    one = np.ones_like(t)
    inner = _core(share, one, t) if which == 0 else _core(share, 1 - t, one)
    polar = np.pi / 4 * (t + which)
    outer = np.column_stack([np.cos(polar), np.sin(polar)])
    return np.asarray((1 - s[:, None]) * inner + s[:, None] * outer)


def _flat(mapping: Callable[[Array, Array], Array], n: int, m: int, line: Array) -> tuple[Array, IntArray]:
    """Nodes (k, 2) and 9-node quadrilaterals of a mapped square; ``line`` has the edges along s."""
    ends = np.array([2 * n + 1, 2 * m + 1])
    index = lattice(ends)
    s = np.interp(np.arange(ends[0]), np.arange(0, ends[0], 2), line)[index[:, 0]]
    first = 2 * lattice(np.array([n, m]))
    return mapping(s, index[:, 1] / (2 * m)), (first[:, None] + QUADRILATERAL_NODES) @ np.array([1, ends[0]])


def _merged(points: Array, cells: IntArray, scale: float) -> tuple[Array, IntArray]:
    """Nodes at the same place made one; coordinates that round-off keeps from zero set to it."""
    points = np.where(np.abs(points) < 1e-12 * scale, 0.0, points)
    _, first, inverse = np.unique(
        np.rint(points / scale * 1e9).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    return points[first], inverse.reshape(-1)[cells]


def _extruded(
    flat: Array, quads: IntArray, height: float, layers: int, radius: float, angle: float | None
) -> BodyMesh:
    """Along y, quadrilaterals of the plane (x, z) becoming hexahedra."""
    n, levels = len(flat), 2 * layers + 1
    y = np.repeat(np.arange(levels) / (levels - 1) * height, n)
    points = np.column_stack([np.tile(flat[:, 0], levels), y, np.tile(flat[:, 1], levels)])
    # The second axis of an element is y, so that (x, y, z) stays right-handed.
    place = {tuple(node): i for i, node in enumerate(QUADRILATERAL_NODES)}
    in_plane = np.array([place[a, c] for a, _, c in VTK_NODES])
    one = quads[:, in_plane] + n * VTK_NODES[:, 1]
    cells = np.concatenate([one + 2 * n * layer for layer in range(layers)])
    facets = boundary_facets(cells)
    middles, corners = facet_middles(points, facets), points[facets[:, :4]]
    tight = 1e-9 * radius
    mantle = (np.abs(np.hypot(corners[..., 0], corners[..., 2]) - radius) < tight).all(axis=1)
    surfaces = {
        "y-": facets[middles[:, 1] < tight],
        "y+": facets[middles[:, 1] > height - tight],
        "side": facets[mantle],
    }
    if angle is not None:
        quarter = np.isclose(angle, np.pi / 2)
        surfaces["z-"] = facets[(np.abs(corners[..., 2]) < tight).all(axis=1)]
        across = np.abs(corners[..., 0] * np.sin(angle) - corners[..., 2] * np.cos(angle)) < tight
        surfaces["x-" if quarter else "oblique"] = facets[across.all(axis=1)]
    return BodyMesh(points, cells, surfaces)


_OF_A_HEXAHEDRON = np.array(
    [(0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)]
)
#: Tetrahedra that are tried for a place, the nearest first; more of them where none of the first holds it.
NEAREST = (20, 500)
#: So far outside a tetrahedron, as a share of its size, a place counts as within.
SLACK = 1e-6


def tetrahedra(points: Array, cells: IntArray) -> tuple[Array, IntArray]:
    """Return the corners (k, 4, 3) of tetrahedra that make up elements, and the element of each (k,).

    Parameters
    ----------
    points : (nodes, 3)
        Nodes of the mesh.
    cells : (elements, 4 or 8)
        Corners of the elements in VTK order.
    """
    split = _OF_A_HEXAHEDRON if cells.shape[1] == 8 else np.array([(0, 1, 2, 3)])
    corners = np.asarray(points, float)[cells[:, split]].reshape(-1, 4, 3)
    return corners, np.repeat(np.arange(len(cells)), len(split))


def tetrahedron_at(corners: Array, places: Array) -> IntArray:
    """Return the tetrahedron (n,), by its number, in which each place (n, 3) lies, or -1."""
    tree = cKDTree(corners.mean(axis=1))
    inverse = np.linalg.pinv((corners[:, 1:] - corners[:, :1]).swapaxes(1, 2))
    found = np.full(len(places), -1)
    for count in NEAREST:
        left = np.flatnonzero(found < 0)
        if not len(left):
            break
        _, near = tree.query(places[left], k=min(count, len(corners)))
        for column in np.asarray(near).reshape(len(left), -1).T:
            open_ = found[left] < 0
            rows, tried = left[open_], column[open_]
            share = (inverse[tried] @ (places[rows] - corners[tried, 0])[:, :, None])[..., 0]
            inside = (share.min(axis=1) >= -SLACK) & (share.sum(axis=1) <= 1 + SLACK)
            found[rows[inside]] = tried[inside]
    return found


Range = Annotated[tuple[float, float], Dimension("displacement")]


class Patch(StrictModel):
    """The facets of a surface whose middles lie within bounds; they no longer belong to that surface."""

    of: Name
    """The surface that it is a part of."""
    x: Range | None = None
    """[from, to] of the middles of its facets along x."""
    y: Range | None = None
    """[from, to] of the middles of its facets along y."""
    z: Range | None = None
    """[from, to] of the middles of its facets along z."""
    centre: Annotated[tuple[float, float, float] | None, Dimension("displacement")] = None
    """[x, y, z] of the middle of a ball that the middles of its facets lie in."""
    radius: Annotated[float | None, Dimension("displacement")] = None
    """Radius of that ball."""

    @model_validator(mode="after")
    def _bounds(self) -> Patch:
        if (self.centre is None) != (self.radius is None):
            raise ValueError("centre and radius belong together")
        if self.centre is None and not any((self.x, self.y, self.z)):
            raise ValueError("expected bounds: x, y or z: [from, to], or centre and radius")
        return self

    def holds(self, places: Array) -> Array:
        """(n,) bool, which of the places (n, 3) lie within the bounds."""
        inside = np.ones(len(places), dtype=bool)
        for axis, bounds in enumerate((self.x, self.y, self.z)):
            if bounds is not None:
                inside &= (places[:, axis] >= bounds[0]) & (places[:, axis] <= bounds[1])
        if self.centre is not None and self.radius is not None:
            inside &= np.linalg.norm(places - np.array(self.centre), axis=1) <= self.radius
        return inside


def called(mesh: BodyMesh, names: Iterable[str]) -> BodyMesh:
    """Return the mesh whose surfaces are called as by ``names``: by their numbers, where these are among them.

    Raises
    ------
    ConfigurationError
        The number and the name of one surface are among them.
    """
    names = set(names)
    new: dict[str, str] = {}
    for number in sorted(names - mesh.surfaces.keys() - mesh.unusable.keys()):
        if (name := mesh.numbers.get(number)) is None:
            continue
        if name in names:
            raise ConfigurationError(
                f"macro: '{name}' and '{number}' are the name and the number of one surface; call it by one of them "
                "everywhere"
            )
        new[name] = number
    if not new:
        return mesh
    surfaces = {new.get(name, name): facets for name, facets in mesh.surfaces.items()}
    return replace(mesh, surfaces=surfaces, unusable={new.get(k, k): why for k, why in mesh.unusable.items()})


def with_patches(mesh: BodyMesh, patches: Mapping[str, Patch]) -> BodyMesh:
    """The mesh with the patches among its surfaces.

    Raises
    ------
    ConfigurationError
        A patch is of no surface, holds no facet, or has the name of a surface.
    """
    surfaces = dict(mesh.surfaces)
    unusable = {name: why for name, why in mesh.unusable.items() if name not in patches or name in surfaces}
    mesh = replace(mesh, unusable=unusable)
    for name, patch in patches.items():
        key = f"macro.surfaces.{name}"
        if name in surfaces:
            raise ConfigurationError(f"{key}: the body has a surface of this name already; take another name")
        facets = replace(mesh, surfaces=surfaces).surface(patch.of, f"{key}.of")
        inside = patch.holds(facet_middles(mesh.points, facets))
        if not inside.any():
            raise ConfigurationError(
                f"{key}: none of the {len(facets)} facets of '{patch.of}' has its middle within these bounds; widen "
                "them, or mesh the body finer there"
            )
        surfaces[name], surfaces[patch.of] = facets[inside], facets[~inside]
    return replace(mesh, surfaces=surfaces)


@dataclass(frozen=True, eq=False)
class Facets:
    """Facets at their quadrature points.

    Attributes
    ----------
    nodes : (f, m)
        Of the displacement; the first ones are the corners.
    """

    mesh: BodyMesh
    nodes: IntArray

    def tangents_of(self, points: Array) -> Array:
        """(f, q, 3, 2) ∂x/∂ξ where the nodes are at ``points``.

        In two dimensions the second is along z, as long as what the point stands for across the plane there.
        """
        reference = self.mesh.element.facet
        found = np.einsum("fai,qak->fqik", points[self.nodes], reference.gradients, optimize=True)
        if not self.mesh.flat:
            return np.asarray(found)
        across = np.zeros_like(found)
        across[..., 2, 0] = self.mesh.measure(reference.values @ points[self.nodes])
        return np.concatenate([found, across], axis=-1)

    @property
    def tangent_slopes(self) -> tuple[Array, Array]:
        """Derivatives (q, m, 3, 3) of the components of the two tangents by those of the places of the nodes."""
        reference = self.mesh.element.facet
        first, *others = np.einsum("qak,ij->kqaij", reference.gradients, np.eye(3))
        if others:
            return first, others[0]
        around = np.zeros((3, 3))
        around[2, 0] = 2 * np.pi if self.mesh.revolved else 0.0
        return first, np.einsum("qa,ij->qaij", reference.values, around)

    @property
    def normals(self) -> Array:
        """(f, q, 3) outward, of the length of the area that a point stands for on the unit facet."""
        t = self.tangents_of(self.mesh.points)
        return np.cross(t[..., 0], t[..., 1])

    @property
    def directions(self) -> Array:
        """(f, q, 3) outward normals of length one."""
        t = self.tangents_of(self.mesh.points)
        n = np.cross(t[..., 0], np.array([0.0, 0.0, 1.0]) if self.mesh.flat else t[..., 1])
        return np.asarray(n / np.linalg.norm(n, axis=-1, keepdims=True))

    @property
    def areas(self) -> Array:
        """(f, q) area of each quadrature point."""
        return np.asarray(np.linalg.norm(self.normals, axis=-1) * self.mesh.element.facet.weights)

    @property
    def elements(self) -> IntArray:
        """(f,) number of the element that each belongs to."""
        mesh, corners = self.mesh, self.mesh.element.facet_corners
        nodes = np.sort(self.nodes[:, :corners], axis=1)
        near = np.flatnonzero(np.isin(mesh.cells[:, : mesh.element.corners], nodes).any(axis=1))
        theirs = np.sort(mesh.cells[near][:, mesh.element.facets[:, :corners]], axis=2)
        owner = {tuple(key): int(e) for e, faces in zip(near, theirs.tolist(), strict=True) for key in faces}
        return np.array([owner[tuple(key)] for key in nodes.tolist()], dtype=np.int64)

    def shares(self, of: Array) -> Array:
        """(nodes,) ∫ N dS of shape functions with values ``of`` (q, k) at the points, for the first k nodes."""
        k = of.shape[1]
        local = self.areas @ of
        return np.bincount(self.nodes[:, :k].ravel(), local.ravel(), len(self.mesh.points)).astype(float)

    def plane(self, key: str) -> Array:
        """(3,) the one outward normal of plane facets.

        Raises
        ------
        ConfigurationError
            They are not plane; the message begins with ``key``.
        """
        n = self.directions.reshape(-1, 3)
        if np.abs(n - n[0]).max() > 1e-6:
            raise ConfigurationError(
                f"{key}: this surface is not plane; prescribe components of the displacement"
            )
        n = np.where(np.abs(n[0]) < 1e-12, 0.0, n[0])
        return np.asarray(n / np.linalg.norm(n))
