"""Calls that run in a worker, and the interface of workers; those in this process, and those of an executor.

An executor calls these functions. Every exception travels back as text.
"""

from __future__ import annotations

import atexit
import os
import socket
import threading
import time
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any, Protocol

from porocore.core.inputs import InputSpace
from porocore.core.parallel.calls import Failure
from porocore.core.parallel.limits import ended_after
from porocore.core.parallel.memory import THREAD_VARIABLES
from porocore.errors import PorocoreError
from porocore.interfaces.cell import CellField, CellSolver
from porocore.interfaces.records import SolvedState
from porocore.plugins.border import solution_of
from porocore.sampling.execution.members import MemberSolver
from porocore.states import CellResponse, MacroState

#: Returns a solver and its prepared cell; called once in each worker.
Factory = Callable[..., tuple[CellSolver, Any]]
#: Who raises, in messages.
SOLVER = "the cell solver"
#: Prepared cells that a process keeps: those of the pools that used it last.
MOST_CELLS = 4


@dataclass(frozen=True, eq=False)
class FinishedSolve:
    """Finished solve: one row, its field if requested, the wall time [s], and whether it came from the store.

    ``warning`` is for the user; empty: there is none.
    """

    key: str
    response: CellResponse
    field: CellField | None
    seconds: float
    stored: bool = False
    warning: str = ""

    def record(self, inputs: InputSpace, x: tuple[float, ...], start: str | None = None) -> SolvedState:
        """Return the solve at ``inputs`` with the values ``x`` for a dataset, begun at the field of ``start``."""
        return SolvedState(self.key, x, inputs.scatter(x), self.response, self.seconds, start, self.field)


@dataclass(frozen=True)
class Recipe:
    """Recipe for the solver and its cell, and the options of each solve; small, unlike a prepared cell."""

    token: str
    factory: Factory
    args: tuple[Any, ...]
    tangent: bool
    fields: bool


@dataclass(frozen=True)
class Ready:
    """Worker that has prepared the cell."""

    process: int
    host: str
    version: str
    #: Values of :data:`porocore.core.parallel.memory.THREAD_VARIABLES` there.
    threads: tuple[str | None, ...]


@dataclass(frozen=True)
class Unprepared:
    """Worker that does not hold the cell any more."""


_cells: OrderedDict[tuple[str, int], tuple[CellSolver, Any, Recipe]] = OrderedDict()
_lock = threading.Lock()
# Prepared cells may hold memory of a library, which must be given back before that library is taken down.
atexit.register(_cells.clear)


def prepare(recipe: Recipe, place: int = 0) -> Ready | Failure:
    """Prepare the cell and keep it in this process."""
    try:
        solver, prepared = recipe.factory(*recipe.args)
    except Exception as error:  # noqa: BLE001 - it is raised again where the states are asked for
        return Failure.from_exception(error)
    with _lock:
        _cells[recipe.token, place] = solver, prepared, recipe
        while len({token for token, _ in _cells}) > MOST_CELLS:
            oldest, _ = next(iter(_cells))
            for kept in [kept for kept in _cells if kept[0] == oldest]:
                del _cells[kept]
    threads = tuple(os.environ.get(name) for name in THREAD_VARIABLES)
    return Ready(os.getpid(), socket.gethostname(), version("porocore"), threads)


def release(token: str) -> None:
    """Release the cells of one pool in this process."""
    with _lock:
        for kept in [kept for kept in _cells if kept[0] == token]:
            del _cells[kept]


def solve(
    token: str,
    key: str,
    state: MacroState,
    start: CellField | None,
    limit: float | None = None,
    place: int = 0,
) -> FinishedSolve | Failure | Unprepared:
    """Solve one state with the cell that was prepared under ``token``.

    Parameters
    ----------
    limit
        Seconds after which the system ends this process, wherever it hangs.
    """
    with _lock:
        if (token, place) not in _cells:
            return Unprepared()
        _cells.move_to_end((token, place))
        solver, prepared, recipe = _cells[token, place]
    try:
        began = time.perf_counter()
        # A member that has to be prepared is no part of what is limited, like the cell of a worker.
        missing = solver.why_missing(prepared, state) if isinstance(solver, MemberSolver) else []
        with ended_after(limit):
            solution = solution_of(
                solver, prepared, state, start=[start], tangent=recipe.tangent, fields=recipe.fields
            )
        seconds = time.perf_counter() - began
    except Exception as error:  # noqa: BLE001 - as above
        return Failure.from_exception(error)
    field, warning = solution.fields[0] if solution.fields else None, "; ".join(missing)
    return FinishedSolve(key, solution.response, field, seconds, warning=warning)


def prepare_and_solve(
    recipe: Recipe, key: str, state: MacroState, start: CellField | None
) -> FinishedSolve | Failure | Unprepared:
    """Prepare the cell in this thread if necessary and solve one state, for executors with unnamed workers."""
    place = threading.get_ident()
    with _lock:
        known = (recipe.token, place) in _cells
    if not known:
        made = prepare(recipe, place)
        if isinstance(made, Failure):
            return made
    return solve(recipe.token, key, state, start, place=place)


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
