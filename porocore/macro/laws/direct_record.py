"""Cost of cells solved during a macro run, by direct FE² or an adaptive surrogate, added up and read."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from porocore.core.files.totals import Numbers, added_up, read_totals
from porocore.states import Status


@dataclass
class Work(ABC):
    """Work done so far.

    Attributes
    ----------
    counts
        Cells solved, by how their solution ended.
    """

    counts: Counter[Status] = field(default_factory=Counter)

    @property
    def solves(self) -> int:
        """Number of cells solved."""
        return self.counts.total()

    @property
    def failed(self) -> int:
        """Number of solved cells without values."""
        return sum(n for status, n in self.counts.items() if not status.has_values)

    @abstractmethod
    def numbers(self) -> Numbers:
        """Return counts and seconds by name, for the record of a solution; none ever falls."""

    @abstractmethod
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
    before = work.numbers()

    def gained() -> Numbers:
        return {name: value - before.get(name, 0) for name, value in work.numbers().items()}

    with added_up(path, direct_records, solution, gained):
        yield


def direct_records(path: Path) -> dict[str, Numbers]:
    """Return points, solves, seconds and solves by status of each solution; empty before the first.

    Raises
    ------
    DataError
        The record is damaged.
    """
    return read_totals(path, "direct solves", _numbers)


def _numbers(record: Any) -> Numbers:
    for value in record.values():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise TypeError(f"expected a number, got {value!r}")
    return dict(record)
