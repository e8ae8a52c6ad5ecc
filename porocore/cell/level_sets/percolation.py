"""Axes along which the pieces of an image percolate, and the narrowest necks on the way."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from porocore.cell.level_sets.cleaning import Mask
from porocore.cell.meshing.connectivity import joined
from porocore.states import Array, IntArray


def runs(phase: Mask, *, periodic: bool, corners: bool = False) -> tuple[IntArray, list[str]]:
    """Return the number of the piece of each voxel, 0 outside of the phase, and by number the axes out of "xyz".

    Along these axes the piece, with its mirror or periodic images, runs through; "" for one that is closed in itself.
    Of a periodic image parts that meet across its sides have a number each, and the same axes.

    Parameters
    ----------
    phase : (n₁, n₂, n₃)
        True for the voxels of the phase.
    periodic
        True if the image repeats, else it is continued by mirrors at its sides.
    corners
        True: voxels with a common corner are joined, else those with a common face.
    """
    from scipy.ndimage import label  # slow to import

    labels, count = label(phase, np.ones((3, 3, 3)) if corners else None)
    if not periodic:
        ends = [[set(np.unique(np.take(labels, side, axis))) for side in (0, -1)] for axis in range(3)]
        # A path between two mirrors goes on in the next cell.
        through = [low & high for low, high in ends]
        return labels, [
            "",
            *(
                "".join(a for a, who in zip("xyz", through, strict=True) if i + 1 in who)
                for i in range(count)
            ),
        ]
    roots, windings = joined(count, _across(labels))
    axes = {
        root: "".join(axis for axis, moves in zip("xyz", np.any(ways, axis=0), strict=True) if moves)
        for root, ways in windings.items()
    }
    return labels, ["", *(axes.get(root, "") for root in roots)]


def _across(labels: IntArray) -> IntArray:
    """Return the pieces that meet across the sides of a periodic image, and the cell of the second, (L, 5)."""
    found = []
    for axis in range(3):
        pairs = np.stack([np.take(labels, -1, axis), np.take(labels, 0, axis)], axis=-1).reshape(-1, 2)
        pairs = np.unique(pairs[(pairs > 0).all(axis=1)], axis=0) - 1
        found.append(np.column_stack([pairs, np.tile(np.eye(3, dtype=np.int64)[axis], (len(pairs), 1))]))
    return np.concatenate(found)


def through_axes(axes: list[str]) -> str:
    """Return the axes along which any piece runs through."""
    return "".join(axis for axis in "xyz" if any(axis in each for each in axes))


def necks(phase: Mask, voxel: Array, widest: float, *, periodic: bool) -> dict[str, float]:
    """Return by axis the width of the narrowest neck on the widest way through, where it is below ``widest``.

    That is the diameter of the largest ball that gets through, to about a voxel, of which ``voxel`` holds the edges.
    """
    found: dict[str, float] = {}
    open_axes = through_axes(runs(phase, periodic=periodic)[1])
    step = float(np.min(voxel))
    for width, deep in _thinned(phase, voxel, widest + step, periodic=periodic):
        still = through_axes(runs(deep, periodic=periodic, corners=True)[1])
        found |= {axis: width for axis in open_axes if axis not in still and axis not in found}
        if len(found) == len(open_axes):
            break
    widths = {axis: max(width - step, step) for axis, width in found.items()}
    return {axis: width for axis, width in widths.items() if width < widest - 1e-9 * step}


def way_out(
    phase: Mask, voxel: Array, start: tuple[IntArray, ...], widest: float, *, periodic: bool
) -> float:
    """Return the width, up to ``widest``, of the narrowest neck on the widest way from a voxel through the cell."""
    step = float(np.min(voxel))
    for width, deep in _thinned(phase, voxel, widest, periodic=periodic):
        labels, axes = runs(deep, periodic=periodic, corners=True)
        if not axes[labels[start]]:
            return max(width - step, step)
    return widest


def _thinned(phase: Mask, voxel: Array, widest: float, *, periodic: bool) -> Iterator[tuple[float, Mask]]:
    """Yield widths of whole voxels up to ``widest``, and the centres of the balls of that diameter in the phase."""
    from scipy.ndimage import distance_transform_edt  # slow to import

    step = float(np.min(voxel))
    # Solid beyond mirrors is never closer than that before them.
    margin = [
        min(int(widest / edge) + 1, n) if periodic else 0 for edge, n in zip(voxel, phase.shape, strict=True)
    ]
    around = np.pad(phase, [(m, m) for m in margin], mode="wrap")
    # Distances are between centres of voxels, and half a voxel less to the boundary.
    depth = (
        distance_transform_edt(around, sampling=voxel)[
            tuple(slice(m, m + n) for m, n in zip(margin, phase.shape, strict=True))
        ]
        - step / 2
    )
    for width in step * np.arange(2, max(int(np.ceil(widest / step - 1e-9)), 2) + 1):
        # The axis of a channel of an even number of voxels lies between their centres.
        yield float(width), depth >= (width - step) / 2 - 1e-9 * step
