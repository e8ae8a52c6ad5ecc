"""Calls that run in a worker: prepare the cell, solve one state, release; results and failures as data.

An executor calls these functions. Every exception travels back as text.
"""

from __future__ import annotations

import atexit
import os
import signal
import socket
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

from porocore.core.inputs.input_space import InputSpace
from porocore.core.parallel.failure import Failure
from porocore.core.parallel.threads import THREAD_VARIABLES
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
    #: Values of :data:`porocore.core.parallel.threads.THREAD_VARIABLES` there.
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
        with _ended_after(limit):
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


@contextmanager
def _ended_after(seconds: float | None) -> Iterator[None]:
    # The system itself takes the default action of SIGALRM, so no library can block it.
    if seconds is None:
        yield
        return
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
