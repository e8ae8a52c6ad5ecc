"""Expected times of a sampling before anything of it is measured; slowness of a busy machine."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator

from porocore.interfaces.sampler import Sampler
from porocore.sampling.forecast import Guess
from porocore.states import Array
from porocore.study.config.config import RunConfig
from porocore.study.preflight.cost import costs
from porocore.study.preflight.workload import as_time, expected_nodes, share_solved, workers_here

#: Seconds of a quiet core in which a process has loaded the libraries and prepared the cell: coarse cells.
START = 0.7
#: Seconds of a state on the coarsest cells: 0.04 to 0.3.
LEAST = 0.15


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
    decision = sampler.outlook.decision * slow
    if solved is not None and len(solved):
        return Guess(max(workers, 1), 0.0, float(solved.mean()), decision, first=1.0)
    start = 0.0 if workers == 1 else START * slow
    state = (LEAST + costs(share_solved(config)).state.at(expected_nodes(config)[0])) * slow
    return Guess(max(workers, 1), start, state, decision)


def decisions(sampler: Sampler) -> Iterator[str]:
    """Yield the time that a sampler takes to choose its rounds, beside that of the cells; nothing where it is none."""
    outlook = sampler.outlook
    if outlook.batch and outlook.decision:
        rounds = math.ceil(outlook.expected / outlook.batch)
        yield (
            f"  on top, {sampler.choosing} between the rounds: some {rounds} times {as_time(outlook.decision)}, "
            f"{as_time(rounds * outlook.decision)} in all on a coarse body, more on one of many elements"
        )


def slowness() -> float:
    """Return how many processes share a core of this machine, at least 1."""
    try:
        return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
    except (AttributeError, OSError):
        return 1.0
