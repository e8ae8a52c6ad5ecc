"""Forecast of the states that a campaign still has to solve, and of what they cost."""

from __future__ import annotations

import numpy as np

from porocore.core.inputs.input_space import InputSpace
from porocore.states import Array

#: A state at the edge of the box of displacement gradients costs so many times as much more than one at rest: it takes
#: more steps of the load, and walls of pores come into contact. Pressure alone costs next to nothing.
FARTHER = 7.0
#: States of the box from which the cost of its mean state is told.
POINTS = 512
#: At most so many states are believed to be added for each that is solved.
MOST_ADDED = 0.75


class StateForecast:
    """Forecast of the work that is left, in units of the cost of a state near rest.

    Where states start from one another, as in sweeps, those to come lie farther out than those before, and cost more.
    Elsewhere they are like those before. A sampler that has added states goes on to add as many for each that is solved
    as among the later half.
    """

    def __init__(self, inputs: InputSpace) -> None:
        low, high = np.array(inputs.lower), np.array(inputs.upper)
        self._reach = np.maximum(np.abs(low), np.abs(high))
        moving = np.array([name != "p" for name in inputs.names])
        self._moving = moving if moving.any() else ~moving
        cloud = low + (high - low) * np.random.default_rng(0).random((POINTS, len(inputs)))
        self._mean = float(self._cost(cloud).mean())
        self._outward = False
        self._foreseen: list[int] = []
        self._done = 0.0

    def add(self, x: tuple[float, ...], expected: int, *, outward: bool) -> None:
        """Take a state that is known, and how many the sampler foresees in all; ``outward``: it began from another."""
        self._outward |= outward
        self._foreseen.append(expected)
        self._done += float(self._cost(np.array([x]))[0])

    @property
    def work(self) -> tuple[float, float]:
        """Work that is done, and work that is left."""
        count = len(self._foreseen)
        if not count:
            return 0.0, 1.0
        half, expected = count // 2, self._foreseen[-1]
        added = max(expected - self._foreseen[half], 0) / max(count - 1 - half, 1)
        alike = max(expected - count, 0) * self._done / count
        left = max(expected * self._mean - self._done, alike) if self._outward and alike else alike
        return self._done, left / (1 - min(added, MOST_ADDED))

    def _cost(self, x: Array) -> Array:
        """Return the cost of states, (n,)."""
        cost: Array = 1 + FARTHER * (np.abs(x) / self._reach)[:, self._moving].max(axis=1) ** 2
        return cost
