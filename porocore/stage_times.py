"""How long each stage of a run has taken, over all the processes that worked on it."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from porocore.errors import DataError
from porocore.files import atomic_path, noted_afterwards
from porocore.reading import read_json


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
    times = stage_times(path)
    began = time.perf_counter()

    def note() -> None:
        times[stage] = times.get(stage, 0.0) + time.perf_counter() - began
        with atomic_path(path) as part:
            part.write_text(json.dumps(times, indent=2) + "\n", encoding="utf-8")

    with noted_afterwards(note):
        yield


def stage_times(path: Path) -> dict[str, float]:
    """Seconds by stage; empty before the first.

    Raises
    ------
    DataError
        The record is damaged.
    """
    if not path.exists():
        return {}
    try:
        times = read_json(path)
        return {str(stage): float(seconds) for stage, seconds in times.items()}
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise DataError(
            f"{path}: not a record of the stages' times ({error}); delete it, it is not needed"
        ) from error
