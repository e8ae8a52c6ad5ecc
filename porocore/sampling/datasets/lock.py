"""Lock beside a dataset, so that it has one writer at a time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from porocore.core.files.lock import Locked, take_lock
from porocore.errors import RunFolderError


@contextmanager
def sole_writer(path: Path) -> Iterator[None]:
    """Hold ``.NAME.lock`` beside ``path``; it is removed afterwards.

    Raises
    ------
    RunFolderError
        Another process holds it, or the folder cannot be written.
    """
    lock = path.with_name(f".{path.name}.lock")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        held = take_lock(lock)
    except Locked as error:
        raise RunFolderError(
            f"{path}: another process ({error.holder}) is writing it; wait for it, stop it, or choose another --out"
        ) from None
    except OSError as error:
        raise RunFolderError(
            f"cannot write {path}: {error.strerror or error}; make room or choose another --out"
        ) from None
    try:
        yield
    finally:
        with suppress(OSError):
            lock.unlink()  # still held: whoever opened it meanwhile finds that it is no longer the one at this path
        os.close(held)
