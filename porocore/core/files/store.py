"""Store of results by kind and hash, in a folder of bounded size (ResultStore); counts in a JSON file.

Nothing in it is needed: a file that is missing, damaged or removed by another process is computed again. So any number
of processes may read, write and clear it at the same time.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

from porocore.core.files.claim import take_lock
from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import complete, read_json
from porocore.errors import DataError, RunFolderError

#: First word of every file, with the version of the layout.
_MARK = b"porocore-store-1 "
#: Bytes that the files may take together, unless another limit is given.
MOST_BYTES = 5_000_000_000
#: Share of the limit that remains when the oldest files are removed.
_REMAINS = 0.8
#: A file without an end that is older was left by a process that was killed [s].
_ABANDONED = 3600.0
_LOCK = ".lock"
#: Names of results. Nothing else in the folder is touched.
_KEY = re.compile("[0-9a-f]{40}")


@dataclass(frozen=True)
class StoredFile:
    """One file of a store.

    Attributes
    ----------
    kind
        Kind of result, the name of the folder that holds it.
    path, bytes
        The file and its size.
    used
        Time of the last use [s since 1970].
    """

    kind: str
    path: Path
    bytes: int
    used: float


@dataclass(frozen=True, eq=False)
class StoredResult:
    """A stored result: its bytes, and facts about them as plain data."""

    payload: bytes
    facts: dict[str, Any]


class ResultStore:
    """Folder of results by kind and key.

    A file is written whole or not at all, carries its SHA-256, and is removed if that does not match. A store that
    cannot be written is left alone; :attr:`fault` says why.

    Parameters
    ----------
    folder
        Made at the first result.
    most_bytes
        Bound of the size of all files; beyond it those that were not used for longest are removed.
    """

    def __init__(self, folder: Path, most_bytes: int = MOST_BYTES) -> None:
        self.folder, self.most_bytes = folder, most_bytes
        #: Reason for which nothing can be written; empty as long as it can.
        self.fault = ""
        self._bytes: int | None = None

    def find(self, kind: str, key: str) -> StoredResult | None:
        """Return a result, or None if the store does not hold it."""
        path = self._path(kind, key)
        try:
            data = path.read_bytes()
        except OSError:
            return None
        found = _unpacked(data)
        with suppress(OSError):
            if found is None:
                path.unlink()
            else:
                os.utime(path)  # the order of removal
        return found

    def keep(self, kind: str, key: str, payload: bytes, facts: Mapping[str, Any]) -> None:
        """Keep a result; one that cannot be written is left out."""
        if self.fault:
            return
        path = self._path(kind, key)
        part = path.with_name(f".{key}.{uuid4().hex}.part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            data = _packed(payload, facts)
            part.write_bytes(data)
            os.replace(part, path)
            self._grown(len(data))
        except OSError as error:
            self.fault = f"{self.folder}: nothing can be stored there: {error.strerror or error}"
            with suppress(OSError):
                part.unlink()

    def files(self) -> list[StoredFile]:
        """Return all results, without reading them."""
        return [
            StoredFile(path.parent.parent.name, path, found.st_size, found.st_mtime)
            for path, found in self._walk()
            if _KEY.fullmatch(path.name) and path.name.startswith(path.parent.name)
        ]

    def check(self) -> list[StoredFile]:
        """Read every result, remove the damaged ones and return them."""
        damaged = []
        for file in self.files():
            with suppress(OSError):
                if _unpacked(file.path.read_bytes()) is None:
                    file.path.unlink()
                    damaged.append(file)
        return damaged

    def clear(self, unused_since: float = 0.0) -> list[StoredFile]:
        """Remove the results that were not used for so many seconds, and return them."""
        before = time.time() - unused_since
        return self._remove([file for file in self.files() if file.used <= before])

    def _path(self, kind: str, key: str) -> Path:
        return self.folder / kind / key[:2] / key

    def _walk(self) -> Iterator[tuple[Path, os.stat_result]]:
        for path in self.folder.glob("*/??/*"):
            with suppress(OSError):  # another process removed it
                yield path, path.stat()

    def _grown(self, by: int) -> None:
        """Count what was written, and make room when it is too much."""
        if self._bytes is None:
            self._bytes = sum(found.st_size for _, found in self._walk())
        else:
            self._bytes += by
        if self._bytes > self.most_bytes:
            self._make_room()

    def _make_room(self) -> None:
        try:
            lock = take_lock(self.folder / _LOCK)
        except OSError:  # another process makes room
            return
        try:
            for path, found in list(self._walk()):
                if path.suffix == ".part" and time.time() - found.st_mtime > _ABANDONED:
                    path.unlink(missing_ok=True)
            files = sorted(self.files(), key=lambda file: file.used)
            self._bytes = sum(file.bytes for file in files)
            surplus, removed = self._bytes - _REMAINS * self.most_bytes, []
            while surplus > 0 and files:
                removed.append(files.pop(0))
                surplus -= removed[-1].bytes
            self._bytes -= sum(file.bytes for file in self._remove(removed))
        finally:
            os.close(lock)

    def _remove(self, files: list[StoredFile]) -> list[StoredFile]:
        removed = []
        for file in files:
            with suppress(OSError):
                file.path.unlink()
                removed.append(file)
        return removed


def _packed(payload: bytes, facts: Mapping[str, Any]) -> bytes:
    head = json.dumps(dict(facts)).encode() + b"\n"
    body = head + payload
    return _MARK + hashlib.sha256(body).hexdigest().encode() + b"\n" + body


def _unpacked(data: bytes) -> StoredResult | None:
    """Return the result in the bytes of a file; None if they were damaged."""
    start = len(_MARK) + 65
    body = data[start:]
    if data[:start] != _MARK + hashlib.sha256(body).hexdigest().encode() + b"\n":
        return None
    head, _, payload = body.partition(b"\n")
    return StoredResult(payload, json.loads(head))


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
    with complete(path, f"record of {what}", "go on without it"):
        return {str(entry): numbers(value) for entry, value in read_json(path).items()}
