"""Further data, ranked by their effect; the rule of identifiability (IdentifiabilityRule); errors of the curves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from porocore.commands.calibration.directions import non_identifiable_count
from porocore.commands.calibration.minimum import ROUND_OFF, LinearPrecision
from porocore.commands.calibration.problem import Fitted, Misfit, Unknown
from porocore.core.echo import joined
from porocore.states import Array

#: Share of the largest singular value below which two of them count as equal.
RESOLUTION = 1e-6
#: A gain of the least singular value below this is none.
LEAST_GAIN = 1.05


@dataclass(frozen=True, eq=False)
class FurtherData:
    """Measurement that could be made.

    Attributes
    ----------
    name
        In words.
    rows : (n, k)
        Derivatives of its values, over their standard deviations, by the coordinates at the best point.
    """

    name: str
    rows: Array


@dataclass(frozen=True, eq=False)
class Suggestion:
    """Gain of further data.

    Attributes
    ----------
    name
        Of the data.
    singular_values : (k,)
        Of the data with the further ones, largest first; the coordinates are measured in their limits.
    before : (k,)
        The same without them.
    non_identifiable, non_identifiable_before
        Numbers of non-identifiable directions with and without them.
    """

    name: str
    singular_values: Array
    before: Array
    non_identifiable: int
    non_identifiable_before: int

    @property
    def least(self) -> float:
        """Smallest singular value with the further data."""
        return float(self.singular_values[-1])

    @property
    def gain(self) -> float:
        """Factor by which the smallest singular value grows; infinite where it was zero to round-off."""
        floor = RESOLUTION * float(self.singular_values[0])
        if self.before[-1] < floor:
            return float("inf") if self.least > floor else 1.0
        return self.least / float(self.before[-1])

    @property
    def helps(self) -> bool:
        """True where the gain is worth a word, or fewer directions stay non-identifiable."""
        return self.gain > LEAST_GAIN or self.separates

    @property
    def separates(self) -> bool:
        """True where fewer directions stay non-identifiable."""
        return self.non_identifiable < self.non_identifiable_before


def ranked(jacobian: Array, limits: Array, further: Sequence[FurtherData]) -> tuple[Suggestion, ...]:
    """Return the gains of further data, the best first.

    They are ordered by the smallest singular value; where several are non-identifiable and it stays zero, by the
    next larger one.

    Parameters
    ----------
    jacobian : (m, k)
        Derivatives of the measured values, over their standard deviations, by the coordinates; without priors.
    limits : (k,)
        Of the coordinates, by the rule of identifiability.
    further
        Data to be ranked.
    """
    before, count = _singular_values(jacobian * limits), non_identifiable_count(jacobian, limits)
    found = []
    for each in further:
        rows = np.vstack([jacobian, each.rows])
        values = _singular_values(rows * limits)
        found.append(Suggestion(each.name, values, before, non_identifiable_count(rows, limits), count))
    largest = max((float(each.singular_values[0]) for each in found), default=1.0)

    def key(suggestion: Suggestion) -> list[float]:
        values = np.maximum(suggestion.singular_values[::-1], RESOLUTION * largest)
        return [-round(float(value), 3) for value in np.log(values)]

    return tuple(sorted(found, key=key))


def _singular_values(rows: Array) -> Array:
    """Return k singular values, also of fewer rows than columns."""
    k = rows.shape[1]
    padded = np.vstack([rows, np.zeros((max(k - len(rows), 0), k))])
    return np.asarray(np.linalg.svd(padded, compute_uv=False))


def repeated_parts(misfit: Misfit, best: Fitted, parts: int = 4, times: int = 10) -> Iterator[FurtherData]:
    """Yield parts of each measured curve, as many values each, measured so many times as densely."""
    data = misfit.data
    for c, name in enumerate(data.names):
        rows = data.rows(c)
        for part in np.array_split(rows, min(parts, len(rows))):
            first, last = data.times[part[0]], data.times[part[-1]]
            more = np.sqrt(times - 1) * best.jacobian[part]
            unit = f" {data.time_units[c]}".rstrip() if data.time_units else ""
            words = f"{times} times as many values of {name} from {first:.3g} to {last:.3g}{unit}"
            yield FurtherData(words, more)


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


#: An error that moves no combination of the unknowns by more than this many standard deviations is small: a 95 %
#: interval that leaves it out holds the true value in 94.5 % of all repeats.
SMALL = 0.2


@dataclass(frozen=True, eq=False)
class SystematicError:
    """Error of the predicted curves, such as that of their steps in time, at the best point.

    Attributes
    ----------
    errors : (m,)
        Predicted less exact values, over the standard deviations of the data.
    shift : (k,)
        Move of the best coordinates that exact curves would bring.
    deviations : (k,)
        The same in standard deviations of each coordinate; 0 where these are infinite.
    size
        Largest move of any combination of the unknowns, in its standard deviations.
    counted
        True where the intervals hold the best values of exact curves, too.
    """

    errors: Array
    shift: Array
    deviations: Array
    size: float
    counted: bool = False

    @classmethod
    def at_best(cls, errors: Array, jacobian: Array, limits: Array) -> SystematicError:
        """Return what errors (m,) do, by the weighted Jacobian (m + priors, k) at the best point.

        Parameters
        ----------
        errors
            Predicted less exact values, over the standard deviations of the data.
        jacobian
            Derivatives of the residuals by the coordinates, those of priors last.
        limits : (k,)
            Lengths by which coordinates are measured.
        """
        whole = np.concatenate([errors, np.zeros(len(jacobian) - len(errors))])
        left, values, right = np.linalg.svd(jacobian * limits, full_matrices=False)
        clear = values > ROUND_OFF * values[0]
        along = left[:, clear].T @ whole
        shift = limits * (right[clear].T @ (along / values[clear]))
        spread = LinearPrecision.from_jacobian(jacobian * limits).deviations * limits
        return cls(errors, shift, shift / spread, float(np.linalg.norm(along)))

    @property
    def is_small(self) -> bool:
        """True where intervals may leave it out."""
        return self.size <= SMALL


def shift_words(unknowns: Sequence[Unknown], coordinates: Array, error: SystematicError) -> str:
    """Return the best values that exact curves would give, of the unknowns that an error moves."""
    moved = [
        f"{one.name} would be {one.text(one.value(float(x + move)))} instead of "
        f"{one.text(one.value(float(x)))} ({abs(by):.2g} standard deviations away)"
        for one, x, move, by in zip(unknowns, coordinates, error.shift, error.deviations, strict=True)
        if abs(by) > SMALL
    ]
    return (
        joined(moved)
        if moved
        else f"combinations of unknowns would move by {error.size:.2g} standard deviations"
    )
