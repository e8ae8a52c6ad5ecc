"""Record of a finished run: size and time of its files, so that a resumed run does nothing."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import read_json

FORMAT, VERSION = "porocore-finished", 1
#: Files that are no part of what the run ended with; the lock is taken by every command.
_LEFT_OUT = (".lock", "finished.json")
#: What the names begin with that a sweep adds to the folder of its family.
_OF_SWEEPS = "sweep"


@dataclass(frozen=True)
class FinishedRun:
    """Texts of a report that change without anything being computed, and what it warned of.

    Attributes
    ----------
    title, heading
        Title of the configuration, and the one that the page shows.
    configuration
        The configuration as the page shows it.
    warnings
        Warnings of the report.
    """

    title: str
    heading: str
    configuration: str
    warnings: tuple[str, ...] = ()

    def keep(self, folder: Path) -> None:
        """Record that the run in ``folder`` is finished with the files that are there now.

        Raises
        ------
        RunFolderError
            The disk is full or read-only.
        """
        document = _head() | asdict(self) | {"files": _stamps(folder)}
        write_json(folder / "finished.json", document)

    @classmethod
    def find(cls, folder: Path) -> Self | None:
        """Return the record; None where there is none, or where a file of the folder is another one now."""
        try:
            document = read_json(folder / "finished.json")
            files, texts = document.pop("files"), {name: document.pop(name) for name in cls.__annotations__}
            if document != _head() or files != _stamps(folder):
                return None
            return cls(**texts | {"warnings": tuple(map(str, texts["warnings"]))})
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None


def _head() -> dict[str, Any]:
    return {"format": FORMAT, "version": VERSION, "porocore": version("porocore")}


def _stamps(folder: Path) -> dict[str, list[int]]:
    """Return size and time of the last change of every file in the folder; a change of either is noticed."""
    found = {}
    for above, _, names in os.walk(folder):
        for path in (Path(above, name) for name in names):
            relative = path.relative_to(folder).as_posix()
            if relative not in _LEFT_OUT and not relative.startswith(_OF_SWEEPS):
                status = path.stat()
                found[relative] = [status.st_size, status.st_mtime_ns]
    return found
