"""Pool of workers (CellPool): submit and wait for states, queue, replacement of dead workers."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from functools import partial
from types import TracebackType
from typing import Any, Self
from uuid import uuid4

from porocore.core.parallel.failure import Failure
from porocore.errors import PorocoreError
from porocore.interfaces.cell import CellField
from porocore.sampling.execution import tasks
from porocore.sampling.execution.choice import ExecutorChoice, check_choice, make_worker_backend
from porocore.sampling.execution.losses import Losses, PendingState, means_death, next_for, place_of
from porocore.sampling.execution.solved_store import SolvedStore
from porocore.sampling.execution.tasks import SOLVER, Factory, FinishedSolve, Ready, Recipe, Unprepared
from porocore.sampling.execution.worker_backend import Worker, WorkerBackend
from porocore.states import CellResponse, MacroState

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
