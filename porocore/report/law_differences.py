"""Differences of laws on one problem: between closures, and of surrogates from direct FE²."""

from __future__ import annotations

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
    "drained": "drained volume",
}
SAME_TIME = 1e-9


def history_difference(reference: History, other: History, quantity: str) -> dict[str, float] | None:
    """Return the difference of one history for JSON, in per cent of the largest magnitude of the reference.

    Returns
    -------
    dict or None
        ``end_percent``, signed; ``largest_percent``, the largest magnitude over the times that both solutions have, and
        ``time_of_largest``. None where the reference is zero or no time is common.
    """
    rows, columns = _common(reference.time, other.time)
    one, two = getattr(reference, quantity)[rows], getattr(other, quantity)[columns]
    scale = float(np.abs(one).max(initial=0.0))
    if scale == 0:
        return None
    apart = 100 * (two - one) / scale
    worst = int(np.abs(apart).argmax())
    return {
        "end_percent": float(apart[-1]),
        "largest_percent": float(abs(apart[worst])),
        "time_of_largest": float(reference.time[rows][worst]),
    }


def law_differences(case: LoadCase) -> list[dict[str, Any]]:
    """Return the differences of all pairs of nonlinear laws of a load for JSON; the more exact one is the reference."""
    found = []
    for pair in combinations((case.nonlinear, *case.others), 2):
        reference, other = sorted(pair, key=_exactness)
        differences = {name: history_difference(reference.history, other.history, name) for name in COMPARED}
        found.append({"law": other.law, "reference": reference.law, **differences})
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
