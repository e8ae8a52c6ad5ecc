"""Meshes of the solid and of the fluid, made by gmsh and unfolded by symmetry."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field

from porocore.cell.mirror import eighth_to_whole, snap, wedge_to_eighth
from porocore.cell.part import PoreGeometry
from porocore.errors import PorocoreError
from porocore.states import Array, IntArray

if TYPE_CHECKING:
    from porocore.cell.part import DrawnPart

Phase = Literal["solid", "fluid"]
Domain = Literal["eighth", "whole"]
#: A narrow channel needs at least some ten elements around it, however coarse the rest may be.
LARGEST_SIZE_TO_RADIUS = 0.8
#: Two elements, seldom three, around a fillet, whose arc is 60° to 90°; coarser ones away from it.
SIZE_TO_FILLET, GROWTH = 0.8, 1.0
#: Of the distance between a wall and a mirror plane: a quadratic element across it has the parabola of the flow. Where
#: finer elements than these are asked for, those in the gaps become finer alike.
SIZE_TO_GAP, COARSE = 0.8, 0.2
#: Corners of a tetrahedron between which its further nodes lie (VTK order).
EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
SYSTEM_LIBRARIES = (
    "libglu1-mesa libgl1 libxrender1 libxcursor1 libxfixes3 libxft2 libfontconfig1 libxinerama1 libgomp1"
)


class MeshSettings(BaseModel):
    """Element size (of the unit cell) and kind of tetrahedra."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    size: Annotated[float, Field(ge=0.01, le=0.5)] = 0.2
    """Of the solid's elements; narrow channels are meshed finer where they need it."""
    fluid_size: Annotated[float, Field(ge=0.01, le=0.5)] = 0.07
    """Of the fluid's; Stokes flow around the sharp ridges converges slowly, and it is solved only once."""
    element: Literal["linear", "quadratic-straight", "quadratic-curved"] = "quadratic-curved"


@dataclass(frozen=True, eq=False)
class CellMesh:
    """Tetrahedra of one phase on the eighth [0, ½]³, on the whole cell [−½, ½]³, or on a block of whole cells.

    Attributes
    ----------
    phase, domain
        What is meshed.
    points : (N, 3)
        Nodes.
    cells : (M, 4) or (M, 10)
        Linear or quadratic tetrahedra in VTK order, positively oriented.
    periods
        Whole cells along each axis; a block extends from −½ to periods − ½ and is of the domain "whole".
    regions : (M,)
        Index of each element into ``region_names``; all 0 where none are given.
    region_names
        Parts of the phase that may differ in material; one, named like the phase, where none are given.

    Raises
    ------
    ValueError
        The regions are not one for each element, or lie outside the names.
    """

    phase: Phase
    domain: Domain
    points: Array
    cells: npt.NDArray[np.int64]
    periods: tuple[int, int, int] = (1, 1, 1)
    regions: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    region_names: tuple[str, ...] = ()

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
        """1 or 2."""
        return 1 if self.cells.shape[1] == 4 else 2

    @property
    def quadrature_degree(self) -> int:
        """Of the solid problem: one point serves constant gradients, four serve the averages of quadratic elements."""
        return 1 if self.order == 1 else 2

    @cached_property
    def quadratic(self) -> CellMesh:
        """The same tetrahedra with a node in the middle of each edge, where they have none yet."""
        if self.order == 2:
            return self
        pairs = self.cells[:, EDGES].reshape(-1, 2)
        unique, inverse = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
        middles = self.points[unique].mean(axis=1)
        cells = np.concatenate([self.cells, inverse.reshape(-1, 6) + len(self.points)], axis=1)
        return replace(self, points=np.concatenate([self.points, middles]), cells=cells)

    @cached_property
    def boundary(self) -> npt.NDArray[np.int64]:
        """Facets of one tetrahedron only, (K, 3) or (K, 6) in VTK order, outward."""
        corners = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        middles = np.array([[6, 5, 4], [4, 8, 7], [7, 9, 6], [5, 9, 8]])
        local = corners if self.order == 1 else np.concatenate([corners, middles], axis=1)
        facets = self.cells[:, local].reshape(-1, local.shape[1])
        _, first, count = np.unique(
            np.sort(facets[:, :3], axis=1), axis=0, return_index=True, return_counts=True
        )
        boundary: npt.NDArray[np.int64] = facets[first[count == 1]]
        return boundary

    @cached_property
    def wall(self) -> npt.NDArray[np.int64]:
        """Facets of the pore wall Γ, outward from this phase; the rest of the boundary lies on the cell's planes."""
        corners = self.points[self.boundary[:, :3]]
        planes = (0.0, self._last) if self.domain == "eighth" else (-0.5, self._last)
        on_plane = np.zeros(len(corners), dtype=bool)
        for plane in planes:
            on_plane |= (corners == plane).all(axis=1).any(axis=1)
        return self.boundary[~on_plane]

    @property
    def _last(self) -> Array:
        """Where the domain ends along each axis, (3,)."""
        return np.array(self.periods) - 0.5

    @cached_property
    def periodic_class(self) -> npt.NDArray[np.int64]:
        """(N,) number of each node when opposite faces of the domain are one; the identity on the eighth."""
        if self.domain == "eighth":
            return np.arange(len(self.points))
        wrapped = np.where(self.points == self._last, -0.5, self.points)
        inverse: npt.NDArray[np.int64] = np.unique(wrapped, axis=0, return_inverse=True)[1].reshape(-1)
        return inverse

    @cached_property
    def hash(self) -> str:
        """Of points and cells, and of the regions where there are several."""
        digest = hashlib.sha256(self.points.round(12).tobytes() + self.cells.tobytes())
        if len(self.region_names) > 1:
            digest.update(self.regions.tobytes() + "\0".join(self.region_names).encode())
        return digest.hexdigest()[:16]


