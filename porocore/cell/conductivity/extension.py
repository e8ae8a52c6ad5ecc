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
        self._wall = self._interpolation.nodes
        fluid = self.fluid = fluid if base is None else base[1]
        images = fluid.periodic_class
        self._corners, first = np.unique(images[fluid.cells[:, :4]], return_index=True)
        number = np.full(int(images.max()) + 1, -1)
        number[self._corners] = np.arange(len(self._corners))
        self._corner_of: IntArray = number[images]
        self._node_of: IntArray = fluid.cells[:, :4].ravel()[first]
        on_wall = np.zeros(len(self._corners), dtype=bool)
        on_wall[self._corner_of[self._wall][self._corner_of[self._wall] >= 0]] = True
        matrix = _stiffness(fluid, self._corner_of[fluid.cells[:, :4]], len(self._corners))
        self._solves = [self._solver(matrix, on_wall, i) for i in range(3)]
        #: Ends of the edge of each mid-edge node; a corner is both of its ends.
        self._ends = np.tile(np.arange(len(fluid.points)), (2, 1))
        for place, (a, b) in enumerate(EDGES, start=4):
            self._ends[:, fluid.cells[:, place]] = fluid.cells[:, [a, b]].T

    def _solver(self, matrix: csc_matrix, on_wall: npt.NDArray[np.bool_], i: int) -> Callable[[Array], Array]:
        """Return the map of u_i on the wall to u_i at all corners, with 0 on the mirror planes of axis i."""
        held = on_wall.copy()
        if self.fluid.domain == "eighth":
            held |= self.fluid.on_mirrors[self._node_of, i]
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
        fluid = self.fluid
        if fluid.domain == "eighth":
            on_wall[fluid.on_mirrors[self._wall]] = 0.0
        corners = np.zeros((len(self._corners), 3))
        corner = self._corner_of[self._wall]
        corners[corner[corner >= 0]] = on_wall[corner >= 0]
        corners = np.stack([solve(corners[:, i]) for i, solve in enumerate(self._solves)], axis=1)
        ends = corners[self._corner_of[self._ends]]
        moved: Array = ends.mean(axis=0)
        moved[self._wall] = on_wall
        return moved


def _stiffness(fluid: CellMesh, corners: IntArray, count: int) -> csc_matrix:
    """Return the stiffness matrix of linear elements, each weighted by the inverse of its volume."""
    edges = fluid.points[fluid.cells[:, 1:4]] - fluid.points[fluid.cells[:, :1]]
    inverse = np.linalg.inv(edges)  # columns: gradients of the last three shape functions
    gradients = np.concatenate([-inverse.sum(axis=2, keepdims=True), inverse], axis=2)
    blocks = gradients.swapaxes(1, 2) @ gradients
    rows, columns = np.repeat(corners, 4, axis=1), np.tile(corners, (1, 4))
    return coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), (count, count)).tocsc()
