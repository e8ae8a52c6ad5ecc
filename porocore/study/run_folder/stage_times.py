"""Seconds that each stage has taken, over all runs that resumed it; clock of a stage."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from porocore.core.files.totals import Numbers, added_up, read_totals
from porocore.core.parallel.calls import Call, CallProcesses
from porocore.errors import PorocoreError


class StageTime(NamedTuple):
    """Seconds of a stage, over all runs that worked on it: one, and one more for each time that it was resumed.

    They are those of an empty store: ``saved`` of them were not spent, because a store held results.
    """

    seconds: float
    runs: int
    saved: float = 0.0


class StageClock:
    """Clock of a running stage, which counts what stored results had taken as if it were taken now.

    Attributes
    ----------
    idle
        True if the stage found its work done, so that its time is not to be added.
    now
        Tells the time; another clock where another process works.
    """

    def __init__(self, now: Callable[[], float] = time.perf_counter) -> None:
        self.now = now
        self._began, self._saved, self.idle = now(), 0.0, False

    @property
    def seconds(self) -> float:
        """Seconds so far, stored results included."""
        return self.now() - self._began + self._saved

    @property
    def saved(self) -> float:
        """Seconds that stored results had taken."""
        return self._saved

    def add(self, seconds: float) -> None:
        """Count the seconds that a result from the store had taken."""
        self._saved += seconds


@contextmanager
def timed(path: Path, stage: str, clock: StageClock | None = None) -> Iterator[StageClock]:
    """Add the block's wall time to what ``stage`` has taken so far, also when the block is interrupted.

    Yields the clock of the block, a new one unless it is given.

    Raises
    ------
    DataError
        The record at ``path`` is damaged; the block is not run.
    RunFolderError
        The disk is full or read-only.
    """
    clock = clock or StageClock()

    def gained() -> Numbers:
        return {} if clock.idle else {"seconds": clock.seconds, "runs": 1, "saved": clock.saved}

    with added_up(path, _record, stage, gained):
        yield clock


@contextmanager
def cut_short_timed(path: Path, calls: Mapping[str, Call], processes: CallProcesses) -> Iterator[None]:
    """Add the times of the calls by stage if the block is interrupted; the calls end with it."""
    try:
        yield
    except BaseException:
        while processes.receive(0.0):
            pass
        for stage, call in calls.items():
            if call.began is not None:
                with suppress(PorocoreError), timed(path, stage, StageClock(call.time)):
                    call.catch_up()
        raise


def stage_times(path: Path) -> dict[str, StageTime]:
    """Return the times by stage; empty before the first.

    Raises
    ------
    DataError
        The record is damaged.
    """
    return {
        stage: StageTime(entry["seconds"], int(entry["runs"]), entry["saved"])
        for stage, entry in _record(path).items()
    }


def _record(path: Path) -> dict[str, Numbers]:
    return read_totals(path, "the stages' times", _numbers)


def _numbers(entry: Any) -> Numbers:
    # Folders of porocore 0.1 have the seconds alone.
    entry = entry if isinstance(entry, dict) else {"seconds": entry, "runs": 1}
    return {
        "seconds": float(entry["seconds"]),
        "runs": int(entry["runs"]),
        "saved": float(entry.get("saved", 0.0)),
    }
