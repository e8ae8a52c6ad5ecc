"""Solving cell states in parallel processes, one state and one thread at a time in each."""

from __future__ import annotations

import os
import signal
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import Any, Self

from porocore import errors
from porocore.errors import PorocoreError
from porocore.interfaces.cell import CellField, CellSolver
from porocore.states import CellResponse, MacroState

#: Makes a solver and what its ``prepare`` returned; called once in each process.
Factory = Callable[..., tuple[CellSolver, Any]]

THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMEXPR_NUM_THREADS")


@dataclass(frozen=True, eq=False)
class Outcome:
    """A finished solve: one row, its field where asked for, and the wall time of the solve [s]."""

    key: str
    response: CellResponse
    field: CellField | None
    seconds: float


@dataclass(frozen=True)
class _Failure:
    """An exception on its way to the parent process, as text: not every exception survives pickling."""

    kind: str
    message: str
    details: str


class CellPool:
    """Worker processes that have each prepared the same cell; a context manager.

    Workers are started afresh (spawned) with one thread for each numerical library. They ignore Ctrl-C,
    which the parent handles, and end when the parent has gone, however it went. With ``workers=1`` states
    are solved in this process, in the order of submission, with whatever number of threads it has.

    Parameters
    ----------
    factory, args
        ``factory(*args)`` returns the solver and the prepared cell. With several workers both must be
        picklable, so ``factory`` is a function at the top level of a module.
    workers
        Number of processes.
    tangent, fields
        What each solve shall return, see :meth:`porocore.CellSolver.solve`.
    """

    def __init__(
        self,
        factory: Factory,
        args: tuple[Any, ...] = (),
        *,
        workers: int = 1,
        tangent: bool = True,
        fields: bool = True,
    ) -> None:
        if workers < 1:
            raise ValueError(f"expected at least one worker, got {workers}")
        self.workers = workers
        self._waiting: deque[tuple[str, tuple[Any, ...]]] = deque()
        self._running: dict[Future[Outcome | _Failure], str] = {}
        self._worker = _Worker(factory, args, tangent, fields)
        self._processes: set[BaseProcess] = set()
        self._executor: ProcessPoolExecutor | None = None
        if workers > 1:
            self._executor = ProcessPoolExecutor(
                workers, get_context("spawn"), initializer=_start_worker, initargs=(self._worker,)
            )

    @property
    def pending(self) -> int:
        """States submitted and not yet returned by :meth:`wait`."""
        return len(self._waiting) + len(self._running)

    @property
    def has_room(self) -> bool:
        """Whether another state can be submitted so that no worker is idle and none waits for long."""
        return self.pending < (1 if self._executor is None else self.workers + 1)

    def submit(self, key: str, state: MacroState, start: CellField | None = None) -> None:
        """Hand in one state (one row) with the field to start from."""
        if self._executor is None:
            self._waiting.append((key, (key, state, start)))
            return
        others = set(active_children())
        try:
            with _one_thread(), _interrupts_blocked():
                self._running[self._executor.submit(_solve_in_worker, key, state, start)] = key
                self._processes |= set(active_children()) - others
        except BrokenProcessPool as error:
            raise self._broken() from error

    def wait(self) -> Outcome:
        """The next finished state; blocks until there is one.

        Raises
        ------
        PorocoreError
            The solver raised an exception, or a worker process died; names the state.
        """
        if self._executor is None:
            _, task = self._waiting.popleft()
            return self._checked(task[0], self._worker.solve(*task))
        done, _ = wait(self._running, return_when=FIRST_COMPLETED)
        # Good outcomes first, so that nothing that was solved is lost behind an error.
        future = min(done, key=lambda f: f.exception() is not None or isinstance(f.result(), _Failure))
        try:
            outcome = future.result()
        except BrokenProcessPool as error:
            raise self._broken() from error
        return self._checked(self._running.pop(future), outcome)

    def finish_running(self) -> Iterator[Outcome]:
        """Drop what has not begun and yield the outcomes of what runs, leaving out failures."""
        self._waiting.clear()
        for future in list(self._running):
            if future.cancel():
                del self._running[future]
        while self._running:
            try:
                yield self.wait()
            except PorocoreError:
                if self._executor is not None and any(f.exception() for f in self._running if f.done()):
                    return

    def close(self) -> None:
        """Finish what runs and end the processes."""
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is KeyboardInterrupt and self._running:
            # The caller was interrupted while it waited: nobody will take what is being solved.
            for process in self._processes:
                process.terminate()
        self.close()

    @staticmethod
    def _checked(key: str, outcome: Outcome | _Failure) -> Outcome:
        if isinstance(outcome, Outcome):
            return outcome
        kind = getattr(errors, outcome.kind, None)
        if isinstance(kind, type) and issubclass(kind, PorocoreError):
            raise kind(outcome.message)
        error = PorocoreError(f"the cell solver raised {outcome.kind} at state '{key}': {outcome.message}")
        error.add_note(outcome.details)
        raise error

    def _broken(self) -> PorocoreError:
        lost = [repr(key) for future, key in self._running.items() if not future.done() or future.exception()]
        return PorocoreError(
            f"a worker process died while solving {' or '.join(lost)} (out of memory, "
            "or killed); finished states are kept: resume with fewer workers or a coarser mesh"
        )


class _Worker:
    """Prepares the cell at the first state and keeps it."""

    def __init__(self, factory: Factory, args: tuple[Any, ...], tangent: bool, fields: bool) -> None:
        self.factory, self.args, self.tangent, self.fields = factory, args, tangent, fields
        self.prepared: tuple[CellSolver, Any] | None = None

    def solve(self, key: str, state: MacroState, start: CellField | None) -> Outcome | _Failure:
        try:
            if self.prepared is None:
                self.prepared = self.factory(*self.args)
            solver, prepared = self.prepared
            began = time.perf_counter()
            solution = solver.solve(prepared, state, start=[start], tangent=self.tangent, fields=self.fields)
            seconds = time.perf_counter() - began
        except Exception as error:  # noqa: BLE001 - it is raised again where the states are asked for
            return _Failure(type(error).__name__, str(error), traceback.format_exc())
        return Outcome(key, solution.response, solution.fields[0] if solution.fields else None, seconds)


_worker: _Worker


def _start_worker(worker: _Worker) -> None:
    global _worker
    _worker = worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=end_with_parent, daemon=True).start()


def end_with_parent() -> None:
    """Wait for the end of the parent process and end this one; for a thread of a worker."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _solve_in_worker(key: str, state: MacroState, start: CellField | None) -> Outcome | _Failure:
    return _worker.solve(key, state, start)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Processes started meanwhile find the thread variables in their environment before numpy is imported."""
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
def _interrupts_blocked() -> Iterator[None]:
    """Processes started meanwhile inherit that Ctrl-C does not reach them, even while they import."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
