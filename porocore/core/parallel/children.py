"""Environment of child processes: one thread, no Ctrl-C, not the user's script; end with the parent."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.machinery import ModuleSpec
from multiprocessing import current_process, parent_process, resource_tracker

from porocore.core.console import quieten_libraries
from porocore.core.parallel.memory import one_thread_in_children
from porocore.errors import PorocoreError


@contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Keep Ctrl-C from processes that are started during the block, even while they import."""
    if sys.platform == "win32":  # Ctrl-C ends a process that is just starting
        yield
        return
    # If it is started along with the first process, it unblocks the signal.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def require_children() -> None:
    """Refuse to start workers in a process that may not have any.

    Raises
    ------
    PorocoreError
        This process is a worker of ``multiprocessing.Pool``.
    """
    if current_process().daemon:
        raise PorocoreError(
            "this process is a worker of multiprocessing.Pool and may not start workers of its own; use one worker "
            "(sampling.workers: 1), or concurrent.futures.ProcessPoolExecutor in the place of the Pool"
        )


class _Script:
    """Script, module or standard input that this process was started with, as its children receive it."""

    def __init__(self) -> None:
        self._lock, self._blocks = threading.Lock(), 0
        self._spec: ModuleSpec | None = None

    @contextmanager
    def left_out(self) -> Iterator[None]:
        """Keep processes that are started during the block from running the script again.

        A spawned process imports the script of its parent, to find there what it is to call. Workers call functions
        of porocore only, and a script without ``if __name__ == "__main__"`` would begin its study anew in each.
        """
        main = sys.modules["__main__"]
        with self._lock:
            if not self._blocks:
                # Children import no module of this name: that of a package runs unconditionally.
                self._spec, main.__spec__ = main.__spec__, ModuleSpec("__main__", None)
            self._blocks += 1
        try:
            yield
        finally:
            with self._lock:
                self._blocks -= 1
                if not self._blocks:
                    main.__spec__ = self._spec


script_left_out = _Script().left_out


@contextmanager
def starting_children() -> Iterator[None]:
    """Start the processes of the block on one thread, without Ctrl-C and the script of the user."""
    with one_thread_in_children(), interrupts_blocked(), script_left_out():
        yield


def begin_child() -> None:
    """Ignore Ctrl-C, which the parent handles, and end when it has gone, however it went; called first in a child."""
    quieten_libraries()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
