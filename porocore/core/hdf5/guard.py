"""Start of a second process that tries an untrusted HDF5 file before this one opens it."""

from __future__ import annotations

import atexit
import json
import os
import subprocess
import sys
from functools import lru_cache
from pathlib import Path
from threading import Lock

from porocore.core.parallel.threads import THREAD_VARIABLES

#: It finds what this process finds, whatever the environment and the folder say.
_COMMAND = "import sys; sys.path[:] = sys.argv[1:]; from porocore.core.hdf5.trial import serve; serve()"
#: An HDF5 library for several processes would take the other one for a part of this run.
_OF_MPI = ("OMPI_", "PMI", "MPI_")


def require_harmless(path: Path) -> None:
    """Check in another process that HDF5 reads all of an ordinary file in bounded time and memory.

    Raises
    ------
    ValueError
        It does not, or the structure is not sound.
    OSError
        There is no such file, or no process can be started.
    """
    found = path.stat()
    if reason := _reason(os.path.abspath(path), found.st_ino, found.st_size, found.st_mtime_ns):
        raise ValueError(reason)


@lru_cache(maxsize=4096)
def _reason(path: str, inode: int, size: int, changed: int) -> str:
    with _LOCK:
        return _trial().ask(path)


class _Trial:
    """The other process; it ends when this one does, whichever way."""

    def __init__(self) -> None:
        self.owner = os.getpid()
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-c", _COMMAND, *sys.path],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, encoding="ascii",
            env={name: value for name, value in os.environ.items() if not name.startswith(_OF_MPI)}
            | dict.fromkeys(THREAD_VARIABLES, "1"),
            start_new_session=True,
        )  # fmt: skip

    def ask(self, path: str) -> str:
        """Return what speaks against reading a file; empty if nothing does."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps(path) + "\n")
            self._process.stdin.flush()
            return str(json.loads(self._process.stdout.readline()))
        except BaseException:
            # An answer that was not waited for would be taken for the next one.
            self.end()
            raise

    def alive(self) -> bool:
        """Return whether it can be asked by this process, which may be a copy of the one that started it."""
        return self.owner == os.getpid() and self._process.poll() is None

    def end(self) -> None:
        """Stop the process."""
        if self.alive():
            self._process.kill()
            self._process.communicate()


_LOCK = Lock()
_RUNNING: list[_Trial] = []


def _trial() -> _Trial:
    if not _RUNNING or not _RUNNING[0].alive():
        _RUNNING[:] = [_Trial()]
        atexit.register(_RUNNING[0].end)
    return _RUNNING[0]
