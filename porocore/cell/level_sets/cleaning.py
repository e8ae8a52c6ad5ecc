"""Removal of floating grains and closed pores from an image, and numbering of its pieces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from porocore.states import IntArray

Mask = npt.NDArray[np.bool_]
#: Sizes that a note names; further ones are counted.
NAMED = 4


@dataclass(frozen=True, eq=False)
class Cleaned:
    """An image without what was to be removed, and the sizes of that in voxels, the largest first.

    Attributes
    ----------
    solid
        True for solid voxels, after cleaning.
    grains, filled
        Grains of the solid that became pores, and closed pores that became solid.
    periodic
        True where opposite sides of the image touch, as pieces of one cell do.
    """

    solid: Mask
    grains: tuple[int, ...]
    filled: tuple[int, ...]
    periodic: bool

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what was removed and on grains that float."""
        share = 100 / self.solid.size
        notes = []
        if self.grains:
            notes.append(
                f"{_pieces(self.grains, 'grain')} of the solid dropped, {sum(self.grains) * share:.3g} % of the image"
            )
        if self.filled:
            notes.append(
                f"{_pieces(self.filled, 'pore')} filled, {sum(self.filled) * share:.3g} % of the image"
            )
        if floating := _sizes(labelled(self.solid, periodic=self.periodic))[1:]:
            notes.append(
                f"{_pieces(floating, 'grain')} of the solid without contact to the rest, face to face; "
                "cell.geometry.drop_grains: true makes pores of them"
            )
        return tuple(notes)


def clean(solid: Mask, *, periodic: bool, drop_grains: bool, fill_pores: int) -> Cleaned:
    """Return an image without the grains that float, if wanted, and without pores of at most ``fill_pores`` voxels.

    Voxels with a common face belong to one piece, across the sides of a periodic image too.
    """
    grains: tuple[int, ...] = ()
    filled: tuple[int, ...] = ()
    if drop_grains:
        labels = labelled(solid, periodic=periodic)
        grains = _sizes(labels)[1:]
        if grains:
            solid = labels == 1 + int(np.bincount(labels.ravel())[1:].argmax())
    if fill_pores:
        labels = labelled(~solid, periodic=periodic)
        counts = np.bincount(labels.ravel())
        small = (counts <= fill_pores) & (np.arange(len(counts)) > 0)
        filled = tuple(sorted(map(int, counts[small]), reverse=True))
        solid = solid | small[labels]
    return Cleaned(solid, grains, filled, periodic)


def labelled(mask: Mask, *, periodic: bool) -> IntArray:
    """Return the number of the piece of each voxel, from 1; 0 outside of the mask."""
    from scipy.ndimage import label  # slow to import
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    labels, count = label(mask)
    if not periodic or count < 2:
        return np.asarray(labels)
    pairs = np.concatenate(
        [
            np.stack([np.take(labels, 0, axis), np.take(labels, -1, axis)], axis=-1).reshape(-1, 2)
            for axis in range(3)
        ]
    )
    pairs = np.unique(pairs[(pairs > 0).all(axis=1)], axis=0) - 1
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, piece = connected_components(graph, directed=False)
    return np.asarray(np.concatenate([[0], piece + 1])[labels])


def _sizes(labels: IntArray) -> tuple[int, ...]:
    """Return the voxels of each piece, the largest first."""
    return tuple(sorted(map(int, np.bincount(labels.ravel())[1:]), reverse=True))


def _pieces(sizes: tuple[int, ...], what: str) -> str:
    shown = ", ".join(f"{size:,}" for size in sizes[:NAMED]) + (", …" if len(sizes) > NAMED else "")
    return f"{len(sizes)} {what}{'s' if len(sizes) > 1 else ''} ({shown} voxels)"
