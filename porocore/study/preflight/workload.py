"""Numbers of solves, bytes on disk and bytes of memory of a study, before anything is solved."""

from __future__ import annotations

import os
from dataclasses import dataclass

from porocore.core.models.bounds import MOST_STATES
from porocore.errors import ConfigurationError
from porocore.study.config.config import RunConfig

#: Memory of one process that solves cells [bytes], shared pages counted once: 0.27 GB in the benchmark with either
#: finite-element backend. Finer meshes take more: 0.65 GB at half the mesh size.
PROCESS = 2.7e8
#: Bytes of a solved state with its derivatives, and of each node of its field.
STATE, NODE = 4_000, 24
#: Numbers of one time step in a history, and of one quadrature point in a kept field.
STEP, POINT = 60, 30
#: Quadrature points of a hexahedron.
POINTS_OF_ELEMENT = 27


@dataclass(frozen=True)
class Workload:
    """Counts of a study.

    Attributes
    ----------
    states
        States that the sampler expects to ask for, and the held-out ones.
    workers
        Processes of this machine that solve them at the same time; 0 with a scheduler.
    steps
        Time steps of one macro run, at least.
    runs
        Macro runs: each load with the cell's law and linearly.
    elements, profiles
        Elements of the body, and times at which fields are kept.
    nodes
        Nodes of the cell's solid.
    """

    states: int
    workers: int
    steps: int
    runs: int
    elements: int
    profiles: int
    nodes: int

    @classmethod
    def of(cls, config: RunConfig, states: int, elements: int, nodes: int) -> Workload:
        """Return the counts of ``config``, of which the first three are known from its sampler and meshes."""
        time = config.macro.time
        steps = time.ramp_increments + int((time.end - time.ramp_increments * time.ramp_step) / time.step) + 1
        return cls(
            states + config.sampling.test.count,
            workers_here(config),
            steps,
            2 * len(config.macro.loads),
            elements,
            len(time.profiles) + 1,
            nodes,
        )

    @property
    def disk(self) -> float:
        """Approximate final size of the run folder [bytes]."""
        fields = self.profiles * self.elements * POINTS_OF_ELEMENT * POINT * 8
        return self.states * (STATE + NODE * self.nodes) + self.runs * (self.steps * STEP * 8 + fields)

    @property
    def memory(self) -> float:
        """Approximate memory of all processes that solve cells [bytes]."""
        return max(1, self.workers) * PROCESS

    def as_line(self) -> str:
        """Return the counts for reading."""
        return (
            f"{self.states} states of the cell, {self.runs} macro runs of {self.steps} steps or more; "
            f"some {self.disk / 1e9:.2g} GB on disk, {self.memory / 1e9:.2g} GB of memory while cells are solved"
        )


def workers_here(config: RunConfig) -> int:
    """Return the number of processes of this machine that solve cells; 0 with a scheduler."""
    sampling = config.sampling
    if sampling.scheduler is not None:
        return 0
    return 1 if sampling.executor == "serial" else sampling.worker_count()


def require_memory(config: RunConfig) -> None:
    """Refuse more processes than this machine has memory for.

    Raises
    ------
    ConfigurationError
        The processes are too many.
    """
    workers, there = workers_here(config), memory_here()
    if there is not None and workers > 1 and workers * PROCESS > there:
        raise ConfigurationError(
            f"sampling.workers: {workers} processes need some {workers * PROCESS / 1e9:.3g} GB of memory, "
            f"{PROCESS / 1e9:g} GB each, but this machine has {there / 1e9:.3g} GB; take at most "
            f"{max(1, int(there / PROCESS))}"
        )


def require_states(config: RunConfig, expected: int) -> None:
    """Refuse a sampler that expects to ask for more states than can be solved.

    Raises
    ------
    ConfigurationError
        The states are too many.
    """
    if not expected <= MOST_STATES:
        raise ConfigurationError(
            f"sampling: sampler '{config.sampling.sampler}' would ask for {float(expected):.3g} states; at most "
            f"{MOST_STATES} are solved: take fewer or larger steps"
        )


def memory_here() -> float | None:
    """Return the memory of this machine [bytes]; None if the system does not tell."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return None
