"""Forecast of the states that a campaign still has to solve, and of the time that they take."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from porocore.core.inputs import InputSpace
from porocore.interfaces.sampler import Outlook
from porocore.states import Array

#: A state at the edge of the box of displacement gradients costs at most so many times as much more than one at rest:
#: it takes more steps of the load, and walls of pores come into contact. Pressure alone costs next to nothing.
FARTHER = 7.0
#: States of the box from which the cost of its mean state is estimated.
POINTS = 512
#: At most so many states are believed to be added for each that is solved.
MOST_ADDED = 0.75
#: The first state of a worker costs so many times as much as a later one: it compiles, and fills caches. Measured 1.5
#: to 5.
FIRST = 2.5
#: From so many solved states the pace of the campaign gives their time; before, the times of the solves themselves,
#: beside which the guess counts as one state.
PACED = 8


@dataclass(frozen=True)
class Guess:
    """Knowledge of times before anything is measured.

    Attributes
    ----------
    workers
        Number of states that are solved at once.
    start
        Seconds until the workers are ready.
    state
        Seconds of a mean state.
    decision
        Seconds of a decision of the sampler on a further round.
    first
        The first state of a worker costs so many times as much as a later one.
    """

    workers: int = 1
    start: float = 0.0
    state: float = 0.0
    decision: float = 0.0
    first: float = FIRST


class StateForecast:
    """Forecast of the work that is left, in units of the cost of a state near rest, and of its seconds.

    Where states start from one another, as in sweeps, those to come lie farther out than those before, and cost more.
    Elsewhere they are like those before. A sampler that has added states goes on to add as many for each that is solved
    as among the later half. For one that may end before its budget, the geometric mean of the fewest and the most
    states that may still come is taken.

    Times are those of the solves in their workers at first, so that the start of the workers is no part of the cost of
    a state, then the pace of the later half; decisions on further rounds take as long as the last one.
    """

    def __init__(self, inputs: InputSpace, guess: Guess | None = None) -> None:
        low, high = np.array(inputs.lower), np.array(inputs.upper)
        self._reach = np.maximum(np.abs(low), np.abs(high))
        moving = np.array([column < 9 for column in inputs.columns])
        self._moving = moving if moving.any() else ~moving
        cloud = low + (high - low) * np.random.default_rng(0).random((POINTS, len(inputs)))
        self._mean = float(self._cost(cloud).mean())
        self._guess = Guess() if guess is None else guess
        self._outward = False
        self._foreseen: list[int] = []
        self._outlook = Outlook(1, 1)
        self._done = 0.0
        #: Works of the solved states, and the seconds that their workers took.
        self._works: list[float] = []
        self._seconds: list[float] = []
        self._decision: float | None = None
        #: Seconds without decisions, and work done, at the end of each solve.
        self._known: list[tuple[float, float]] = []
        self._deciding = 0.0

    def add(
        self,
        x: tuple[float, ...],
        expected: int,
        *,
        outward: bool,
        seconds: float | None = None,
        now: float = 0.0,
    ) -> None:
        """Take a state that is known.

        Parameters
        ----------
        x
            Its inputs.
        expected
            How many the sampler foresees in all.
        outward
            True if it began from another.
        seconds
            What its solve took; None: it was known already, and says nothing about times.
        now
            Seconds since the campaign began.
        """
        self._outward |= outward
        self._foreseen.append(expected)
        self._outlook = Outlook(expected, expected)
        work = float(self._cost(np.array([x]))[0])
        self._done += work
        if seconds is not None:
            self._works.append(work)
            self._seconds.append(seconds)
            self._known.append((now - self._deciding, sum(self._works)))

    def look(self, outlook: Outlook) -> None:
        """Take what the sampler foresees now."""
        self._outlook = outlook

    def decided(self, seconds: float) -> None:
        """Take the seconds of a decision on a further round."""
        self._decision, self._deciding = seconds, self._deciding + seconds

    @property
    def states(self) -> float:
        """Number of states that are still to come."""
        count, outlook = len(self._foreseen), self._outlook
        fewest, most = outlook.fewest - count, outlook.expected - count
        return math.sqrt(max(fewest, 1) * most) if most > 0 else 0.0

    @property
    def work(self) -> tuple[float, float]:
        """Work that is done, and work that is left."""
        count = len(self._foreseen)
        if not count:
            return 0.0, self.states * self._mean
        half, expected, states = count // 2, self._foreseen[-1], self.states
        added = max(expected - self._foreseen[half], 0) / max(count - 1 - half, 1)
        # The first ones, such as the state at rest, are not typical.
        left = states * (self._done / count if count > self._guess.workers else self._mean)
        if self._outward and left:
            left = max((count + states) * self._mean - self._done, left)
        return self._done, left / (1 - min(added, MOST_ADDED))

    @property
    def decisions(self) -> float:
        """Number of decisions that are still to come."""
        outlook, count = self._outlook, len(self._foreseen)
        if not outlook.batch or (outlook.expected <= count and outlook.asked <= count):
            return 0.0
        return max(count + self.states - outlook.asked, 0.0) / outlook.batch + 1

    def seconds(self) -> float | None:
        """Return the seconds that are left; None if nothing is known about them."""
        guess, work = self._guess, self.work[1]
        decisions = self.decisions * (guess.decision if self._decision is None else self._decision)
        pace = self._pace()
        if pace is None:
            if not guess.state:
                return None
            first = guess.start + (guess.first - 1) * guess.state
            return first + work / self._mean * guess.state / self._at_once + decisions
        return work * pace + decisions

    @property
    def _at_once(self) -> float:
        """Number of states that are still solved at once."""
        return min(self._guess.workers, max(self.states, 1.0))

    def _pace(self) -> float | None:
        """Return the seconds of the campaign for one unit of work; None before the first."""
        guess = self._guess
        if len(self._known) < PACED:
            pace = self._pace_of_workers()
            if pace is not None and guess.state:
                share = 1 / (1 + max(len(self._known) - guess.workers, 1))
                pace = pace ** (1 - share) * (guess.state / self._mean) ** share
            return None if pace is None else pace / self._at_once
        first, (end, reached) = self._known[0][1], self._known[-1]
        k = bisect_left(self._known, first + (reached - first) / 2, key=itemgetter(1))
        start, before = self._known[min(k, len(self._known) - 2)]
        return (end - start) / (reached - before)

    def _pace_of_workers(self) -> float | None:
        """Return the seconds of one unit of work in a worker; None before the first."""
        guess, works, seconds = self._guess, self._works, self._seconds
        if len(works) <= guess.workers:
            return sum(seconds) / sum(works) / guess.first if works else None
        return sum(seconds[guess.workers :]) / sum(works[guess.workers :])

    def _cost(self, x: Array) -> Array:
        """Return the cost of states, (n,)."""
        cost: Array = 1 + FARTHER * (np.abs(x) / self._reach)[:, self._moving].max(axis=1) ** 2
        return cost