@lru_cache(maxsize=8)
def make_mesh(geometry: PoreGeometry, settings: MeshSettings, phase: Phase, domain: Domain) -> CellMesh:
    """Mesh one phase; the eighth is part of the whole, so both give the same averages for symmetric loads.

    Raises
    ------
    PorocoreError
        gmsh cannot be imported or fails.
    """
    if domain == "whole":
        eighth = make_mesh(geometry, settings, phase, "eighth")
        points, cells = eighth_to_whole(eighth.points, eighth.cells)
        return CellMesh(
            phase, domain, points, cells, regions=np.tile(eighth.regions, 8), region_names=eighth.region_names
        )
    size = settings.size if phase == "solid" else settings.fluid_size
    points, cells = _mesh_part(geometry, size, settings.element)[phase]
    if geometry.unfolding == "wedge":
        points, cells = wedge_to_eighth(points, cells)
    else:
        points = snap(points, [0.0, 0.5])
    return CellMesh(phase, domain, points, cells)


def _import_gmsh() -> Any:
    try:
        import gmsh
    except (ImportError, OSError) as error:
        raise PorocoreError(
            f"gmsh cannot be loaded ({error}); it needs some system libraries: on Debian or Ubuntu run "
            f"apt-get install {SYSTEM_LIBRARIES}"
        ) from error
    return gmsh


@lru_cache(maxsize=4)
def _mesh_part(
    geometry: PoreGeometry, size: float, element: str
) -> dict[Phase, tuple[Array, npt.NDArray[np.int64]]]:
    gmsh = _import_gmsh()
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        size = min(size, LARGEST_SIZE_TO_RADIUS * geometry.narrowest)
        gmsh.option.setNumber("Mesh.MeshSizeMin", size)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.model.add("cell")
        part = geometry.draw(gmsh)
        if part.fillets:
            _refine(gmsh, part.fillets, min(size, SIZE_TO_FILLET * geometry.finest_fillet), size)
        elif type(geometry).gap is not PoreGeometry.gap:
            _follow_gaps(gmsh, geometry, size)
        gmsh.model.mesh.generate(3)
        if not part.extruded:
            gmsh.model.mesh.optimize("Netgen")
        if element != "linear":
            gmsh.option.setNumber("Mesh.SecondOrderLinear", float(element == "quadratic-straight"))
            gmsh.model.mesh.setOrder(2)
        nodes = _nodes(gmsh, geometry, part)
        return {
            "solid": _read(gmsh, part.solid, nodes, element),
            "fluid": _read(gmsh, part.fluid, nodes, element),
        }
    except Exception as error:  # gmsh raises plain Exception
        raise PorocoreError(f"gmsh could not mesh {geometry!r} at size {size:g}: {error}") from error
    finally:
        gmsh.finalize()


