"""Smooth positive part with two derivatives, for fibres that bear tension only; the same in sympy."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from porocore.states import Array


def ramp(x: Array) -> Array:
    """Return 0 for x ≤ 0, x³ − x⁴/2 up to 1, x − ½ beyond: a positive part with two continuous derivatives."""
    t = _clipped(x)
    return np.asarray(t**3 - t**4 / 2 + np.where(np.real(x) > 1, x - 1, 0.0))


def ramp_derivative(x: Array) -> Array:
    """Return the first derivative of the ramp, 3x² − 2x³ between 0 and 1."""
    t = _clipped(x)
    return np.asarray(t * t * (3 - 2 * t))


def ramp_curvature(x: Array) -> Array:
    """Return the second derivative of the ramp, 6x (1 − x) between 0 and 1."""
    t = _clipped(x)
    return np.asarray(6 * t * (1 - t))


def _clipped(x: Array) -> Array:
    """Return x between 0 and 1; a complex x is clipped by its real part, as a complex step needs it."""
    if not np.iscomplexobj(x):
        return np.clip(x, 0.0, 1.0)
    return np.where(np.real(x) < 0, 0.0, np.where(np.real(x) > 1, 1.0, x))


@lru_cache(maxsize=1)
def symbolic_ramp() -> Any:
    """Return :func:`ramp` as a sympy function with derivatives named like the functions above."""
    import sympy

    class ramp_curvature(sympy.Function):  # type: ignore[misc]
        pass

    class ramp_derivative(sympy.Function):  # type: ignore[misc]
        def fdiff(self, argindex: int = 1) -> Any:
            return ramp_curvature(self.args[0])

    class ramp(sympy.Function):  # type: ignore[misc]
        def fdiff(self, argindex: int = 1) -> Any:
            return ramp_derivative(self.args[0])

    return ramp
