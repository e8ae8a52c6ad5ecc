"""Non-identifiable directions of the unknowns, in numbers and words; identifiable products of two unknowns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from porocore.commands.calibration.minimum import ROUND_OFF, LinearPrecision, Minimum, Objective
from porocore.commands.calibration.problem import Unknown
from porocore.commands.calibration.profiles import ROOT_95, End, ProfileWalk, interval_words
from porocore.core.echo import joined
from porocore.core.units import pretty
from porocore.states import Array

#: A move that changes what a model knows of its unknowns by less than this share is exact: round-off.
EXACT = 1e-12
#: The step of a direction moves no unknown further than so many limits of the rule.
MOST_LIMITS = 4.0


@dataclass(frozen=True, eq=False)
class NonIdentifiableDirection:
    """Non-identifiable combination of unknowns.

    Attributes
    ----------
    direction : (k,)
        Unit vector over the coordinates.
    deviation
        Standard deviation along it by the data alone; infinite where they do not depend on it.
    step : (k,)
        A move of the coordinates along it: one standard deviation, or less where that is far.
    change
        Largest change of a measured value by the step to first order, in standard deviations of that value.
    exact
        True where the model does not depend on it, so that no measurement makes it identifiable.
    """

    direction: Array
    deviation: float
    step: Array
    change: float
    exact: bool = False


def exact_directions(dependence: Array, limits: Array) -> Array:
    """Return the directions (n, k), in limits, along which a model knows nothing of its unknowns.

    Parameters
    ----------
    dependence : (r, k)
        Derivatives, by the coordinates, of all that the model knows of them.
    limits : (k,)
        Of the coordinates.
    """
    rows = dependence * limits
    sizes = np.linalg.norm(rows, axis=1)
    rows = rows[sizes > 0] / sizes[sizes > 0, None]
    if not len(rows):
        return np.eye(len(limits))
    _, values, right = np.linalg.svd(rows)
    rank = int((values > EXACT * values[0]).sum())
    return _sparse(right[rank:])


def non_identifiable_directions(
    jacobian: Array, limits: Array, dependence: Array | None = None
) -> tuple[NonIdentifiableDirection, ...]:
    """Return the non-identifiable directions of weighted data, the least identifiable one first.

    The coordinates are measured in their limits: a step by one is what makes an unknown not identifiable. In these
    units the singular vectors of the Jacobian are independent, with deviations 1/s. A direction is non-identifiable
    where one standard deviation along it moves some unknown beyond its limit. Where several are, any combination
    is; the ones with the fewest unknowns are taken as long as they are non-identifiable, too.

    Parameters
    ----------
    jacobian : (m, k)
        Derivatives of the measured values, over their standard deviations, by the coordinates; without priors.
    limits : (k,)
        Of the coordinates, by the rule of identifiability.
    dependence : (r, k)
        Derivatives, by the coordinates, of all that the model knows of the unknowns; exact directions are separated
        from the others and come first. None: it is not known.
    """
    k = len(limits)
    exact = np.zeros((0, k)) if dependence is None else exact_directions(dependence, limits)
    # The others are sought among what is left.
    rest = np.linalg.svd(exact)[2][len(exact) :] if len(exact) else np.eye(k)
    precision = LinearPrecision.from_jacobian(jacobian * limits @ rest.T)
    others = precision.directions @ rest
    weak = others[np.abs(others).max(axis=1, initial=0.0) > precision.singular_values]
    sparse = _sparse(weak)
    if all(_is_non_identifiable(jacobian * limits, each) for each in sparse):
        weak = sparse
    largest = float(precision.singular_values.max(initial=0.0))
    order = np.argsort(np.linalg.norm(jacobian @ (weak * limits).T, axis=0), kind="stable")
    found = [_direction(jacobian, limits, each, largest, exact=True) for each in exact]
    return (*found, *(_direction(jacobian, limits, weak[i], largest) for i in order))


def _beyond_limits(precision: LinearPrecision) -> npt.NDArray[np.bool_]:
    """Return True for singular vectors, in limits, along which one deviation moves an unknown beyond its limit."""
    return np.asarray(np.abs(precision.directions).max(axis=1) > precision.singular_values)


def non_identifiable_count(jacobian: Array, limits: Array) -> int:
    """Return the number of non-identifiable directions of weighted data; see :func:`non_identifiable_directions`."""
    return int(_beyond_limits(LinearPrecision.from_jacobian(jacobian * limits)).sum())


def _is_non_identifiable(scaled: Array, direction: Array) -> bool:
    return float(np.abs(direction).max()) > float(np.linalg.norm(scaled @ direction))


def _sparse(directions: Array) -> Array:
    """Return unit directions (n, k) of the same span, each zero at the pivots of all others."""
    from scipy.linalg import qr

    if len(directions) < 2:
        return directions
    _, _, order = qr(directions, mode="economic", pivoting=True)
    made = np.linalg.solve(directions[:, order[: len(directions)]], directions)
    made[np.abs(made) < 1e-12] = 0.0
    return np.asarray(made / np.linalg.norm(made, axis=1, keepdims=True))


def _direction(
    jacobian: Array, limits: Array, scaled: Array, largest: float, exact: bool = False
) -> NonIdentifiableDirection:
    """Return the direction of a unit vector in limits; ``largest`` is the largest singular value there."""
    moves = np.abs(scaled)
    # The first unknown that counts goes up.
    scaled = scaled * np.sign(scaled[int((moves > moves.max() / 10).argmax())])
    size = float(np.linalg.norm(jacobian @ (scaled * limits)))
    deviation = np.inf if exact or size <= ROUND_OFF * largest else 1 / size
    step = scaled * limits * min(deviation, MOST_LIMITS / float(np.abs(scaled).max()))
    length = float(np.linalg.norm(scaled * limits))
    change = float(np.abs(jacobian @ step).max(initial=0.0))
    return NonIdentifiableDirection(scaled * limits / length, deviation * length, step, change, exact)


def significant(direction: Array, limits: Array, share: float = 0.02) -> Iterator[int]:
    """Yield the unknowns that a direction moves, in limits, by more than a share of its largest move."""
    moves = np.abs(direction) / limits
    yield from (int(i) for i in np.flatnonzero(moves > share * moves.max()))


#: Largest exponent of a product or ratio that is named.
LARGEST_EXPONENT = 3
#: Exponents are named where the direction has them to this relative tolerance.
EXPONENT_TOLERANCE = 0.02
#: A change below this many standard deviations is given as an upper limit.
SMALLEST_CHANGE = 0.001


def direction_words(
    found: NonIdentifiableDirection, unknowns: Sequence[Unknown], limits: Array, coordinates: Array
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
    together = f"{moves[0]} alone changes" if one else f"{joined(moves)} together change"
    effect = f"{together} no curve by more than its noise ({change} standard deviations of a value)."
    if found.exact:
        effect = f"{together} no curve at all."
    pair = _pair_words(found.direction, unknowns, indices, coordinates) if len(indices) == 2 else ""
    if one:
        pair = f"{unknowns[indices[0]].name} is not identifiable. "
    if found.exact:
        effect += (
            " The model does not depend on it, so no test, load or quantity makes it identifiable: fix "
            + ("it, or leave it out." if one else "one of them, or report the identifiable combination.")
        )
    return f"{pair}{effect}"


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


def kept_powers(
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
    powers = kept_powers(direction, unknowns, indices, coordinates)
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


@dataclass(frozen=True, eq=False)
class IdentifiableProduct:
    """Identifiable product of powers of two unknowns that no measurement separates.

    Attributes
    ----------
    indices, powers
        The unknowns, and their exponents.
    name, unit
        Such as ``pore²/viscosity`` and ``nm²/(mPa·s)``; empty for a dimensionless one.
    value, interval
        At the best point, and its 95 % interval by the data; None where they set no end.
    """

    indices: tuple[int, int]
    powers: tuple[int, int]
    name: str
    unit: str
    value: float
    interval: tuple[float | None, float | None]

    @property
    def words(self) -> str:
        """Value and interval in a sentence."""
        ends = interval_words(self.interval)
        return f"{self.name} = {self.value:.4g} {self.unit}".rstrip() + f" (95 % interval {ends})"

    def moved(self, unknowns: Sequence[Unknown], coordinates: Array, shift: Array) -> IdentifiableProduct:
        """Return the product with an interval that also holds its values after a shift (k,) of the coordinates."""
        there = _value(unknowns, coordinates + shift, self.indices, self.powers)
        factor = there / self.value
        low, high = self.interval
        return replace(
            self,
            interval=(
                None if low is None else low * min(factor, 1.0),
                None if high is None else high * max(factor, 1.0),
            ),
        )


def identifiable_product(
    objective: Objective,
    best: Minimum,
    direction: NonIdentifiableDirection,
    limits: Array,
) -> IdentifiableProduct | None:
    """Return the product of powers that stays along an exact direction; None where it is none of two unknowns.

    Along the direction nothing changes. So the profile of the product is that of one of the two unknowns while the
    other is held at its best value, whichever has more room to its bounds.
    """
    unknowns, x = objective.misfit.unknowns, best.fitted.coordinates
    indices = list(significant(direction.direction, limits))
    powers = kept_powers(direction.direction, unknowns, indices, x) if len(indices) == 2 else None
    if powers is None:
        return None
    pair = (indices[0], indices[1])
    name = product_words([unknowns[i].name for i in pair], powers)
    ends = list[float | None]()
    for sign in (-1, 1):
        objective.tell(f"{'lower' if sign < 0 else 'upper'} end of {name}")
        moves = [sign * np.sign(power) * side for power, side in zip(powers, np.eye(2), strict=True)]
        walks = [
            ProfileWalk(objective, best, np.array(pair), np.asarray(move), ROOT_95, strict=False)
            for move in moves
        ]
        walk = max(walks, key=lambda each: each.room / each.linear_distance).run()
        end = np.array(x)
        end[list(pair)] += walk.distance * walk.direction
        ends.append(_value(unknowns, end, pair, powers) if walk.end is End.crossed else None)
    unit = _unit([unknowns[i].unit for i in pair], powers)
    return IdentifiableProduct(
        pair, powers, name, unit, _value(unknowns, x, pair, powers), (ends[0], ends[1])
    )


def _value(unknowns: Sequence[Unknown], x: Array, pair: tuple[int, int], powers: tuple[int, int]) -> float:
    parts = [unknowns[i].value(float(x[i])) ** power for i, power in zip(pair, powers, strict=True)]
    return float(np.prod(parts))


def _unit(units: Sequence[str], powers: tuple[int, int]) -> str:
    """Return the unit of a product of powers of numbers with units; empty where they have none."""
    if not all(units):
        return ""
    first, last = (
        unit if abs(power) == 1 else f"{unit if unit.isalpha() else f'({unit})'}**{abs(power)}"
        for unit, power in zip(units, powers, strict=True)
    )
    return pretty(f"{first}/({last})" if powers[1] < 0 else f"{first}*{last}")
