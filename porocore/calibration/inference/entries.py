"""Entries of an inference for a JSON file: unknowns, directions, precision, suggestions."""

from __future__ import annotations

from typing import Any

import numpy as np

from porocore.calibration.inference.infer import Inference
from porocore.calibration.inference.intervals import ConfidenceInterval
from porocore.calibration.inference.precision import LinearPrecision
from porocore.states import Array


def unknown_entries(inference: Inference) -> dict[str, dict[str, Any]]:
    """Return value, unit, intervals and identifiability of each unknown, by its name.

    ``interval95`` counts the priors, ``interval95_without_prior`` does not; an end that the data do not set is None,
    and ``open_ends`` has the reason. ``deviation`` is that of ln x where the scale is ``log``, to first order.
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
        }
        for i, one in enumerate(inference.unknowns)
    }


def direction_entries(inference: Inference) -> list[dict[str, Any]]:
    """Return the unseen directions in words and numbers, by the names of the unknowns.

    ``direction`` is a unit vector over the coordinates, which are ln x where the scale is ``log``; ``deviation`` is the
    standard deviation along it, None where the data see nothing of it. ``step`` changes no measured value by more than
    ``largest_change`` of its standard deviations.
    """
    names = [one.name for one in inference.unknowns]
    return [
        {
            "words": words,
            "direction": _by_name(names, each.direction),
            "deviation": _finite(each.deviation),
            "step": _by_name(names, each.step),
            "largest_change": each.change,
        }
        for words, each in zip(inference.words, inference.directions, strict=True)
    ]


def precision_entries(inference: Inference) -> dict[str, Any]:
    """Return singular values without priors, and correlations without and with them."""
    names = [one.name for one in inference.unknowns]

    def correlations(precision: LinearPrecision) -> dict[str, dict[str, float]]:
        return {name: _by_name(names, row) for name, row in zip(names, precision.correlations, strict=True)}

    return {
        "singular_values": inference.without_priors.singular_values.tolist(),
        "correlations": correlations(inference.with_priors),
        "correlations_without_priors": correlations(inference.without_priors),
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
