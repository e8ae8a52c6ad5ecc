"""Workers that solve cell states side by side: this process, processes, dask, executors; the pool."""

from porocore.sampling.execution.pool import EXECUTORS as EXECUTORS
from porocore.sampling.execution.pool import CellPool as CellPool
from porocore.sampling.execution.tasks import FinishedSolve as FinishedSolve
