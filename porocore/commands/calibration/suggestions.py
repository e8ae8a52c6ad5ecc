"""Further data, ranked by their effect on identifiability; the rule and the sentences of what is identifiable."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from porocore.commands.calibration.minimum import (
    ROUND_OFF,
    LinearPrecision,
    UnseenDirection,
    significant,
    unseen_count,
)
from porocore.commands.calibration.problem import CurveModel, Fitted, Misfit, Unknown
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
    unseen, unseen_before
        Numbers of non-identifiable directions with and without them.
    """

    name: str
    singular_values: Array
    before: Array
    unseen: int
    unseen_before: int

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
        return self.unseen < self.unseen_before


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
    before, unseen = _singular_values(jacobian * limits), unseen_count(jacobian, limits)
    found = []
    for each in further:
        rows = np.vstack([jacobian, each.rows])
        values = _singular_values(rows * limits)
        found.append(Suggestion(each.name, values, before, unseen_count(rows, limits), unseen))
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
        rows = np.flatnonzero(data.curve == c)
        rows = rows[np.argsort(data.times[rows], kind="stable")]
        for part in np.array_split(rows, min(parts, len(rows))):
            first, last = data.times[part[0]], data.times[part[-1]]
            more = np.sqrt(times - 1) * best.jacobian[part]
            unit = f" {data.time_units[c]}".rstrip() if data.time_units else ""
            words = f"{times} times as many values of {name} from {first:.3g} to {last:.3g}{unit}"
            yield FurtherData(words, more)


def experiment(name: str, model: CurveModel, coordinates: Array, deviations: Array) -> FurtherData:
    """Return the data of a further experiment that has the same unknowns.

    Parameters
    ----------
    name
        In words.
    model
        Predicts its curves.
    coordinates : (k,)
        Best point.
    deviations : (n,)
        Expected standard deviations of its values.

    Raises
    ------
    SolveError
        The experiment cannot be computed there.
    """
    pairs = list(zip(model.unknowns, coordinates, strict=True))
    slopes = model.curves(np.array([one.value(float(x)) for one, x in pairs])).slopes
    scale = np.array([one.value_slope(float(x)) for one, x in pairs])
    return FurtherData(name, slopes * scale / deviations[:, None])


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
        seen = values > ROUND_OFF * values[0]
        along = left[:, seen].T @ whole
        shift = limits * (right[seen].T @ (along / values[seen]))
        spread = LinearPrecision.from_jacobian(jacobian * limits).deviations * limits
        return cls(errors, shift, shift / spread, float(np.linalg.norm(along)))

    @property
    def is_small(self) -> bool:
        """True where intervals may leave it out."""
        return self.size <= SMALL


#: Largest exponent of a product or ratio that is named.
LARGEST_EXPONENT = 3
#: Exponents are named where the direction has them to this relative tolerance.
EXPONENT_TOLERANCE = 0.02
#: A change below this many standard deviations is given as an upper limit.
SMALLEST_CHANGE = 0.001


def direction_words(
    found: UnseenDirection, unknowns: Sequence[Unknown], limits: Array, coordinates: Array
) -> str:
    """Return a non-identifiable direction in words.

    First the product, ratio, sum or difference of two unknowns that alone is identifiable, if there is one; then a
    step of all unknowns that are involved, and its effect on the measured values.
    """
    indices = list(significant(found.direction, limits))
    moves = [move_words(unknowns[i], float(found.step[i])) for i in indices]
    change = (
        f"less than {SMALLEST_CHANGE:g}" if found.change < SMALLEST_CHANGE else f"at most {found.change:.2g}"
    )
    one = len(moves) == 1
    together = f"{moves[0]} alone changes" if one else f"{_listed(moves)} together change"
    told = f"{together} no curve by more than its noise ({change} standard deviations of a value)."
    if found.exact:
        told = f"{together} no curve at all."
    pair = _pair_words(found.direction, unknowns, indices, coordinates) if len(indices) == 2 else ""
    if one:
        pair = f"{unknowns[indices[0]].name} is not identifiable. "
    if found.exact:
        told += (
            " The model does not depend on it, so no test, load or quantity makes it identifiable: fix "
            + ("it, or leave it out." if one else "one of them, or report the identifiable combination.")
        )
    return f"{pair}{told}"


def move_words(unknown: Unknown, step: float) -> str:
    """Return a step of an unknown's coordinate, such as ``radius + 7 %``, ``viscosity × 3.1`` or ``shift − 0.2 s``."""
    if unknown.scale == "log":
        factor = float(np.exp(step))
        if not 0.5 < factor < 2:
            return f"{unknown.name} × {factor:.2g}"
        size, unit = f"{100 * abs(factor - 1):.2g}", "%"
    else:
        size, unit = f"{abs(step):.2g}", unknown.unit
    return f"{unknown.name} {'+' if step >= 0 else '−'} {size} {unit}".rstrip()


