"""Expected times of a run and of its sampling before anything of it is measured; slowness of a busy machine."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from multiprocessing import current_process

from porocore.core.parallel import launched_by_mpi
from porocore.interfaces.sampler import Sampler
from porocore.macro.integration.newton import StepForecast
from porocore.macro.integration.stepping import Stepper
from porocore.macro.linear_systems import available_bytes, fits
from porocore.macro.problem import MacroProblem, body_mesh
from porocore.sampling.forecast import Guess
from porocore.sampling.samplers.macro_driven import MacroDriven
from porocore.states import Array
from porocore.study.config.config import RunConfig
from porocore.study.notes import cost
from porocore.study.notes.workload import (
    Workload,
    as_time,
    expected_cost,
    workers_here,
)
from porocore.study.run.exploration import coarse_problem

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
        macro = [macro_time(config, load) for load in config.macro.loads]
        return cls(
            work.cell_time + start,
            rounds(sampler) * decision_time(config, sampler),
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


def macro_time(config: RunConfig, load: float) -> float:
    """Return the time of the body under a load, with the cell's law and linearly, on a quiet core [s]."""
    problem = config.macro.problem(load)
    changing = problem.time.tolerance is not None or problem.is_column
    linear = 1.0 if changing else cost.LINEAR_FIXED
    return _law_time(config, problem) + expected_steps(problem) * linear * _system_time(problem)


def _system_time(problem: MacroProblem) -> float:
    """Return the time of a linear system of a body, without that of its law."""
    return cost.SYSTEM.at(_points(problem)) * (cost.COLUMN if problem.is_column else 1.0)


def _law_time(config: RunConfig, problem: MacroProblem) -> float:
    """Return the time of a body with the cell's law."""
    law = cost.LAW.get(config.closure, max(cost.LAW.values())) * _points(problem)
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
    return max(planned, cost.STEPS * len(kinks) / math.sqrt(plan.tolerance))


def decision_time(config: RunConfig, sampler: Sampler) -> float:
    """Return the time in which a sampler chooses a round on a quiet core [s]."""
    if not isinstance(sampler, MacroDriven):
        return sampler.outlook.decision
    problems = [
        coarse_problem(config.macro.problem(load), sampler.elements, sampler.steps)
        for load in config.macro.loads
    ]
    return sum(_law_time(config, problem) for problem in problems)


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
    workers, slow = workers_here(config), slowness()
    decision = decision_time(config, sampler) * slow
    if solved is not None and len(solved):
        return Guess(max(workers, 1), 0.0, float(solved.mean()), decision, first=1.0)
    start = 0.0 if workers == 1 else cost.START * slow
    return Guess(max(workers, 1), start, _state(config) * slow, decision)


def _state(config: RunConfig) -> float:
    """Return the time of a state of the cell on a quiet core [s]."""
    return expected_cost(config).state


def processes_here(config: RunConfig) -> int:
    """Return how many processes of this machine may work on stages and solutions beside each other."""
    alone = config.sampling.executor == "serial" or launched_by_mpi() or current_process().daemon
    return 1 if alone else config.sampling.worker_count()


def bodies_at_once(config: RunConfig, count: int, work: float | None = None) -> int:
    """Return how many of ``count`` macro solves run at a time: as many as there are cores and memory for.

    ``work`` is the time of all where each process does several of them; by default each does one [s].
    """
    load, most = config.macro.loads[0], min(processes_here(config), count)
    if most < 2 or (macro_time(config, load) if work is None else work / most) < WORTHWHILE:
        return 1
    each = cost.LIBRARIES + UNKNOWN * body_mesh(config.macro.problem(load)).size
    there = available_bytes()
    return next((several for several in range(most, 1, -1) if fits(several * each, there)), 1)


def starts_early(config: RunConfig) -> bool:
    """Return whether there is memory for workers that prepare the cell while its conductivity is computed."""
    cell = expected_cost(config)
    return fits(workers_here(config) * cell.memory + cell.memory_of_flow, available_bytes())


def trains_beside(config: RunConfig) -> bool:
    """Return whether the surrogate is trained in a process of its own, while the held-out states are solved."""
    processes = processes_here(config)
    return processes > 1 and config.sampling.test.count * _state(config) / processes >= WORTHWHILE


def decisions(config: RunConfig, sampler: Sampler) -> Iterator[str]:
    """Yield the time that a sampler takes to choose its rounds, beside that of the cells; nothing where it is none."""
    if count := rounds(sampler):
        each = decision_time(config, sampler)
        yield (
            f"  {sampler.choosing} between the rounds: at most some {count} times {as_time(each)}, "
            f"{as_time(count * each)} in all"
        )


def slowness() -> float:
    """Return how many processes share a core of this machine, at least 1."""
    try:
        return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
    except (AttributeError, OSError):
        return 1.0
