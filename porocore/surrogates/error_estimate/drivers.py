"""Component of the state that drives a flagged state out, in words."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from porocore.core.inputs.input_space import NAMES, InputSpace, components, value_text
from porocore.states import Array, MacroState

#: Share of its range by which a component is moved inwards to see whether it drives the error.
WITHIN = 0.25
#: The last words of a reason with an estimated error.
ERROR_END = "of the range"
MINUS = str.maketrans("-", "−")


def reasons(
    inputs: InputSpace, states: MacroState, estimate: Callable[[MacroState], Array] | None
) -> list[str]:
    """Return for each of n flagged states which component drives it out, with its value.

    A component that was not sampled comes first, then the one that lies farthest beyond its range; within all ranges
    it is the one without which the estimated error would be smallest, moved to the inner half of its range.

    Parameters
    ----------
    inputs
        The sampled inputs.
    states
        The flagged states, without rotation if the surrogate is objective.
    estimate
        Error of states as a share of the range of what is learned, (n,); None where there is no estimate.
    """
    rows = components(states)
    others = [column for column in range(10) if column not in inputs.columns]
    beyond = np.abs(rows[others])
    unit = inputs.to_unit(inputs.gather(states))
    excess = np.maximum(unit - 1, -unit)
    within = _smallest(inputs, states, unit, estimate)
    found = []
    for n in range(len(states)):
        if others and not beyond[:, n].max() <= inputs.negligible:
            column = others[int(np.nanargmax(beyond[:, n]))]
            found.append(f"{_value(NAMES[column], rows[column, n])}, which was not sampled")
            continue
        k = int(np.argmax(excess[n])) if estimate is None or excess[n].max() > 1e-9 else within[0][n]
        said = _value(inputs.names[k], rows[inputs.columns[k], n])
        ends = inputs.range_text(inputs.names[k]).translate(MINUS)
        said += f", beyond {ends}" if excess[n, k] > 1e-9 else f" in {ends}"
        if estimate is not None and np.isfinite(within[1][n]):
            said += f", where the estimated error is {100 * within[1][n]:.2g} % {ERROR_END}"
        found.append(said)
    return found


def _smallest(
    inputs: InputSpace, states: MacroState, unit: Array, estimate: Callable[[MacroState], Array] | None
) -> tuple[list[int], Array]:
    """Return the input of each state without which the error would be smallest, and the error as it is."""
    if estimate is None:
        return [], np.full(len(states), np.nan)
    low, span = np.array(inputs.lower), np.array(inputs.upper) - np.array(inputs.lower)
    errors = []
    for k in range(len(inputs)):
        moved = unit.copy()
        moved[:, k] = np.clip(moved[:, k], WITHIN, 1 - WITHIN)
        errors.append(estimate(inputs.scatter(low + span * moved)))
    return [int(k) for k in np.argmin(np.nan_to_num(errors, nan=np.inf), axis=0)], estimate(states)


def _value(name: str, value: float) -> str:
    return f"{name} = {value_text(name, value, 3)}".translate(MINUS)
