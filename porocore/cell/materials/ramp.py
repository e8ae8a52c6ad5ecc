"""A smooth positive part, for what bears tension only."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from porocore.states import Array


def ramp(x: Array) -> Array:
    """0 for x ≤ 0, x³ − x⁴/2 up to 1, x − ½ beyond: a positive part with two continuous derivatives."""
    t = np.clip(x, 0.0, 1.0)
    return np.asarray(t**3 - t**4 / 2 + np.maximum(x - 1, 0.0))


def ramp_slope(x: Array) -> Array:
    """Its derivative, 3x² − 2x³ between 0 and 1."""
    t = np.clip(x, 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))


def ramp_bend(x: Array) -> Array:
    """Its second derivative, 6x (1 − x) between 0 and 1."""
    t = np.clip(x, 0.0, 1.0)
    return np.asarray(6 * t * (1 - t))


@lru_cache(maxsize=1)
def symbolic_ramp() -> Any:
    """:func:`ramp` as a function of sympy's, whose derivatives are named like the functions above."""
    import sympy

    class ramp_bend(sympy.Function):  # type: ignore[misc]
        pass

    class ramp_slope(sympy.Function):  # type: ignore[misc]
        def fdiff(self, argindex: int = 1) -> Any:
            return ramp_bend(self.args[0])

    class ramp(sympy.Function):  # type: ignore[misc]
        def fdiff(self, argindex: int = 1) -> Any:
            return ramp_slope(self.args[0])

    return ramp
