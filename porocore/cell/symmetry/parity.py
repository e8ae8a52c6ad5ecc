"""Parity classes of fields on the eighth, and the components that they hold on mirror planes and wall.

A perturbation by H_ij is even or odd under the mirror of each axis. On the planes of an axis an odd field has a normal
component only, an even field has tangential components only.

A perturbation with wave vector components k_a ∈ {0, π} may have one parity at X_a = 0 and another at half
of the cell's side, X_a = ½ in a cube. The product of both mirrors is the translation by one cell, so equal parities
mean period one, k_a = 0, and different ones period two, k_a = π. A class of perturbations is named by the axes under
whose mirrors it is odd: "xy" at both planes of x and of y, "xy|xz" at X = 0 and Y = 0, and at X = ½ and Z = ½. The 64
classes contain every perturbation of the eight wave vectors; the eight classes without a bar have period one.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np
import numpy.typing as npt

from porocore.cell.meshing.mesh import CellMesh
from porocore.states import Array

#: Loads of each class of period one, out of the ten loads θ = (H row by row, p). The last four classes have no loads.
CLASSES: dict[str, tuple[int, ...]] = {
    "": (0, 4, 8, 9),
    "xy": (1, 3),
    "xz": (2, 6),
    "yz": (5, 7),
    "x": (),
    "y": (),
    "z": (),
    "xyz": (),
}
#: δH (3, 3) of a unit change of each of the ten loads, 0 for p.
UNIT_LOADS: Array = np.eye(10)[:, :9].reshape(10, 3, 3)


def classes(mesh: CellMesh) -> dict[str, tuple[int, ...]]:
    """Return the loads of each class of period one; the whole cell has one class."""
    return CLASSES if mesh.domain == "eighth" else {"": tuple(range(10))}


def odd_axes(parity: str, plane: int) -> str:
    """Return the axes under whose mirrors a class is odd, at X_a = 0 for ``plane`` 0 and at X_a = ½ for 1."""
    first, bar, second = parity.partition("|")
    return second if bar and plane else first


@lru_cache(maxsize=1)
def bloch_classes() -> dict[str, tuple[str, ...]]:
    """Return the eight classes of each wave vector, "000" to "111"; "110" is k = (π, π, 0)."""
    found: dict[str, tuple[str, ...]] = {}
    for wave in product((0, 1), repeat=3):
        names = []
        for signs in product((0, 1), repeat=3):
            first = "".join(a for a, odd in zip("xyz", signs, strict=True) if odd)
            second = "".join(a for a, odd, k in zip("xyz", signs, wave, strict=True) if odd != k)
            names.append(first if first == second else f"{first}|{second}")
        found["".join(map(str, wave))] = tuple(names)
    return found


def translation(parity: str) -> int | None:
    """Return the axis of the rigid translation in a class, the one under whose mirrors alone it is odd, or None."""
    return "xyz".index(parity) if parity in ("x", "y", "z") else None


def held_displacements(mesh: CellMesh, parity: str = "") -> npt.NDArray[np.bool_]:
    """Return the components of u¹ that vanish, (nodes, 3), for the fields of a class.

    A rigid translation does not change the energy. It is excluded by holding one node, with its periodic images, on the
    whole cell, and one component of one node in a class of the eighth that contains it. So the inertia lacks the zero
    eigenvalue of the translation only.
    """
    held = np.zeros((len(mesh.points), 3), dtype=bool)
    if mesh.domain == "whole":
        held[mesh.periodic_class == 0] = True
        return held
    for plane, position in enumerate((mesh.low, mesh.high)):
        axes = odd_axes(parity, plane)
        for axis in range(3):
            there = mesh.points[:, axis] == position[axis]
            for i in range(3):
                if (i != axis) == ("xyz"[axis] in axes):
                    held[there, i] = True
    along = translation(parity)
    if along is not None:
        held[0, along] = True
    return held


def held_velocities(mesh: CellMesh, j: int) -> npt.NDArray[np.bool_]:
    """Return the components of w^j that vanish, (nodes, 3), on the wall and by symmetry on the mirror planes.

    The flow under e_j is odd under the mirror of j and even under the others.
    """
    held = np.zeros((len(mesh.points), 3), dtype=bool)
    # The wall's facets at a node may belong to a periodic image of it.
    on_wall = np.zeros(int(mesh.periodic_class.max(initial=-1)) + 1, dtype=bool)
    on_wall[mesh.periodic_class[mesh.wall]] = True
    held[on_wall[mesh.periodic_class]] = True
    if mesh.domain == "eighth":
        on_plane = mesh.on_mirrors
        for i in {0, 1, 2} - {j}:
            held[on_plane[:, i] | on_plane[:, j], i] = True
    return held


def held_pressures(mesh: CellMesh, j: int) -> npt.NDArray[np.bool_]:
    """Return the nodes where the pressure p̃^j vanishes because it is odd under the mirror of j, (nodes,)."""
    if mesh.domain == "whole":
        return np.zeros(len(mesh.points), dtype=bool)
    return mesh.on_mirrors[:, j]


def visible(mesh: CellMesh, parity: str = "") -> Array:
    """Return 1 for the components (3, 3) of a mean gradient that do not cancel between images of the domain, else 0."""
    if mesh.domain == "whole":
        return np.ones((3, 3))
    if not parity:
        return np.eye(3)
    i, j = ("xyz".index(axis) for axis in parity)
    mask = np.zeros((3, 3))
    mask[i, j] = mask[j, i] = 1.0
    return mask
