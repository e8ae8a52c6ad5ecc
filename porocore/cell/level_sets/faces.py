"""Opposite faces of an image: the share that does not match, and a layer in which they are made to match."""

from __future__ import annotations

import numpy as np

from porocore.cell.level_sets.cleaning import Mask
from porocore.cell.level_sets.image import SMALLEST
from porocore.errors import ConfigurationError
from porocore.states import Array

#: Times the largest share of voxels that change between neighbouring layers inside of an image, above which that
#: between its opposite faces is a fault; flat walls change as much inside. Along n voxels it is FAULT + FEW/n, since
#: few layers scatter: of 1,900 periodic images of noise none is accused, of pieces of 24³ voxels or more all are.
FAULT, FEW = 1.5, 6.0


def mismatch_note(solid: Mask) -> tuple[str, ...]:
    """Return a sentence on faces that do not match, with the share of voxels that differ; none where all match."""
    faults = []
    for axis, name in enumerate("xyz"):
        changes = solid != np.roll(solid, -1, axis=axis)
        inside = changes.mean(axis=tuple(a for a in range(3) if a != axis))
        across, within = float(inside[-1]), float(inside[:-1].max())
        if across > (FAULT + FEW / len(inside)) * within:
            faults.append(f"{100 * across:.0f} % across {name} (inside at most {100 * within:.0f} %)")
    if not faults:
        return ()
    return (
        f"the image is not periodic: of the voxels of opposite faces differ {', '.join(faults)}; the cell has walls "
        "there that the sample has not; choose 'repeat: mirror', by which the image is an eighth of the cell, or "
        "'repeat: layer', which blends opposite sides",
    )


def blended(solid: Mask, width: int) -> tuple[Mask, str]:
    """Return a periodic image, smaller by ``width`` voxels along each axis, and a sentence on it.

    Its first layers are blended from those of the image and from the last layers, which are left out: the signed
    distances from the wall are weighed, from those of the last layers at the face to those of the first ones inside.

    Raises
    ------
    ConfigurationError
        The layer takes more than half of an edge, or leaves too few voxels.
    """
    most = min(min(solid.shape) // 2, min(solid.shape) - SMALLEST)
    if width > most:
        raise ConfigurationError(
            f"cell.geometry.layer: expected at most {most} voxels, half of the shortest edge of the image, got {width}"
        )
    distance = _signed_distance(solid)
    weights = (np.arange(width) + 0.5) / width
    for axis in range(3):
        along = np.moveaxis(distance, axis, 0)
        kept = along[:-width].copy()
        w = weights[:, None, None]
        kept[:width] = w * along[:width] + (1 - w) * along[-width:]
        distance = np.moveaxis(kept, 0, axis)
    found = distance > 0
    before, after = (1 - float(mask.mean()) for mask in (solid, found))
    note = (
        f"opposite sides are blended in a layer of {width} voxels, {100 * _share(found.shape, width):.0f} % of the "
        f"cell; the porosity of the image is {before:.4g}, that of the cell {after:.4g}"
    )
    return found, note


def _share(shape: tuple[int, ...], width: int) -> float:
    return 1 - float(np.prod([1 - width / n for n in shape]))


def _signed_distance(solid: Mask) -> Array:
    """Return the distance of each voxel from the other phase, less half a voxel, negative in the pores."""
    from scipy.ndimage import distance_transform_edt  # slow to import

    inside, outside = distance_transform_edt(solid), distance_transform_edt(~solid)
    return np.asarray(np.where(solid, inside - 0.5, 0.5 - outside))
