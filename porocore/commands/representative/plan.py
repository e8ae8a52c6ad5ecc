"""Sub-volumes of an image: the plan (SubvolumePlan), their cells (Scan), their costs (SizeOutlook)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from porocore.cell.cell import Cell
from porocore.cell.geometry.pore_geometry import MOST
from porocore.cell.level_sets.cutting import FEWEST
from porocore.cell.level_sets.image import LARGEST, SMALLEST, open_image
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.meshing.mesh import MeshSettings
from porocore.core.echo import echo
from porocore.core.models.bounds import LARGEST_SEED
from porocore.core.units import length_text
from porocore.errors import ConfigurationError
from porocore.states import Array
from porocore.study.config.config import RunConfig
from porocore.study.notes.abilities import memory_here
from porocore.study.notes.cost import CellCost
from porocore.study.notes.forecast import as_time, nodes_of, parts_at_rest

#: Sizes that are looked at where none are given, as far as the image reaches [voxels].
LADDER = (8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384)
#: Sub-volumes of one size that may be solved, and elements' sizes that may be given [voxels].
MOST_OF_A_SIZE, THINNEST, THICKEST = 1000, 0.5, 100.0


@dataclass(frozen=True)
class SubvolumePlan:
    """Sub-volumes of an image, cubes of so many voxels along each edge.

    Attributes
    ----------
    sizes
        Edges [voxels], increasing; None: 8, 12, 16, 24 … 384, as far as image and elements allow.
    count
        Sub-volumes of each size that are solved, at most.
    seed
        Seed of the choice of their places. A larger ``count`` adds to the places of a smaller one.
    overlapping
        False: cubes of a grid, which do not overlap, in random order; True: cubes at random places.
    within_crop
        True: in the part that ``cell.geometry.crop`` names, else in the whole image.
    element
        Size of the tetrahedra of both phases [voxels]; None: as many voxels as in the cell of the configuration.
    tolerance
        Share by which means may differ from that of the largest size, and single sub-volumes may scatter.
    solve
        False: only the porosity of the voxels is looked at.

    Raises
    ------
    ConfigurationError
        A value is out of its bounds; the message begins with its name.
    """

    sizes: tuple[int, ...] | None = None
    count: int = 4
    seed: int = 0
    overlapping: bool = False
    within_crop: bool = False
    element: float | None = None
    tolerance: float = 0.05
    solve: bool = True

    def __post_init__(self) -> None:
        if self.sizes is not None:
            _check_sizes(self.sizes)
        if not 1 <= self.count <= MOST_OF_A_SIZE:
            raise ConfigurationError(
                f"count: expected 1 to {MOST_OF_A_SIZE:,} sub-volumes, got {echo(self.count)}"
            )
        if not 0 <= self.seed <= LARGEST_SEED:
            raise ConfigurationError(
                f"seed: expected a whole number from 0 to {LARGEST_SEED}, got {echo(self.seed)}"
            )
        if self.element is not None and not THINNEST <= self.element <= THICKEST:
            raise ConfigurationError(
                f"element: expected {THINNEST:g} to {THICKEST:g} voxels, got {echo(self.element)}; three are usual"
            )
        if not (math.isfinite(self.tolerance) and 0 < self.tolerance < 1):
            raise ConfigurationError(
                f"tolerance: expected a share between 0 and 1, such as 0.05 for 5 %, got {echo(self.tolerance)}"
            )

    def describe(self) -> dict[str, Any]:
        """Return the plan as plain data."""
        return {**asdict(self), "sizes": None if self.sizes is None else list(self.sizes)}


def _check_sizes(sizes: tuple[int, ...]) -> None:
    shown = ",".join(str(size) for size in sizes)
    if not sizes:
        raise ConfigurationError("sizes: expected at least one edge in voxels, got none")
    if any(later <= earlier for earlier, later in pairwise(sizes)):
        raise ConfigurationError(f"sizes: expected increasing edges such as 16,24,32, got {echo(shown)}")
    if not SMALLEST <= sizes[0] <= sizes[-1] <= LARGEST:
        raise ConfigurationError(
            f"sizes: expected edges of {SMALLEST} to {LARGEST} voxels, got {echo(shown)}"
        )


#: Sub-volumes of one size of which the porosity is looked at, and voxels of all of them together.
PLACES, VOXELS = 100, 2_000_000_000
#: Digits of a mesh size; rounded up, so that no side gets an element more.
DIGITS = 4

Corner = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class Scan:
    """Image from which sub-volumes are taken.

    Attributes
    ----------
    cell
        Cell of the configuration; its geometry says how a sub-volume becomes periodic, and its mesh how fine it is.
    geometry
        Its geometry.
    values : (n₁, n₂, n₃)
        Values of the voxels, read as far as they are looked at.
    region : (3, 2)
        First voxel, and the one after the last, along x, y, z, between which the sub-volumes lie.
    elements
        Sizes of the tetrahedra of the solid and of the fluid [voxels].
    voxel_edges
        Edges of a voxel along x, y, z, or the one of a cube [m]; none: not known.
    """

    cell: Cell
    geometry: Voxels
    values: npt.NDArray[Any]
    region: tuple[tuple[int, int], ...]
    elements: tuple[float, float]
    voxel_edges: tuple[float, ...]

    @classmethod
    def open(cls, config: RunConfig, plan: SubvolumePlan) -> Scan:
        """Open the image of a configuration.

        Raises
        ------
        ConfigurationError
            The cell is no image, or its file no segmented one.
        """
        config.cell.require_member()
        geometry, mesh = config.cell.geometry, config.cell.mesh
        if not isinstance(geometry, Voxels):
            raise ConfigurationError(
                f"cell.geometry.kind: expected voxels, since sub-volumes are taken from an image, got '{geometry.kind}'"
            )
        path = geometry.checked("cell.geometry")
        values = open_image(path, grey=geometry.threshold is not None)
        whole = tuple((0, n) for n in values.shape)
        part = whole if geometry.crop is None else geometry.crop
        if any(not first < end <= n for (first, end), n in zip(part, values.shape, strict=True)):
            raise ConfigurationError(
                f"cell.geometry.crop: expected along each axis a first voxel and a larger end within {path}, got the "
                f"shape {values.shape} and the part {[list(span) for span in part]}"
            )
        length = math.cbrt(math.prod(_cell_edge(geometry, end - first) for first, end in part))
        elements = (
            (mesh.size * length, mesh.fluid_size * length)
            if plan.element is None
            else (plan.element, plan.element)
        )
        voxel: tuple[float, ...] = ()
        if geometry.voxel_size is not None:
            voxel = tuple(np.atleast_1d(geometry.voxel_size).tolist())
        elif config.scales is not None:
            voxel = (config.scales.pore / length,)
        voxel = voxel[:1] if len(set(voxel)) == 1 else voxel
        return cls(config.cell, geometry, values, part if plan.within_crop else whole, elements, voxel)

    @property
    def voxel(self) -> float | None:
        """Cube root of the volume of a voxel [m]; None: not known."""
        return math.cbrt(math.prod(np.broadcast_to(self.voxel_edges, 3))) if self.voxel_edges else None

    @property
    def extents(self) -> tuple[int, ...]:
        """Voxels of the region along each axis."""
        return tuple(end - first for first, end in self.region)

    def lines(self) -> Iterator[str]:
        """Yield the image and the elements for reading."""
        shape, extents = (" x ".join(map(str, each)) for each in (self.values.shape, self.extents))
        of = "" if shape == extents else f", of which {extents} are used"
        length = f" of {length_text(*self.voxel_edges)}" if self.voxel_edges else ""
        yield f"image {self.geometry.file_name} of {shape} voxels{length}{of}, repeat: {self.geometry.repeat}"
        solid, fluid = self.elements
        yield f"elements of {solid:.3g} voxels in the solid and {fluid:.3g} in the fluid"
        yield from (f"note: {warning}" for warning in self.geometry.value_warnings)

    def edge(self, size: int) -> int:
        """Return the edge of the cell that is made of a sub-volume [voxels]."""
        return _cell_edge(self.geometry, size)

    def extents_of(self, size: int) -> tuple[float, ...]:
        """Return the extents of a sub-volume along x, y, z in metres, or the one of a cube; none where not known."""
        return tuple(size * edge for edge in self.voxel_edges)

    def too_small(self, size: int) -> str:
        """Return why a sub-volume is too small for a cell; empty if it is not."""
        meshed = self.edge(size) // (2 if self.geometry.repeat == "mirror" else 1)
        if self.geometry.repeat == "layer":
            least = max(2 * self.geometry.layer, self.geometry.layer + SMALLEST)
            if size < least:
                return f"cell.geometry.layer: {self.geometry.layer} needs {least} voxels or more"
        edges = np.broadcast_to(self.geometry.voxel_size or 1.0, 3)
        short = float(edges.min() / np.cbrt(edges.prod()))
        largest = max(self.elements)
        if meshed * short < FEWEST * largest * (1 - 1e-9):
            return f"fewer than {FEWEST} elements of {largest:.3g} voxels lie along its edge; give --element, such as 3"
        return ""

    def sizes(self, plan: SubvolumePlan) -> tuple[int, ...]:
        """Return the sizes to look at.

        Raises
        ------
        ConfigurationError
            One that was given, or every one, is too large for the image or too small for a cell.
        """
        shortest = min(self.extents)
        shape = " x ".join(map(str, self.extents))
        if plan.sizes is None:
            found = tuple(size for size in LADDER if size <= shortest and not self.too_small(size))
            if not found:
                raise ConfigurationError(
                    f"--sizes: an image of {shape} voxels has no sub-volume for a cell: "
                    f"{self.too_small(max(shortest, SMALLEST)) or 'it is too small'}"
                )
            return found
        if plan.sizes[-1] > shortest:
            part = "the part that cell.geometry.crop names" if plan.within_crop else "the image"
            raise ConfigurationError(
                f"--sizes: expected edges of at most {shortest} voxels, since {part} has {shape}, got {plan.sizes[-1]}"
            )
        for size in plan.sizes:
            if fault := self.too_small(size):
                raise ConfigurationError(f"--sizes: {size} voxels are too few for a cell: {fault}")
        return plan.sizes

    def places(self, size: int, plan: SubvolumePlan) -> list[Corner]:
        """Return the first voxels of the sub-volumes of one size, those that are solved first."""
        most = max(plan.count, min(PLACES, VOXELS // size**3))
        draw = np.random.default_rng([plan.seed, size])
        if plan.overlapping:
            free = [extent - size + 1 for extent in self.extents]
            drawn = [tuple(int(draw.integers(n)) for n in free) for _ in range(most)]
            inner = list(dict.fromkeys(drawn))
        else:
            grid = [extent // size for extent in self.extents]
            chosen = draw.permutation(math.prod(grid))[:most]
            spare = [(extent - k * size) // 2 for extent, k in zip(self.extents, grid, strict=True)]
            cubes = np.stack(np.unravel_index(chosen, grid), axis=1) * size + spare
            inner = [tuple(map(int, cube)) for cube in cubes]
        starts = [first for first, _ in self.region]
        return [(a + starts[0], b + starts[1], c + starts[2]) for a, b, c in inner]

    def porosities(self, size: int, places: list[Corner]) -> Array:
        """Return the share of pore voxels of sub-volumes, before anything is blended or cleaned."""
        shares = [
            np.count_nonzero(self.geometry.pores_of(self.values[x : x + size, y : y + size, z : z + size]))
            for x, y, z in places
        ]
        return np.array(shares, dtype=float) / size**3

    def mesh_sizes(self, size: int) -> tuple[float, float]:
        """Return ``mesh.size`` and ``mesh.fluid_size`` of the cell of a sub-volume."""
        solid, fluid = (_rounded_up(element / self.edge(size)) for element in self.elements)
        return solid, fluid

    def subvolume(self, corner: Corner, size: int) -> Cell:
        """Return the cell of one sub-volume.

        Raises
        ------
        ConfigurationError
            Its mesh would have too many elements.
        """
        solid, fluid = self.mesh_sizes(size)
        crop = tuple((first, first + size) for first in corner)
        geometry = self.geometry.model_copy(update={"crop": crop})
        mesh = self.cell.mesh.model_copy(update={"size": solid, "fluid_size": fluid})
        return Cell(**{**dict(self.cell), "geometry": geometry, "mesh": mesh})


def _cell_edge(geometry: Voxels, size: int) -> int:
    return {"mirror": 2 * size, "periodic": size, "layer": size - geometry.layer}[geometry.repeat]


def _rounded_up(value: float) -> float:
    scale = 10.0 ** (DIGITS - 1 - math.floor(math.log10(value)))
    return float(f"{math.ceil(value * scale - 1e-6) / scale:.{DIGITS}g}")


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
    left_out
        Why none of this size is solved; empty if they are.
    nodes
        Expected nodes of the solid and of the fluid that are solved.
    seconds, memory
        Expected for one cell, on one core and in one process [s, bytes].
    side_by_side
        Number of processes that this machine has the memory for.
    """

    size: int
    places: list[Corner]
    porosities: Array
    solved: int
    left_out: str = ""
    nodes: tuple[float, float] = (0.0, 0.0)
    seconds: float = 0.0
    memory: float = 0.0
    side_by_side: int = 0

    @property
    def corners(self) -> list[Corner]:
        """First voxels of the sub-volumes that are solved."""
        return [] if self.left_out else self.places[: self.solved]

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
        return SizeOutlook(size, places, porosities, count, left_out)
    cell = scan.subvolume(places[0], size)
    cost = CellCost(*nodes_of(cell, porosity), parts_at_rest(cell))
    # Each sub-volume is the first state of its cell.
    seconds = cost.first + cost.state + cost.conductivity
    memory, there = max(cost.memory, cost.memory_of_flow), memory_here()
    side_by_side = min(workers, int(there / memory))
    if side_by_side < 1:
        left_out = (
            f"one needs some {memory / 1e9:.3g} GB of memory, but this machine has {there / 1e9:.3g} GB"
        )
    elif plan.sizes is None and seconds * math.ceil(count / side_by_side) > LONG:
        whole = as_time(seconds * math.ceil(count / side_by_side))
        left_out = f"{count} would take some {whole}; name the size in --sizes to solve them"
    return SizeOutlook(size, places, porosities, count, left_out, cost.nodes, seconds, memory, side_by_side)


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
