"""Seconds that each stage of a run has taken, summed over all runs that resumed it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from porocore.core.files.atomic import noted_afterwards
from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import read_json
from porocore.errors import DataError


class StageTime(NamedTuple):
    """Seconds of a stage, over all runs that worked on it: one, and one more for each time that it was resumed."""

    seconds: float
    runs: int


@contextmanager
def timed(path: Path, stage: str) -> Iterator[None]:
    """Add the block's wall time to what ``stage`` has taken so far, also when the block is interrupted.

    Raises
    ------
    DataError
        The record at ``path`` is damaged; the block is not run.
    RunFolderError
        The disk is full or read-only.
    """
    record = stage_times(path)
    began = time.perf_counter()

    def note() -> None:
        seconds, runs = record.get(stage, (0.0, 0))
        record[stage] = StageTime(seconds + time.perf_counter() - began, runs + 1)
        write_json(path, {name: each._asdict() for name, each in record.items()}, indent=2)

    with noted_afterwards(note):
        yield


def stage_times(path: Path) -> dict[str, StageTime]:
    """Return the times by stage; empty before the first.

    Raises
    ------
    DataError
        The record is damaged.
    """
    if not path.exists():
        return {}
    try:
        record = read_json(path).items()
        # Folders of porocore 0.1 have the seconds alone.
        entries = {s: e if isinstance(e, dict) else {"seconds": e, "runs": 1} for s, e in record}
        return {str(s): StageTime(float(e["seconds"]), int(e["runs"])) for s, e in entries.items()}
    except (OSError, ValueError, TypeError, AttributeError, KeyError, OverflowError) as error:
        raise DataError(
            f"{path}: not a record of the stages' times ({error}); delete it, it is not needed"
        ) from error
