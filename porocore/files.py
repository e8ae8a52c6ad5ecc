"""Writing files so that a reader never sees half of one."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from porocore.errors import RunFolderError


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A temporary path beside ``path`` that takes its place, once on the disk, when the block ends well.

    Raises
    ------
    RunFolderError
        The disk is full or read-only; ``path`` is as it was before.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        with open(part, "rb+") as file:
            os.fsync(file.fileno())
        os.replace(part, path)
    except OSError as error:
        raise RunFolderError(f"cannot write {path}: {error}; make room or choose another --out") from error
    finally:
        with suppress(OSError):  # not only a missing file: the error above is the one to tell
            part.unlink()


@contextmanager
def noted_afterwards(note: Callable[[], None]) -> Iterator[None]:
    """Call ``note``, which writes a record, after the block, also when the block is interrupted.

    Raises
    ------
    RunFolderError
        The record cannot be written; not where an error of the block is on its way, which is the one to tell.
    """
    try:
        yield
    except BaseException:
        with suppress(RunFolderError):
            note()
        raise
    note()
