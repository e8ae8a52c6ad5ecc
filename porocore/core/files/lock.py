"""Lock file with one holder at a time (take_lock), released when its holder ends; refusal names the holder."""

from __future__ import annotations

import errno
import os
import stat
from contextlib import suppress
from pathlib import Path

from filelock import lock_descriptor

#: Windows has no flag against links; there the path is looked at instead.
_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
_FLAGS = os.O_RDWR | os.O_CREAT | _NO_LINK | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NONBLOCK", 0)


class Locked(OSError):
    """Refusal of a lock that another process holds.

    Attributes
    ----------
    holder
        Number of that process, or ``unknown``.
    """

    def __init__(self, holder: str) -> None:
        super().__init__(errno.EAGAIN, f"held by process {holder}")
        self.holder = holder


def take_lock(path: Path) -> int:
    """Take a lock and write the number of this process into its file, which is made where there is none.

    Returns
    -------
    int
        A descriptor; closing it releases the lock.

    Raises
    ------
    Locked
        Another process holds it.
    OSError
        It is no ordinary file, or the folder cannot be written.
    """
    while True:
        held = _open_lock(path)
        try:
            if not lock_descriptor(held, blocking=False):
                raise Locked(_holder(held))
            # A holder may remove the file before it ends; then this one guards nothing.
            if os.path.samestat(os.fstat(held), path.stat()):
                with suppress(OSError):  # a full disk: the number is for messages only
                    os.ftruncate(held, 0)
                    os.write(held, f"\n{os.getpid()}\n".encode())
                return held
        except FileNotFoundError:
            pass
        except BaseException:
            os.close(held)
            raise
        os.close(held)


def _open_lock(path: Path) -> int:
    """Open a lock file, or make it. A link is not followed, so that no other file is touched."""
    try:
        if not _NO_LINK and path.is_symlink():
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
        held = os.open(path, _FLAGS, 0o644)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(errno.ELOOP, f"its lock {path.name} is a symbolic link; remove that") from None
        raise
    if not stat.S_ISREG(os.fstat(held).st_mode):
        os.close(held)
        raise OSError(errno.EINVAL, f"its lock {path.name} is no ordinary file; remove that")
    return held


def _holder(held: int) -> str:
    """Return the number that the holder wrote: from the second byte on, since Windows keeps the first from readers."""
    with suppress(OSError):
        os.lseek(held, 1, os.SEEK_SET)
        return os.read(held, 32).decode(errors="replace").strip() or "unknown"
    return "unknown"
