"""Cells and samplings that are too large for this machine: refused for their memory, noted for their time."""

from __future__ import annotations

import math
import os

from porocore.core.models.bounds import LARGEST_PRESSURE, MOST_STATES
from porocore.errors import ConfigurationError
from porocore.study.config.config import RunConfig
from porocore.study.preflight.cost import LIBRARIES, costs, process_memory
from porocore.study.preflight.workload import (
    as_time,
    expected_nodes,
    share_of_flow,
    share_solved,
    workers_here,
)

#: A state that takes longer on one core is noted [s].
LONG = 60.0


def require_memory(config: RunConfig) -> None:
    """Refuse processes that this machine has too little memory for.

    Raises
    ------
    ConfigurationError
        The mesh of the cell is too fine, or the processes are too many.
    """
    workers, there, share = workers_here(config), memory_here(), share_solved(config)
    if there is None or workers == 0:
        return
    (nodes, flow), mesh = expected_nodes(config), config.cell.mesh
    process, law = process_memory(nodes, share), costs(share_of_flow(config)).fluid
    fluid = LIBRARIES + law.at(flow)
    spare = max(there - LIBRARIES, LIBRARIES)
    for key, count, phase, needs, bytes_of in (
        ("size", nodes, "solid", process, costs(share).solid),
        ("fluid_size", flow, "fluid", fluid, law),
    ):
        if needs > there:
            larger = getattr(mesh, key) * (count / bytes_of.nodes_for(spare)) ** (1 / 3)
            raise ConfigurationError(
                f"cell.mesh.{key}: at {getattr(mesh, key):g} the {phase} has about {count:,.0f} nodes, and solving it "
                f"needs some {needs / 1e9:.3g} GB of memory, but this machine has {there / 1e9:.3g} GB; take "
                f"{_at_least(larger)} or more, or a part of the cell"
            )
    if workers > 1 and (workers + 1) * process > there:
        raise ConfigurationError(
            f"sampling.workers: {workers} workers and the run itself need some {(workers + 1) * process / 1e9:.3g} GB "
            f"of memory, {process / 1e9:.2g} GB each, but this machine has {there / 1e9:.3g} GB; take at most "
            f"{max(1, int(there / process) - 1)}"
        )


def slow_states(nodes: float, size: float, share: float = 1.0) -> str:
    """Return a note on a solid of which a state takes long; empty for a smaller one. Nodes are those of a share."""
    law = costs(share).state
    seconds = law.at(nodes)
    if seconds <= LONG:
        return ""
    larger = size * (nodes / law.nodes_for(LONG)) ** (1 / 3)
    beyond = ", which is beyond what was measured" if nodes > 1.2 * law.nodes[-1] else ""
    return (
        f"a state of {nodes:,.0f} nodes of the solid takes about {as_time(seconds)} on one core{beyond}; "
        f"cell.mesh.size: {_at_least(larger)} takes {as_time(LONG)}"
    )


def _at_least(size: float) -> str:
    """Return a size in two digits, rounded up."""
    digits = 1 - math.floor(math.log10(size))
    return f"{math.ceil(round(size * 10**digits, 6)) / 10**digits:g}"


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


def unit_of_the_modulus(config: RunConfig, name: str) -> str:
    """Return which key may be to blame for a pressure that is too large for the cell."""
    if name != "p" or config.scales is None or config.scales.modulus is None:
        return ""
    return f": that is {LARGEST_PRESSURE:g} times the modulus; is scales.modulus = {config.scales.modulus:g} Pa meant?"
