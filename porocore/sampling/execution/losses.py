"""Account of dead workers (a state is tried again, lost, or an error); the state that a worker takes next."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from porocore.errors import PorocoreError
from porocore.interfaces.cell import CellField
from porocore.interfaces.records import failed_response
from porocore.sampling.execution.tasks import FinishedSolve, Worker
from porocore.states import CellResponse, MacroState, Status

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
