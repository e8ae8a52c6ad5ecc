"""Memory and threads of a process: freed memory kept or returned, one thread for numerical libraries.

Several threads gain nothing here: the matrices are small. On a busy machine they lose everything. Threads of OpenBLAS
that wait give up the processor again and again, and the system hands it to other programs: a study of 46 s stood still
for minutes beside 8 other processes on 2 cores.
"""

from __future__ import annotations

import ctypes
import os
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


THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMEXPR_NUM_THREADS")


def one_thread_from_now() -> None:
    """Set the thread variables to 1 in a process that has not imported numpy yet, unless the user has set one."""
    if not _chosen():
        os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))


@contextmanager
def one_thread_in_children() -> Iterator[None]:
    """Set the thread variables to 1 for processes that are started during the block."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Keep the linear algebra of numpy and scipy on one thread during the block, unless the user has set a number."""
    if _chosen():
        yield
        return
    with exactly_one_blas_thread():
        yield


@contextmanager
def exactly_one_blas_thread() -> Iterator[None]:
    """Keep it on one thread whatever the user has set: the order of sums, so their last bits, follows the number."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield


def _chosen() -> bool:
    """Return whether the user has set a number of threads."""
    return any(os.environ.get(name) for name in THREAD_VARIABLES)
