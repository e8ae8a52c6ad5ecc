"""Second process that reads all of an HDF5 file with limits on time and memory, and says the fault."""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
from contextlib import suppress
from typing import Any

import h5py

from porocore.core.echo import reason
from porocore.core.hdf5 import COMPRESSION, UNREADABLE, examine

#: What reading a file may take beyond what its size explains: processor time [s], and memory [bytes].
SECONDS, MEMORY = 2.0, 1 << 30
#: Bytes of a file that even a slow machine unpacks in a second.
PER_SECOND = 10e6
#: Elapsed time for one second of processor time, on a machine or a disk that others use too.
BUSY = 10
#: Bytes that are read at once.
PIECE = 16 << 20
_ENDED = {
    signal.SIGPROF: "HDF5 comes to no end with it, so it is damaged",
    signal.SIGALRM: "HDF5 comes to no end with it, so it is damaged",
}
_CRASHED = "HDF5 crashes with it, so it is damaged"


def serve() -> None:
    """Answer each path, one JSON text a line, by the reason against reading that file; empty if there is none.

    Each file is read in a process of its own, a copy of this one, which costs little.
    """
    for line in sys.stdin:
        sys.stdout.write(json.dumps(_tried(json.loads(line))) + "\n")
        sys.stdout.flush()


def _tried(path: str) -> str:
    source, sink = os.pipe()
    child = os.fork()
    if not child:
        try:
            os.write(sink, _read(path).encode("utf-8", "backslashreplace")[:1000])
        finally:
            os._exit(0)
    os.close(sink)
    with open(source, encoding="utf-8", errors="replace") as said:
        reason = said.read()
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        return _ENDED.get(signal.Signals(os.WTERMSIG(status)), _CRASHED)
    return reason


def _read(path: str) -> str:
    """Read everything in a file; return why its structure is not sound, or nothing."""
    try:
        size = os.stat(path).st_size
        _limit(size)
        with h5py.File(path, "r") as file:
            names = examine(file.id, size).datasets
            _read_all(file, list(names))
    except UNREADABLE as error:
        return reason(error)
    return ""


def _read_all(file: Any, names: list[str]) -> None:
    """Read all arrays and attributes, piece by piece; what cannot be read is refused by whoever wants it."""
    for name in file.attrs:
        with suppress(*UNREADABLE):
            file.attrs[name]
    for name in names:
        with suppress(*UNREADABLE):
            _read_pieces(file[name])


def _read_pieces(array: Any) -> None:
    if not array.shape:
        array[()]
        return
    row = max(1, array.nbytes // max(1, len(array)))
    step = max(1, PIECE // row)
    for begin in range(0, len(array), step):
        with suppress(*UNREADABLE):
            array[begin : begin + step]


def _limit(size: int) -> None:
    """Bound the time and the memory of this process for a file of ``size`` bytes."""
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    most = MEMORY + COMPRESSION * size
    resource.setrlimit(
        resource.RLIMIT_DATA, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard)
    )
    signal.pthread_sigmask(signal.SIG_SETMASK, [])
    seconds = SECONDS + size / PER_SECOND
    for timer, number, limit in (
        (signal.ITIMER_PROF, signal.SIGPROF, seconds),
        (signal.ITIMER_REAL, signal.SIGALRM, BUSY * seconds),
    ):
        signal.signal(number, signal.SIG_DFL)
        signal.setitimer(timer, limit)
