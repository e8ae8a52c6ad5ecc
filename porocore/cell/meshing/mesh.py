"""Mesh settings, and the mesh of one phase (CellMesh); its reflections, and blocks of whole cells.

The images share their nodes on the mirror planes exactly, so the whole cell has matching opposite faces, and that of a
wedge has the full symmetry of the cube.

The first cell of a block is the whole cell; that of cubic cells is [−½, n₁ − ½] × [−½, n₂ − ½] × [−½, n₃ − ½].
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import permutations, product
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from porocore.cell.geometry.pore_geometry import CUBE, PoreGeometry, Sides
from porocore.cell.meshing.tetrahedra import (
    SWAPPED,
    Element,
    Phase,
    Tetrahedra,
    boundary_facets,
    facet_classes,
    porosity,
    rows_of,
    with_middles,
)
from porocore.core.files.plain_data import stable_hash
from porocore.core.models.strict import StrictModel
from porocore.core.units import Unit
from porocore.errors import ConfigurationError
from porocore.states import Array, BoolArray, IntArray


def wedge_to_eighth(points: Array, cells: IntArray) -> tuple[Array, IntArray]:
    """Return the mesh of [0, ½]³ from that of 0 ≤ x ≤ y ≤ z ≤ ½, by the six permutations of the coordinates."""
    points = snap(points)
    for i, j in ((0, 1), (1, 2)):
        on_plane = np.abs(points[:, i] - points[:, j]) < 1e-9
        points[on_plane, i] = points[on_plane, j]
    orders = [list(order) for order in permutations(range(3))]
    return _merge([(points[:, order], bool(np.linalg.det(np.eye(3)[order]) < 0)) for order in orders], cells)


def eighth_to_whole(points: Array, cells: IntArray, sides: Sides = CUBE) -> tuple[Array, IntArray]:
    """Return the mesh of the whole cell from that of its eighth, by the eight sign changes of the coordinates."""
    points = snap(points, sides)
    images = [(points * signs, bool(np.prod(signs) < 0)) for signs in product((1.0, -1.0), repeat=3)]
    return _merge(images, cells)


def snap(points: Array, sides: Sides = CUBE) -> Array:
    """Return points with the coordinates within 1e-9 of the planes of the eighth, 0 and half a side, set onto them."""
    for plane in (np.zeros(3), np.array(sides) / 2):
        points = np.where(np.abs(points - plane) < 1e-9, plane, points)
    return points


def _merge(images: list[tuple[Array, bool]], cells: IntArray) -> tuple[Array, IntArray]:
    swapped = cells[:, SWAPPED[: cells.shape[1]]]
    all_points = np.concatenate([points for points, _ in images]) + 0.0  # + 0.0 turns −0.0 into 0.0
    all_cells = np.concatenate(
        [(swapped if odd else cells) + k * len(points) for k, (points, odd) in enumerate(images)]
    )
    merged, inverse = np.unique(all_points, axis=0, return_inverse=True)
    return merged, inverse.reshape(-1)[all_cells]


def unfold_displacement(points: Array, u: Array, whole: Array, sides: Sides = CUBE) -> Array:
    """Return a displacement of the eighth under a load that preserves the mirrors on the whole cell, exactly.

    Parameters
    ----------
    points : (n, 3)
        Nodes of the eighth.
    u : (n, 3)
        Displacement; u_i vanishes on the mirror planes across axis i.
    whole : (N, 3)
        Nodes of the whole cell, images of the eighth's by :func:`eighth_to_whole`.
    sides
        Sides of the cell.

    Returns
    -------
    (N, 3)
        The component u_i is odd under the mirror of axis i and even under the others.

    Raises
    ------
    ValueError
        A node of the whole cell is no image of one of the eighth.
    """
    image = rows_of(snap(points, sides) + 0.0, np.abs(whole) + 0.0)
    if (image < 0).any():
        raise ValueError("the nodes of the whole cell are no mirror images of those of the eighth")
    return np.asarray(np.sign(whole) * u[image])


#: Difference of the share of a phase in a mesh from that in its geometry beyond which nothing is computed, relative to
#: the smaller share. K goes with the third power of the porosity or so: beyond, it would be wrong by a factor of two.
MISSED = 0.25

__all__ = ["CellMesh", "Domain", "MeshSettings", "Phase", "make_mesh"]

Domain = Literal["eighth", "whole"]


class MeshSettings(StrictModel):
    """Element size, of a cell of volume 1, and kind of tetrahedra."""

    size: Annotated[float, Field(ge=0.01, le=0.5), Unit("cell")] = 0.2
    """Size of the solid's tetrahedra; narrow channels are meshed finer, with at most 0.8 of their radius."""
    fluid_size: Annotated[float, Field(ge=0.01, le=0.5), Unit("cell")] = 0.07
    """Size of the fluid's tetrahedra; Stokes flow converges slowly around sharp ridges, and it is solved only once."""
    element: Element = "quadratic-curved"
    """Order and shape of the tetrahedra: curved ones follow the pore wall."""


