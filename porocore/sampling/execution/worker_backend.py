"""Interface of workers and of their backend; the backend that solves in this process."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any

from porocore.sampling.execution.tasks import Ready, release


class Worker(ABC):
    """Worker that takes one call at a time.

    Attributes
    ----------
    prepared
        True if it holds the cell; kept by the pool.
    host
        Machine, if known, so that a second try can be made on another one.
    member
        Parameters of the cell of its last state; kept by the pool.
    """

    def __init__(self) -> None:
        self.prepared = False
        self.host = ""
        self.member = b""

    @abstractmethod
    def submit(self, call: Callable[..., Any], *args: Any) -> Future[Any]:
        """Start a call."""


class WorkerBackend(ABC):
    """Set of workers, which may come and go.

    Attributes
    ----------
    ahead
        Number of states that may wait, so that no worker waits for the next one.
    eager
        True if calls start when they are submitted, not only when they are waited for.
    separate
        True if workers can be distinguished and prepared one by one.
    """

    ahead = 1
    eager = True
    separate = True

    def __init__(self, workers: Sequence[Worker] = ()) -> None:
        self._workers = workers

    def workers(self) -> Sequence[Worker]:
        """Return the present workers.

        Raises
        ------
        PorocoreError
            The workers cannot be reached any more.
        """
        return self._workers

    @property
    def slots(self) -> int:
        """Number of states that can be solved at once, at least 1."""
        return max(1, len(self._workers))

    @abstractmethod
    def lost(self, worker: Worker) -> None:
        """Replace a worker that has died during a call, if possible.

        Raises
        ------
        PorocoreError
            The worker cannot be replaced, and there is no other.
        """

    def check(self, ready: Ready) -> list[str]:
        """Return warnings about a worker that has just prepared the cell.

        Raises
        ------
        PluginError
            The worker cannot be used.
        """
        return []

    @property
    def warnings(self) -> list[str]:
        """Warnings for the user before the work begins."""
        return []

    @abstractmethod
    def close(self) -> None:
        """Finish the running states and release the workers."""

    @abstractmethod
    def abort(self) -> None:
        """Release the workers at once; running solves are lost."""


class SerialBackend(WorkerBackend):
    """The process itself with all its threads; a state is solved when it is waited for."""

    ahead = 0
    eager = False

    def __init__(self, token: str) -> None:
        super().__init__([_ThisProcess()])
        self._token = token

    def lost(self, worker: Worker) -> None:
        """Raise, since this process cannot be lost."""
        raise AssertionError

    def close(self) -> None:
        """Release the prepared cell."""
        release(self._token)

    abort = close


class _ThisProcess(Worker):
    def submit(self, call: Callable[..., Any], *args: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(call(*args))
        return future