def _listed(texts: Sequence[str]) -> str:
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} and {texts[-1]}"


def seen_powers(
    direction: Array, unknowns: Sequence[Unknown], indices: Sequence[int], coordinates: Array
) -> tuple[int, int] | None:
    """Return the exponents of the product of powers of two unknowns that stays along a direction; None: it is none."""
    moves = [_relative_move(unknowns[n], float(direction[n]), float(coordinates[n])) for n in indices]
    if 0.0 in moves:
        return None
    ratio = moves[1] / moves[0]
    # Along (1, q/p) in logarithms x^q / y^p stays.
    power = Fraction(abs(ratio)).limit_denominator(LARGEST_EXPONENT)
    if power.numerator > LARGEST_EXPONENT or not _close(float(power), abs(ratio)):
        return None
    return power.numerator, -power.denominator if ratio > 0 else power.denominator


def product_words(names: Sequence[str], powers: tuple[int, int]) -> str:
    """Return a product of powers of two names, such as ``pore²/viscosity``."""
    kept = [_power(name, abs(power)) for name, power in zip(names, powers, strict=True)]
    return f"{kept[0]}/{kept[1]}" if powers[1] < 0 else f"{kept[0]}·{kept[1]}"


def _pair_words(
    direction: Array, unknowns: Sequence[Unknown], indices: Sequence[int], coordinates: Array
) -> str:
    """Return the identifiable sum, difference, ratio or product of powers of two unknowns; empty where none is."""
    i, j = indices
    one, other = unknowns[i], unknowns[j]
    if one.scale == other.scale == "linear" and one.unit == other.unit:
        ratio = float(direction[j] / direction[i])
        if abs(abs(ratio) - 1) < EXPONENT_TOLERANCE:
            word, sign = ("difference", "−") if ratio > 0 else ("sum", "+")
            return f"Only the {word} {one.name} {sign} {other.name} is identifiable, not the two separately. "
    powers = seen_powers(direction, unknowns, indices, coordinates)
    if powers is None:
        return ""
    kind = "ratio" if powers[1] < 0 else "product"
    return f"Only the {kind} {product_words((one.name, other.name), powers)} is identifiable, not the two separately. "


def _relative_move(unknown: Unknown, move: float, coordinate: float) -> float:
    """Return the move of ln x; 0 for an unknown that need not be positive."""
    if unknown.scale == "log":
        return move
    return move / coordinate if unknown.lower >= 0 and coordinate > 0 else 0.0


def _close(one: float, other: float) -> bool:
    return abs(one - other) < EXPONENT_TOLERANCE * other


def _power(name: str, exponent: int) -> str:
    return name + {1: "", 2: "²", 3: "³"}[exponent]


def number_words(unknown: Unknown, value: float) -> str:
    """Return a value of an unknown with its unit."""
    return f"{value:.4g} {unknown.unit}".rstrip()


def held_words(unknowns: Sequence[Unknown], at_bounds: Sequence[tuple[int, float]]) -> str:
    """Return why an end that other unknowns at their bounds hold is none; their indices and values."""

    def each() -> Iterator[str]:
        for i, value in at_bounds:
            yield f"{unknowns[i].name} at its bound {number_words(unknowns[i], value)}"

    return f"the data set no end here; only {_listed(list(each()))} would"


def bound_words(unknown: Unknown, value: float) -> str:
    """Return why a profile that reaches the bound of the search has no end."""
    return f"the data do not exclude any value up to the bound of the search, {number_words(unknown, value)}"


def widened_words(unknown: Unknown, value: float) -> str:
    """Return why an end that an error of the curves moves beyond the bound of the search is none."""
    return f"an error of the curves moves it beyond the bound of the search, {number_words(unknown, value)}"


def shift_words(unknowns: Sequence[Unknown], coordinates: Array, error: SystematicError) -> str:
    """Return the best values that exact curves would give, of the unknowns that an error moves."""
    moved = [
        f"{one.name} would be {number_words(one, one.value(float(x + move)))} instead of "
        f"{number_words(one, one.value(float(x)))} ({abs(by):.2g} standard deviations away)"
        for one, x, move, by in zip(unknowns, coordinates, error.shift, error.deviations, strict=True)
        if abs(by) > SMALL
    ]
    return (
        _listed(moved)
        if moved
        else f"combinations of unknowns would move by {error.size:.2g} standard deviations"
    )


def lost_words(unknown: Unknown, value: float, reason: str) -> str:
    """Return why a profile that cannot be followed beyond a value has no end."""
    return f"the profile is known up to {number_words(unknown, value)}; beyond it {reason}"
