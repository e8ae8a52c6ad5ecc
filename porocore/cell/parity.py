"""What the mirror planes of the eighth of a cell prescribe, and how the whole cell is held.

A perturbation by H_ij is even or odd under the mirror of each axis; a field that is odd under the mirror of an
axis keeps the normal component on its planes and loses the tangential ones, an even one the other way round.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from porocore.cell.mesh import CellMesh
from porocore.states import Array

#: Of the ten loads θ = (H row by row, p): the classes that the mirror planes of the eighth sort them into.
CLASSES = {"": (0, 4, 8, 9), "xy": (1, 3), "xz": (2, 6), "yz": (5, 7)}


def classes(mesh: CellMesh) -> dict[str, tuple[int, ...]]:
    """Loads of each class; the whole cell needs only one."""
    return CLASSES if mesh.domain == "eighth" else {"": tuple(range(10))}


def held_displacements(mesh: CellMesh, odd: str = "") -> npt.NDArray[np.bool_]:
    """Components of u¹ that vanish, (nodes, 3), for fields that are odd under the mirrors of the named axes.

    On the whole cell one node, with its periodic images, is held: a translation changes nothing.
    """
    held = np.zeros((len(mesh.points), 3), dtype=bool)
    if mesh.domain == "whole":
        held[mesh.periodic_class == 0] = True
        return held
    on_plane = _on_plane(mesh)
    for axis in range(3):
        for i in range(3):
            if (i != axis) == ("xyz"[axis] in odd):
                held[on_plane[:, axis], i] = True
    return held


def held_velocities(mesh: CellMesh, j: int) -> npt.NDArray[np.bool_]:
    """Components of w^j that vanish, (nodes, 3): on the wall, and on the planes where symmetry asks for it.

    The flow under e_j is odd under the mirror of j and even under the others.
    """
    held = np.zeros((len(mesh.points), 3), dtype=bool)
    held[mesh.wall.ravel()] = True
    if mesh.domain == "eighth":
        on_plane = _on_plane(mesh)
        for i in range(3):
            if i != j:
                held[on_plane[:, i] | on_plane[:, j], i] = True
    return held


def held_pressures(mesh: CellMesh, j: int) -> npt.NDArray[np.bool_]:
    """Nodes where the pressure p̃^j vanishes because it is odd under the mirror of j, (nodes,)."""
    if mesh.domain == "whole":
        return np.zeros(len(mesh.points), dtype=bool)
    return _on_plane(mesh)[:, j]


def visible(mesh: CellMesh, odd: str = "") -> Array:
    """1 for the components of a mean gradient (3, 3) that do not cancel between the images of the domain, else 0."""
    if mesh.domain == "whole":
        return np.ones((3, 3))
    if not odd:
        return np.eye(3)
    i, j = ("xyz".index(axis) for axis in odd)
    mask = np.zeros((3, 3))
    mask[i, j] = mask[j, i] = 1.0
    return mask


def _on_plane(mesh: CellMesh) -> npt.NDArray[np.bool_]:
    on_plane: npt.NDArray[np.bool_] = (mesh.points == 0.0) | (mesh.points == 0.5)
    return on_plane
