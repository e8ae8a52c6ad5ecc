"""Cost of cells solved during a macro run, added up over all sessions that worked on a solution."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from porocore.core.files.atomic import noted_afterwards
from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import read_json
from porocore.errors import DataError

#: By name of the solution: points, solves, seconds, and solves by status.
DirectRecords = dict[str, dict[str, float]]


class Work(Protocol):
    """Work done so far."""

    def numbers(self) -> dict[str, float]:
        """Return counts and seconds by name; none ever falls."""

    def in_words(self) -> str:
        """Return the work in a sentence."""


class SolvesCells(Protocol):
    """Solver of cells during a macro run.

    Attributes
    ----------
    on_work
        Called with what was done, in words.
    """

    on_work: Callable[[str], None]

    @property
    def work(self) -> Work:
        """Work since this process began."""


@contextmanager
def cost_recorded(path: Path, solution: str, work: Work) -> Iterator[None]:
    """Add to ``solution`` what ``work`` grows by during the block, also when the block is interrupted.

    Raises
    ------
    DataError
        The record at ``path`` is damaged; the block is not run.
    RunFolderError
        The disk is full or read-only.
    """
    records = direct_records(path)
    before = work.numbers()

    def record() -> None:
        known = records.get(solution, {})
        now = work.numbers()
        gained = {name: value - before.get(name, 0) for name, value in now.items()}
        records[solution] = {name: known.get(name, 0) + gained.get(name, 0) for name in {**known, **gained}}
        write_json(path, records, indent=2)

    with noted_afterwards(record):
        yield


def direct_records(path: Path) -> DirectRecords:
    """Return the recorded costs by solution; empty before the first.

    Raises
    ------
    DataError
        The record is damaged.
    """
    if not path.exists():
        return {}
    try:
        records = read_json(path)
        return {
            str(solution): {str(name): _number(value) for name, value in record.items()}
            for solution, record in records.items()
        }
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise DataError(
            f"{path}: not a record of direct solves ({error}); delete it, it is not needed"
        ) from error


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"expected a number, got {value!r}")
    return value
