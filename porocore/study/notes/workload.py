"""Counts of a study before it runs: solves, nodes, disk, memory, time; refusal of too many."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from porocore.cell.cell import Cell
from porocore.cell.family.mesh import undeformed_count
from porocore.study.config.config import RunConfig
from porocore.study.notes.cost import CellCost
from porocore.study.notes.reach import shears

#: Nodes for each tetrahedron that a geometry expects; measured 1.7 to 2.4 of second order on images, since
#: more tetrahedra are made at the wall.
NODES_OF_TETRAHEDRON = {"linear": 0.27, "quadratic-straight": 2.0, "quadratic-curved": 2.0}
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
    solid, fluid
        Nodes of the cell's solid and fluid.
    parts
        Shares of them that are solved for the sampled states and for K.
    rest
        Share of the solid that is solved at rest.
    deformed
        True if every state also has the flow through its deformed pore.
    serial
        True if states are solved by the run's own process, without workers.
    undeformed, members
        Undeformed members of a family of cells, and members that are prepared for other states; 0 without parameters.
    """

    states: int
    workers: int
    steps: int
    runs: int
    elements: int
    profiles: int
    solid: int
    fluid: int
    parts: tuple[float, float] = (1.0, 1.0)
    rest: float = 1.0
    deformed: bool = False
    serial: bool = False
    undeformed: int = 0
    members: int = 0

    @classmethod
    def of(
        cls, config: RunConfig, states: int, elements: int, nodes: tuple[int, int], members: int = 0
    ) -> Workload:
        """Return the counts of ``config``, of which the others are known from its sampler and meshes."""
        time = config.macro.time
        return cls(
            states + config.sampling.test.count,
            workers_here(config),
            time.least_steps,
            2 * len(config.macro.loads),
            elements,
            len(time.profiles) + 2,
            *nodes,
            (share_solved(config), share_of_flow(config)),
            parts_at_rest(config.cell)[0],
            config.conductivity == "deformed",
            solves_itself(config),
            undeformed_count(config.cell) if config.cell.is_family else 0,
            members,
        )

    @property
    def disk(self) -> float:
        """Approximate final size of the run folder [bytes]."""
        return self.disk_of_states + self.disk_of_runs

    @property
    def disk_of_states(self) -> float:
        """Approximate size of the solved states [bytes]."""
        return self.states * (STATE + NODE * self.solid)

    @property
    def disk_of_runs(self) -> float:
        """Approximate size of the solutions of the body [bytes]."""
        fields = self.profiles * self.elements * POINTS_OF_ELEMENT * POINT * 8
        return self.runs * (self.steps * STEP * 8 + fields)

    @property
    def memory(self) -> float:
        """Approximate memory of all processes at once [bytes]: workers, and the run itself, which solves K and rest."""
        return max((1 if self.serial else self.workers + 1) * self.cell.memory, self.cell.memory_of_flow)

    @property
    def cell(self) -> CellCost:
        """Costs of the cell's problems for the sampled states."""
        return CellCost(self.solid, self.fluid, self.parts, self.deformed)

    @property
    def cell_time(self) -> float:
        """Approximate time of all cell problems, K and the state at rest included; the states share the workers [s]."""
        cell, at_rest, workers = self.cell, replace(self.cell, parts=(self.rest, 1.0)), max(1, self.workers)
        again = 0.0 if self.serial and self.rest == cell.parts[0] else cell.first
        undeformed = cell.conductivity + at_rest.first + at_rest.state
        members = math.ceil(self.members / workers) * cell.first
        members += math.ceil(self.undeformed / workers) * undeformed
        return undeformed + again + members + math.ceil(self.states / workers) * cell.state

    def line(self, name: str | None = None) -> str:
        """Return the cell problems for reading; ``name`` is that of the cell."""
        cell, workers = self.cell, max(1, self.workers)
        solid, fluid = cell.nodes
        head = "" if name is None else f"{name}: "
        return (
            f"  {head}cell problems of {solid:,.0f} nodes of the solid and {fluid:,.0f} of the fluid: "
            f"{as_time(cell.state)} for a state with its derivatives, {as_time(cell.state + cell.first)} for the "
            f"first, {as_time(cell.conductivity)} for K; "
            f"all cells {as_time(self.cell_time)} on {workers} quiet {'core' if workers == 1 else 'cores'}"
        )

    @property
    def each(self) -> str:
        """Memory of each process in words, after a comma; empty where there are no workers."""
        if self.serial or not self.workers:
            return ""
        who = f"{self.workers} {'worker' if self.workers == 1 else 'workers'} and of the run itself"
        return f", {self.cell.memory / 1e9:.2g} GB each of {who}"


