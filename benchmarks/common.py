"""Timing that stands a shared machine: the best of several runs, and ratios within one process.

One thread is set by ``run.py``, before numpy is imported.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any


def best(work: Callable[[], Any], runs: int = 3) -> tuple[float, Any]:
    """Shortest wall time [s] of several runs, and the last result."""
    times, result = [], None
    for _ in range(runs):
        began = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - began)
    return min(times), result


def in_turn(works: Sequence[Callable[[], Any]], rounds: int = 6) -> tuple[list[float], list[Any]]:
    """Shortest processor time [s] of works that take turns, and their last results.

    The first round is not counted: it enlarges the memory of the process. Other work on the machine adds to the wall
    time of all, but by chance more to that of one than to another.
    """
    times: list[list[float]] = [[] for _ in works]
    results: list[Any] = [None] * len(works)
    for counted in range(rounds + 1):
        for place, work in enumerate(works):
            began = time.process_time()
            results[place] = work()
            if counted:
                times[place].append(time.process_time() - began)
    return [min(each) for each in times], results


def table(title: str, header: list[str], rows: list[list[str]]) -> str:
    """A Markdown table under a heading."""
    lines = [f"## {title}", "", "| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"
