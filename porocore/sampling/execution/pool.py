"""Pool of workers (CellPool): worker processes, choice of the workers by name, account of those that died."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import active_children, get_context
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import Any, Literal, Self
from uuid import uuid4

from porocore.core.parallel.calls import Failure
from porocore.core.parallel.children import begin_child, require_children, starting_children
from porocore.errors import ConfigurationError, PorocoreError
from porocore.interfaces.cell import CellField
from porocore.interfaces.records import failed_response
from porocore.sampling.execution import tasks
from porocore.sampling.execution.solved_store import SolvedStore
from porocore.sampling.execution.tasks import (
    SOLVER,
    Factory,
    FinishedSolve,
    FuturesBackend,
    Ready,
    Recipe,
    SerialBackend,
    SubmitsFutures,
    Unprepared,
    Worker,
    WorkerBackend,
)
from porocore.states import CellResponse, MacroState, Status


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


ExecutorName = Literal["auto", "serial", "processes", "dask"]
#: ``auto`` is dask where a scheduler is named, this process for one worker without time limit, else processes.
EXECUTORS: tuple[ExecutorName, ...] = ("auto", "serial", "processes", "dask")
ExecutorChoice = ExecutorName | SubmitsFutures


def contradiction(executor: str, scheduler: str | None, state_seconds: float | None) -> str | None:
    """Return why these settings exclude each other, or None."""
    if scheduler is not None and executor not in ("auto", "dask"):
        return f"executor '{executor}' has no scheduler; leave out the scheduler, or choose executor 'dask'"
    if state_seconds is not None and executor == "serial":
        return (
            "executor 'serial' cannot end a solve that takes too long; leave out state_seconds, or choose "
            "'processes' or 'dask'"
        )
    return None


def check_choice(
    executor: ExecutorChoice, workers: int, scheduler: str | None, state_seconds: float | None
) -> None:
    """Refuse settings that cannot be used together.

    Raises
    ------
    ConfigurationError
        The executor is unknown, or the settings exclude each other.
    """
    if workers < 1:
        raise ValueError(f"expected at least one worker, got {workers}")
    if not isinstance(executor, str):
        if scheduler is not None or state_seconds is not None:
            raise ConfigurationError(
                "an executor that is handed in has its own workers, whose solves cannot be ended from here: leave "
                "out scheduler and state_seconds"
            )
    elif executor not in EXECUTORS:
        raise ConfigurationError(f"unknown executor '{executor}'; the executors are {', '.join(EXECUTORS)}")
    elif fault := contradiction(executor, scheduler, state_seconds):
        raise ConfigurationError(fault)


def make_worker_backend(
    executor: ExecutorChoice, workers: int, scheduler: str | None, state_seconds: float | None, token: str
) -> WorkerBackend:
    """Return the workers of a pool for checked settings; see :class:`porocore.sampling.execution.CellPool`."""
    if not isinstance(executor, str):
        return FuturesBackend(executor, workers, token)
    if executor == "dask" or scheduler is not None:
        from porocore.sampling.execution.dask_workers import DaskBackend

        return DaskBackend(scheduler, workers)
    if executor == "serial" or (executor == "auto" and workers == 1 and state_seconds is None):
        return SerialBackend(token)
    return ProcessBackend(workers)


#: Times that a state is tried when workers die or hang over it.
TRIES = 2
#: Workers that may die in a row before one has prepared the cell, and states that may be lost before one is solved.
MOST_LOST = 3


@dataclass(eq=False)
class PendingState:
    """State on its way through the pool."""

    key: str
    state: MacroState
    start: CellField | None
    tries: int = 0
    #: Host of the worker that died over it.
    host: str | None = None
    began: float = field(default_factory=time.perf_counter)

    @property
    def member(self) -> bytes:
        """Parameters of the cell, which a worker has prepared if it has just solved another state of the same."""
        values = self.state.parameters
        return b"" if values is None else values.tobytes()


class Losses:
    """Account of dead workers and of the states that they worked on.

    As long as no state was solved, a lost state may not be at fault; it is doubtful.

    Attributes
    ----------
    like
        A response of the cell, as a pattern for those of lost states; None before the first.
    doubtful
        States lost before any was solved.
    preparations
        Workers that died in a row while they prepared the cell.
    """

    def __init__(self, like: CellResponse | None, limit: float | None) -> None:
        self.like, self._limit = like, limit
        self.doubtful: list[PendingState] = []
        self.preparations = 0

    def preparation_died(self) -> list[PorocoreError]:
        """Count a worker that died while it prepared the cell; return an error if there are too many."""
        self.preparations += 1
        if self.preparations < MOST_LOST:
            return []
        return [
            PorocoreError(
                f"{MOST_LOST} workers in a row died while they prepared the cell (out of memory, or killed); "
                "finished states are kept: resume with fewer workers or a coarser mesh"
            )
        ]

    def may_be_tried_again(self, task: PendingState, host: str) -> bool:
        """Count a worker that died over a state; return False if the state is lost, which makes it doubtful."""
        task.tries += 1
        task.host = host
        if task.tries < TRIES:
            return True
        self.doubtful.append(task)
        return False

    def take_lost(self) -> list[FinishedSolve]:
        """Return the doubtful states as lost, once a pattern of the response is known."""
        if self.like is None:
            return []
        lost, self.doubtful = self.doubtful, []
        return [
            FinishedSolve(
                task.key, failed_response(Status.lost, like=self.like), None, time.perf_counter() - task.began
            )
            for task in lost
        ]

    def judge(self, *, nothing_else: bool) -> list[PorocoreError]:
        """Return an error if several states, or all that there are, were lost before any was solved."""
        if not self.doubtful or not (nothing_else or len(self.doubtful) >= MOST_LOST):
            return []
        lost = " and ".join(repr(task.key) for task in self.doubtful)
        states = "the state" if len(self.doubtful) == 1 else "each of the states"
        limit = "" if self._limit is None else f", or over {self._limit:g} s (sampling.state_seconds)"
        self.doubtful.clear()
        return [
            PorocoreError(
                f"two workers died on {states} {lost} before any state was solved (out of memory, killed{limit}); "
                "finished states are kept: resume with fewer workers, a coarser mesh"
                f"{'' if self._limit is None else ' or more time'}"
            )
        ]


def next_for(worker: Worker, waiting: deque[PendingState], workers: Sequence[Worker]) -> PendingState:
    """Take the first state out of the queue for a worker, of those with the parameters of its last state if it can.

    A second try goes to another machine if there is one.
    """
    alone = len({other.host for other in workers}) == 1
    suitable = [task for task in waiting if alone or task.host is None or task.host != worker.host]
    queue = suitable or list(waiting)
    task = next((task for task in queue if task.member == worker.member), queue[0])
    waiting.remove(task)
    worker.member = task.member
    return task


def means_death(trouble: BaseException | None) -> bool:
    """Return whether dask reports a dead worker; its class is not imported for that."""
    return type(trouble).__name__ == "KilledWorker"


def place_of(state: PendingState | None) -> str:
    """Return where a worker failed, for a message; None: before its first state."""
    return "while it prepared the cell" if state is None else f"at state '{state.key}'"


#: Seconds between two checks of workers and interrupts while nothing is finished.
PATIENCE = 0.2


class CellPool:
    """Workers that have each prepared the same cell; a context manager.

    A worker that dies over a state, or is ended because the state takes longer than ``state_seconds``, is replaced,
    and the state is tried once more, on another machine if there is one. If that fails too, its outcome has the
    status ``lost`` and NaN in every response, and the other states go on.

    Parameters
    ----------
    factory, args
        ``factory(*args)`` returns the solver and the prepared cell in each worker. Both must be picklable: ``factory``
        is a function at the top level of a module that can be imported; workers do not see the script that runs.
    workers, scheduler, state_seconds
        Number of processes; address of a dask scheduler, None: a local cluster; time limit of a solve [s].
    tangent, fields
        Results of each solve, see :meth:`porocore.CellSolver.solve`.
    executor
        One of :data:`porocore.sampling.execution.EXECUTORS`, or any executor with ``submit(function, *args)`` that
        returns futures of :mod:`concurrent.futures`; ``workers`` is then the number of states that it gets at a time.
    like
        A response of this cell, as a pattern for those of lost states. By default, that of the first solved state.
    on_warning, on_start
        Called with warnings for the user, and before the first state is solved.
    known
        Solved states of this cell with the same results, to take from and to add to.

    Raises
    ------
    ConfigurationError
        The settings exclude each other. A missing dask or scheduler shows at the first state, which starts the workers.
    """

    def __init__(
        self,
        factory: Factory,
        args: tuple[Any, ...] = (),
        *,
        workers: int = 1,
        tangent: bool = True,
        fields: bool = True,
        executor: ExecutorChoice = "auto",
        scheduler: str | None = None,
        state_seconds: float | None = None,
        like: CellResponse | None = None,
        on_warning: Callable[[str], None] = lambda text: None,
        known: SolvedStore | None = None,
        on_start: Callable[[], None] = lambda: None,
    ) -> None:
        self.workers = workers
        self._recipe = Recipe(uuid4().hex, factory, args, tangent, fields)
        #: States over which workers died, and a response of this cell as a pattern for them.
        self.losses = Losses(like, state_seconds)
        self._limit, self._on_start = state_seconds, on_start
        self._warn, self._warned = on_warning, set[str]()
        self._waiting: deque[PendingState] = deque()
        self._running: dict[Future[Any], tuple[Worker, PendingState | None]] = {}
        self._finished: deque[FinishedSolve] = deque()
        self._failures: deque[PorocoreError] = deque()
        self._finishing = False
        self.known = known
        check_choice(executor, workers, scheduler, state_seconds)
        self._make_workers = partial(
            make_worker_backend, executor, workers, scheduler, state_seconds, self._recipe.token
        )
        self._made: WorkerBackend | None = None

    @property
    def _backend(self) -> WorkerBackend:
        """Worker backend, started at the first state."""
        if self._made is None:
            self._on_start()
            self._made = self._make_workers()
            self._tell(self._made.warnings)
        return self._made

    @property
    def pending(self) -> int:
        """Number of states submitted and not yet returned by :meth:`wait`."""
        return len(self._waiting) + len(self._finished) + len(self.losses.doubtful) + self._solving

    @property
    def has_room(self) -> bool:
        """True if another state can be submitted without waiting long for a worker."""
        if self._finished or not self.pending:  # no worker is started for states that the store holds
            return not self._finished
        return self.pending - len(self.losses.doubtful) < self._backend.slots + self._backend.ahead

    def start(self) -> None:
        """Let workers prepare the cell before there is a state to solve; this process itself does not."""
        if self._backend.eager and self._backend.separate:
            for worker in self._backend.workers():
                self._begin(worker, None, tasks.prepare, self._recipe)

    def submit(self, key: str, state: MacroState, start: CellField | None = None) -> None:
        """Submit one state (one row) with the field to start from.

        Raises
        ------
        PluginError
            dask.distributed is missing.
        PorocoreError
            The scheduler cannot be reached.
        """
        if self.known is not None and (known := self.known.find(key, state, start)):
            self._finish(known)
            return
        self._waiting.append(PendingState(key, state, start))
        if self._backend.eager:
            self._dispatch()

    def wait(self) -> FinishedSolve:
        """Return the next finished state; block until there is one.

        Raises
        ------
        PorocoreError
            The solver raised an exception, which names the state; workers die whatever they are given; or
            the scheduler has gone.
        """
        outcome = self.wait_unless(lambda: False)
        assert outcome is not None
        return outcome

    def wait_unless(self, stop: Callable[[], bool]) -> FinishedSolve | None:
        """Return the next finished state, or None as soon as ``stop()``."""
        if not self.pending:
            raise ValueError("no state was submitted to wait for")
        while not (self._finished or self._failures):
            self._dispatch()
            self._collect()
            if not self._finished:
                self._failures += self.losses.judge(nothing_else=not self._waiting and not self._solving)
            if stop() and not (self._finished or self._failures):
                return None
        if self._waiting and self._backend.eager:
            self._dispatch()
        # Good outcomes first, so that nothing that was solved is lost behind an error.
        if not self._finished:
            raise self._failures.popleft()
        return self._finished.popleft()

    def finish_running(self, until: float = float("inf")) -> Iterator[FinishedSolve]:
        """Drop the waiting states and yield those that run and end until a monotonic time, leaving out failures."""
        self._waiting.clear()
        self.losses.doubtful.clear()
        self._finishing = True
        try:
            while self._finished or (self._solving and time.monotonic() < until):
                while self._finished:
                    yield self._finished.popleft()
                if self._solving:
                    try:
                        self._collect()
                    except PorocoreError:  # the workers have gone
                        self._running.clear()
        finally:
            self._finishing = False
            self._failures.clear()

    def close(self) -> None:
        """Finish the running states and release the workers."""
        if self._made is not None:
            self._made.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind and self._made and not (self._solving and issubclass(kind, Exception)):
            self._made.abort()  # running solves and preparations have no receiver
        else:
            self.close()

    @property
    def _solving(self) -> int:
        return sum(task is not None for _, task in self._running.values())

    def _dispatch(self) -> None:
        """Hand waiting states to idle workers."""
        if not self._waiting:
            return
        busy = {id(worker) for worker, _ in self._running.values()}
        for worker in self._backend.workers():
            if id(worker) in busy:
                continue
            if self._backend.separate and not worker.prepared:
                self._begin(worker, None, tasks.prepare, self._recipe)
            elif self._waiting:
                task = next_for(worker, self._waiting, self._backend.workers())
                what = (task.key, task.state, task.start)
                if self._backend.separate:
                    self._begin(worker, task, tasks.solve, self._recipe.token, *what, self._limit)
                else:
                    self._begin(worker, task, tasks.prepare_and_solve, self._recipe, *what)

    def _begin(self, worker: Worker, task: PendingState | None, call: Callable[..., Any], *args: Any) -> None:
        try:
            self._running[worker.submit(call, *args)] = worker, task
        except BrokenExecutor:  # it died while it had nothing to do: no state is to blame
            self._backend.lost(worker)
            if task is not None:
                self._waiting.appendleft(task)

    def _collect(self) -> None:
        """Wait briefly for calls that end and for workers that vanish."""
        done, _ = wait(self._running, PATIENCE, return_when=FIRST_COMPLETED)
        if not self._running:
            self._tell(self._backend.warnings)
            time.sleep(PATIENCE)
        for future in done:
            self._take(future, *self._running.pop(future))
        there = {id(worker) for worker in self._backend.workers()}
        for future, (worker, task) in list(self._running.items()):
            if id(worker) not in there:
                del self._running[future]
                future.cancel()
                self._died(worker, task)

    def _take(self, future: Future[Any], worker: Worker, task: PendingState | None) -> None:
        trouble = future.exception() if not future.cancelled() else None
        if future.cancelled() or isinstance(trouble, BrokenExecutor) or means_death(trouble):
            self._died(worker, task)
            return
        result = Failure(type(trouble).__name__, str(trouble), "") if trouble else future.result()
        if isinstance(result, Failure):
            self._failures.append(result.as_error(SOLVER, place_of(task)))
        elif isinstance(result, Ready):
            worker.prepared, self.losses.preparations = True, 0
            self._tell(self._backend.check(result))
        elif isinstance(result, Unprepared):
            worker.prepared = False
            assert task is not None
            self._waiting.appendleft(task)
        else:
            assert task is not None
            if self.known is not None:
                self.known.keep(result, task.state, task.start)
            if result.warning:
                self._tell([result.warning])
            self._finish(result)

    def _finish(self, result: FinishedSolve) -> None:
        self._finished.append(result)
        if self.losses.like is None:
            self.losses.like = result.response
        self._finished += self.losses.take_lost()

    def _died(self, worker: Worker, task: PendingState | None) -> None:
        self._backend.lost(worker)
        if self._finishing:
            return
        if task is None:
            self._failures += self.losses.preparation_died()
        elif self.losses.may_be_tried_again(task, worker.host):
            self._waiting.appendleft(task)
        else:
            self._finished += self.losses.take_lost()

    def _tell(self, warnings: list[str]) -> None:
        for text in warnings:
            if text not in self._warned:
                self._warned.add(text)
                self._warn(text)
