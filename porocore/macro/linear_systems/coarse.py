"""Linear displacements on a body's elements, prolongation, rigid motions: the coarse level of multigrid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse

from porocore.macro.body.mesh import BodyMesh
from porocore.macro.boundary.conditions import BoundaryData
from porocore.states import Array


@dataclass(frozen=True, eq=False)
class LinearLevel:
    """Linear displacements of a body under its supports, three unknowns at each corner of the elements.

    Attributes
    ----------
    prolongation : (displacements, 3 · corners)
        Sparse, from these unknowns to those of the mesh; nodes with a frame of their own have it on both levels. A row
        is zero where a displacement is prescribed.
    active : (3 · corners,) bool
        False for those that take no part: columns of zeros.
    modes : (3 · corners, 6)
        Rigid motions, zero where inactive.
    """

    prolongation: sparse.csr_matrix
    active: npt.NDArray[np.bool_]
    modes: Array


def linear_level(mesh: BodyMesh, boundary: BoundaryData) -> LinearLevel:
    """Return the linear displacements of a body; those of a plate are one unknown, the first of its corners."""
    corners = (3 * mesh.p_nodes[:, None] + np.arange(3)).ravel()
    level = linear_prolongation(mesh)
    modes = rigid_modes(mesh.points[mesh.p_nodes])
    if boundary.rotation is not None:
        turn = boundary.rotation[: mesh.n_u, : mesh.n_u].tocsr()
        at_corners = turn[corners][:, corners]
        level, modes = turn @ level @ at_corners.T, at_corners @ modes
    is_free = np.ones(mesh.n_u, bool)
    is_free[boundary.prescribed[boundary.prescribed < mesh.n_u]] = False
    leader, active = np.arange(len(corners)), is_free[corners]
    for plate in boundary.plates:
        of_plate = np.flatnonzero(np.isin(corners, plate))
        leader[of_plate], active[of_plate[1:]] = of_plate[0], False
        modes[of_plate[0]] = modes[of_plate].mean(axis=0)
    kept = is_free[corners].astype(float)
    collapse = sparse.csr_matrix((kept, (np.arange(len(corners)), leader)), shape=(len(corners),) * 2)
    level = (sparse.diags(is_free.astype(float)) @ level @ collapse).tocsr()
    level.data[np.abs(level.data) < 1e-14] = 0.0
    level.eliminate_zeros()
    level.sort_indices()
    modes[~active] = 0.0
    return LinearLevel(level, active, modes)


def linear_prolongation(mesh: BodyMesh) -> sparse.csr_matrix:
    """Return the values (displacements, 3 · corners) at all nodes of the linear shape functions, Cartesian."""
    element, per_cell = mesh.element, mesh.cells.shape[1]
    _, first = np.unique(mesh.cells.ravel(), return_index=True)
    values = element.corner_values(element.nodes)[first % per_cell]
    columns = mesh.p_cells[first // per_cell]
    starts = np.arange(len(first) + 1) * element.corners
    shape = (len(mesh.points), len(mesh.p_nodes))
    scalar = sparse.csr_matrix((values.ravel(), columns.ravel(), starts), shape=shape)
    scalar.eliminate_zeros()
    return sparse.kron(scalar, sparse.identity(3), format="csr")


def rigid_modes(points: Array) -> Array:
    """Return the three translations and three rotations (3 n, 6) of ``points`` (n, 3), in units of their size."""
    x = points - points.mean(axis=0)
    x = x / max(float(np.abs(x).max()), np.finfo(float).tiny)
    modes = np.zeros((len(points), 3, 6))
    modes[:, :, :3] = np.eye(3)
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        modes[:, j, 3 + k], modes[:, i, 3 + k] = x[:, i], -x[:, j]
    return modes.reshape(-1, 6)