@dataclass(frozen=True, eq=False)
class CellMesh:
    """Tetrahedra of one phase on the eighth, on the whole cell around the origin, or on a block of whole cells.

    With sides s the eighth is the box from 0 to s/2, [0, ½]³ in a cubic cell, and the whole cell that from −s/2 to s/2.

    Attributes
    ----------
    phase, domain
        Phase and domain of the mesh.
    points : (nodes, 3)
        Nodes.
    cells : (tetrahedra, 4 or 10)
        Linear or quadratic tetrahedra in VTK order, positively oriented.
    periods
        Cells along each axis; a block extends from −s/2 to (periods − ½) s and has the domain "whole".
    regions : (tetrahedra,)
        Index of each element into ``region_names``; all 0 where none are given.
    region_names
        Parts of the phase that may differ in material; one, named like the phase, where none are given.
    sides
        Sides s of one cell along each axis; its volume is 1.

    Raises
    ------
    ValueError
        The regions are not one for each element, or lie outside the names.
    """

    phase: Phase
    domain: Domain
    points: Array
    cells: IntArray
    periods: tuple[int, int, int] = (1, 1, 1)
    regions: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    region_names: tuple[str, ...] = ()
    sides: Sides = CUBE

    def __post_init__(self) -> None:
        if not self.region_names:
            object.__setattr__(self, "region_names", (self.phase,))
            object.__setattr__(self, "regions", np.zeros(len(self.cells), dtype=np.int64))
        if (
            self.regions.shape != (len(self.cells),)
            or not np.isin(self.regions, np.arange(len(self.region_names))).all()
        ):
            raise ValueError(
                f"regions: expected {len(self.cells)} indices into {self.region_names}, got shape {self.regions.shape}"
            )

    @property
    def order(self) -> int:
        """Order of the elements, 1 or 2."""
        return 1 if self.cells.shape[1] == 4 else 2

    @property
    def quadrature_degree(self) -> int:
        """Degree of the solid's quadrature: one point for constant gradients, four points for quadratic elements."""
        return 1 if self.order == 1 else 2

    @cached_property
    def quadratic(self) -> CellMesh:
        """The mesh with mid-edge nodes; itself where it has them."""
        if self.order == 2:
            return self
        points, cells, _ = with_middles(self.points, self.cells)
        return replace(self, points=points, cells=cells)

    @cached_property
    def boundary(self) -> IntArray:
        """Facets of one tetrahedron only, (K, 3) or (K, 6) in VTK order, outward."""
        return boundary_facets(self.cells)

    @cached_property
    def wall(self) -> IntArray:
        """Facets of the pore wall Γ, outward from this phase.

        The rest of the boundary of an eighth lies on its mirror planes, that of a whole cell on opposite facets of
        the same phase.
        """
        if self.domain == "eighth":
            corners = self.points[self.boundary[:, :3]]
            on_plane = (corners == self.low).all(axis=1) | (corners == self.high).all(axis=1)
            return np.asarray(self.boundary[~on_plane.any(axis=1)])
        number = facet_classes(self.points, self.boundary, self.low, self.high)
        return np.asarray(self.boundary[np.bincount(number)[number] == 1])

    @property
    def spans(self) -> Array:
        """Periods of a field on the whole cell or on the block along each axis, (3,)."""
        return np.multiply(self.periods, self.sides)

    @property
    def low(self) -> Array:
        """Lower end of the domain along each axis, (3,): the middle of the cell for its eighth."""
        return np.zeros(3) if self.domain == "eighth" else np.array(self.sides) / -2

    @property
    def high(self) -> Array:
        """Upper end of the domain along each axis, (3,)."""
        return self.spans - np.array(self.sides) / 2

    @cached_property
    def on_mirrors(self) -> BoolArray:
        """True (nodes, 3) for a node of the eighth on a mirror plane across each axis."""
        return np.asarray((self.points == self.low) | (self.points == self.high))

    @cached_property
    def periodic_class(self) -> IntArray:
        """Number (N,) of each node with opposite faces identified; the identity on the eighth."""
        if self.domain == "eighth":
            return np.arange(len(self.points))
        wrapped = np.where(self.points == self.high, self.low, self.points)
        return np.asarray(np.unique(wrapped, axis=0, return_inverse=True)[1].reshape(-1))

    @cached_property
    def hash(self) -> str:
        """Hash of points and cells, and of the regions where there are several."""
        several = len(self.region_names) > 1
        regions = (self.regions.tobytes(), "\0".join(self.region_names)) if several else ()
        return stable_hash(self.points.round(12).tobytes(), self.cells.tobytes(), *regions, length=16)


