"""Grey values of an image, Otsu's threshold, and what is said of an image by its values (GreyValues)."""

from __future__ import annotations

from collections.abc import Iterator
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
#: Intervals in which other numbers are counted, as many as 16 bits have values.
INTERVALS = 1 << 16


def whole(values: npt.NDArray[Any]) -> bool:
    """Return True if all numbers are whole and finite."""
    return bool((np.isfinite(values) & (values == np.rint(values))).all())


def _finite(image: npt.NDArray[Any]) -> Iterator[npt.NDArray[Any]]:
    """Yield the finite values of layer after layer."""
    for layer in image:
        yield layer[np.isfinite(layer)]


@dataclass(frozen=True, eq=False)
class GreyValues:
    """Values of the voxels, ascending, and how many voxels have each.

    Attributes
    ----------
    values, counts : (m,)
        Distinct values; of other than whole numbers, the means in equal intervals that are not empty.
    """

    values: Array
    counts: IntArray

    @classmethod
    def of(cls, image: npt.NDArray[Any]) -> GreyValues:
        """Count the values of an image, layer by layer, so that a file that is read as needed stays on the disk."""
        ends = [(layer.min(), layer.max()) for layer in _finite(image) if layer.size]
        if not ends:
            return cls(np.zeros(0), np.zeros(0, dtype=np.int64))
        decimals = np.issubdtype(image.dtype, np.floating)
        low, high = (
            end(values).item() for end, values in zip((min, max), zip(*ends, strict=True), strict=True)
        )
        if high - low < SPAN and (not decimals or all(map(whole, _finite(image)))):
            counts = sum(
                np.bincount(
                    (layer.astype(float if decimals else np.int64) - low).astype(np.int64),
                    minlength=int(high - low) + 1,
                )
                for layer in _finite(image)
            )
            found = np.flatnonzero(counts)
            return cls(found + float(low), np.asarray(counts)[found])
        if not decimals:
            values, counts = np.unique(image, return_counts=True)
            return cls(values.astype(np.float64), counts)
        if low == high:
            return cls(np.array([low]), np.array([sum(len(layer) for layer in _finite(image))]))
        counts, sums = np.zeros(INTERVALS, dtype=np.int64), np.zeros(INTERVALS)
        for layer in _finite(image):
            values = layer.astype(float)
            counts += np.histogram(values, INTERVALS, (low, high))[0]
            sums += np.histogram(values, INTERVALS, (low, high), weights=values - low)[0]
        found = np.flatnonzero(counts)
        return cls(low + sums[found] / counts[found], counts[found])

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


@dataclass(frozen=True, eq=False)
class Parting:
    """Grey values of an image and the threshold that parts them.

    Attributes
    ----------
    grey
        Of all voxels of the file.
    threshold
        Voxels of at most this value are of one phase.
    name
        Of the threshold: where it comes from.
    bright_pores
        Pores are the voxels above it; None: the threshold is not used.
    """

    grey: GreyValues
    threshold: float
    name: str
    bright_pores: bool | None


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
