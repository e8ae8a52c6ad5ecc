"""Checks of both ends of an HDF5 file before it is opened: superblock, length, checksum behind the data.

HDF5 may read for ever where a byte was changed, so damage is found here. A file that another program has written or
changed has no seal; HDF5 cuts off what lies behind its data when it writes.
"""

from __future__ import annotations

import hashlib
import struct
from functools import lru_cache
from pathlib import Path
from typing import Literal

from porocore.core.files.reading import require_ordinary

try:
    from fcntl import LOCK_NB, LOCK_SH, flock
except ImportError:  # Windows
    flock = None  # type: ignore[assignment]

SIGNATURE = b"\x89HDF\r\n\x1a\n"
_LABEL = b"\nporocore-sha256:"
_LENGTH = len(_LABEL) + 64
#: Where a superblock of a version says how long the file is: behind which byte.
_END_AT = {0: 40, 1: 44, 2: 28, 3: 28}
_BLOCK = 1 << 20
#: Mark of a file that is being written, in the flags of a superblock from version 2 on.
_WRITTEN = 1


class NoHdf5Error(ValueError):
    """A file that was never one of HDF5, in contrast to a damaged one."""


def seal_of(image: bytes) -> bytes:
    """Return what stands behind the bytes of an HDF5 file."""
    return _LABEL + hashlib.sha256(image).hexdigest().encode()


def check_ends(path: Path) -> bool:
    """Check length and seal of an ordinary file; return whether it has a seal.

    Raises
    ------
    ValueError
        It is no HDF5 file, is cut short or longer than it says, or was changed after it was sealed.
    OSError
        It cannot be read.
    """
    stat = path.stat()
    return _check_ends(str(path), stat.st_ino, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=4096)
def _check_ends(path: str, inode: int, size: int, changed: int) -> bool:
    with open(path, "rb") as file:
        head = file.read(64)
        end = _end_of_data(head)
        if size < end:
            raise ValueError(f"cut short: {size} of {end} bytes")
        if size == end:
            return False
        file.seek(end)
        seal = file.read(_LENGTH + 1)
        if len(seal) != _LENGTH or not seal.startswith(_LABEL):
            raise ValueError("bytes that do not belong to it lie behind its data")
        file.seek(0)
        digest, left = hashlib.sha256(), end
        while left:
            block = file.read(min(left, _BLOCK))
            if not block:
                raise ValueError("cut short while it was read")
            digest.update(block)
            left -= len(block)
    if digest.hexdigest().encode() != seal[len(_LABEL) :]:
        raise ValueError("its bytes do not match its checksum, so it was damaged")
    return True


def use_elsewhere(path: Path) -> Literal["", "open", "not closed"]:
    """Return whether another program has a file open for writing, or did not close it.

    HDF5 locks a file that it writes, and marks it until it is closed; old versions do neither, and some network file
    systems have no locks.
    """
    try:
        require_ordinary(path)  # a pipe would be waited for
        with open(path, "rb") as file:
            head = file.read(64)
            if not head.startswith(SIGNATURE):
                return ""
            if flock is not None:
                try:
                    flock(file.fileno(), LOCK_SH | LOCK_NB)
                except BlockingIOError:
                    return "open"
    except OSError:
        return ""
    return "not closed" if len(head) == 64 and head[8] in (2, 3) and head[11] & _WRITTEN else ""


def _end_of_data(head: bytes) -> int:
    """Return the length of the file as its superblock tells it."""
    if not head.startswith(SIGNATURE):
        raise NoHdf5Error("no HDF5 file" if head else "an empty file, no HDF5 file")
    version = head[8] if len(head) == 64 else -1
    if version not in _END_AT:
        raise ValueError("an HDF5 superblock that is cut short or of an unknown version")
    sizes = head[13:15] if version < 2 else head[9:11]
    base = _END_AT[version] - 16
    if sizes != b"\x08\x08" or any(head[base : base + 8]):
        raise ValueError("an HDF5 superblock as porocore does not write it")
    return int(struct.unpack_from("<Q", head, _END_AT[version])[0])
