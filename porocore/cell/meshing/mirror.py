"""Unfolding of a mesh by reflections: wedge, eighth, whole cell; points set onto planes; displacements.

The images share their nodes on the mirror planes exactly, so the whole cell has matching opposite faces, and that of a
wedge has the full symmetry of the cube.
"""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import numpy.typing as npt

from porocore.cell.geometry.sides import CUBE, Sides
from porocore.states import Array

#: Nodes of a tetrahedron (VTK order, 4 or 10) after swapping its first two corners, which restores the orientation.
SWAPPED = np.array([1, 0, 2, 3, 4, 6, 5, 8, 7, 9])


def wedge_to_eighth(points: Array, cells: npt.NDArray[np.int64]) -> tuple[Array, npt.NDArray[np.int64]]:
    """Return the mesh of [0, ½]³ from that of 0 ≤ x ≤ y ≤ z ≤ ½, by the six permutations of the coordinates."""
    points = snap(points)
    for i, j in ((0, 1), (1, 2)):
        on_plane = np.abs(points[:, i] - points[:, j]) < 1e-9
        points[on_plane, i] = points[on_plane, j]
    orders = [list(order) for order in permutations(range(3))]
    return _merge([(points[:, order], bool(np.linalg.det(np.eye(3)[order]) < 0)) for order in orders], cells)


def eighth_to_whole(
    points: Array, cells: npt.NDArray[np.int64], sides: Sides = CUBE
) -> tuple[Array, npt.NDArray[np.int64]]:
    """Return the mesh of the whole cell from that of its eighth, by the eight sign changes of the coordinates."""
    points = snap(points, sides)
    images = [(points * signs, bool(np.prod(signs) < 0)) for signs in product((1.0, -1.0), repeat=3)]
    return _merge(images, cells)


def snap(points: Array, sides: Sides = CUBE) -> Array:
    """Return points with the coordinates within 1e-9 of the planes of the eighth, 0 and half a side, set onto them."""
    for plane in (np.zeros(3), np.array(sides) / 2):
        points = np.where(np.abs(points - plane) < 1e-9, plane, points)
    return points


def _merge(
    images: list[tuple[Array, bool]], cells: npt.NDArray[np.int64]
) -> tuple[Array, npt.NDArray[np.int64]]:
    swapped = cells[:, SWAPPED[: cells.shape[1]]]
    all_points = np.concatenate([points for points, _ in images]) + 0.0  # + 0.0 turns −0.0 into 0.0
    all_cells = np.concatenate(
        [(swapped if odd else cells) + k * len(points) for k, (points, odd) in enumerate(images)]
    )
    merged, inverse = np.unique(all_points, axis=0, return_inverse=True)
    return merged, inverse.reshape(-1)[all_cells]


def unfold_displacement(points: Array, u: Array, whole: Array, sides: Sides = CUBE) -> Array:
    """Return a displacement of the eighth under a load that preserves the mirrors on the whole cell, exactly.

    Parameters
    ----------
    points : (n, 3)
        Nodes of the eighth.
    u : (n, 3)
        Displacement; u_i vanishes on the mirror planes across axis i.
    whole : (N, 3)
        Nodes of the whole cell, images of the eighth's by :func:`eighth_to_whole`.
    sides
        Sides of the cell.

    Returns
    -------
    (N, 3)
        The component u_i is odd under the mirror of axis i and even under the others.

    Raises
    ------
    ValueError
        A node of the whole cell is no image of one of the eighth.
    """
    known = snap(points, sides) + 0.0
    _, inverse = np.unique(np.concatenate([known, np.abs(whole) + 0.0]), axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    node = np.full(int(inverse.max()) + 1, -1)
    node[inverse[: len(known)]] = np.arange(len(known))
    image = node[inverse[len(known) :]]
    if (image < 0).any():
        raise ValueError("the nodes of the whole cell are no mirror images of those of the eighth")
    return np.asarray(np.sign(whole) * u[image])
