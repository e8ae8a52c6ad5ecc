"""One writer at a time: a lock beside a file, which the system releases when its holder ends, however it ends."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from porocore.core.files.atomic import open_lock
from porocore.errors import RunFolderError

if sys.platform != "win32":
    import fcntl


@contextmanager
def sole_writer(path: Path) -> Iterator[None]:
    """Hold ``.NAME.lock`` beside ``path``; it is removed afterwards.

    Raises
    ------
    RunFolderError
        Another process holds it, or the folder cannot be written.
    """
    if sys.platform == "win32":
        yield
        return
    lock = path.with_name(f".{path.name}.lock")
    held = _take(path, lock)
    try:
        yield
    finally:
        with suppress(OSError):
            lock.unlink()  # still held: whoever opened it meanwhile finds that it is no longer the one at this path
        os.close(held)


def _take(path: Path, lock: Path) -> int:
    while True:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            held = open_lock(lock)
        except OSError as error:
            raise RunFolderError(
                f"cannot write {path}: {error.strerror or error}; make room or choose another --out"
            ) from error
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(held).st_ino == lock.stat().st_ino:
                with suppress(OSError):  # a full disk: the number is for the message only
                    os.truncate(held, 0)
                    os.write(held, f"{os.getpid()}\n".encode())
                return held
        except BlockingIOError as error:
            holder = os.read(held, 32).decode(errors="replace").strip() or "unknown"
            os.close(held)
            raise RunFolderError(
                f"{path}: another process ({holder}) is writing it; wait for it, stop it, or choose another --out"
            ) from error
        except FileNotFoundError:
            pass
        os.close(held)  # removed between opening and locking it: once more
