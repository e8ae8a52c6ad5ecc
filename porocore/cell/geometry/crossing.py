"""Volume of three circular channels of different radii that cross in the middle of the cell."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np


@lru_cache(maxsize=16)
def crossing_volume(along_x: float, along_y: float, along_z: float) -> float:
    """Return the share of the cell in channels of the given radii along the axes; a radius of 0 is no channel.

    The area of each section across z is known: two crossing strips, and the part of the disk outside of them. It is
    integrated over z between the heights where a strip ends, where it varies like a square root.
    """
    from scipy.integrate import quad  # slow to import

    def section(z: float) -> float:
        """Return the area of the section in the quarter 0 ≤ x, y ≤ ½."""
        y = np.sqrt(max(along_x**2 - z**2, 0.0))  # half width of the strip along x
        x = np.sqrt(max(along_y**2 - z**2, 0.0))
        return float(0.25 - (0.5 - x) * (0.5 - y) + _beyond(along_z, float(x), float(y)))

    ends = sorted(
        {0.0, min(along_x, 0.5), min(along_y, 0.5), 0.5, *_corner_on_circle(along_x, along_y, along_z)}
    )
    total = 0.0
    for low, high in pairwise(ends):
        # z = low + (high − low) sin² s makes the integrand smooth at the ends.
        total += quad(
            lambda s, a=low, b=high: section(a + (b - a) * np.sin(s) ** 2) * (b - a) * np.sin(2 * s),
            0.0,
            np.pi / 2,
            epsabs=1e-13,
            epsrel=1e-12,
        )[0]
    return float(8 * total)


def _beyond(r: float, x: float, y: float) -> float:
    """Return the area of a quarter of a disk where the coordinates exceed x and y."""
    if x**2 + y**2 >= r**2:
        return 0.0
    right, top = np.sqrt(r**2 - y**2), np.sqrt(r**2 - x**2)
    angle = np.arctan2(top, x) - np.arctan2(y, right)
    return float((r**2 * angle - x * (top - y) - y * (right - x)) / 2)


def _corner_on_circle(along_x: float, along_y: float, along_z: float) -> list[float]:
    """Return the height at which the corner between the strips lies on the circle, if there is one."""
    square = (along_x**2 + along_y**2 - along_z**2) / 2
    inside = 0 < square < min(along_x, along_y) ** 2
    return [float(np.sqrt(square))] if inside else []
