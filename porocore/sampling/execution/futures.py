"""Workers in an executor that the caller has made (FuturesBackend): threads, MPI ranks, a cluster."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Protocol

from porocore.errors import PorocoreError
from porocore.sampling.execution.tasks import release
from porocore.sampling.execution.worker_backend import Worker, WorkerBackend


class SubmitsFutures(Protocol):
    """Executor that returns futures, such as :class:`concurrent.futures.Executor`."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Start a call."""


class FuturesBackend(WorkerBackend):
    """Given executor with a number of calls at a time; it is neither replaced nor shut down here.

    Its workers cannot be told apart, so the recipe of the cell goes with every state, and each of its threads
    prepares the cell once.
    """

    separate = False

    def __init__(self, executor: SubmitsFutures, count: int, token: str) -> None:
        super().__init__([ExecutorWorker(executor) for _ in range(count)])
        self._token = token

    def lost(self, worker: Worker) -> None:
        """Raise, since the executor of the caller cannot be replaced."""
        raise PorocoreError(
            "the executor that was handed in is broken: one of its workers died (out of memory, or killed); "
            "finished states are kept: make a new one and resume"
        )

    def close(self) -> None:
        """Release the cells that its threads have prepared in this process."""
        release(self._token)

    abort = close


class ExecutorWorker(Worker):
    """One call at a time of an executor."""

    def __init__(self, executor: SubmitsFutures, host: str = "") -> None:
        super().__init__()
        self._executor, self.host = executor, host

    def submit(self, call: Callable[..., Any], *args: Any) -> Future[Any]:
        """Start a call."""
        return self._executor.submit(call, *args)
