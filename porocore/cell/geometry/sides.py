"""Sides of a cell that is a box, scaled to the volume 1."""

from __future__ import annotations

import math
from collections.abc import Iterable

Sides = tuple[float, float, float]
CUBE: Sides = (1.0, 1.0, 1.0)
#: Significant bits of a side. Multiples of it are exact, so that copies of a cell meet in the same numbers.
BITS = 48


def unit_sides(lengths: Iterable[float]) -> Sides:
    """Return the sides of a box of volume 1 with the proportions of the given lengths; exactly 1 for a cube."""
    x, y, z = lengths
    if x == y == z:
        return CUBE
    edge = math.cbrt(x * y * z)
    return _rounded(x / edge), _rounded(y / edge), _rounded(z / edge)


def _rounded(side: float) -> float:
    mantissa, exponent = math.frexp(side)
    return math.ldexp(round(math.ldexp(mantissa, BITS)), exponent - BITS)
