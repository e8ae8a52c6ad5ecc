"""Surfaces on which a pore wall lies (WallSurface), as smooth functions of place and of the geometry's numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from porocore.states import Array

#: Real values; complex ones where a number of the geometry is complex.
Values = npt.NDArray[Any]


class WallSurface(Protocol):
    """Smooth function that vanishes on a surface.

    A number of the geometry may be complex, with a tiny imaginary part: that of the value is then the derivative by
    the number, to round-off.
    """

    def value(self, points: Array) -> Values:
        """Return the values (n,) at points (n, 3)."""

    def gradient(self, points: Array) -> Array:
        """Return the gradients (n, 3) at points (n, 3), for real numbers."""


@dataclass(frozen=True)
class Round:
    """Distance from a point, or from a straight line, less a radius: a sphere, or an endless cylinder.

    Attributes
    ----------
    centre : (3,)
        The point, or a point of the line.
    radius
        Radius.
    along : (3,)
        Direction of the line, of any length; 0 for a sphere.
    is_tube
        Whether the body is the part of the cylinder from ``centre`` to ``centre + along`` alone.
    """

    centre: Values
    radius: complex
    along: Values
    is_tube: bool = False

    def value(self, points: Array) -> Values:
        away = self._away(points)
        return np.asarray(np.sqrt((away * away).sum(axis=1)) - self.radius)

    def gradient(self, points: Array) -> Array:
        away = self._away(points)
        return np.asarray(away / np.linalg.norm(away, axis=1, keepdims=True))

    def covers(self, points: Array, depth: float) -> npt.NDArray[np.bool_]:
        """Return which points (n, 3) lie deeper than ``depth`` in the body, for real numbers."""
        deep: npt.NDArray[np.bool_] = self.value(points) < -depth
        if self.is_tube:
            share = self._share(points - self.centre)
            deep &= (share >= 0) & (share <= 1)
        return deep

    def _away(self, points: Array) -> Values:
        away: Values = points - self.centre
        if np.any(self.along != 0):
            away = away - self._share(away)[:, None] * self.along
        return away

    def _share(self, away: Values) -> Values:
        return np.asarray((away @ self.along) / (self.along @ self.along))


def sphere(centre: Values, radius: complex) -> Round:
    """Return the surface of a sphere."""
    return Round(np.asarray(centre), radius, np.zeros(3))


def cylinder(axis: str, radius: complex) -> Round:
    """Return the surface of a cylinder around the axis "x", "y" or "z" through the middle of the cell."""
    return Round(np.zeros(3), radius, np.eye(3)["xyz".index(axis)])


@dataclass(frozen=True)
class Plane:
    """Plane X · normal = height in which two surfaces touch.

    Attributes
    ----------
    normal : (3,)
        Normal, of any length.
    height
        X · normal in the plane.
    between
        The two surfaces.
    """

    normal: Values
    height: complex
    between: tuple[WallSurface, WallSurface]

    def value(self, points: Array) -> Values:
        return np.asarray(points @ self.normal - self.height)

    def gradient(self, points: Array) -> Array:
        return np.tile(self.normal, (len(points), 1))
