"""Differences of laws on one problem: between closures, and of surrogates from direct FE²."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from porocore.interfaces.solution import History, MacroSolution
from porocore.report.metrics import LoadCase
from porocore.states import Array

#: Histories that are compared, with their names for a reader.
COMPARED = {
    "settlement": "settlement",
    "pressure_max": "largest pore pressure",
    "drained_flux": "drained volume",
}
SAME_TIME = 1e-9


@dataclass(frozen=True)
class HistoryDifference:
    """Difference of one history, in per cent of the largest magnitude that the reference has over time.

    Attributes
    ----------
    end
        At the end, signed.
    largest
        Largest magnitude over the times that both solutions have.
    time
        Where that is.
    """

    end: float
    largest: float
    time: float


def history_difference(reference: History, other: History, quantity: str) -> HistoryDifference | None:
    """Return the difference of one field of :class:`History`; None where the reference is zero or no time is common."""
    rows, columns = _common(reference.time, other.time)
    one, two = getattr(reference, quantity)[rows], getattr(other, quantity)[columns]
    scale = float(np.abs(one).max(initial=0.0))
    if scale == 0:
        return None
    apart = 100 * (two - one) / scale
    worst = int(np.abs(apart).argmax())
    return HistoryDifference(float(apart[-1]), float(abs(apart[worst])), float(reference.time[rows][worst]))


def law_differences(case: LoadCase) -> list[dict[str, Any]]:
    """Return the differences of all pairs of nonlinear laws of a load for JSON; the more exact one is the reference."""
    found = []
    for pair in combinations((case.nonlinear, *case.others), 2):
        reference, other = sorted(pair, key=_exactness)
        differences = {name: history_difference(reference.history, other.history, name) for name in COMPARED}
        found.append(
            {
                "law": other.law,
                "reference": reference.law,
                **{
                    name: None
                    if value is None
                    else {
                        "end_percent": value.end,
                        "largest_percent": value.largest,
                        "time_of_largest": value.time,
                    }
                    for name, value in differences.items()
                },
            }
        )
    return found


def _exactness(solution: MacroSolution) -> tuple[bool, bool]:
    """Return the sorting key: cells before surrogates, the exact closure before the other."""
    return not solution.law.startswith("direct-"), solution.law.endswith("mean-gradient")


def _common(one: Array, other: Array) -> tuple[Any, Any]:
    """Return rows of equal times; a solution that had to halve its steps has more."""
    near = np.searchsorted(other, one)
    near = np.clip(near, 1, len(other) - 1)
    near -= np.abs(other[near - 1] - one) < np.abs(other[near] - one)
    rows = np.flatnonzero(np.abs(other[near] - one) <= SAME_TIME * np.maximum(1.0, one))
    return rows, near[rows]
