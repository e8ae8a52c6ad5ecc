"""Thickness of the thinnest walls, struts or channels of an image."""

from __future__ import annotations

import numpy as np

from porocore.cell.level_sets.cleaning import Mask
from porocore.states import Array

#: Voxels of a wall that lie at least at this share of half its thickness. At edges and corners of thick parts, which
#: balls do not fill either, the uncovered voxels lie at less than 0.42 of the radius of the ball.
DEEP = 0.5
#: Share of the voxels of this depth from which they are a wall and not the roughness of an image.
ROUGH = 0.01


def least_thickness(phase: Mask, voxel: Array, *, periodic: bool) -> float:
    """Return the thickness of the thinnest walls, struts or channels of a phase, to about a voxel.

    It is the diameter of the smallest ball that does not cover all of the phase but its edges and its roughness, while
    it lies in the phase; infinite where there is one phase only. One and two voxels are not told from each other.

    Parameters
    ----------
    phase : (n₁, n₂, n₃)
        True for the voxels of the phase.
    voxel : (3,)
        Edges of a voxel, which are the units of the result.
    periodic
        True if the image repeats, else it is continued by mirrors at its sides.

    References
    ----------
    Hildebrand & Rüegsegger (1997), A new method for the model-independent assessment of thickness in three-dimensional
    images, Journal of Microscopy 185, 67.
    """
    from scipy.ndimage import distance_transform_edt, zoom  # slow to import

    if phase.all() or not phase.any():
        return float("inf")
    step = float(np.min(voxel))
    cubes = zoom(phase, voxel / step, order=0, grid_mode=True, mode="grid-constant")
    margin = [(n // 4 + 1,) * 2 for n in cubes.shape]
    around = np.pad(cubes, margin, mode="wrap" if periodic else "symmetric")
    inner = tuple(slice(m, -m) for m, _ in margin)
    # In voxels. Distances are between their centres, and half a voxel less to the boundary.
    depth = distance_transform_edt(around) - 0.5
    for radius in np.arange(1.5, depth[inner].max(), 0.5):
        deep = (depth >= DEEP * radius)[inner]
        covered = (distance_transform_edt(depth < radius) < radius + 0.5)[inner]
        if np.count_nonzero(deep & ~covered) > ROUGH * np.count_nonzero(deep):
            return step * float(2 * radius - 0.5)
    return step * float(2 * depth[inner].max() + 0.5)