def _refine(gmsh: Any, faces: list[int], smallest: float, largest: float) -> None:
    """Elements of the smallest size on the faces, growing with the distance from them."""
    fields = gmsh.model.mesh.field
    distance, size = fields.add("Distance"), fields.add("Threshold")
    fields.setNumbers(distance, "SurfacesList", faces)
    fields.setNumber(distance, "Sampling", 40)
    fields.setNumber(size, "InField", distance)
    fields.setNumber(size, "SizeMin", smallest)
    fields.setNumber(size, "SizeMax", largest)
    fields.setNumber(size, "DistMin", smallest)
    fields.setNumber(size, "DistMax", smallest + (largest - smallest) / GROWTH)
    fields.setAsBackgroundMesh(size)
    gmsh.option.setNumber("Mesh.MeshSizeMin", smallest)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)


def _follow_gaps(gmsh: Any, geometry: PoreGeometry, largest: float) -> None:
    """Elements as small as the gaps beside them."""
    share = SIZE_TO_GAP * min(1.0, largest / COARSE)

    def size(dim: int, tag: int, x: float, y: float, z: float, proposed: float) -> float:
        return min(largest, share * geometry.gap(x, y, z))

    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.0)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.model.mesh.setSizeCallback(size)


def _nodes(gmsh: Any, geometry: PoreGeometry, part: DrawnPart) -> Array:
    """Coordinates by tag, (largest tag + 1, 3), those on approximate faces moved onto the wall."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    points = np.full((int(tags.max()) + 1, 3), np.nan)
    points[tags.astype(np.int64)] = coordinates.reshape(-1, 3)
    # The fillet's ends are also the channel's: last what is the more curved.
    for faces, onto in ((part.channels, geometry.onto_channel), (part.fillets, geometry.onto_fillet)):
        for face in faces:
            on_face = gmsh.model.mesh.getNodes(2, face, includeBoundary=True)[0].astype(np.int64)
            points[on_face] = onto(points[on_face])
    return points


def _read(gmsh: Any, volumes: list[int], nodes: Array, element: str) -> tuple[Array, npt.NDArray[np.int64]]:
    """Points and tetrahedra (VTK order) of the given volumes, numbered from 0."""
    blocks = []
    for volume in volumes:
        kinds, _, tags_of_kind = gmsh.model.mesh.getElements(3, volume)
        for kind, tags in zip(kinds, tags_of_kind, strict=True):
            per_element = {4: 4, 11: 10}[int(kind)]
            blocks.append(tags.astype(np.int64).reshape(-1, per_element))
    if not blocks:
        return np.empty((0, 3)), np.empty((0, 4 if element == "linear" else 10), dtype=np.int64)
    cells = np.concatenate(blocks)
    if cells.shape[1] == 10:
        cells = cells[
            :, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
        ]  # gmsh numbers the last two edges the other way round
    used, cells = np.unique(cells, return_inverse=True)
    cells = cells.reshape(-1, blocks[0].shape[1])
    points = nodes[used]
    if element == "quadratic-straight":
        points[cells[:, 4:]] = points[cells[:, EDGES]].mean(axis=2)
    corners = points[cells[:, :4]]
    edges = corners[:, 1:] - corners[:, :1]
    if not (np.linalg.det(edges) > 0).all():
        raise ValueError("inverted tetrahedra")
    return points, cells