@lru_cache(maxsize=8)
def make_mesh(geometry: PoreGeometry, settings: MeshSettings, phase: Phase, domain: Domain) -> CellMesh:
    """Return the mesh of one phase; the eighth is part of the whole, so symmetric loads have the same averages on both.

    Raises
    ------
    ConfigurationError
        The mesh is too coarse for the pores or walls.
    PorocoreError
        The geometry cannot be meshed.
    ValueError
        The domain is the eighth of a cell without mirrors.
    """
    if geometry.unfolding == "whole" and domain == "eighth":
        raise ValueError(f"{geometry.description}: the cell has no mirrors, and so no eighth")
    if geometry.unfolding != "whole" and domain == "whole":
        eighth = make_mesh(geometry, settings, phase, "eighth")
        points, cells = eighth_to_whole(eighth.points, eighth.cells, geometry.sides)
        regions = np.tile(eighth.regions, 8)
        return replace(eighth, domain=domain, points=points, cells=cells, regions=regions)
    size = settings.size if phase == "solid" else settings.fluid_size
    part = _part(geometry, size, settings.element)[phase]
    points, cells, regions = part.points, part.cells, part.regions
    _require_porosity(geometry, settings, phase, part)
    if geometry.unfolding == "wedge":
        points, cells = wedge_to_eighth(points, cells)
        regions = np.tile(regions, 6)
    elif geometry.unfolding == "eighth":
        points = snap(points, geometry.sides)
    return CellMesh(
        phase, domain, points, cells, regions=regions, region_names=part.region_names, sides=geometry.sides
    )


