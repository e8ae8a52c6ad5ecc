"""Ranges of four and of seven inputs, held-out states in them, and what flags that follow an error have to do."""

from __future__ import annotations

from itertools import product

import numpy as np

from porocore.core.inputs import InputSpace

FOUR = InputSpace.from_ranges({name: (-0.15, 0.1) for name in ("H11", "H22", "H33")} | {"p": (0.0, 0.2)})
SHEARED = ("H11", "H22", "H33", "H12", "H13", "H23")
SEVEN = InputSpace.from_ranges({name: (-0.1, 0.1) for name in SHEARED} | {"p": (0.0, 0.1)})


def held_out(inputs, n=400):
    """Random states, and corners."""
    unit = np.random.default_rng(8).random((n, len(inputs)))
    unit = np.concatenate([unit, list(product((0.0, 1.0), repeat=len(inputs)))])
    low, high = np.array(inputs.lower), np.array(inputs.upper)
    return inputs.scatter(low + (high - low) * unit)


def assert_follows(flagged, error, tolerance):
    wrong = error > tolerance
    assert 0.05 < wrong.mean() < 0.9
    assert flagged[wrong].mean() >= 0.9
    assert flagged[~wrong].mean() <= 0.1
