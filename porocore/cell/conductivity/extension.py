"""Harmonic extension of the solid's displacement into the pore, so that the fluid's mesh follows.

Inside the pore any extension that folds no element gives the same flow. The corners of the fluid's elements follow a
harmonic field with a larger stiffness in smaller elements, mid-edge nodes lie halfway between them, and on the wall
every node follows the solid.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import splu

from porocore.cell.conductivity.wall_displacement import wall_interpolation
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.shape_functions import EDGES
from porocore.states import Array, IntArray

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

    def __init__(
        self, mesh: CellMesh, nodes: IntArray, held: npt.NDArray[np.bool_], *, curved: bool = False
    ) -> None:
        self._nodes = nodes
        images, points, cells = mesh.periodic_class, mesh.points, mesh.cells[:, :4]
        if curved:
            points, cells = points.copy(), mesh.cells[:, EIGHTHS].reshape(-1, 4)
            points[mesh.cells[:, 4:]] = points[mesh.cells[:, EDGES]].mean(axis=2)
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


def _solver(matrix: csc_matrix, held: npt.NDArray[np.bool_]) -> Callable[[Array], Array]:
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
