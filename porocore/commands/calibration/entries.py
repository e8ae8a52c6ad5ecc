"""Entries of an inference for a JSON file, and intervals of numbers that follow from the unknowns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from porocore.commands.calibration.infer import Inference
from porocore.commands.calibration.profiles import ROOT_95, ConfidenceInterval, IntervalEnd
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
    not determine the number, where on the way to it an unknown meets a bound of the search, or where the profile of an
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
        end = IntervalEnd(None, "the data do not determine it")
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


def unknown_entries(inference: Inference) -> dict[str, dict[str, Any]]:
    """Return value, unit, intervals and identifiability of each unknown, by its name.

    ``interval95`` counts the priors, ``interval95_without_prior`` does not; an end that the data do not set is None,
    and ``open_ends`` has the reason. ``deviation`` is that of ln x where the scale is ``log``, to first order. It is
    ``identifiable`` if the ends without priors lie within ``resolution`` of the value.
    """
    return {
        one.name: {
            "value": float(inference.values[i]),
            "unit": one.unit,
            "scale": one.scale,
            "interval95": list(inference.intervals[i].values),
            "interval95_without_prior": list(inference.data_intervals[i].values),
            "open_ends": _reasons(inference.data_intervals[i]),
            "deviation": _finite(inference.with_priors.deviations[i]),
            "deviation_without_prior": _finite(inference.without_priors.deviations[i]),
            "identifiable": inference.identifiable[i],
            "resolution": inference.rule.distance(one, float(inference.values[i])),
        }
        for i, one in enumerate(inference.unknowns)
    }


def direction_entries(inference: Inference) -> list[dict[str, Any]]:
    """Return the unseen directions in words and numbers, by the names of the unknowns.

    ``direction`` is a unit vector over the coordinates, which are ln x where the scale is ``log``; ``deviation`` is the
    standard deviation along it, None where the data do not depend on it. ``step`` changes no measured value by more
    than ``largest_change`` of its standard deviations. The model does not depend on one that is ``exact``.
    """
    names = [one.name for one in inference.unknowns]
    return [
        {
            "words": words,
            "direction": _by_name(names, each.direction),
            "deviation": _finite(each.deviation),
            "step": _by_name(names, each.step),
            "largest_change": each.change,
            "exact": each.exact,
        }
        for words, each in zip(inference.words, inference.directions, strict=True)
    ]


def product_entries(inference: Inference) -> dict[str, dict[str, Any]]:
    """Return value, unit and 95 % interval of the identifiable products of powers, by their names."""
    return {
        each.name: {"value": each.value, "unit": each.unit, "interval95": list(each.interval)}
        for each in inference.products
    }


def precision_entries(inference: Inference) -> dict[str, Any]:
    """Return singular values without priors, and correlations without and with them; None where they mean nothing."""
    names = [one.name for one in inference.unknowns]

    def correlations(found: Array) -> dict[str, dict[str, float | None]]:
        rows = zip(names, found, strict=True)
        return {name: {other: _finite(x) for other, x in zip(names, row, strict=True)} for name, row in rows}

    alone = inference.correlations
    with_priors = (
        inference.with_priors.correlations if any(u.has_prior for u in inference.unknowns) else alone
    )
    return {
        "singular_values": inference.without_priors.singular_values.tolist(),
        "correlations": correlations(with_priors),
        "correlations_without_priors": correlations(alone),
    }


def systematic_entry(inference: Inference) -> dict[str, Any] | None:
    """Return the known error of the curves and how it moves the best values, by the names; None: none is known.

    ``largest_error`` is that of a value in its standard deviations; ``shift`` is what exact curves would add to the
    values, ``shift_in_deviations`` the same to first order in standard deviations of each unknown. The intervals hold
    the values of exact curves where it is ``counted``.
    """
    found = inference.systematic
    if found is None:
        return None
    names, best = [one.name for one in inference.unknowns], inference.best.coordinates
    moved = [one.value(float(x)) for one, x in zip(inference.unknowns, best + found.shift, strict=True)]
    return {
        "largest_error": float(np.abs(found.errors).max()),
        "shift": _by_name(names, np.array(moved) - inference.values),
        "shift_in_deviations": _by_name(names, found.deviations),
        "largest_shift_in_deviations": found.size,
        "counted": found.counted,
    }


def suggestion_entries(inference: Inference) -> list[dict[str, Any]]:
    """Return further data that help, the best first; a gain of the smallest singular value that is None is infinite.

    ``unseen`` directions are left with them.
    """
    return [
        {"data": each.name, "gain": _finite(each.gain), "least": each.least, "unseen": each.unseen}
        for each in inference.suggestions
        if each.helps
    ]


def _reasons(interval: ConfidenceInterval) -> dict[str, str]:
    ends = {"low": interval.low, "high": interval.high}
    return {name: end.reason for name, end in ends.items() if end.value is None}


def _by_name(names: list[str], values: Array) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def _finite(value: float) -> float | None:
    """Return a number that JSON has, None for an infinite one."""
    return float(value) if np.isfinite(value) else None
