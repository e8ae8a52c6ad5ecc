"""Choice of the workers by name (this process, processes, dask); settings that exclude each other."""

from __future__ import annotations

import signal
from typing import Literal

from porocore.errors import ConfigurationError
from porocore.sampling.execution.futures import FuturesBackend, SubmitsFutures
from porocore.sampling.execution.processes import ProcessBackend
from porocore.sampling.execution.worker_backend import SerialBackend, WorkerBackend

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
        The executor is unknown, the settings exclude each other, or this system has no time limits.
    """
    if workers < 1:
        raise ValueError(f"expected at least one worker, got {workers}")
    if state_seconds is not None and not hasattr(signal, "setitimer"):
        raise ConfigurationError("sampling.state_seconds: this system cannot end a solve that takes too long")
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
