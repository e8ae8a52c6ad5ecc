"""Expected time and memory of the sub-volumes of one size; sizes that are left out."""

from __future__ import annotations

import math
from dataclasses import dataclass

from porocore.cell.geometry.pore_geometry import MOST
from porocore.cell.meshing.mesh import MeshSettings
from porocore.commands.representative.plan import SubvolumePlan
from porocore.commands.representative.scan import Corner, Scan
from porocore.states import Array
from porocore.study.notes.abilities import memory_here
from porocore.study.notes.cost import CellCost
from porocore.study.notes.forecast import as_time, nodes_of, parts_at_rest

#: Sizes that nobody asked for are solved where that takes no longer on the workers [s].
LONG = 3600.0
#: Reason why none is solved where only the porosity is wanted.
NOT_ASKED = "only the porosity was asked for"


@dataclass(frozen=True, eq=False)
class SizeOutlook:
    """Sub-volumes of one size before they are solved.

    Attributes
    ----------
    size
        Edge [voxels].
    places
        First voxels of all that are looked at.
    porosities
        Share of pore voxels in each.
    solved
        Number of those that are solved, the first of the places.
    nodes
        Expected nodes of the solid and of the fluid that are solved.
    seconds, memory
        Expected for one cell, on one core and in one process [s, bytes].
    side_by_side
        Number of processes that this machine has the memory for.
    left_out
        Why none of this size is solved; empty if they are.
    """

    size: int
    places: tuple[Corner, ...]
    porosities: Array
    solved: int
    nodes: tuple[float, float]
    seconds: float
    memory: float
    side_by_side: int
    left_out: str = ""

    @property
    def corners(self) -> tuple[Corner, ...]:
        """First voxels of the sub-volumes that are solved."""
        return () if self.left_out else self.places[: self.solved]

    def line(self, workers: int) -> str:
        """Return the outlook as a sentence."""
        count, places, (solid, fluid) = self.solved, len(self.places), map(_few, self.nodes)
        text = f"{self.size} voxels: porosity {self.porosities.mean():.3g} by the voxels of {places}"
        if self.left_out == NOT_ASKED:
            return text
        if self.left_out:
            return f"{text}; no cell is solved: {self.left_out}"
        side_by_side = min(workers, self.side_by_side, count)
        several = f", {side_by_side} side by side" if side_by_side > 1 else ""
        whole = as_time(self.seconds * math.ceil(count / side_by_side))
        return (
            f"{text}; {count} {'cell' if count == 1 else 'cells'} of some {solid} nodes of the solid and "
            f"{fluid} of the fluid, {as_time(self.seconds)} and {self.memory / 1e9:.2g} GB each{several}: "
            f"{whole}"
        )


def foresee(scan: Scan, plan: SubvolumePlan, size: int, workers: int) -> SizeOutlook:
    """Look at the voxels of the sub-volumes of one size, and estimate what their cells cost."""
    places = scan.places(size, plan)
    porosities = scan.porosities(size, places)
    count = min(plan.count, len(places))
    porosity = min(max(float(porosities.mean()), 0.01), 0.99)
    left_out = "" if plan.solve else NOT_ASKED
    left_out = left_out or _too_fine(scan, size)
    if left_out:
        return SizeOutlook(size, tuple(places), porosities, count, (0.0, 0.0), 0.0, 0.0, 0, left_out)
    cell = scan.subvolume(places[0], size)
    cost = CellCost(*nodes_of(cell, porosity), parts_at_rest(cell))
    # Each sub-volume is the first state of its cell.
    seconds = cost.first + cost.state + cost.conductivity
    memory, there = max(cost.memory, cost.memory_of_flow), memory_here()
    side_by_side = workers if there is None else min(workers, int(there / memory))
    if side_by_side < 1:
        assert there is not None
        left_out = (
            f"one needs some {memory / 1e9:.3g} GB of memory, but this machine has {there / 1e9:.3g} GB"
        )
    elif plan.sizes is None and seconds * math.ceil(count / side_by_side) > LONG:
        whole = as_time(seconds * math.ceil(count / side_by_side))
        left_out = f"{count} would take some {whole}; name the size in --sizes to solve them"
    return SizeOutlook(
        size, tuple(places), porosities, count, cost.nodes, seconds, memory, side_by_side, left_out
    )


def _few(count: float) -> str:
    return f"{float(f'{count:.2g}'):,.0f}"


def _too_fine(scan: Scan, size: int) -> str:
    """Return why the mesh of a sub-volume has too many elements; empty if it has not."""
    finest = min(scan.mesh_sizes(size))
    least = next(each.ge for each in MeshSettings.model_fields["size"].metadata if hasattr(each, "ge"))
    count = scan.geometry.elements(finest) * math.prod(scan.cell.supercell)
    if finest >= least and count <= MOST:
        return ""
    return (
        f"it would have about {float(f'{count:.2g}'):,.0f} elements, at most {MOST:,} are made, none smaller than "
        f"{least:g} of the cell; give a larger --element"
    )
