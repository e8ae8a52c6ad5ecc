"""Sub-volumes cut out of an image (Scan), and their solution at rest."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from porocore.cell.cell import Cell
from porocore.cell.level_sets.cutting import FEWEST
from porocore.cell.level_sets.image import SMALLEST, open_image
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.materials.material import voigt_moduli
from porocore.commands.representative.plan import LADDER, SubvolumePlan
from porocore.core.echo import cut
from porocore.core.files.plain_data import json_ready
from porocore.core.files.store import ResultStore
from porocore.core.parallel.calls import Tell
from porocore.core.units import length_text
from porocore.errors import ConfigurationError, PluginError, PorocoreError
from porocore.macro.laws.linear import LinearCoefficients
from porocore.plugins.border import conductivity_of
from porocore.states import Array
from porocore.study.config.config import FemSettings, RunConfig
from porocore.study.run.composition import prepare_cell
from porocore.study.run.reference import undeformed

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


#: Statuses: all results; permeability alone, of a solid that is not connected; none, for the reason in the message;
#: none, since its process ended.
SOLVED, LOOSE, FAILED, LOST = "solved", "no stiffness", "failed", "lost"
#: Characters of a message that are kept.
LONGEST = 300
#: Results by name, with their shapes.
SHAPES: dict[str, tuple[int, ...]] = {
    "porosity": (),
    "permeability": (3, 3),
    "stiffness": (3, 3, 3, 3),
    "biot": (3, 3),
    "storage": (),
    "M": (3, 3, 3, 3),
    "Q": (3, 3),
}


@dataclass(frozen=True, eq=False)
class Subvolume:
    """Results of one sub-volume; NaN where there are none.

    Attributes
    ----------
    size, corner
        Edge, and first voxel along x, y, z.
    cell
        Identity of its cell.
    status, message
        One of ``solved``, ``no stiffness``, ``failed`` and ``lost``, and why it is not solved.
    seconds
        Time that it took, whenever that was.
    porosity : ()
        φ_f of the mesh of the solid.
    permeability : (3, 3)
        K μ_f [voxel²].
    stiffness : (3, 3, 3, 3)
        Drained, C_eff [E].
    biot : (3, 3)
        α.
    storage : ()
        1/M_B [1/E].
    M : (3, 3, 3, 3)
        ∂<∇u¹>_s/∂H at rest.
    Q : (3, 3)
        ∂<∇u¹>_s/∂p at rest [1/E].
    """

    size: int
    corner: Corner
    cell: str
    status: str
    message: str
    seconds: float
    porosity: Array
    permeability: Array
    stiffness: Array
    biot: Array
    storage: Array
    M: Array
    Q: Array

    def scalars(self) -> dict[str, float]:
        """Return the results as averages over all directions; see ``settling.QUANTITIES``."""
        k = (
            np.linalg.eigvalsh(self.permeability)
            if np.isfinite(self.permeability).all()
            else np.full(3, np.nan)
        )
        mean = float(k.mean())
        return {
            "porosity": float(self.porosity),
            "permeability": mean,
            "anisotropy": float(np.ptp(k)) / mean if mean > 0 else float("nan"),
            "modulus": voigt_moduli(self.stiffness)[0],
            "biot": float(np.trace(self.biot)) / 3,
            "storage": float(self.storage),
        }

    def as_data(self) -> dict[str, Any]:
        """Return plain data."""
        found: dict[str, Any] = json_ready({each.name: getattr(self, each.name) for each in fields(self)})
        return found

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Subvolume:
        """Return what :meth:`as_data` was made of.

        Raises
        ------
        KeyError, TypeError, ValueError
            It was not.
        """
        arrays = {
            # None within becomes NaN.
            name: np.array(np.nan if data[name] is None else data[name], dtype=float).reshape(shape)
            for name, shape in SHAPES.items()
        }
        a, b, c = map(int, data["corner"])
        cell, status, message = (str(data[name]) for name in ("cell", "status", "message"))
        return cls(int(data["size"]), (a, b, c), cell, status, message, float(data["seconds"]), **arrays)


@dataclass(frozen=True, eq=False)
class SubvolumeJob:
    """A sub-volume that is to be solved.

    Attributes
    ----------
    cell, identity
        Its cell, and the identity of that.
    size, corner
        Edge, and first voxel along x, y, z.
    edge
        Edge of the cell [voxels].
    """

    cell: Cell
    identity: str
    size: int
    corner: Corner
    edge: int

    def unsolved(self, status: str, message: str, seconds: float = 0.0, **known: Array) -> Subvolume:
        """Return what is recorded of a sub-volume of which at most some results are known."""
        message = cut(" ".join(message.split()), LONGEST)
        nothing = {name: np.full(shape, np.nan) for name, shape in SHAPES.items()}
        return Subvolume(
            self.size, self.corner, self.identity, status, message, seconds, **{**nothing, **known}
        )


def solve_subvolume(
    tell: Tell, job: SubvolumeJob, fem: FemSettings, store: ResultStore | None, took: float | None = None
) -> Subvolume:
    """Solve one sub-volume at rest; what cannot be solved is recorded.

    Parameters
    ----------
    tell
        Not called: a sub-volume is one solve.
    job
        The sub-volume.
    fem, store
        Backend, and results that studies share.
    took
        Seconds that a cell had taken that the store holds.

    Raises
    ------
    PluginError
        The backend is missing or returns what it may not.
    """
    cell, began = job.cell, time.perf_counter()
    try:
        reference = undeformed(cell, fem, "piola", store)
        found = LinearCoefficients.from_reference(
            reference.response, reference.solid_fraction, cell.solid, reference.conductivity
        )
    except PluginError:
        raise
    except PorocoreError as error:
        status, message, known = _what_is_left(error, job, fem)
        return job.unsolved(status, message, time.perf_counter() - began, **known)
    seconds = time.perf_counter() - began if took is None else took
    return Subvolume(
        job.size, job.corner, job.identity, SOLVED, "", seconds,
        np.array(reference.porosity), _permeability(found.conductivity, job), found.stiffness, found.biot,
        np.array(found.storage), found.mean_grad_grad_u, found.mean_grad_p,
    )  # fmt: skip


def _what_is_left(
    error: PorocoreError, job: SubvolumeJob, fem: FemSettings
) -> tuple[str, str, dict[str, Array]]:
    """Return the permeability of a solid that is not connected, else nothing but the reason."""
    try:
        if disconnected := job.cell.disconnected:
            K = conductivity_of(*prepare_cell(fem.backend, fem.options, job.cell))
            return LOOSE, disconnected, {"permeability": _permeability(K, job)}
    except PluginError:
        raise
    except PorocoreError as another:
        return FAILED, str(another), {}
    return FAILED, str(error), {}


def _permeability(conductivity: Array, job: SubvolumeJob) -> Array:
    """Return K μ_f in voxels²; K is in units of the edge of the cell, squared."""
    return np.asarray((conductivity + conductivity.T) / 2 * job.cell.viscosity * job.edge**2)
