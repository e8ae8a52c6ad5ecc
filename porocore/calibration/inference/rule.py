"""Rule by which an unknown is identifiable (IdentifiabilityRule): how wide its 95 % interval may be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from porocore.calibration.problem import Unknown
from porocore.states import Array

#: Last parts of the names of a Poisson's ratio, and of an angle in degrees.
POISSON_RATIO, ANGLE = "poisson_ratio", "angle"


@dataclass(frozen=True)
class IdentifiabilityRule:
    """Largest distance of the ends of a 95 % interval from the value for which an unknown is called identifiable.

    Attributes
    ----------
    relative
        Share of the value, for all unknowns but those below.
    poisson_ratio
        For a Poisson's ratio on a linear scale, whose name ends in ``poisson_ratio``.
    angle
        For an angle on a linear scale, whose name ends in ``angle``, in degrees.
    distances
        For single unknowns by their names, in their units, such as a time shift.
    """

    relative: float = 0.1
    poisson_ratio: float = 0.04
    angle: float = 9.0
    distances: Mapping[str, float] = field(default_factory=dict)

    def distance(self, unknown: Unknown, value: float) -> float:
        """Return the largest distance of an end of the interval from ``value``, in the unknown's unit.

        A linear unknown that may have either sign has no scale in its value; there it is the share of half its range.
        """
        if unknown.name in self.distances:
            return self.distances[unknown.name]
        if unknown.scale == "linear":
            return self.without_scale(unknown.name) or self._relative(unknown, value)
        return self._relative(unknown, value)

    def without_scale(self, name: str) -> float | None:
        """Return the distance of a number whose value is no scale for it, by its name; None: it is one, or has none."""
        return {POISSON_RATIO: self.poisson_ratio, ANGLE: self.angle}.get(name.rsplit(".", 1)[-1])

    def _relative(self, unknown: Unknown, value: float) -> float:
        if value == 0.0 or unknown.lower < 0.0 < unknown.upper:
            return self.relative * (unknown.upper - unknown.lower) / 2
        return self.relative * abs(value)

    def limit(self, unknown: Unknown, coordinate: float) -> float:
        """Return the same upwards as a distance of coordinates, by which directions are scaled."""
        value = unknown.value(coordinate)
        return unknown.coordinate(value + self.distance(unknown, value)) - coordinate

    def limits(self, unknowns: tuple[Unknown, ...], coordinates: Array) -> Array:
        """Return :meth:`limit` of all unknowns, (k,)."""
        return np.array([self.limit(one, float(x)) for one, x in zip(unknowns, coordinates, strict=True)])

    def holds(self, unknown: Unknown, value: float, low: float | None, high: float | None) -> bool:
        """Tell whether an interval makes the unknown identifiable; an open end never does."""
        if low is None or high is None:
            return False
        distance = self.distance(unknown, value)
        return value - distance <= low and high <= value + distance
