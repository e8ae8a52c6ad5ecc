"""Interpolation of the solid's displacement to the fluid's nodes on the pore wall.

Solid and fluid are meshed separately, so the nodes of their walls differ, and between its nodes each wall is its own
polynomial. A wall node of the fluid is therefore located in the elements of the solid along the wall: in the element
whose coordinates contain it, or nearly do. The displacement extrapolated there is as accurate as the walls are close,
and exact where it is affine.
"""

from __future__ import annotations

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


def wall_interpolation(solid: CellMesh, fluid: CellMesh) -> tuple[IntArray, csr_matrix]:
    """Return the wall nodes of the fluid, with every periodic image, and the matrix from the solid's nodal values.

    Returns
    -------
    nodes : (k,)
        Wall nodes of the fluid.
    matrix : (k, nodes of the solid)
        Periodic images have the same row.

    Raises
    ------
    ConfigurationError
        The walls do not coincide.
    """
    images = fluid.periodic_class
    walled = np.unique(fluid.wall)
    classes, first = np.unique(images[walled], return_index=True)
    rows, elements, local, shares = _looked_up(solid, fluid.points[walled[first]])
    values, _ = shape_functions(local, solid.cells.shape[1])
    entries = (shares[:, None] * values).ravel()
    places = np.repeat(rows, values.shape[1]), solid.cells[elements].ravel()
    matrix = csr_matrix((entries, places), (len(classes), len(solid.points)))
    nodes = np.flatnonzero(np.isin(images, classes))
    return nodes, matrix[np.searchsorted(classes, images[nodes])]


def _looked_up(solid: CellMesh, points: Array) -> tuple[IntArray, IntArray, Array, Array]:
    """Locate points (k, 3): return m numbers of points, their elements, coordinates (m, 3) in them, and weights.

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
    return rows, elements[alike], local.reshape(*elements.shape, 3)[alike], 1 / alike.sum(axis=1)[rows]


def _wall_elements(solid: CellMesh) -> IntArray:
    """Return the element of each facet of the wall."""
    facets = np.sort(solid.cells[:, FACETS[:, :3]].reshape(-1, 3), axis=1)
    wall = np.sort(solid.wall[:, :3], axis=1)
    _, inverse = np.unique(np.concatenate([facets, wall]), axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    owner = np.zeros(int(inverse.max(initial=-1)) + 1, dtype=np.int64)
    owner[inverse[: len(facets)]] = np.arange(len(facets)) // 4
    return np.asarray(owner[inverse[len(facets) :]])


def _inverted(corners: Array, places: Array) -> tuple[Array, Array]:
    """Return the coordinates (k, 3) of places (k, 3), each in its own element (k, a, 3), and which ones were found."""
    local = np.full((len(places), 3), 0.25)
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
