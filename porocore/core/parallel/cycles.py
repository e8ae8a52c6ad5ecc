"""Collection of objects that refer to one another (CycleCollection), at a small share of the time."""

from __future__ import annotations

import gc
from collections.abc import Callable
from time import perf_counter

#: Time between two collections, in times of the first: they take at most about a tenth of all time.
PAUSE = 10.0


class CycleCollection:
    """Calls of Python's collector that are left out while they would cost too much.

    A call takes 0.05 s with the libraries of a study loaded, and a second in a large session, as long as the solves of
    some small cells. What is left behind by solves of so short a time is small.

    Parameters
    ----------
    clock
        Time in seconds.
    """

    def __init__(self, clock: Callable[[], float] = perf_counter) -> None:
        self._clock, self._next = clock, -float("inf")

    def offer(self) -> None:
        """Collect, unless the last call was too short a time ago."""
        began = self._clock()
        if began < self._next:
            return
        gc.collect()
        ended = self._clock()
        self._next = ended + PAUSE * (ended - began)
