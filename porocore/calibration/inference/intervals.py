"""Confidence intervals by profile likelihood (ConfidenceInterval), an end None where the data set none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from porocore.calibration.inference.minimise import Minimum, Objective
from porocore.calibration.inference.profile import End, ProfileWalk
from porocore.calibration.inference.words import bound_words, held_words, lost_words, widened_words
from porocore.calibration.problem import Unknown
from porocore.states import Array

#: Root of the 95 % quantile of χ² with one degree of freedom.
ROOT_95 = 1.959963984540054


@dataclass(frozen=True)
class IntervalEnd:
    """End of an interval.

    Attributes
    ----------
    value
        The unknown there; None: the data set no end.
    reason
        Why there is none.
    """

    value: float | None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class ConfidenceInterval:
    """95 % interval of one unknown, with its profile.

    Attributes
    ----------
    low, high
        Its ends.
    coordinates : (n, k)
        Points of the profile in the order of the unknown: its coordinate, and the best of the others. Points at which
        bounds of the others raise the sum of squares are left out.
    roots : (n,)
        Square root of the rise of the sum of squares, negative below the best value; ±1.96 at the ends.
    """

    low: IntervalEnd
    high: IntervalEnd
    coordinates: Array
    roots: Array

    @property
    def values(self) -> tuple[float | None, float | None]:
        """Both ends as values."""
        return self.low.value, self.high.value

    def widened(self, unknown: Unknown, shift: float) -> ConfidenceInterval:
        """Return the interval that holds the values of this one, and all of them after a shift of the coordinate."""
        low, high = (
            _shifted(end, unknown, move)
            for end, move in ((self.low, min(shift, 0.0)), (self.high, max(shift, 0.0)))
        )
        return replace(self, low=low, high=high)


def _shifted(end: IntervalEnd, unknown: Unknown, move: float) -> IntervalEnd:
    """Return an end of an interval after a move of its coordinate; none beyond a bound of the search."""
    if end.value is None or move == 0:
        return end
    value = unknown.value(unknown.coordinate(end.value) + move)
    if unknown.lower <= value <= unknown.upper:
        return IntervalEnd(value)
    bound = unknown.lower if move < 0 else unknown.upper
    return IntervalEnd(None, widened_words(unknown, bound))


def confidence_interval(
    objective: Objective,
    best: Minimum,
    index: int,
    tell: Callable[[str], None] = lambda text: None,
    strict: bool = True,
) -> ConfidenceInterval:
    """Return the 95 % interval of an unknown by its profile likelihood.

    The ends are where the least sum of squares over all other unknowns has risen by 3.84, the 95 % quantile of χ²
    (Wilks 1938; Venzon & Moolgavkar 1988, Appl. Statist. 37:87–94). An end is None where the profile reaches a bound of
    the search before, where a bound of another unknown alone makes it rise, or where the model cannot be computed or
    trusted.

    Raises
    ------
    LowerPoint
        ``best`` was not the minimum, and the interval is ``strict`` about that.
    """
    unknown, walks = objective.misfit.unknowns[index], list[ProfileWalk]()
    for sign, name in ((-1.0, "lower"), (1.0, "upper")):
        tell(f"{name} end of {unknown.name}")
        walk = ProfileWalk(objective, best, np.array([index]), np.array([sign]), ROOT_95, strict)
        walks.append(walk.run())
    below, above = (walk.honest for walk in walks)
    # The best point is the first one of both walks.
    points = [*((-1, each) for each in reversed(below[1:])), *((1, each) for each in above)]
    ends = [
        _end(walk, sign, objective.misfit.unknowns, index) for walk, sign in zip(walks, (-1, 1), strict=True)
    ]
    return ConfidenceInterval(
        ends[0],
        ends[1],
        np.array([point.fitted.coordinates for _, point in points]),
        np.array([sign * point.root for sign, point in points]),
    )


def _end(walk: ProfileWalk, sign: int, unknowns: Sequence[Unknown], index: int) -> IntervalEnd:
    """Return the end of an interval that a walk has found, or the reason why it has none."""
    unknown = unknowns[index]
    best = walk.best.fitted.coordinates
    if walk.end is End.crossed:
        return IntervalEnd(unknown.value(float(best[index] + sign * walk.distance)))
    furthest = max(walk.points, key=lambda each: each.distance).fitted.coordinates
    reached = unknown.value(float(furthest[index]))
    if walk.end is End.bound:
        return IntervalEnd(None, bound_words(unknown, reached))
    if walk.end is End.held:
        held = [(int(i), unknowns[i].value(float(furthest[i]))) for i in walk.held_by]
        return IntervalEnd(None, held_words(unknowns, held))
    return IntervalEnd(None, lost_words(unknown, reached, walk.end.value))
