"""Shares of statuses of the solved states, and of the body by its nearest solved states, in words."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from porocore.interfaces.solution import MacroSolution
from porocore.macro.body.mesh import BodyMesh
from porocore.report.context import SamplingSummary
from porocore.report.format import number, percent
from porocore.states import Array, IntArray, Status

#: What a reader must know of a state that is not plainly converged.
SHARES: dict[str, tuple[Status, ...]] = {
    "contact": (Status.contact,),
    "unstable": (Status.unstable,),
    "without_values": tuple(status for status in Status if not status.has_values),
}


def solved_shares(sampling: SamplingSummary) -> dict[str, float]:
    """Return the shares of the solved states in contact, unstable, and without values, ready for JSON."""
    count = max(len(sampling.status), 1)
    shares = {name: int(np.isin(sampling.status, kinds).sum()) / count for name, kinds in SHARES.items()}
    return shares | _wall(sampling, np.arange(len(sampling.status)))


def visited_shares(solution: MacroSolution, sampling: SamplingSummary) -> list[dict[str, float]]:
    """Return the same shares of the body's volume at each kept time, ready for JSON.

    A macroscopic law does not know how a cell would end. Each element counts as the solved state that lies nearest to
    its own, in inputs divided by their ranges. What lies beyond the sampled range is flagged elsewhere, and counts here
    as what the sampling found at its edge.
    """
    if not len(sampling.status):
        return []
    span = np.subtract(sampling.inputs.upper, sampling.inputs.lower)
    tree = cKDTree(sampling.x / span)
    volume = BodyMesh(solution.points, solution.cells).weights.sum(axis=1)
    return [_at(solution, i, sampling, tree, span, volume) for i in range(len(solution.profiles))]


def _at(
    solution: MacroSolution, i: int, sampling: SamplingSummary, tree: Any, span: Array, volume: Array
) -> dict[str, float]:
    inputs = sampling.inputs
    x = inputs.gather(inputs.without_rotation(solution.cell_states(i)))
    nearest = tree.query(x / span)[1]
    status = sampling.status[nearest]
    shares = {
        name: float(volume[np.isin(status, kinds)].sum() / volume.sum()) for name, kinds in SHARES.items()
    }
    return {"time": solution.profiles[i].time, **shares, **_wall(sampling, nearest)}


def _wall(sampling: SamplingSummary, rows: IntArray) -> dict[str, float]:
    """Return the largest share of the pore wall in contact, of states in contact; nothing where it is not known."""
    if sampling.contact_share is None:
        return {}
    touching = sampling.contact_share[rows][np.isin(sampling.status[rows], SHARES["contact"])]
    return {"wall_in_contact": float(np.nanmax(touching, initial=0.0))}


def _of_the_wall(shares: dict[str, float], where: str) -> str:
    """Return a sentence on how much of the wall touches; empty where it is not known or nothing touches."""
    wall = shares.get("wall_in_contact", 0.0)
    if not wall:
        return ""
    most = "less than 0.01" if wall < 1e-4 else f"at most {number(100 * wall, 2)}"
    return f" In {where}, {most} % of the wall is in contact."


def solved_sentence(shares: dict[str, float]) -> str:
    """Return :func:`solved_shares` in words."""
    contact, unstable, without = (percent(shares[name], 0) for name in SHARES)
    return (
        f"Of the solved states, {contact} are in contact: the pore wall is pressed against itself."
        f"{_of_the_wall(shares, 'each state')} {unstable} of the states are unstable, and {without} have no valid data."
    )


def visited_sentence(visited: list[dict[str, float]]) -> str:
    """Return :func:`visited_shares` in words; empty where no profile was kept."""
    if not visited:
        return ""
    end = visited[-1]
    largest = {name: max(at[name] for at in visited) for name in SHARES}
    if not any(largest.values()):
        return (
            "For each element of the body, the nearest solved state of the cell is stable and has no contact."
        )
    at_end, at_most = ([percent(shares[name], 0) for name in SHARES] for shares in (end, largest))
    return (
        "For the next numbers, each element of the body is given the status of the nearest solved state of the cell. "
        f"At the end of the run, the pore wall touches itself in the cells of {at_end[0]} of the body."
        f"{_of_the_wall(end, 'each cell')} {at_end[1]} of the body is unstable, and {at_end[2]} has no valid data. "
        "Over all times at which profiles are stored, the largest values of these shares are "
        f"{at_most[0]} in contact, {at_most[1]} unstable and {at_most[2]} without valid data."
    )
