"""One thread for numerical libraries: in this process, in its children, or during a block.

Several threads gain nothing here: the matrices are small. On a busy machine they lose everything. Threads of OpenBLAS
that wait give up the processor again and again, and the system hands it to other programs: a study of 46 s stood still
for minutes beside 8 other processes on 2 cores.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

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
