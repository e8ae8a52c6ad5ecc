"""Geometries drawn by gmsh (DrawnGeometry): parts, sizes, tetrahedra; solid spheres, cylinders, no pores."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from porocore.cell.geometry.pore_geometry import (
    PER_CUBE,
    PER_FILLET,
    PoreGeometry,
    Unfolding,
    WallSurface,
    cylinder,
    sphere,
)
from porocore.cell.meshing.tetrahedra import (
    EDGES,
    Element,
    Phase,
    Tetrahedra,
    least_stretch,
    straightened,
    used,
    volumes,
)
from porocore.core.files.gmsh_model import gmsh_session
from porocore.core.tensors import CUBIC, PointGroup
from porocore.core.units import Unit
from porocore.errors import PorocoreError
from porocore.states import Array, IntArray

#: Largest element size over the radius of a channel, for about ten elements around it.
LARGEST_SIZE_TO_RADIUS = 0.8
#: Element size over the radius of a fillet, for two or three elements around its arc of 60° to 90°, and its growth.
SIZE_TO_FILLET, GROWTH = 0.8, 1.0
#: Element size over the distance between a wall and a mirror plane: a quadratic element across the gap represents the
#: parabola of the flow. Below the size COARSE, the elements in gaps are refined by the same ratio.
SIZE_TO_GAP, COARSE = 0.8, 0.2
#: A curved element gets straight edges if its smallest volume element is below this share of the straight one's.
LEAST_STRETCH = 0.02
#: Largest difference of the drawn porosity from the described one, relative to it; fillets differ by 3e-4.
LARGEST_ERROR_OF_DRAWING = 1e-3


@dataclass(frozen=True)
class DrawnPart:
    """Tags in a gmsh model.

    Attributes
    ----------
    solid, fluid
        Volumes; none where the phase is absent.
    fillets, channels
        Faces of the wall that the CAD kernel represents approximately.
    extruded
        True for one layer of elements along an axis of translational symmetry.
    """

    solid: list[int]
    fluid: list[int]
    fillets: list[int] = field(default_factory=list)
    channels: list[int] = field(default_factory=list)
    extruded: bool = False


class DrawnGeometry(PoreGeometry):
    """Geometry that adds its part to a gmsh model, from which its mesh is made."""

    @abstractmethod
    def draw(self, gmsh: Any) -> DrawnPart:
        """Add the part to the current gmsh model, and synchronise."""

    @property
    def narrowest(self) -> float:
        """Smallest length that limits the element size, whatever the settings; infinite without one."""
        return float("inf")

    @property
    def finest_fillet(self) -> float:
        """Radius of the fillets of :attr:`DrawnPart.fillets`; 0 without any."""
        return 0.0

    def gap(self, x: float, y: float, z: float) -> float:
        """Return the width of the fluid between walls at a point of the part, where it limits the element size."""
        return float("inf")

    def onto_fillet(self, points: Array) -> Array:
        """Return points (n, 3) of the drawn part near a fillet, projected onto it; unchanged without one."""
        return points

    def onto_channel(self, points: Array) -> Array:
        """Return points (n, 3) of the drawn part near a channel's wall, projected onto it; unchanged without one."""
        return points

    def elements(self, size: float) -> float:
        on_fillets = PER_FILLET / self.finest_fillet if self.finest_fillet else 0.0
        return PER_CUBE / min(size, LARGEST_SIZE_TO_RADIUS * self.narrowest) ** 3 + on_fillets

    def is_drawn(self, gmsh: Any, part: DrawnPart) -> bool:
        """Return whether a drawn part has the porosity that is described; OpenCASCADE loses some pieces in silence."""
        solid, fluid = (
            sum(gmsh.model.occ.getMass(3, tag) for tag in tags) for tags in (part.solid, part.fluid)
        )
        return abs(float(fluid / (solid + fluid)) - self.porosity) <= LARGEST_ERROR_OF_DRAWING * self.porosity

    def tetrahedra(self, size: float, element: Element) -> dict[Phase, Tetrahedra]:
        size = min(size, LARGEST_SIZE_TO_RADIUS * self.narrowest)
        with gmsh_session() as gmsh:
            try:
                return self._drawn(gmsh, size, element)
            except Exception as error:  # gmsh raises plain Exception
                raise PorocoreError(f"gmsh could not mesh {self!r} at size {size:g}: {error}") from error

    def _drawn(self, gmsh: Any, size: float, element: Element) -> dict[Phase, Tetrahedra]:
        gmsh.option.setNumber("Mesh.MeshSizeMin", size)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.model.add("cell")
        part = self.draw(gmsh)
        if not self.is_drawn(gmsh, part):
            raise PorocoreError(
                "the drawn pores are not those that are described; change a length of cell.geometry by a thousandth"
            )
        if part.fillets:
            _refine(gmsh, part.fillets, min(size, SIZE_TO_FILLET * self.finest_fillet), size)
        elif type(self).gap is not DrawnGeometry.gap:
            _follow_gaps(gmsh, self, size)
        gmsh.model.mesh.generate(3)
        if not part.extruded:
            gmsh.model.mesh.optimize("Netgen")
        if element != "linear":
            gmsh.option.setNumber("Mesh.SecondOrderLinear", float(element == "quadratic-straight"))
            gmsh.model.mesh.setOrder(2)
        nodes = _nodes(gmsh, self, part)
        if element == "quadratic-curved":
            _straighten_folds(nodes, _cells(gmsh, part.solid + part.fluid))
        volumes_of: dict[Phase, list[int]] = {"solid": part.solid, "fluid": part.fluid}
        return {phase: _read(gmsh, tags, nodes, element) for phase, tags in volumes_of.items()}


