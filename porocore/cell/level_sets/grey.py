"""Grey values of an image (GreyValues): how many there are, a threshold by Otsu, notes on what they mean."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from porocore.states import Array, IntArray

#: Distinct values of a segmented image: pores, and a handful of phases of the solid.
HANDFUL = 6
#: Whole numbers are counted one by one within this span.
SPAN = 1 << 20
#: Intervals in which other numbers are counted.
INTERVALS = 1024


@dataclass(frozen=True, eq=False)
class GreyValues:
    """Values of the voxels, ascending, and how many voxels have each.

    Attributes
    ----------
    values, counts : (m,)
        Distinct values; of other than whole numbers, the middles of equal intervals that are not empty.
    undefined
        Number of voxels that are infinite or no number.
    """

    values: Array
    counts: IntArray
    undefined: int = 0

    @classmethod
    def of(cls, image: npt.NDArray[Any]) -> GreyValues:
        """Count the values of an image, layer by layer, so that a file that is read as needed stays on the disk."""
        if not np.issubdtype(image.dtype, np.floating):
            low, high = int(min(map(np.min, image))), int(max(map(np.max, image)))
            if high - low < SPAN:
                counts = sum(
                    np.bincount((layer.astype(np.int64) - low).ravel(), minlength=high - low + 1)
                    for layer in image
                )
                found = np.flatnonzero(counts)
                return cls(found + float(low), np.asarray(counts)[found])
            values, counts = np.unique(image, return_counts=True)
            return cls(values.astype(np.float64), counts)
        known = [layer[np.isfinite(layer)].astype(np.float64) for layer in image]
        undefined = image.size - sum(map(len, known))
        if undefined == image.size:
            return cls(np.zeros(0), np.zeros(0, dtype=np.int64), undefined)
        low, high = min(x.min() for x in known if len(x)), max(x.max() for x in known if len(x))
        if low == high:
            return cls(np.array([low]), np.array([image.size - undefined]), undefined)
        edges = np.linspace(low, high, INTERVALS + 1)
        counts = np.asarray(sum(np.histogram(x, edges)[0] for x in known))
        found = np.flatnonzero(counts)
        return cls(((edges[1:] + edges[:-1]) / 2)[found], counts[found], undefined)

    @cached_property
    def otsu(self) -> float:
        """Threshold after which the variance between both classes is largest [Otsu, IEEE Trans. SMC 9 (1979) 62].

        It lies in the middle between two values; of equally good ones, as in the gap between two peaks, in the middle
        of them all.
        """
        if len(self.values) < 2:
            return float(self.values[0])
        share = np.cumsum(self.counts) / self.counts.sum()
        moment = np.cumsum(self.counts * self.values) / self.counts.sum()
        below, above = share[:-1], 1 - share[:-1]
        between = (moment[-1] * below - moment[:-1]) ** 2 / (below * above)
        best = np.flatnonzero(between >= between.max() * (1 - 1e-12))
        return float((self.values[best[0]] + self.values[best[-1] + 1]) / 2)

    def share(self, threshold: float) -> float:
        """Return the share of the voxels at or below a threshold."""
        return float(self.counts[self.values <= threshold].sum() / self.counts.sum())

    @property
    def extent(self) -> str:
        """The values with the numbers of their voxels, or how many values there are and how far they reach."""
        if len(self.values) <= HANDFUL:
            return ", ".join(f"{v:g} ({n:,})" for v, n in zip(self.values, self.counts, strict=True))
        return f"{len(self.values):,} distinct ones from {self.values[0]:g} to {self.values[-1]:g}"


def assumed(grey: GreyValues, pore: int) -> tuple[str, ...]:
    """Return a sentence on which of two values was taken for the pores without being told; none for other images."""
    if len(grey.values) != 2 or pore not in grey.values:
        return ()
    (other,) = (value for value in grey.values if value != pore)
    share = 100 * float(grey.counts[grey.values == pore].sum() / grey.counts.sum())
    return (
        f"cell.geometry.pore is not given, so the voxels of the value {pore} are pores, {share:.3g} %, and those of "
        f"{other:g} are solid; if it is the other way round, write 'pore: {other:g}'",
    )


def not_segmented(grey: GreyValues, pore: int) -> tuple[str, ...]:
    """Return a sentence on an image that is not segmented, with a threshold; none for one of a handful of values."""
    if len(grey.values) <= HANDFUL:
        return ()
    taken = 100 * float(grey.counts[grey.values == pore].sum() / grey.counts.sum())
    dark = grey.share(grey.otsu)
    return (
        f"the image is not segmented, its values are {grey.extent}, and 'pore: {pore}' takes {taken:.3g} % of the "
        f"voxels; 'threshold: otsu' in its place parts them at {grey.otsu:g} and takes the darker {100 * dark:.3g} %, "
        f"with 'bright_pores: true' the brighter {100 - 100 * dark:.3g} %",
    )


def phases(grey: GreyValues, pore: int) -> tuple[str, ...]:
    """Return a sentence on a segmented image of more than two values; none for others."""
    if not 2 < len(grey.values) <= HANDFUL:
        return ()
    total = grey.counts.sum()
    shares = ", ".join(
        f"{v:g} ({100 * n / total:.3g} %)" for v, n in zip(grey.values, grey.counts, strict=True)
    )
    return (
        f"the image has {len(grey.values)} values: {shares}; voxels of the value {pore} are pores, all others are one "
        "solid",
    )
