"""95 % intervals of numbers that follow from the unknowns of a fit, such as a modulus (derived_intervals)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from porocore.calibration.inference.infer import Inference
from porocore.calibration.inference.intervals import ROOT_95, IntervalEnd
from porocore.states import Array

#: Step of the differences that give slopes, as a share of the range of the search.
STEP = 1e-4
#: An end is none where the data allow values so many times as far away, along a profile without end.
MOST = 1.1
#: Differences that are round-off.
ROUND_OFF = 1e-9


def derived_intervals(
    inference: Inference, numbers: Callable[[Array], Mapping[str, float]], linear: Callable[[str], bool]
) -> dict[str, tuple[float, IntervalEnd, IntervalEnd]]:
    """Return value and ends of the 95 % interval of each number, by the covariance of the fit (delta method).

    The intervals hold the values of exact curves, too, where those of the unknowns do. An end is None where the data do
    not see the number, where on the way to it an unknown meets a bound of the search, or where the profile of an
    unknown without end leads beyond it.

    Parameters
    ----------
    inference
        Of the fit.
    numbers
        Numbers by name as a function of the values (k,) of the unknowns.
    linear
        True for a name whose interval is symmetric; those of other numbers, which are positive, are in the logarithm.
    """
    unknowns, x = inference.unknowns, inference.best.coordinates
    spans = np.array([one.coordinate(one.upper) - one.coordinate(one.lower) for one in unknowns])

    def at(coordinates: Array) -> Mapping[str, float]:
        return numbers(np.array([one.value(float(c)) for one, c in zip(unknowns, coordinates, strict=True)]))

    best = at(x)
    moved = [(at(x + step), at(x - step)) for step in np.diag(STEP * spans)]
    open_paths = [(name, [at(c) for c in path]) for name, path in _open_paths(inference)]
    found = {}
    for name, value in best.items():
        form, back = (np.asarray, np.asarray) if linear(name) else (np.log, np.exp)
        slopes = np.array([form(up[name]) - form(down[name]) for up, down in moved]) / (2 * STEP * spans)
        allowed = [(words, form([each[name] for each in path])) for words, path in open_paths]
        ends = _ends(inference, slopes, float(form(value)), allowed)
        low, high = (
            IntervalEnd(None if end.value is None else float(back(end.value)), end.reason) for end in ends
        )
        found[name] = (value, low, high)
    return found


def _open_paths(inference: Inference) -> Iterator[tuple[str, Array]]:
    """Yield the part (n, k) of each profile towards an end that is none, with words for it; the data allow it all."""
    for i, (one, interval) in enumerate(zip(inference.unknowns, inference.intervals, strict=True)):
        away = interval.coordinates[:, i] - inference.best.coordinates[i]
        for end, side, which in ((interval.low, away < 0, "lower"), (interval.high, away > 0, "upper")):
            if end.value is None:
                yield f"{one.name}, which has no {which} end", interval.coordinates[side]


def _ends(
    inference: Inference, slopes: Array, value: float, allowed: Sequence[tuple[str, Array]]
) -> tuple[IntervalEnd, IntervalEnd]:
    """Return both ends of a number with slopes (k,) by the coordinates, and ``allowed`` values along open profiles."""
    covariances, deviation = inference.with_priors.moves_with(slopes)
    if not np.isfinite(deviation):
        end = IntervalEnd(None, "the data do not see it")
        return end, end
    error = inference.systematic
    systematic = float(slopes @ error.shift) if error is not None and error.counted else 0.0
    ends = []
    for side in (-1.0, 1.0):
        steps = side * ROOT_95 * covariances / deviation if deviation else 0 * covariances
        reached, room = inference.best.coordinates + steps, side * ROOT_95 * deviation
        beyond = [
            words
            for words, values in allowed
            if (side * (values - value) > MOST * abs(room) + ROUND_OFF).any()
        ]
        bounded = [
            one.name
            for one, x in zip(inference.unknowns, reached, strict=True)
            if not one.coordinate(one.lower) <= x <= one.coordinate(one.upper)
        ]
        if bounded:
            ends.append(IntervalEnd(None, f"{bounded[0]} meets a bound of the search"))
        elif beyond:
            ends.append(IntervalEnd(None, f"it moves with {beyond[0]}"))
        else:
            ends.append(IntervalEnd(value + room + side * max(side * systematic, 0.0)))
    return ends[0], ends[1]
