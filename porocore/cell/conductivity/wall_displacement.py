"""Interpolation of the solid's displacement to the fluid's nodes on the pore wall.

Solid and fluid are meshed separately, so the nodes of their walls differ, and between its nodes each wall is its own
polynomial. A wall node of the fluid is therefore located in the elements of the solid along the wall: in the element
whose coordinates contain it, or nearly do. The displacement extrapolated there is as accurate as the walls are close,
and exact where it is affine.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.shape_functions import FACETS, shape_functions
from porocore.errors import ConfigurationError
from porocore.states import Array, IntArray

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
    _, inverse = np.unique(np.concatenate([facets, wall]), axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    owner = np.zeros(int(inverse.max(initial=-1)) + 1, dtype=np.int64)
    owner[inverse[: len(facets)]] = np.arange(len(facets)) // 4
    return np.asarray(owner[inverse[len(facets) :]])


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
