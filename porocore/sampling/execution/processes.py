"""Worker processes on this machine, one thread each (ProcessBackend); they end with their parent."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import active_children, get_context
from multiprocessing.process import BaseProcess
from typing import Any

from porocore.core.parallel.children import begin_child, require_children, starting_children
from porocore.sampling.execution.worker_backend import Worker, WorkerBackend


class ProcessBackend(WorkerBackend):
    """Spawned processes, each an executor of its own, so that a dead one does not end the others.

    They ignore Ctrl-C, which the parent handles, and end when the parent has gone, however it went.
    """

    _workers: list[_Process]

    def __init__(self, count: int) -> None:
        super().__init__([_Process() for _ in range(count)])

    def lost(self, worker: Worker) -> None:
        """Replace the process by a new one."""
        place = next(i for i, known in enumerate(self._workers) if known is worker)
        self._workers[place].close()
        self._workers[place] = _Process()

    def close(self) -> None:
        """Finish what runs and end the processes."""
        for worker in self._workers:
            worker.close()

    def abort(self) -> None:
        """End the processes."""
        for worker in self._workers:
            worker.terminate()
        self.close()


class _Process(Worker):
    """Process that starts with its first call."""

    def __init__(self) -> None:
        super().__init__()
        self._process: BaseProcess | None = None
        self._executor = ProcessPoolExecutor(1, get_context("spawn"), initializer=begin_child)

    def submit(self, call: Callable[..., Any], *args: Any) -> Future[Any]:
        if self._process is not None:
            return self._executor.submit(call, *args)
        require_children()
        others = set(active_children())
        with starting_children():
            future = self._executor.submit(call, *args)
        self._process = next(iter(set(active_children()) - others), None)
        return future

    def close(self) -> None:
        self._executor.shutdown(cancel_futures=True)

    def terminate(self) -> None:
        if self._process is not None:
            self._process.terminate()
