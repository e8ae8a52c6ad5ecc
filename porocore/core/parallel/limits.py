"""Limits on the time and the memory of this process, which hold wherever a library hangs."""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

#: Exit statuses of a process that :func:`ended_after` has ended.
OUT_OF_TIME = {1}
if sys.platform != "win32":
    OUT_OF_TIME.add(-signal.SIGPROF)


@contextmanager
def ended_after(seconds: float | None, *, processor: float | None = None) -> Iterator[None]:
    """End this process if the block takes longer, whatever it is at; None: it may.

    Parameters
    ----------
    seconds
        Elapsed time [s].
    processor
        Processor time [s], where the system counts it (not Windows).
    """
    if seconds is None:
        yield
        return
    # A thread that needs nothing of Python ends the process, after it has written where that stands.
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        faulthandler.dump_traceback_later(seconds, exit=True, file=nowhere)
        try:
            if sys.platform != "win32" and processor is not None:
                signal.signal(signal.SIGPROF, signal.SIG_DFL)
                signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGPROF})
                signal.setitimer(signal.ITIMER_PROF, processor)
            yield
        finally:
            if sys.platform != "win32" and processor is not None:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
            faulthandler.cancel_dump_traceback_later()


def memory_limited(size: int) -> None:
    """Let the system refuse this process more than ``size`` bytes of data from now on, where it can (not Windows)."""
    if sys.platform == "win32":
        return
    import resource

    with suppress(OSError, ValueError):
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        resource.setrlimit(
            resource.RLIMIT_DATA, (size if hard == resource.RLIM_INFINITY else min(size, hard), hard)
        )
