"""Forecast of a study before it runs: solves, nodes, disk, memory, and the times of its stages on quiet cores."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from multiprocessing import current_process

from porocore.cell.cell import Cell
from porocore.cell.family.mesh import undeformed_count
from porocore.core.parallel import launched_by_mpi
from porocore.interfaces.sampler import Sampler
from porocore.macro.integration.newton import StepForecast
from porocore.macro.integration.stepping import Stepper
from porocore.macro.linear_systems import available_bytes, fits
from porocore.macro.problem import MacroProblem, body_mesh
from porocore.sampling.forecast import Guess
from porocore.sampling.samplers.macro_driven import MacroDriven
from porocore.states import Array
from porocore.study.config.config import MacroSettings, RunConfig, SamplingSettings
from porocore.study.notes import cost
from porocore.study.notes.cost import CellCost
from porocore.study.notes.reach import shears
from porocore.study.run.exploration import coarse_problem

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
    cell
        Costs of the cell's problems for the sampled states.
    rest
        Share of the solid that is solved at rest.
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
    cell: CellCost
    rest: float = 1.0
    serial: bool = False
    undeformed: int = 0
    members: int = 0

    @classmethod
    def of(
        cls, config: RunConfig, states: int, elements: int, nodes: tuple[int, int], members: int = 0
    ) -> Workload:
        """Return the counts of ``config``, of which the others are known from its sampler and meshes."""
        time, (rest, flow) = config.macro.time, parts_at_rest(config.cell)
        share = share_solved(config.cell, config.sampling.inputs)
        return cls(
            states + config.sampling.test.count,
            config.sampling.workers_here,
            time.least_steps,
            2 * len(config.macro.loads),
            elements,
            len(time.profiles) + 2,
            CellCost(*nodes, (share, flow), config.conductivity == "deformed"),
            rest,
            config.sampling.solves_itself,
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
        return self.states * (STATE + NODE * self.cell.solid)

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


def share_solved(cell: Cell, inputs: Iterable[str]) -> float:
    """Return the largest share of a cell that is solved for any state of some inputs: an eighth, or the whole."""
    return 1 / 8 if cell.mirrored and not shears(inputs) else 1.0


def sheared(cell: Cell, inputs: Collection[str], nodes: int, more: Iterable[str] = ()) -> list[str]:
    """Return a note on shears that take the whole cell instead of an eighth, none where that is not so.

    Parameters
    ----------
    cell, inputs
        The cell, and the components that are sampled.
    nodes
        Nodes of the whole solid.
    more
        Components that would be sampled in addition; the note is on these.
    """
    sampled, names = shears(inputs), shears(more or inputs)
    if not cell.mirrored or not names or (more and sampled):
        return []
    eighth, whole = (as_time(CellCost(nodes, 0, (share, 1.0)).state) for share in (1 / 8, 1))
    them = " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
    is_ = "would be" if more else "is" if len(names) == 1 else "are"
    return [
        f"since {them} {is_} sampled, states are solved on the whole cell instead of an eighth: some {whole} a state "
        f"on one quiet core instead of {eighth}"
    ]


def expected_cost(cell: Cell, inputs: Iterable[str]) -> CellCost:
    """Return the approximate costs of the problems of a cell for states of some inputs, without meshing it."""
    nodes = nodes_of(cell, cell.geometry.porosity)
    return CellCost(*nodes, (share_solved(cell, inputs), parts_at_rest(cell)[1]))


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


#: Seconds of work that are worth a process of its own: it starts in 1.3 s, with the libraries of a training in 3 s.
WORTHWHILE = 3.0
#: Bytes for each unknown of a body in three dimensions: 22 kB with a factor at 91,000 unknowns, less with an iteration.
UNKNOWN = 22e3


@dataclass(frozen=True)
class RunTimes:
    """Times of the stages of a run on quiet cores [s].

    Attributes
    ----------
    cells
        Of all cell problems.
    choosing
        Of the sampler, which chooses states between rounds.
    training
        Of the surrogate; None where it is not known.
    macro
        Of the body under all loads with both laws.
    around
        Of the start and of the report.
    """

    cells: float
    choosing: float
    training: float | None
    macro: float
    around: float

    @classmethod
    def of(cls, config: RunConfig, work: Workload, sampler: Sampler) -> RunTimes:
        """Return the times of a study, of which the states and the meshes are known."""
        training = cost.TRAINING.get((config.surrogate.backend, config.surrogate_model))
        start = cost.START if work.workers > 1 else 0.0
        macro = [macro_time(config.closure, config.macro.problem(load)) for load in config.macro.loads]
        return cls(
            work.cell_time + start,
            rounds(sampler) * decision_time(config.macro, config.closure, sampler),
            None if training is None else training.at(sampler.expected),
            max(*macro, sum(macro) / bodies_at_once(config, 2 * len(macro))),
            cost.BEGIN + cost.REPORT + cost.REPORT_OF_LOAD * len(config.macro.loads),
        )

    @classmethod
    def together(cls, times: Sequence[RunTimes]) -> RunTimes:
        """Return the times of a study of several cells, of one body, by those of the studies of each."""
        trained = [each.training for each in times if each.training is not None]
        return replace(
            times[0],
            cells=sum(each.cells for each in times),
            choosing=sum(each.choosing for each in times),
            training=sum(trained) if len(trained) == len(times) else None,
        )

    @property
    def total(self) -> float:
        """Time of the run, without what is not known [s]."""
        return self.cells + self.choosing + (self.training or 0.0) + self.macro + self.around

    def line(self, workers: int) -> str:
        """Return the times as a sentence."""
        parts = [f"cells {as_time(self.cells)}"]
        parts += [f"choosing them {as_time(self.choosing)}"] if self.choosing else []
        parts += [] if self.training is None else [f"training {as_time(self.training)}"]
        parts += [f"macro {as_time(self.macro)}", f"start and report {as_time(self.around)}"]
        unknown = "; the time of training is not known, and comes on top" if self.training is None else ""
        cores = f"{workers} quiet {'core' if workers == 1 else 'cores'}"
        return (
            f"  the run takes about {as_time(self.total)} in all on {cores}, within a factor of two or so: "
            f"{', '.join(parts)}{unknown}"
        )


def macro_time(closure: str, problem: MacroProblem) -> float:
    """Return the time of a body with the law of a closure and linearly, on a quiet core [s]."""
    changing = problem.time.tolerance is not None or problem.is_column
    linear = 1.0 if changing else cost.LINEAR_FIXED
    return _law_time(closure, problem) + expected_steps(problem) * linear * _system_time(problem)


def _system_time(problem: MacroProblem) -> float:
    """Return the time of a linear system of a body, without that of its law."""
    return cost.SYSTEM.at(_points(problem)) * (cost.COLUMN if problem.is_column else 1.0)


def _law_time(closure: str, problem: MacroProblem) -> float:
    """Return the time of a body with the cell's law."""
    law = cost.LAW.get(closure, max(cost.LAW.values())) * _points(problem)
    system = _system_time(problem) + law
    return expected_steps(problem) * cost.SYSTEMS * system


