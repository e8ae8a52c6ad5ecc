"""MPI processes that solve one macro problem together: sums, maxima, united lists, failure of one."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from mpi4py import MPI

from porocore.core.parallel.communicator import Communicator, T
from porocore.core.unexpected import describe
from porocore.errors import PorocoreError, SolveError

#: Seconds that a process which has failed waits for the others to fail alike.
PATIENCE = 10.0


class MpiCommunicator(Communicator):
    """All processes of a communicator."""

    def __init__(self, comm: MPI.Intracomm) -> None:
        self.comm, self.rank, self.size = comm, comm.rank, comm.size
        # A communicator of its own: a process may fail while others still communicate.
        self._meetings = comm.Dup()

    def on_root(self, action: Callable[[], T]) -> T:
        """Call on process 0, and return the value or raise the exception on all."""
        outcome: tuple[T, Exception | None] | tuple[None, Exception] | None = None
        if self.rank == 0:
            try:
                outcome = action(), None
            except Exception as error:  # noqa: BLE001 - raised below, on every process
                outcome = None, error
        value: T
        value, failure = self.comm.bcast(outcome, root=0)
        if failure is not None:
            raise failure
        return value

    def sum(self, value: Any) -> Any:
        """Return the sum over the processes."""
        if not isinstance(value, np.ndarray):
            return self.comm.allreduce(value, op=MPI.SUM)
        mine = np.ascontiguousarray(value)
        whole = np.empty_like(mine)
        self.comm.Allreduce(mine, whole, op=MPI.SUM)
        return whole

    def max(self, value: float) -> float:
        """Return the largest value over the processes."""
        return float(self.comm.allreduce(value, op=MPI.MAX))

    @contextmanager
    def united(self) -> Iterator[None]:
        """Raise an error of all processes on all; report one that leaves others waiting, and end all processes."""
        failure: BaseException | None = None
        try:
            yield
        except BaseException as error:  # noqa: BLE001 - raised below, once the others have been heard
            failure = error
        meeting = self._meetings.Ibarrier()
        since = time.monotonic()
        while not meeting.Test():
            if failure is not None and time.monotonic() - since > PATIENCE:
                self._end_all(failure)
            time.sleep(0.001)
        said = self._meetings.allgather(None if failure is None else f"{type(failure).__name__}: {failure}")
        if failure is not None:
            raise failure
        for rank, text in enumerate(said):
            if text is not None:
                raise SolveError(f"process {rank} of {self.size} failed alone ({text})")

    def _end_all(self, failure: BaseException) -> None:
        expected = isinstance(failure, PorocoreError)
        said = str(failure) if expected else describe(failure)
        sys.stderr.write(f"error: process {self.rank} of {self.size}: {said}\n")
        sys.stderr.flush()
        self.comm.Abort(2 if expected else 70)
