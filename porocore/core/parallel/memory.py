"""Freed memory: kept while a large problem is solved (freed_memory_kept), else returned to the system."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock

#: Problems of fewer unknowns have no arrays of many megabytes.
LARGE = 50_000
#: Numbers of the settings of glibc, see mallopt(3): freed memory beyond so many bytes goes back to the system, so many
#: bytes are asked for in advance, arrays beyond so many bytes come from the system one by one, and so many at most.
_TRIM, _AHEAD, _ALONE, _MOST_ALONE = -1, -2, -3, -4
#: Values under which glibc keeps everything.
_KEPT = {_TRIM: -1, _ALONE: 2**31 - 1}
#: Values to which its own rule comes at last, and its first ones of the settings that no rule changes.
_USUAL = {_TRIM: 64 * 2**20, _AHEAD: 128 * 2**10, _ALONE: 32 * 2**20, _MOST_ALONE: 2**16}
#: Values in place of a library's ban: they return what is large, and cost solves of a second 1 to 2 % of their time,
#: where the usual ones cost 5 to 10 %.
_LARGE_ONES = _USUAL | {_TRIM: 512 * 2**20, _ALONE: 256 * 2**20}
_lock = Lock()
_depth, _ordinary = 0, _USUAL


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


def return_freed_memory() -> None:
    """Let glibc return freed memory to the system again, which some libraries forbid for the whole process.

    SuperLU_DIST does, and it comes with PETSc: the memory of a process was then the largest that it ever needed. Some
    hundred megabytes are kept. Within :func:`freed_memory_kept` nothing changes until its block ends. Another C library
    is left as it is.
    """
    global _ordinary
    library = _glibc()
    if library is None:
        return
    with _lock:
        _ordinary = _LARGE_ONES
        if not _depth:
            _set(library, _ordinary)


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
            _set(library, _ordinary)
            library.malloc_trim(0)


def _set(library: ctypes.CDLL, values: dict[int, int]) -> None:
    for setting, value in values.items():
        library.mallopt(setting, value)