def _refine(gmsh: Any, faces: list[int], smallest: float, largest: float) -> None:
    """Set the smallest element size on the faces, growing with the distance from them."""
    fields = gmsh.model.mesh.field
    distance, size = fields.add("Distance"), fields.add("Threshold")
    fields.setNumbers(distance, "SurfacesList", faces)
    fields.setNumber(distance, "Sampling", 40)
    fields.setNumber(size, "InField", distance)
    limits = {"SizeMin": smallest, "SizeMax": largest, "DistMin": smallest}
    for name, limit in {**limits, "DistMax": smallest + (largest - smallest) / GROWTH}.items():
        fields.setNumber(size, name, limit)
    fields.setAsBackgroundMesh(size)
    gmsh.option.setNumber("Mesh.MeshSizeMin", smallest)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)


def _follow_gaps(gmsh: Any, geometry: DrawnGeometry, largest: float) -> None:
    """Set the element size to a share of the gap at each point."""
    share = SIZE_TO_GAP * min(1.0, largest / COARSE)

    def size(dim: int, tag: int, x: float, y: float, z: float, proposed: float) -> float:
        return min(largest, share * geometry.gap(x, y, z))

    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.0)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.model.mesh.setSizeCallback(size)


def _nodes(gmsh: Any, geometry: DrawnGeometry, part: DrawnPart) -> Array:
    """Return coordinates by tag, (largest tag + 1, 3), with nodes of approximate faces projected onto the wall."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    points = np.full((int(tags.max()) + 1, 3), np.nan)
    points[tags.astype(np.int64)] = coordinates.reshape(-1, 3)
    # The ends of a fillet also lie on the channel; the more curved surface comes last.
    for faces, onto in ((part.channels, geometry.onto_channel), (part.fillets, geometry.onto_fillet)):
        for face in faces:
            on_face = gmsh.model.mesh.getNodes(2, face, includeBoundary=True)[0].astype(np.int64)
            points[on_face] = onto(points[on_face])
    return points


def _straighten_folds(nodes: Array, cells: IntArray | None) -> None:
    """Give straight edges to folded curved tetrahedra, and to their neighbours along these edges.

    They occur beside narrow gaps and where walls touch.
    """
    if cells is None:
        return
    while True:
        folded = cells[least_stretch(nodes, cells) < LEAST_STRETCH]
        middles = nodes[folded[:, EDGES]].mean(axis=2)
        if np.array_equal(nodes[folded[:, 4:]], middles):
            return
        nodes[folded[:, 4:]] = middles


def _cells(gmsh: Any, tags_of_volumes: list[int]) -> IntArray | None:
    """Return the tetrahedra (VTK order) of the given volumes by the tags of their nodes; None without any volume."""
    blocks = []
    for volume in tags_of_volumes:
        kinds, _, tags_of_kind = gmsh.model.mesh.getElements(3, volume)
        for kind, tags in zip(kinds, tags_of_kind, strict=True):
            per_element = {4: 4, 11: 10}[int(kind)]
            blocks.append(tags.astype(np.int64).reshape(-1, per_element))
    if not blocks:
        return None
    cells: IntArray = np.concatenate(blocks)
    # gmsh numbers the last two edges the other way round.
    return cells if cells.shape[1] == 4 else cells[:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]]


def _read(gmsh: Any, tags_of_volumes: list[int], nodes: Array, element: str) -> Tetrahedra:
    """Return points and tetrahedra of the given volumes, numbered from 0."""
    cells = _cells(gmsh, tags_of_volumes)
    if cells is None:
        return Tetrahedra(np.empty((0, 3)), np.empty((0, 4 if element == "linear" else 10), dtype=np.int64))
    points, cells = used(nodes, cells)
    if element == "quadratic-straight":
        points = straightened(points, cells)
    if not (volumes(points, cells) > 0).all():
        raise ValueError("inverted tetrahedra")
    return Tetrahedra(points, cells)


def split(occ: Any, part: tuple[int, int], tools: list[tuple[int, int]]) -> tuple[list[int], list[int]]:
    """Split a volume by some tools and return the tags of its pieces inside and outside of them."""
    pieces, origin = occ.fragment([part], tools)
    of_part = set(origin[0])
    inside = {piece for images in origin[1:] for piece in images} & of_part
    occ.remove([piece for piece in set(pieces) - of_part if piece[0] == 3], recursive=True)
    occ.synchronize()
    return sorted(tag for _, tag in inside), sorted(tag for _, tag in of_part - inside)


def eighth(occ: Any) -> int:
    """Draw the volume [0, ½]³ and return its tag."""
    return int(occ.addBox(0, 0, 0, 0.5, 0.5, 0.5))


def wedge(occ: Any) -> int:
    """Draw the volume 0 ≤ x ≤ y ≤ z ≤ ½ and return its tag."""
    corners = ((0, 0, 0), (0, 0, 0.5), (0, 0.5, 0.5), (0.5, 0.5, 0.5))
    points = [occ.addPoint(*corner) for corner in corners]
    edge = {(i, j): occ.addLine(points[i], points[j]) for i in range(4) for j in range(i + 1, 4)}
    faces = [
        occ.addPlaneSurface([occ.addCurveLoop([edge[i, j], edge[j, k], -edge[i, k]])])
        for i, j, k in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
    ]
    return int(occ.addVolume([occ.addSurfaceLoop(faces)]))


#: Smallest gap between neighbours that a mesh resolves.
SMALLEST_GAP = 0.002


def _require_gap(radius: float, advice: str) -> None:
    if 1 - 2 * radius < SMALLEST_GAP:
        raise ValueError(
            f"radius = {radius:g} leaves a gap below {SMALLEST_GAP:g} between neighbours, which no mesh resolves; "
            f"{advice}"
        )


class SphereArray(DrawnGeometry):
    """Equal spheres on a simple cubic lattice, one in the middle of each cell (Zick & Homsy 1982)."""

    kind: Literal["sphere-array"]
    """Solid spheres on a simple cubic lattice, the pores around them."""
    radius: Annotated[float, Field(gt=0, le=0.5), Unit("cell")]
    """Radius of the spheres; at 0.5 they touch, which needs a neck."""
    neck: Annotated[float, Field(ge=0), Unit("cell")] = 0.0
    """Radius of round bars along the axes that join the spheres, below ``radius``; 0: none, and the spheres are
    loose."""

    unfolding: ClassVar[Unfolding] = "wedge"

    @model_validator(mode="after")
    def _can_be_meshed(self) -> SphereArray:
        if self.neck >= self.radius:
            raise ValueError(f"neck = {self.neck:g} is not below the radius {self.radius:g} of the spheres")
        if self.neck == 0:
            _require_gap(
                self.radius, "give a neck > 0, which fills it where it is narrowest, or a smaller radius"
            )
        return self

    @property
    def porosity(self) -> float:
        """Porosity 1 − 4/3 π r³, less the parts of the three bars outside the spheres."""
        r, n = self.radius, self.neck
        height = np.sqrt(r**2 - n**2)
        cap = np.pi * (r - height) ** 2 * (2 * r + height) / 3
        bar = 2 * (np.pi * n**2 * (0.5 - height) - cap)
        return float(1 - 4 / 3 * np.pi * r**3 - 3 * bar)

    def wall_surfaces(self) -> Sequence[WallSurface] | None:
        necks = [cylinder(axis, self.neck) for axis in "xyz"] if self.neck else []
        return [sphere(np.zeros(3), self.radius), *necks]

    @property
    def description(self) -> str:
        necks = f" with necks of radius {self.neck:g}" if self.neck else ""
        return f"spheres of radius {self.radius:g} on a cubic lattice{necks}"

    @property
    def disconnected(self) -> str:
        """Reason without necks; empty with necks."""
        return "" if self.neck else "its spheres do not touch; give cell.geometry.neck > 0"

    @property
    def narrowest(self) -> float:
        """Radius of the obstacles."""
        return self.radius

    def gap(self, x: float, y: float, z: float) -> float:
        """Return the distance from the sphere to the mirror plane across z, the only one in the wedge."""
        return 0.5 - float(np.sqrt(max(self.radius**2 - max(x**2 + y**2, self.neck**2), 0.0)))

    def draw(self, gmsh: Any) -> DrawnPart:
        """Draw the wedge, which only the bar along z enters."""
        occ = gmsh.model.occ
        solid = [(3, occ.addSphere(0, 0, 0, self.radius))]
        if self.neck:
            solid, _ = occ.fuse(solid, [(3, occ.addCylinder(0, 0, 0, 0, 0, 1, self.neck))])
        return DrawnPart(*split(occ, (3, wedge(occ)), solid))


class CylinderArray(DrawnGeometry):
    """Equal cylinders along z on a square lattice (Sangani & Acrivos 1982)."""

    kind: Literal["cylinder-array"]
    """Solid cylinders along z on a square lattice, the pores around them."""
    radius: Annotated[float, Field(gt=0, lt=0.5), Unit("cell")]
    """Radius of the cylinders; at 0.5 neighbours would touch."""

    #: The eighth, one element high.
    unfolding: ClassVar[Unfolding] = "eighth"

    disconnected: ClassVar[str] = "its cylinders do not touch"

    @model_validator(mode="after")
    def _can_be_meshed(self) -> CylinderArray:
        _require_gap(self.radius, "give a smaller radius")
        return self

    @property
    def porosity(self) -> float:
        """Porosity 1 − π r²."""
        return 1 - np.pi * self.radius**2

    def wall_surfaces(self) -> Sequence[WallSurface] | None:
        return [cylinder("z", self.radius)]

    @property
    def point_group(self) -> PointGroup:
        """Point group 4/mmm of a square prism along z."""
        return CUBIC.kept(lambda Q: Q[2, 2] != 0)

    @property
    def description(self) -> str:
        return f"cylinders of radius {self.radius:g} along z on a square lattice"

    @property
    def narrowest(self) -> float:
        """Radius of the obstacles."""
        return self.radius

    def gap(self, x: float, y: float, z: float) -> float:
        """Return the distance from the cylinder to the mirror planes across x and y."""
        return 0.5 - float(np.sqrt(max(self.radius**2 - min(x, y) ** 2, 0.0)))

    def elements(self, size: float) -> float:
        """See :class:`~porocore.cell.geometry.pore_geometry.PoreGeometry`; one layer only."""
        return PER_CUBE / min(size, LARGEST_SIZE_TO_RADIUS * self.narrowest) ** 2

    def draw(self, gmsh: Any) -> DrawnPart:
        """Draw a section and extrude it by one element; the flow is uniform along z."""
        occ = gmsh.model.occ
        square = (2, occ.addRectangle(0, 0, 0, 0.5, 0.5))
        disk = (2, occ.addDisk(0, 0, 0, self.radius, self.radius))
        pieces, origin = occ.fragment([square], [disk])
        within = set(origin[0])
        inside = within & set(origin[1])
        occ.remove(sorted(set(pieces) - within), recursive=True)
        solid, fluid = (
            [tag for dim, tag in occ.extrude(sorted(faces), 0, 0, 0.5, numElements=[1]) if dim == 3]
            for faces in (inside, within - inside)
        )
        occ.synchronize()
        return DrawnPart(solid, fluid, extruded=True)


class NoPores(DrawnGeometry):
    """Cell without pores, for checks: its response is that of the material."""

    kind: Literal["no-pores"]
    """A cell that is all solid, for checks: its response is that of the material."""

    porosity: ClassVar[float] = 0.0

    unfolding: ClassVar[Unfolding] = "wedge"

    disconnected: ClassVar[str] = ""

    description: ClassVar[str] = "no pores"

    def draw(self, gmsh: Any) -> DrawnPart:
        """Draw the wedge."""
        part = DrawnPart([wedge(gmsh.model.occ)], [])
        gmsh.model.occ.synchronize()
        return part
