"""Comparison of responses in the suites, values and slopes; states moved by one component."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from porocore.states import Array, CellResponse, MacroState
from porocore.testing.expect import holds, require, same

Check = Callable[[str, Any, Any, str], None]
RESPONSES = ("mean_grad", "potential", "stress", "fluid_volume")
#: Responses with the names of their derivatives in :class:`~porocore.states.CellTangent`.
DERIVATIVES = {name: (f"{name}_grad_u", f"{name}_p") for name in ("mean_grad", "stress", "fluid_volume")}


def with_derivatives(response: CellResponse) -> Iterator[tuple[str, tuple[Array, Array]]]:
    """Responses that come with both derivatives, and those: with respect to H and to p."""
    for name, (by_H, by_p) in DERIVATIVES.items():
        slopes = getattr(response.tangent, by_H), getattr(response.tangent, by_p)
        if getattr(response, name) is not None and slopes[0] is not None and slopes[1] is not None:
            yield name, slopes


def perturbed(states: MacroState, column: int, step: float) -> MacroState:
    """The states with one of the ten components (H row by row, then p) moved."""
    flat, p = states.grad_u.reshape(-1, 9).copy(), states.p.copy()
    if column == 9:
        p += step
    else:
        flat[:, column] += step
    return replace(states, grad_u=flat.reshape(-1, 3, 3), p=p)


def assert_identical(found: CellResponse, expected: CellResponse, state: str) -> None:
    """Raise a violation unless both are alike to the last bit, derivatives and flags included."""
    assert_alike(found, expected, state, same, same)


def assert_alike(found: CellResponse, expected: CellResponse, state: str, value: Check, slope: Check) -> None:
    """Check values and slopes, given name, found, expected and state; flags are alike to the last bit."""
    same(
        "outside_training_range",
        require("outside_training_range", found.outside_training_range, state),
        require("outside_training_range", expected.outside_training_range, state),
        state,
    )
    for name in RESPONSES:
        if getattr(expected, name) is not None:
            value(name, getattr(found, name), getattr(expected, name), state)
    slopes, others = dict(with_derivatives(found)), dict(with_derivatives(expected))
    holds(slopes.keys() == others.keys(), state, f"derivatives of {sorted(others)}", sorted(slopes))
    for name in others:
        for what, a, b in zip(("H", "p"), slopes[name], others[name], strict=True):
            slope(f"d{name}/d{what}", a, b, state)


def global_random_state() -> tuple[Any, ...]:
    """Return the states of Python's and numpy's global random number generators."""
    name, keys, *place = np.random.get_state()  # noqa: NPY002
    return random.getstate(), name, np.asarray(keys).tobytes(), place
