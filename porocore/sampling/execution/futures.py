"""Any executor that the caller has made: threads, MPI ranks, a cluster of another kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any, Protocol

from porocore.errors import PorocoreError
from porocore.sampling.execution.tasks import forget
from porocore.sampling.execution.worker_backend import Worker, WorkerBackend


class SubmitsFutures(Protocol):
    """What is needed of an executor; :class:`concurrent.futures.Executor` has it."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Begin a call."""


class FuturesBackend(WorkerBackend):
    """A given executor with a number of calls at a time; it is neither replaced nor shut down here.

    Its workers cannot be told apart, so the recipe of the cell goes with every state, and each of its threads
    prepares the cell once.
    """

    separate = False

    def __init__(self, executor: SubmitsFutures, count: int, token: str) -> None:
        self._workers = [_ExecutorWorker(executor) for _ in range(count)]
        self._token = token

    def workers(self) -> Sequence[Worker]:
        """As many as may work at once."""
        return self._workers

    @property
    def slots(self) -> int:
        """As many as may work at once."""
        return len(self._workers)

    def lost(self, worker: Worker) -> None:
        """The executor is not ours to mend."""
        raise PorocoreError(
            "the executor that was handed in is broken: one of its workers died (out of memory, or killed); "
            "finished states are kept: make a new one and resume"
        )

    def close(self) -> None:
        """Let go of the cells that its threads have prepared in this process."""
        forget(self._token)

    abort = close


class _ExecutorWorker(Worker):
    def __init__(self, executor: SubmitsFutures) -> None:
        super().__init__()
        self._executor = executor

    def submit(self, call: Callable[..., Any], *args: Any) -> Future[Any]:
        return self._executor.submit(call, *args)
