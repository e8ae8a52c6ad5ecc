"""Processes that share one macro problem, and threads of numerical libraries."""

from porocore.core.parallel.communicator import Communicator as Communicator
from porocore.core.parallel.communicator import launched as launched
from porocore.core.parallel.communicator import launched_by_mpi as launched_by_mpi
from porocore.core.parallel.communicator import let_the_first_speak as let_the_first_speak