def _points(problem: MacroProblem) -> int:
    """Return the number of quadrature points of a body."""
    mesh = body_mesh(problem)
    return len(mesh.cells) * len(mesh.element.weights)


def expected_steps(problem: MacroProblem) -> float:
    """Return about how many time steps a body takes; those of a plan without tolerance are counted.

    A step of backward Euler has an error that goes with its square, so that the number of steps between two kinks of
    the loads goes with the inverse root of the tolerance.
    """
    planned, plan = StepForecast(problem).remaining(), problem.time
    if plan.tolerance is None:
        return planned
    kinks = {kink for kink in Stepper(plan, problem.corners).kinks if kink < plan.end}
    found = cost.STEPS * len(kinks) / math.sqrt(plan.tolerance)
    return max(planned, found * (cost.STEPS_OF_CONTACT if problem.contact else 1.0))


def decision_time(macro: MacroSettings, closure: str, sampler: Sampler) -> float:
    """Return the time in which a sampler chooses a round on a quiet core [s]."""
    if not isinstance(sampler, MacroDriven):
        return sampler.outlook.decision
    problems = [coarse_problem(macro.problem(load), sampler.elements, sampler.steps) for load in macro.loads]
    return sum(_law_time(closure, problem) for problem in problems)


def rounds(sampler: Sampler) -> int:
    """Return on how many rounds a sampler decides in a time that counts, at most."""
    outlook = sampler.outlook
    if not outlook.batch or not outlook.decision:
        return 0
    # The first states are a design; after them and after every round the body is computed.
    begun = sampler.initial - outlook.batch if isinstance(sampler, MacroDriven) else 0
    return max(math.ceil((outlook.expected - begun) / outlook.batch), 1)