def _require_porosity(geometry: PoreGeometry, settings: MeshSettings, phase: Phase, part: Tetrahedra) -> None:
    """Refuse the mesh of a phase whose share is another one than that of a geometry of two phases."""
    copies = {"wedge": 48, "eighth": 8, "whole": 1}[geometry.unfolding]
    found, exact = porosity(part.points, part.cells, phase, copies), geometry.porosity
    less = min(exact, 1 - exact)
    if less == 0 or abs(found - exact) <= MISSED * less:
        return
    key = "size" if phase == "solid" else "fluid_size"
    told = (
        f"expected a mesh of the porosity {exact:.3g}, which is that of {geometry.description}, got {found:.3g} with "
        f"the {phase}'s mesh of size {getattr(settings, key):g}"
    )
    advice = f"give a smaller cell.mesh.{key}, with several elements across pores and walls"
    if values := geometry.value_warnings:
        place = "" if values[0].startswith("cell.geometry.") else "cell.geometry: "
        missed = f"so the mesh misses these pores: {told}; if they are the pores, {advice}"
        raise ConfigurationError(f"{place}{'; '.join(values)}; {missed}")
    raise ConfigurationError("; ".join((f"cell.mesh.{key}: {told}", *geometry.warnings, advice)))


@lru_cache(maxsize=4)
def _part(geometry: PoreGeometry, size: float, element: Element) -> dict[Phase, Tetrahedra]:
    return geometry.tetrahedra(size, element)


Periods = tuple[int, int, int]
#: Largest difference of the copies of a field where they meet, relative to its largest value.
SAME = 1e-6


@lru_cache(maxsize=4)
def block(mesh: CellMesh, periods: Periods) -> CellMesh:
    """Return the mesh of a block: copies of the mesh of a whole cell, joined at their faces.

    Raises
    ------
    ValueError
        The mesh is not that of one whole cell, or a number of cells is not positive.
    """
    if mesh.domain != "whole" or mesh.periods != (1, 1, 1):
        raise ValueError("a block is made of the mesh of one whole cell")
    first, inverse = _joined(mesh, periods)
    shifts = _shifts(periods) * mesh.sides
    points = (mesh.points[None] + shifts[:, None]).reshape(-1, 3)[first]
    n = len(mesh.points)
    cells = np.concatenate([inverse[mesh.cells + k * n] for k in range(len(shifts))])
    regions = np.tile(mesh.regions, len(shifts))
    return CellMesh(mesh.phase, "whole", points, cells, periods, regions, mesh.region_names, mesh.sides)


def tiled(mesh: CellMesh, u: Array, periods: Periods) -> Array:
    """Return a periodic field of the whole cell on a block of its copies, (nodes of the block, 3).

    Parameters
    ----------
    mesh
        Mesh of one whole cell.
    u : (nodes, 3)
        Field at its nodes.
    periods
        Cells of the block along each axis.

    Raises
    ------
    ValueError
        The field is not continuous from cell to cell.
    """
    if mesh.domain != "whole" or mesh.periods != (1, 1, 1) or u.shape != mesh.points.shape:
        raise ValueError(
            f"expected a field ({len(mesh.points)}, 3) on the mesh of one whole cell, got {u.shape}"
        )
    first, inverse = _joined(mesh, periods)
    copies = np.tile(u, (math.prod(periods), 1))
    values: Array = copies[first]
    if np.abs(values[inverse] - copies).max(initial=0.0) > SAME * np.abs(u).max(initial=0.0):
        raise ValueError("the copies of the field do not meet: it is not periodic")
    return values


def _shifts(periods: Periods) -> Array:
    if min(periods) < 1:
        raise ValueError(f"expected positive numbers of cells, got {periods}")
    return np.array(list(product(*(range(n) for n in periods))), dtype=np.float64)


@lru_cache(maxsize=4)
def _joined(mesh: CellMesh, periods: Periods) -> tuple[IntArray, IntArray]:
    """Return the first copy of each node of the block, and the node of the block of each copy.

    The coordinates of copies agree exactly where they meet, as those of opposite faces of the cell do.
    """
    points = (mesh.points[None] + (_shifts(periods) * mesh.sides)[:, None]).reshape(-1, 3)
    _, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    return first.astype(np.int64), inverse.reshape(-1).astype(np.int64)
