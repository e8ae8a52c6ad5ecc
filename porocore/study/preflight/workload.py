"""Numbers of solves, bytes on disk and bytes of memory of a study, before anything is solved."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from dataclasses import dataclass

from porocore.core.models.bounds import MOST_STATES
from porocore.errors import ConfigurationError
from porocore.study.config.config import RunConfig

#: Memory of one process that solves cells [bytes], shared pages counted once: in the benchmark with either
#: finite-element backend; of the libraries alone; for each node of the solid that is solved. The last is the largest of
#: 0.68 GB at 12,017 nodes, 1.58 GB at 42,164 and 3.7 GB at 102,597 (images, scikit-fem).
PROCESS, LIBRARIES, SOLID_NODE = 2.7e8, 2e8, 4e4
#: Nodes for each tetrahedron that a geometry expects; measured 1.7 to 2.4 of second order on images, since
#: more tetrahedra are made at the wall.
NODES_OF_TETRAHEDRON = {"linear": 0.27, "quadratic-straight": 2.0, "quadratic-curved": 2.0}
#: Largest number of nodes of the solid for which the time of a state was measured, and that time on one quiet core [s].
TIMED, SECONDS = 12_000, 10
#: The time of a state goes with this power of the nodes; a sheared state of 8,444 took 17 times as long as one of an
#: eighth (medians of 64 each).
POWER = 1.4
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
    process
        Memory of one process that solves cells [bytes].
    """

    states: int
    workers: int
    steps: int
    runs: int
    elements: int
    profiles: int
    nodes: int
    process: float = PROCESS

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
            len(time.profiles) + 2,
            nodes,
            process_memory(nodes * share_solved(config)),
        )

    @property
    def disk(self) -> float:
        """Approximate final size of the run folder [bytes]."""
        fields = self.profiles * self.elements * POINTS_OF_ELEMENT * POINT * 8
        return self.states * (STATE + NODE * self.nodes) + self.runs * (self.steps * STEP * 8 + fields)

    @property
    def memory(self) -> float:
        """Approximate memory of all processes that solve cells [bytes]."""
        return max(1, self.workers) * self.process

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


def share_solved(config: RunConfig) -> float:
    """Return the largest share of the cell that is solved for any state: an eighth, or the whole."""
    return 1 / 8 if config.cell.mirrored and not shears(config.sampling.inputs) else 1.0


def shears(names: Iterable[str]) -> list[str]:
    """Return those of the components of H that are off its diagonal."""
    return [name for name in names if name[0] == "H" and name[1] != name[2]]


def sheared(config: RunConfig, nodes: int, more: Iterable[str] = ()) -> list[str]:
    """Return a note on shears that take the whole cell instead of an eighth, none where that is not so.

    Parameters
    ----------
    config
        With the inputs.
    nodes
        Nodes of the whole solid.
    more
        Components that would be sampled in addition; the note is on these.
    """
    sampled, names = shears(config.sampling.inputs), shears(more or config.sampling.inputs)
    if not config.cell.mirrored or not names or (more and sampled):
        return []
    eighth, whole = (_rounded(state_seconds(nodes * share)) for share in (1 / 8, 1))
    them = " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
    is_ = "would be" if more else "is" if len(names) == 1 else "are"
    return [
        f"since {them} {is_} sampled, states are solved on the whole cell instead of an eighth: some {whole} s a state "
        f"on one quiet core instead of {eighth} s"
    ]


def _rounded(seconds: float) -> str:
    return f"{seconds:.1g}" if seconds < 10 else f"{round(seconds, 1 - len(str(int(seconds)))):.0f}"


def expected_nodes(config: RunConfig) -> float:
    """Return the approximate number of nodes of the solid that is solved, without meshing it."""
    cell = config.cell
    tetrahedra = cell.geometry.elements(cell.mesh.size) * (1 - cell.geometry.porosity)
    nodes = tetrahedra * math.prod(cell.supercell) * NODES_OF_TETRAHEDRON[cell.mesh.element]
    return nodes * share_solved(config)


def process_memory(nodes: float) -> float:
    """Return the memory of one process that solves a solid of so many nodes [bytes]."""
    return max(PROCESS, LIBRARIES + SOLID_NODE * nodes)


def require_memory(config: RunConfig) -> None:
    """Refuse processes that this machine has too little memory for.

    Raises
    ------
    ConfigurationError
        The mesh of the cell is too fine, or the processes are too many.
    """
    workers, there = workers_here(config), memory_here()
    if there is None or workers == 0:
        return
    nodes, size = expected_nodes(config), config.cell.mesh.size
    process = process_memory(nodes)
    if process > there:
        larger = size * (SOLID_NODE * nodes / max(there - LIBRARIES, LIBRARIES)) ** (1 / 3)
        raise ConfigurationError(
            f"cell.mesh.size: at {size:g} the solid has about {nodes:,.0f} nodes, and solving it needs some "
            f"{process / 1e9:.3g} GB of memory, but this machine has {there / 1e9:.3g} GB; take {larger:.2g} or more"
        )
    if workers > 1 and workers * process > there:
        raise ConfigurationError(
            f"sampling.workers: {workers} processes need some {workers * process / 1e9:.3g} GB of memory, "
            f"{process / 1e9:.2g} GB each, but this machine has {there / 1e9:.3g} GB; take at most "
            f"{max(1, int(there / process))}"
        )


def state_seconds(nodes: float) -> float:
    """Return the approximate time of a state on one quiet core, given the nodes of the solid that are solved [s]."""
    return float(SECONDS * (nodes / TIMED) ** POWER)


def slow_states(nodes: float, size: float) -> str:
    """Return a note on a solid for which the time of a state was not measured; empty for a smaller one."""
    if nodes <= TIMED:
        return ""
    larger = size * (nodes / TIMED) ** (1 / 3)
    return (
        f"{nodes:,.0f} nodes of the solid are solved at a time; {TIMED:,} take some {SECONDS} s a state on one core, "
        f"more were not measured and may take many minutes; cell.mesh.size: {larger:.2g} has about {TIMED:,}"
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