def guessed_times(config: RunConfig, sampler: Sampler, solved: Array | None = None) -> Guess:
    """Return the times that a sampling is likely to take on this machine with what else it has to do at present.

    Parameters
    ----------
    config
        With cell, workers and solver.
    sampler
        Tells how long it takes to decide.
    solved
        Seconds of states that these workers have solved before.
    """
    workers, slow = config.sampling.workers_here, slowness()
    decision = decision_time(config.macro, config.closure, sampler) * slow
    if solved is not None and len(solved):
        return Guess(max(workers, 1), 0.0, float(solved.mean()), decision, first=1.0)
    start = 0.0 if workers == 1 else cost.START * slow
    state = expected_cost(config.cell, config.sampling.inputs).state
    return Guess(max(workers, 1), start, state * slow, decision)


def processes_here(sampling: SamplingSettings) -> int:
    """Return how many processes of this machine may work on stages and solutions beside each other."""
    alone = sampling.executor == "serial" or launched_by_mpi() or current_process().daemon
    return 1 if alone else sampling.worker_count()


def bodies_at_once(config: RunConfig, count: int, work: float | None = None) -> int:
    """Return how many of ``count`` macro solves run at a time: as many as there are cores and memory for.

    ``work`` is the time of all where each process does several of them; by default each does one [s].
    """
    problem, most = config.macro.problem(config.macro.loads[0]), min(processes_here(config.sampling), count)
    if most < 2 or (macro_time(config.closure, problem) if work is None else work / most) < WORTHWHILE:
        return 1
    each = cost.LIBRARIES + UNKNOWN * body_mesh(problem).size
    there = available_bytes()
    return next((several for several in range(most, 1, -1) if fits(several * each, there)), 1)


def starts_early(cell: Cell, sampling: SamplingSettings) -> bool:
    """Return whether there is memory for workers that prepare the cell while its conductivity is computed."""
    expected = expected_cost(cell, sampling.inputs)
    return fits(sampling.workers_here * expected.memory + expected.memory_of_flow, available_bytes())


def trains_beside(cell: Cell, sampling: SamplingSettings) -> bool:
    """Return whether the surrogate is trained in a process of its own, while the held-out states are solved."""
    processes, state = processes_here(sampling), expected_cost(cell, sampling.inputs).state
    return processes > 1 and sampling.test.count * state / processes >= WORTHWHILE


def decisions(macro: MacroSettings, closure: str, sampler: Sampler) -> Iterator[str]:
    """Yield the time that a sampler takes to choose its rounds, beside that of the cells; nothing where it is none."""
    if count := rounds(sampler):
        each = decision_time(macro, closure, sampler)
        yield (
            f"  {sampler.choosing} between the rounds: at most some {count} times {as_time(each)}, "
            f"{as_time(count * each)} in all"
        )


def slowness() -> float:
    """Return how many processes share a core of this machine, at least 1."""
    if sys.platform == "win32":  # which does not count them
        return 1.0
    return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
