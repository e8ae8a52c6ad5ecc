"""Workers that solve cell states side by side: this process, processes, dask, executors; the pool."""

from porocore.sampling.execution.choice import EXECUTORS as EXECUTORS
from porocore.sampling.execution.environment import require_children as require_children
from porocore.sampling.execution.environment import script_left_out as script_left_out
from porocore.sampling.execution.pool import CellPool as CellPool
from porocore.sampling.execution.processes import end_with_parent as end_with_parent
from porocore.sampling.execution.tasks import FinishedSolve as FinishedSolve