def work_lines(works: Mapping[str | None, Workload]) -> Iterator[str]:
    """Yield the counts of a study for reading, by the name of the cell: None for that of the rest of the body."""
    first, largest = works[None], max(works.values(), key=lambda work: work.memory)
    states, kinds = sum(work.states for work in works.values()), len(works)
    disk = sum(work.disk_of_states for work in works.values()) + first.disk_of_runs
    yield (
        f"work: {states} states of {'the cell' if kinds == 1 else f'{kinds} cells'}, {first.runs} macro runs of "
        f"{first.steps} steps or more; some {disk / 1e9:.2g} GB on disk, {largest.memory / 1e9:.2g} GB of memory in "
        f"all while cells are solved{largest.each}"
    )
    yield from (work.line(name) for name, work in works.items())


def workers_here(config: RunConfig) -> int:
    """Return the number of processes of this machine that solve cells; 0 with a scheduler."""
    sampling = config.sampling
    if sampling.scheduler is not None:
        return 0
    return 1 if sampling.executor == "serial" else sampling.worker_count()


def solves_itself(config: RunConfig) -> bool:
    """Return True if the process that runs the study solves the states, without workers beside it."""
    sampling = config.sampling
    alone = sampling.executor == "auto" and sampling.state_seconds is None and workers_here(config) == 1
    return sampling.scheduler is None and (sampling.executor == "serial" or alone)


def share_solved(config: RunConfig) -> float:
    """Return the largest share of the cell that is solved for any state: an eighth, or the whole."""
    return 1 / 8 if config.cell.mirrored and not shears(config.sampling.inputs) else 1.0


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
    eighth, whole = (as_time(CellCost(nodes, 0, (share, 1.0)).state) for share in (1 / 8, 1))
    them = " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
    is_ = "would be" if more else "is" if len(names) == 1 else "are"
    return [
        f"since {them} {is_} sampled, states are solved on the whole cell instead of an eighth: some {whole} a state "
        f"on one quiet core instead of {eighth}"
    ]


def share_of_flow(config: RunConfig) -> float:
    """Return the share of the fluid on which its flow is solved."""
    return 1 / 8 if config.cell.symmetric else 1.0


def expected_cost(config: RunConfig) -> CellCost:
    """Return the approximate costs of the problems of the cell, without meshing it."""
    nodes = nodes_of(config.cell, config.cell.geometry.porosity)
    return CellCost(*nodes, (share_solved(config), share_of_flow(config)))


def parts_at_rest(cell: Cell) -> tuple[float, float]:
    """Return the shares of the solid and of the fluid that are solved at rest and for K."""
    return 1 / 8 if cell.mirrored else 1.0, 1 / 8 if cell.symmetric else 1.0


def nodes_of(cell: Cell, porosity: float) -> tuple[float, float]:
    """Return the approximate numbers of nodes of the whole solid and of the fluid of one cell, without meshing them."""
    geometry, mesh = cell.geometry, cell.mesh
    solid = geometry.elements(mesh.size) * (1 - porosity) * NODES_OF_TETRAHEDRON[mesh.element]
    # The flow is quadratic on every mesh, and that of one cell.
    fluid = geometry.elements(mesh.fluid_size) * porosity * NODES_OF_TETRAHEDRON["quadratic-curved"]
    return solid * math.prod(cell.supercell), fluid


def as_time(seconds: float) -> str:
    """Return a time that is known roughly, for reading."""
    for unit, length in (("days", 86_400), ("h", 3600), ("min", 60), ("s", 1)):
        if seconds >= 2 * length:
            return f"{float(f'{seconds / length:.2g}'):g} {unit}"
    return f"{seconds:.1g} s"
