"""Solving cell states side by side: what runs and what waits, apart from where it runs."""

from porocore.execution.choice import EXECUTORS as EXECUTORS
from porocore.execution.pool import CellPool as CellPool
from porocore.execution.processes import end_with_parent as end_with_parent
from porocore.execution.tasks import Outcome as Outcome
from porocore.execution.threads import THREAD_VARIABLES as THREAD_VARIABLES
