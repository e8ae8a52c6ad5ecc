"""Freed memory that a process keeps while it solves a large problem (freed_memory_kept)."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock

#: Problems of fewer unknowns have no arrays of many megabytes.
LARGE = 50_000
#: Numbers of the settings of glibc, see mallopt(3): freed memory beyond so many bytes goes back to the system, arrays
#: beyond so many bytes come from it one by one.
_TRIM, _ALONE = -1, -3
#: Values under which glibc keeps everything, and those to which its own rule comes at last.
_KEPT, _USUAL = {_TRIM: -1, _ALONE: 2**31 - 1}, {_TRIM: 64 * 2**20, _ALONE: 32 * 2**20}
_lock = Lock()
_depth = 0


@contextmanager
def freed_memory_kept(unknowns: int) -> Iterator[None]:
    """Keep freed memory during the block if a problem has many unknowns; hand it back to the system afterwards.

    glibc takes every array above 32 MB from the system and gives it back as soon as it is freed, and the system clears
    its pages each time. That took two fifths of the processor time of a cell of 540,000 unknowns. Another C library is
    left as it is.
    """
    library = _glibc() if unknowns > LARGE else None
    if library is None:
        yield
        return
    _enter(library)
    try:
        yield
    finally:
        _leave(library)


@cache
def _glibc() -> ctypes.CDLL | None:
    """Return the C library where it is glibc."""
    try:
        library = ctypes.CDLL(None)
    except (OSError, TypeError):  # Windows has no such thing
        return None
    return library if hasattr(library, "mallopt") and hasattr(library, "malloc_trim") else None


def _enter(library: ctypes.CDLL) -> None:
    global _depth
    with _lock:
        _depth += 1
        if _depth == 1:
            _set(library, _KEPT)


def _leave(library: ctypes.CDLL) -> None:
    global _depth
    with _lock:
        _depth -= 1
        if not _depth:
            _set(library, _USUAL)
            library.malloc_trim(0)


def _set(library: ctypes.CDLL, values: dict[int, int]) -> None:
    for setting, value in values.items():
        library.mallopt(setting, value)
