"""Members of a family of cells that a study prepares: their number, and where the body is among the parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from porocore.cell.family.undeformed import undeformed_count
from porocore.interfaces.sampler import Sampler
from porocore.study.config.config import RunConfig


def members_of(config: RunConfig, sampler: Sampler) -> tuple[int, int]:
    """Return how many members of a family of cells are prepared for the sampler's states and for the held-out ones."""
    if not config.cell.is_family:
        return 0, 0
    test, used = config.sampling.test, len(config.used_parameters)
    held_out = math.ceil(test.count / test.together)
    return min(sampler.members, used or sampler.expected), min(held_out, used or held_out)


def family_lines(config: RunConfig, sampler: Sampler) -> Iterator[str]:
    """Yield the counts of members of a family of cells; nothing of a cell without parameters."""
    if not config.cell.is_family:
        return
    sampled, held_out = members_of(config, sampler)
    used = _used(config)
    ranges = (f"{each.name} in [{each.lower:g}, {each.upper:g}]" for each in config.cell.parameters)
    yield (
        f"  family of cells over {', '.join(ranges)}: {undeformed_count(config.cell)} undeformed "
        f"members; states of {_members(sampled)}, held-out states of {_members(held_out)}{used}"
    )


def _used(config: RunConfig) -> str:
    """Return where the body is among the parameters, after a comma; empty where the whole ranges are sampled."""
    rows = np.array(config.used_parameters)
    if not len(rows):
        return ""
    ends = [
        f"{low:g}" if low == high else f"{low:g} to {high:g}"
        for low, high in zip(rows.min(0), rows.max(0), strict=True)
    ]
    names = (each.name for each in config.cell.parameters)
    there = ", ".join(f"{name} {at}" for name, at in zip(names, ends, strict=True))
    return f", where the body is: {there} (sampling.parameters: body)"


def _members(count: int) -> str:
    return f"{count} {'member' if count == 1 else 'members'}"
