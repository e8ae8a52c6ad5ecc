"""Values that components of the state reach beyond what is sampled, and the lines that would sample them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from porocore.core.inputs.input_space import NAMES, InputSpace, components
from porocore.core.units.results import ResultUnits
from porocore.interfaces.solution import MacroSolution
from porocore.interfaces.surrogate import Surrogate
from porocore.states import Array, MacroState

#: A proposed range goes beyond what was reached by this share of its width.
MARGIN = 0.1
#: Components that one warning names.
MOST = 4
#: The reach beyond a range, as a share of its width, that is round-off.
ROUND_OFF = 1e-6
MINUS = str.maketrans("-", "−")


@dataclass(frozen=True)
class Reach:
    """Component of the state that leaves what is sampled.

    Attributes
    ----------
    name
        From ``H11`` … ``H33`` and ``p``.
    value
        Farthest of what it reaches.
    sampled
        Its sampled range; None where it was not sampled.
    low, high
        All that it reaches.
    where
        Place and time of ``value`` in words.
    """

    name: str
    value: float
    sampled: tuple[float, float] | None
    low: float
    high: float
    where: str

    def in_words(self, units: ResultUnits) -> str:
        """Return what is reached and what was sampled."""
        known = "not sampled"
        if self.sampled is not None:
            ends = ", ".join(written(self.name, end, units) for end in self.sampled)
            known = f"sampled in [{ends}]".translate(MINUS)
        value = written(self.name, self.value, units).translate(MINUS)
        # Not in the place: a surface may be called y-.
        return f"{self.name} = {value} {self.where} ({known})"

    def line(self, units: ResultUnits) -> str:
        """Return the line of the configuration that samples it."""
        ends = (*(self.sampled or (0.0, 0.0)), self.low, self.high)
        low, high = min(ends), max(ends)
        more = MARGIN * (high - low)
        inside = self.sampled or (0.0, 0.0)
        low = _outward(low - more, -1) if low < inside[0] else inside[0]
        high = _outward(high + more, 1) if high > inside[1] else inside[1]
        return f"{self.name}: {{range: [{', '.join(written(self.name, end, units) for end in (low, high))}]}}"


def written(name: str, value: float, units: ResultUnits) -> str:
    """Return a value of a component as the configuration may have it."""
    if name != "p" or not units.given or value == 0:
        return f"{value:.3g}"
    return f"{value * units.factor('pressure'):.3g} {units.units.of('pressure')}"


def advice(reached: Sequence[Reach], units: ResultUnits) -> str:
    """Return what is reached, and the lines to write."""
    shown = reached[:MOST]
    more = f"; and {len(reached) - MOST} more" if len(reached) > MOST else ""
    said = "; ".join(each.in_words(units) for each in shown)
    return f"{said}{more}. Write under 'sampling.inputs:' " + ", ".join(each.line(units) for each in reached)


def beyond(inputs: InputSpace, rows: Array, where: Sequence[str]) -> list[Reach]:
    """Return the components that leave what is sampled in ``rows`` (10, n), the worst first; ``where`` is that of each.

    A component that is no input leaves it where it is not negligible. The worst is that with the largest excess as a
    share of its range, those that are no inputs before all others.
    """
    found: list[tuple[float, Reach]] = []
    for column, name in enumerate(NAMES):
        values = rows[column]
        if name in inputs.names:
            k = inputs.names.index(name)
            ends = inputs.lower[k], inputs.upper[k]
            excess = np.maximum(ends[0] - values, values - ends[1]) / (ends[1] - ends[0])
            least, rank, sampled = ROUND_OFF, 0.0, ends
        else:
            excess, least, rank, sampled = np.abs(values), inputs.negligible, 1e6, None
        if len(excess) and np.nanmax(excess) > least:
            worst = int(np.nanargmax(excess))
            reach = Reach(
                name, float(values[worst]), sampled, float(values.min()), float(values.max()), where[worst]
            )
            found.append((rank + float(excess[worst]), reach))
    return [reach for _, reach in sorted(found, key=lambda each: -each[0])]


def flagged_place(
    solution: MacroSolution, surrogate: Surrogate, objective: bool = False, units: ResultUnits | None = None
) -> str:
    """Return which components take a body out of what is sampled, where and when, and what to write.

    Where all lie within their ranges, the first of the elements that are flagged most at the latest kept time is named
    with the component at fault. The text is empty without flagged elements.

    Parameters
    ----------
    solution
        With the surrogate; elements at its kept times are looked at.
    surrogate
        With its inputs.
    objective
        Whether the surrogate does not change when a state is turned.
    units
        Units of the results; None: without.
    """
    units = units or ResultUnits()
    shares = [float(profile.outside_training_range.max(initial=0.0)) for profile in solution.profiles]
    if not max(shares, default=0.0) > 0:
        return ""
    states, where = _flagged_elements(solution, units)
    if objective:
        states = surrogate.inputs.without_rotation(states)
    reached = beyond(surrogate.inputs, components(states), where)
    if reached:
        return f"Beyond what was sampled: {advice(reached, units)}."
    profile = solution.profiles[len(shares) - 1 - int(np.argmax(shares[::-1]))]
    element = int(np.argmax(profile.outside_training_range))
    state = MacroState(profile.grad_u[[element]], profile.element_p[[element]])
    (why,) = surrogate.reasons(state)
    example = (
        f"An example is the element {_place(solution, element, profile.time, units)}{why and ': ' + why}"
    )
    return (
        f"{example}. All lies within the sampled ranges, so more states help: raise sampling.options.count."
    )


def _flagged_elements(solution: MacroSolution, units: ResultUnits) -> tuple[MacroState, list[str]]:
    """Return the means of all elements that are flagged at a kept time, and place and time of each."""
    states, where = [], []
    for profile in solution.profiles:
        (flagged,) = np.nonzero(profile.outside_training_range > 0)
        if len(flagged):
            states.append(MacroState(profile.grad_u[flagged], profile.element_p[flagged]))
            where += [_place(solution, int(element), profile.time, units) for element in flagged]
    return MacroState.concatenate(states), where


def _place(solution: MacroSolution, element: int, time: float, units: ResultUnits) -> str:
    centre = solution.points[solution.cells[element]].mean(axis=0) * units.factor("displacement")
    at = f"at ({', '.join(f'{x:.3g}' for x in centre)})"
    at += f" {units.name('displacement')}" if units.given else ""
    return f"{at} at t = {units.text(time, 'time', 3)}"


def _outward(value: float, sign: int) -> float:
    """Return a number of two digits that is not nearer to the other end than ``value``."""
    if value == 0:
        return 0.0
    step = 10.0 ** (math.floor(math.log10(abs(value))) - 1)
    return float(f"{sign * math.ceil(sign * value / step - 1e-9) * step:.6g}")
