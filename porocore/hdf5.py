"""Writing HDF5 files on a disk that may be full.

When the operating system refuses a write, HDF5 keeps the half-written file open, tries again at every later
close, and ends in a segmentation fault. So it writes through an object that keeps such an error to itself.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from porocore.files import atomic_path

#: Files that any HDF5 since 1.10 reads; older layouts would double the size of small ones.
LIBVER = ("v110", "v110")


@contextmanager
def atomic_hdf5(path: Path) -> Iterator[Any]:
    """An open HDF5 file that takes the place of ``path``, whole, when the block ends well.

    Raises
    ------
    RunFolderError
        The disk is full or read-only; ``path`` is as it was before.
    """
    with atomic_path(path) as part, open(part, "wb+", buffering=0) as raw:
        sink = _Sink(raw)
        try:
            with h5py.File(sink, "w", libver=LIBVER) as file:
                yield file
        except Exception:
            # What HDF5 says of a file that lacks what could not be written is of no use.
            sink.check()
            raise
        sink.check()


class _Sink(io.RawIOBase):
    """A file that takes everything; after the first write that fails, nothing more is written."""

    def __init__(self, raw: Any) -> None:
        super().__init__()
        self.raw = raw
        self.error: OSError | None = None

    def check(self) -> None:
        if self.error is not None:
            raise self.error

    def write(self, data: Any) -> int:
        rest = memoryview(data).cast("B")
        size = len(rest)
        try:
            while len(rest) and self.error is None:
                rest = rest[self.raw.write(rest) :]
        except OSError as error:
            self.error = error
        return size

    def truncate(self, size: int | None = None) -> int:
        try:
            if self.error is None:
                self.raw.truncate(size)
        except OSError as error:
            self.error = error
        return size or 0

    def readinto(self, buffer: Any) -> int:
        count: int = self.raw.readinto(buffer)
        return count

    def seek(self, offset: int, whence: int = 0) -> int:
        place: int = self.raw.seek(offset, whence)
        return place

    def tell(self) -> int:
        place: int = self.raw.tell()
        return place

    def flush(self) -> None:
        """Nothing is buffered here."""
