"""Displacement of the fluid's mesh: that of the solid on the pore wall, extended harmonically.

Inside the pore any extension that folds no element gives the same flow. The corners of the fluid's elements follow a
harmonic field with a larger stiffness in smaller elements, mid-edge nodes lie halfway between them, and on the wall
every node follows the solid.

Solid and fluid are meshed separately, so the nodes of their walls differ, and between its nodes each wall is its own
polynomial. A wall node of the fluid is therefore located in the elements of the solid along the wall: in the element
whose coordinates contain it, or nearly do. The displacement extrapolated there is as accurate as the walls are close,
and exact where it is affine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.tetrahedra import EDGES, FACETS, rows_of, shape_functions, straightened
from porocore.errors import ConfigurationError
from porocore.states import Array, BoolArray, IntArray

#: Number of nearest elements along the wall that are tried for each node.
CANDIDATES = 12
ITERATIONS = 20
ACCURACY = 1e-12
#: Largest distance of a node outside its element, in element coordinates; farther off the walls do not coincide.
FARTHEST = 0.5
#: Tolerance of that distance within which elements are equally good.
ALIKE = 1e-8


@dataclass(frozen=True, eq=False)
class WallInterpolation:
    """Interpolation of the solid's displacement to the wall nodes of the fluid, with every periodic image.

    Attributes
    ----------
    nodes : (k,)
        Wall nodes of the fluid.
    matrix : (k, nodes of the solid)
        Values there from the solid's nodal values; periodic images have the same row.
    row : (k,), first : (c,)
        Number of the periodic class of each node, and one node of each class.
    rows, elements, shifts, local, shares : (l,), (l,), (l, 3), (l, 3), (l,)
        Class that is located, element of the solid, period from that to the class, coordinates in it, and weight;
        equally good elements share a class.
    """

    nodes: IntArray
    matrix: csr_matrix
    row: IntArray
    first: IntArray
    rows: IntArray
    elements: IntArray
    shifts: Array
    local: Array
    shares: Array

    def slope(
        self, solid: CellMesh, u: Array, u_slope: Array, solid_velocity: Array, fluid_velocity: Array
    ) -> Array:
        """Return the slope (k, 3) of the interpolated u where both meshes move, each with its own nodal velocity.

        A wall node of the fluid moves within the element of the solid where the velocities differ.
        """
        cells = solid.cells[self.elements]
        N, dN = shape_functions(self.local, cells.shape[1])

        def at_points(values: Array) -> Array:
            return np.asarray(np.einsum("la,lai->li", N, values[cells]))

        jacobian = np.einsum("lai,laj->lij", solid.points[cells], dN)
        beside = fluid_velocity[self.first][self.rows] - at_points(solid_velocity)
        moved = np.linalg.solve(jacobian, beside[:, :, None])
        found = at_points(u_slope) + (np.einsum("lai,laj->lij", u[cells], dN) @ moved)[:, :, 0]
        out = np.zeros((len(self.first), 3))
        np.add.at(out, self.rows, self.shares[:, None] * found)
        return np.asarray(out[self.row])


def wall_interpolation(
    solid: CellMesh, fluid: CellMesh, base: tuple[CellMesh, CellMesh] | None = None
) -> WallInterpolation:
    """Return the interpolation to the wall nodes of the fluid.

    Parameters
    ----------
    solid, fluid
        Meshes of one domain.
    base
        Meshes of solid and fluid of which these are moved ones: every node keeps the elements of the base.

    Raises
    ------
    ConfigurationError
        The walls do not coincide.
    """
    if base is None:
        return _located(solid, fluid)
    found = _located_in_base(*base)
    places = fluid.points[found.first][found.rows] - found.shifts
    local, _ = _inverted(solid.points[solid.cells[found.elements]], places, found.local)
    moved = replace(found, local=local)
    return replace(moved, matrix=_matrix(solid, moved.rows, moved.elements, local, moved.shares)[found.row])


def _located(solid: CellMesh, fluid: CellMesh) -> WallInterpolation:
    images = fluid.periodic_class
    walled = np.unique(fluid.wall)
    classes, first = np.unique(images[walled], return_index=True)
    found = _looked_up(solid, fluid.points[walled[first]])
    rows, elements, _, local, shares = found
    matrix = _matrix(solid, rows, elements, local, shares)
    nodes = np.flatnonzero(np.isin(images, classes))
    row = np.searchsorted(classes, images[nodes])
    return WallInterpolation(nodes, matrix[row], row, walled[first], *found)


#: Locations in the last bases, which all members of a family share.
_located_in_base = lru_cache(maxsize=4)(_located)


def _matrix(solid: CellMesh, rows: IntArray, elements: IntArray, local: Array, shares: Array) -> csr_matrix:
    """Return the matrix (classes, nodes of the solid) of the interpolation."""
    values, _ = shape_functions(local, solid.cells.shape[1])
    entries = (shares[:, None] * values).ravel()
    places = np.repeat(rows, values.shape[1]), solid.cells[elements].ravel()
    return csr_matrix((entries, places), (int(rows.max(initial=-1)) + 1, len(solid.points)))


def _looked_up(solid: CellMesh, points: Array) -> tuple[IntArray, IntArray, Array, Array, Array]:
    """Locate points (k, 3): return m numbers of points, elements, shifts and coordinates (m, 3) in them, and weights.

    Equally good elements of a point, such as an element and its mirror image, share it, which preserves symmetry.
    """
    owners = _wall_elements(solid)
    centres = solid.points[solid.wall[:, :3]].mean(axis=1)
    shifts = np.zeros((1, 3))
    if solid.domain == "whole":
        shifts = np.array(list(product((0.0, 1.0, -1.0), repeat=3))) * solid.spans
    tiled = (shifts[:, None] + centres).reshape(-1, 3)
    _, near = cKDTree(tiled).query(points, k=min(CANDIDATES, len(tiled)))
    near = near.reshape(len(points), -1)
    elements = owners[near % len(centres)]
    places = (points[:, None] - shifts[near // len(centres)]).reshape(-1, 3)
    local, found = _inverted(solid.points[solid.cells[elements.ravel()]], places)
    outside = np.where(found, np.maximum(-local.min(axis=1), local.sum(axis=1) - 1), np.inf)
    outside = outside.reshape(elements.shape)
    least = outside.min(axis=1)
    if not (least < FARTHEST).all():
        raise ConfigurationError(
            "cell.mesh: 'conductivity: deformed' needs the same pore wall in the meshes of solid and fluid, but the "
            "two walls differ; give 'size' and 'fluid_size' the same value, or lower the larger one"
        )
    alike = outside <= (least + ALIKE)[:, None]
    rows = np.nonzero(alike)[0]
    shifts = shifts[near // len(centres)][alike]
    shares = 1 / alike.sum(axis=1)[rows]
    return rows, elements[alike], shifts, local.reshape(*elements.shape, 3)[alike], shares


def _wall_elements(solid: CellMesh) -> IntArray:
    """Return the element of each facet of the wall."""
    facets = np.sort(solid.cells[:, FACETS[:, :3]].reshape(-1, 3), axis=1)
    wall = np.sort(solid.wall[:, :3], axis=1)
    return rows_of(facets, wall) // 4


def _inverted(corners: Array, places: Array, start: Array | None = None) -> tuple[Array, Array]:
    """Return the coordinates (k, 3) of places (k, 3), each in its own element (k, a, 3), and which ones were found."""
    local = np.full((len(places), 3), 0.25) if start is None else start
    for _ in range(ITERATIONS):
        N, dN = shape_functions(local, corners.shape[1])
        error = np.einsum("ka,kai->ki", N, corners) - places
        if np.abs(error).max(initial=0.0) < ACCURACY:
            break
        jacobian = np.einsum("kai,kaj->kij", corners, dN)
        step = np.linalg.solve(jacobian + 1e-300 * np.eye(3), error[:, :, None])[:, :, 0]
        # A point far from an element may have no coordinates in it; another element contains it.
        local = np.clip(local - step, -3.0, 4.0)
    N, _ = shape_functions(local, corners.shape[1])
    error = np.einsum("ka,kai->ki", N, corners) - places
    return local, np.abs(error).max(axis=1) < 1e3 * ACCURACY


#: Eighths of a quadratic tetrahedron. Those inside share the diagonal that mirror images of an element share.
EIGHTHS = np.array([
    [0, 4, 6, 7], [1, 5, 4, 8], [2, 6, 5, 9], [3, 7, 8, 9],
    [4, 9, 5, 6], [4, 9, 6, 7], [4, 9, 7, 8], [4, 9, 8, 5],
])  # fmt: skip


class BoundaryExtension:
    """Harmonic extension of displacements of some nodes to all nodes of a mesh; set up once, a linear map.

    The corners of the elements follow the field. Mid-edge nodes that are not given lie halfway between them, or follow
    the field too, which is then linear on eighths of the elements.

    Parameters
    ----------
    mesh
        Mesh of one phase.
    nodes : (k,)
        Nodes whose displacement is given, with every periodic image; images have the same displacement.
    held : (nodes, 3)
        True for components that are 0.
    curved
        True if mid-edge nodes follow the field.
    """

    def __init__(self, mesh: CellMesh, nodes: IntArray, held: BoolArray, *, curved: bool = False) -> None:
        self._nodes = nodes
        images, points, cells = mesh.periodic_class, mesh.points, mesh.cells[:, :4]
        if curved:
            points, cells = straightened(points, mesh.cells), mesh.cells[:, EIGHTHS].reshape(-1, 4)
        corners, first = np.unique(images[cells], return_index=True)
        self._count = len(corners)
        number = np.full(int(images.max()) + 1, -1)
        number[corners] = np.arange(len(corners))
        self._corner_of: IntArray = number[images]
        node_of: IntArray = cells.ravel()[first]
        given = np.zeros(len(corners), dtype=bool)
        given[self._corner_of[nodes][self._corner_of[nodes] >= 0]] = True
        matrix = _stiffness(points[cells], self._corner_of[cells], len(corners))
        self._solves = [_solver(matrix, given | held[node_of, i]) for i in range(3)]
        self._ends = np.tile(np.arange(len(mesh.points)), (2, 1)) if curved else ends_of_edges(mesh)

    def __call__(self, values: Array) -> Array:
        """Return the displacement (nodes, 3) of all nodes from that of the given ones (k, 3)."""
        corners = np.zeros((self._count, 3))
        corner = self._corner_of[self._nodes]
        corners[corner[corner >= 0]] = values[corner >= 0]
        corners = np.stack([solve(corners[:, i]) for i, solve in enumerate(self._solves)], axis=1)
        ends = corners[self._corner_of[self._ends]]
        moved: Array = ends.mean(axis=0)
        moved[self._nodes] = values
        return moved


class HarmonicExtension:
    """Harmonic extension of u¹ from the solid to the nodes of the fluid; set up once, applied by back substitution.

    Both meshes are of the same domain; the elements of the fluid are quadratic. Where both were moved from those of a
    ``base``, the field is harmonic there and the walls belong together as there; so it depends smoothly on the motion.

    Raises
    ------
    ConfigurationError
        The walls of the two meshes do not coincide.
    """

    def __init__(
        self, solid: CellMesh, fluid: CellMesh, base: tuple[CellMesh, CellMesh] | None = None
    ) -> None:
        self._solid, self._interpolation = solid, wall_interpolation(solid, fluid, base)
        fluid = self.fluid = fluid if base is None else base[1]
        nodes = self._interpolation.nodes
        held = fluid.on_mirrors if fluid.domain == "eighth" else np.zeros(fluid.points.shape, dtype=bool)
        self._held = held[nodes]
        self._extend = BoundaryExtension(fluid, nodes, held)

    def __call__(self, u: Array) -> Array:
        """Return u¹ (nodes, 3) of the fluid from that of the solid (nodes, 3)."""
        return self._extended(self._interpolation.matrix @ u)

    def slope(self, u: Array, u_slope: Array, solid_velocity: Array, fluid_velocity: Array) -> Array:
        """Return the slope (nodes, 3) of u¹ of the fluid where both meshes move and u¹ changes by ``u_slope``.

        Parameters
        ----------
        u, u_slope : (nodes of the solid, 3)
            u¹ of the solid, and its slope at the moving nodes.
        solid_velocity, fluid_velocity : (nodes, 3)
            Slopes of the places of the nodes of each mesh.
        """
        on_wall = self._interpolation.slope(self._solid, u, u_slope, solid_velocity, fluid_velocity)
        return self._extended(on_wall)

    def _extended(self, on_wall: Array) -> Array:
        on_wall[self._held] = 0.0
        return self._extend(on_wall)


def ends_of_edges(mesh: CellMesh) -> IntArray:
    """Return the ends (2, nodes) of the edge of each mid-edge node; a corner is both of its ends."""
    ends = np.tile(np.arange(len(mesh.points)), (2, 1))
    for place, (a, b) in enumerate(EDGES if mesh.order == 2 else (), start=4):
        ends[:, mesh.cells[:, place]] = mesh.cells[:, [a, b]].T
    return ends


def _solver(matrix: csc_matrix, held: BoolArray) -> Callable[[Array], Array]:
    """Return the map of one component at the corners held to that at all corners."""
    free, known = np.flatnonzero(~held), np.flatnonzero(held)
    if not len(free):
        return lambda values: values
    rows = matrix[free].tocsc()
    factor, coupling = splu(rows[:, free].tocsc(), permc_spec="MMD_AT_PLUS_A"), rows[:, known]

    def solve(values: Array) -> Array:
        out = values.copy()
        out[free] = -factor.solve(coupling @ values[known])
        return out

    return solve


def _stiffness(places: Array, corners: IntArray, count: int) -> csc_matrix:
    """Return the stiffness of linear elements at places (m, 4, 3), each weighted by the inverse of its volume."""
    edges = places[:, 1:] - places[:, :1]
    inverse = np.linalg.inv(edges)  # columns: gradients of the last three shape functions
    gradients = np.concatenate([-inverse.sum(axis=2, keepdims=True), inverse], axis=2)
    blocks = gradients.swapaxes(1, 2) @ gradients
    rows, columns = np.repeat(corners, 4, axis=1), np.tile(corners, (1, 4))
    return coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), (count, count)).tocsc()
