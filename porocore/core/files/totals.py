"""Numbers by name in a JSON file, added up over all processes that worked on a result."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from porocore.core.echo import reason
from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import read_json, set_aside
from porocore.errors import DataError, RunFolderError

Numbers = dict[str, float]


@contextmanager
def added_up(
    path: Path, read: Callable[[Path], dict[str, Numbers]], entry: str, gained: Callable[[], Numbers]
) -> Iterator[None]:
    """Add what ``gained`` returns after the block to an entry of the file, also when the block is interrupted.

    Where that is nothing, the file is not touched. It is read by ``read`` before the block, so that a damaged one is
    told at once, and after it, since other blocks may end meanwhile.

    Raises
    ------
    DataError
        The file is damaged; the block is not run.
    RunFolderError
        The file cannot be written; not where an error of the block is on its way, which is the one to tell.
    """

    def write() -> None:
        more = gained()
        if not more:
            return
        totals = read(path)
        known = totals.get(entry, {})
        totals[entry] = {name: known.get(name, 0) + more.get(name, 0) for name in {**known, **more}}
        write_json(path, totals, indent=2)

    read(path)
    try:
        yield
    except BaseException:
        with suppress(RunFolderError, DataError):
            write()
        raise
    write()


def read_totals(path: Path, what: str, numbers: Callable[[Any], Numbers]) -> dict[str, Numbers]:
    """Return the numbers of each entry, taken from it by ``numbers``; empty where there is no file.

    Raises
    ------
    DataError
        The file is damaged.
    """
    if not path.exists():
        return {}
    try:
        return {str(entry): numbers(value) for entry, value in read_json(path).items()}
    except (OSError, ValueError, TypeError, AttributeError, KeyError, OverflowError) as error:
        raise DataError(
            f"{path}: not a record of {what} ({reason(error)}); {set_aside(path, 'go on without it')}"
        ) from error
