"""Second process that reads all of an HDF5 file with limits on time and memory, and says the fault."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import h5py

from porocore.core.echo import reason
from porocore.core.hdf5 import COMPRESSION, UNREADABLE, examine
from porocore.core.parallel.limits import ended_after, memory_limited

#: What reading a file may take beyond what its size explains: processor time [s], and memory [bytes].
SECONDS, MEMORY = 2.0, 1 << 30
#: Bytes of a file that even a slow machine unpacks in a second.
PER_SECOND = 10e6
#: Elapsed time for one second of processor time, on a machine or a disk that others use too.
BUSY = 10
#: Bytes that are read at once.
PIECE = 16 << 20


def serve() -> None:
    """Answer each path, one JSON text a line, by the reason against reading that file; empty if there is none."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for line in sys.stdin:
        sys.stdout.write(json.dumps(_read(json.loads(line))[:1000]) + "\n")
        sys.stdout.flush()


def _read(path: str) -> str:
    """Read everything in a file; return why its structure is not sound, or nothing."""
    try:
        size = os.stat(path).st_size
        with _limited(size), h5py.File(path, "r") as file:
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


@contextmanager
def _limited(size: int) -> Iterator[None]:
    """Bound the time and the memory of this process while it reads a file of ``size`` bytes."""
    memory_limited(MEMORY + COMPRESSION * size)
    seconds = SECONDS + size / PER_SECOND
    with ended_after(BUSY * seconds, processor=seconds):
        yield
