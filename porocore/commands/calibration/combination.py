"""Identifiable product of powers of two unknowns (SeenProduct), with its 95 % interval."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from porocore.commands.calibration.minimum import Minimum, Objective, UnseenDirection, significant
from porocore.commands.calibration.problem import Unknown
from porocore.commands.calibration.profiles import ROOT_95, End, ProfileWalk
from porocore.commands.calibration.suggestions import SystematicError, product_words, seen_powers
from porocore.core.units import pretty
from porocore.states import Array


@dataclass(frozen=True, eq=False)
class SeenProduct:
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
        ends = " to ".join("open" if end is None else f"{end:.4g}" for end in self.interval)
        return f"{self.name} = {self.value:.4g} {self.unit}".rstrip() + f" (95 % interval {ends})"

    def moved(self, unknowns: Sequence[Unknown], coordinates: Array, error: SystematicError) -> SeenProduct:
        """Return the product with an interval that also holds its values after a known error of the curves."""
        there = _value(unknowns, coordinates + error.shift, self.indices, self.powers)
        factor = there / self.value
        low, high = self.interval
        return replace(
            self,
            interval=(
                None if low is None else low * min(factor, 1.0),
                None if high is None else high * max(factor, 1.0),
            ),
        )


def seen_product(
    objective: Objective,
    best: Minimum,
    direction: UnseenDirection,
    limits: Array,
    tell: Callable[[str], None] = lambda text: None,
) -> SeenProduct | None:
    """Return the product of powers that stays along an exact direction; None where it is none of two unknowns.

    Along the direction nothing changes. So the profile of the product is that of one of the two unknowns while the
    other is held at its best value, whichever has more room to its bounds.
    """
    unknowns, x = objective.misfit.unknowns, best.fitted.coordinates
    indices = list(significant(direction.direction, limits))
    powers = seen_powers(direction.direction, unknowns, indices, x) if len(indices) == 2 else None
    if powers is None:
        return None
    pair = (indices[0], indices[1])
    name = product_words([unknowns[i].name for i in pair], powers)
    ends = list[float | None]()
    for sign in (-1, 1):
        tell(f"{'lower' if sign < 0 else 'upper'} end of {name}")
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
    return SeenProduct(pair, powers, name, unit, _value(unknowns, x, pair, powers), (ends[0], ends[1]))


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
