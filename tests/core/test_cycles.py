"""Collections of objects that refer to one another take a small share of the time."""

from __future__ import annotations

import weakref
from itertools import count

from porocore.core.parallel.calls import PAUSE, CycleCollection


class Circle:
    def __init__(self) -> None:
        self.itself = self


def test_a_collection_is_left_out_until_ten_times_its_duration_has_passed() -> None:
    times = iter([0.0, 0.5, 0.5 + 0.4 * PAUSE, 0.5 + 0.6 * PAUSE, 99.0])
    collection = CycleCollection(lambda: next(times))
    freed = []
    for _ in range(3):
        circle = weakref.ref(Circle())
        collection.offer()
        freed.append(circle() is None)
    assert freed == [True, False, True]


def test_collections_of_a_busy_session_take_a_tenth_of_the_time() -> None:
    """Each reading of the clock is a second after the last, as if all took as long."""
    clock, called = count(), list[int]()

    def tick() -> float:
        called.append(next(clock))
        return float(called[-1])

    collection = CycleCollection(tick)
    for _ in range(200):
        collection.offer()
    collections = len(called) - 200
    assert 0.08 < collections / len(called) < 0.12
