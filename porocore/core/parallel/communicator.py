"""Processes that share one macro problem (Communicator): rank, sums, maxima; the launcher's variables.

The core knows no MPI. A backend that distributes its work derives its own :class:`Communicator`.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any, TypeVar

T = TypeVar("T")
#: Rank and size as launchers tell them: Open MPI; MPICH, Intel MPI and srun --mpi=pmi2; srun --mpi=pmix.
_VARIABLES = (
    ("OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"),
    ("PMI_RANK", "PMI_SIZE"),
    ("PMIX_RANK", "SLURM_STEP_NUM_TASKS"),
)
#: Seconds, for launchers that leave the other processes alone.
_LONGEST_WAIT = 30.0


def launched() -> tuple[int, int]:
    """Return rank and number of processes as an MPI launcher has set them; (0, 1) without one.

    Slurm's own variables alone are no sign of MPI: a batch script has them too.
    """
    for rank, size in _VARIABLES:
        try:
            return int(os.environ[rank]), int(os.environ[size])
        except (KeyError, ValueError):
            continue
    return 0, 1


def launched_by_mpi() -> bool:
    """Return whether an MPI launcher has started this process, be it alone."""
    return any(rank in os.environ and size in os.environ for rank, size in _VARIABLES)


def let_the_first_speak() -> None:
    """Wait before a process other than the first ends with an error that all have.

    A launcher ends all processes as soon as one has failed, so the one that is to tell the error must not be
    overtaken; it ends this wait. Once MPI runs, leaving it waits for the others anyway.
    """
    if "mpi4py.MPI" not in sys.modules:
        time.sleep(_LONGEST_WAIT)


class Communicator:
    """The processes that solve one problem together; this one stands for a single process.

    Every method is called by all processes, in the same order.
    """

    #: Number of this process; 0 is the one that reads, writes and prints.
    rank: int = 0
    #: How many there are.
    size: int = 1

    def on_root(self, action: Callable[[], T]) -> T:
        """Run an action on process 0 only; all processes receive its value or its exception."""
        return action()

    def sum(self, value: Any) -> Any:
        """Return the sum of a number, or of an array entry by entry, over the processes."""
        return value

    def max(self, value: float) -> float:
        """Return the largest value over the processes."""
        return value

    @contextmanager
    def united(self) -> Iterator[None]:
        """Run a block that all processes complete, or none: an error of one alone ends them all."""
        yield

    @contextmanager
    def holding(self, resource: Any) -> Iterator[None]:
        """Hold a context manager, such as a locked folder, that process 0 alone enters and leaves."""
        with self.united(), ExitStack() as stack:
            self.on_root(partial(_enter, stack, resource))
            yield


def _enter(stack: ExitStack, resource: Any) -> None:
    # What the resource returns stays here: the value of an action is sent to all processes.
    stack.enter_context(resource)
