"""Sentences: a direction that is not seen, and why an interval has no end."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction

import numpy as np

from porocore.calibration.inference.directions import UnseenDirection, significant
from porocore.calibration.inference.systematic import SMALL, SystematicError
from porocore.calibration.problem import Unknown
from porocore.states import Array

#: Largest exponent of a product or ratio that is told.
LARGEST_EXPONENT = 3
#: Exponents are told where the direction has them to this share.
EXPONENT_TOLERANCE = 0.02
#: A change below this many standard deviations is told as smaller than it.
SMALLEST_CHANGE = 0.001


def direction_words(
    found: UnseenDirection, unknowns: Sequence[Unknown], limits: Array, coordinates: Array
) -> str:
    """Return an unseen direction in words.

    First the product, ratio, sum or difference of two unknowns that alone is seen, where that is so; then a step of
    all unknowns that are involved, and how little it changes the measured values.
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
        pair = f"{unknowns[indices[0]].name} is not seen. "
    if found.exact:
        told += " No test, load or quantity can tell, since the model knows nothing else of them: fix " + (
            "it, or leave it out." if one else "one of them, or report what is seen."
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
    """Return what alone is seen of two unknowns: a sum or a difference, a ratio or a product of powers."""
    i, j = indices
    one, other = unknowns[i], unknowns[j]
    if one.scale == other.scale == "linear" and one.unit == other.unit:
        ratio = float(direction[j] / direction[i])
        if abs(abs(ratio) - 1) < EXPONENT_TOLERANCE:
            word, sign = ("difference", "−") if ratio > 0 else ("sum", "+")
            return f"Only the {word} {one.name} {sign} {other.name} is seen, not each. "
    powers = seen_powers(direction, unknowns, indices, coordinates)
    if powers is None:
        return ""
    kind = "ratio" if powers[1] < 0 else "product"
    return f"Only the {kind} {product_words((one.name, other.name), powers)} is seen, not each. "


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
