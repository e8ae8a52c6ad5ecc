"""Kinds of bodies in the configuration, their middle sections, states at their quadrature points."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, Tag, field_validator, model_validator

from porocore.core.files.input_file import FromFile
from porocore.core.models.bounds import MOST_ELEMENTS
from porocore.core.models.strict import Name, StrictModel, by_kind
from porocore.core.units import Dimension, Unit
from porocore.macro.body.mesh import (
    VTK_NODES,
    BodyMesh,
    box,
    graded,
    rectangle,
    sector,
    tetrahedra,
    tetrahedron_at,
)
from porocore.states import Array, IntArray, MacroState

Positive = Annotated[float, Field(gt=0)]
Length = Annotated[Positive, Dimension("displacement")]
Count = Annotated[int, Field(ge=1, le=MOST_ELEMENTS)]
Grading = Annotated[float, Field(ge=1e-3, le=1e3)]


class Body(StrictModel, ABC):
    """A shape and how finely it is meshed.

    A new kind derives this class, has a field ``kind`` with one allowed text, and stands in :data:`AnyBody`.
    """

    #: Names of its surfaces, where the kind alone decides them.
    surfaces: ClassVar[tuple[str, ...]] = ()
    #: Those of them at which the kind is cut out of a whole.
    cuts: ClassVar[tuple[str, ...]] = ()
    symmetry: tuple[Name, ...] | None = None
    """Surfaces that are symmetry planes: the body stands for a whole that is mirrored there, and forces and volumes are
    those of the whole; null: the planes of a quarter-cylinder or a wedge that have ``normal: 0`` alone; []: none."""

    @property
    def is_section(self) -> bool:
        """True for a section of a long body, in plane strain."""
        return False

    @property
    def symmetry_planes(self) -> tuple[str, ...]:
        """Surfaces that may be symmetry planes."""
        return self.cuts if self.symmetry is None else self.symmetry

    @field_validator("elements", check_fields=False)
    @classmethod
    def _so_many(cls, elements: tuple[int, ...]) -> tuple[int, ...]:
        if math.prod(elements) > MOST_ELEMENTS:
            raise ValueError(
                f"{' × '.join(map(str, elements))} are {math.prod(elements)} elements; at most {MOST_ELEMENTS} are made"
            )
        return elements

    @abstractmethod
    def make(self) -> BodyMesh:
        """Return its mesh, the same on every machine."""

    def coarsened(self, elements: int) -> Body:
        """Return the same body with at most about ``elements`` along each axis, where the kind has such numbers."""
        counts = getattr(self, "elements", None)
        return (
            self
            if counts is None
            else self.model_copy(update={"elements": tuple(min(n, elements) for n in counts)})
        )


class Box(Body):
    """[0, a] × [0, b] × [0, c]; surfaces x-, x+, y-, y+, z-, z+."""

    surfaces = ("x-", "x+", "y-", "y+", "z-", "z+")
    kind: Literal["box"] = "box"
    """A box, [0, a] × [0, b] × [0, c]."""
    size: tuple[Length, Length, Length] = (0.1, 7.5, 0.1)
    """Lengths a, b and c along the axes."""
    elements: tuple[Count, Count, Count] = (1, 106, 1)
    """Hexahedra along each axis: quadratic displacement, linear pressure."""
    grading: tuple[Grading, Grading, Grading] = (1.0, 1.0, 1.0)
    """Length of the last element along each axis over that of the first."""

    def make(self) -> BodyMesh:
        """Return a mesh of triquadratic hexahedra."""
        x, y, z = (graded(*each) for each in zip(self.size, self.elements, self.grading, strict=True))
        return box((x, y, z))


class _Round(Body):
    radius: Length
    """Radius of the mantle about the y axis."""
    height: Length
    """Length along the y axis, from y = 0."""
    elements: tuple[Count, Count, Count] = (8, 8, 3)
    """From the inner block to the mantle; along y; around each of a quarter's two blocks, and along the inner one."""
    grading: Grading = 1.0
    """Length of the outermost element over that of the innermost outside the inner block."""

    @property
    def sweep(self) -> float:
        """Angle about the y axis, in radians."""
        return 2 * np.pi

    def make(self) -> BodyMesh:
        """Return a mesh of triquadratic hexahedra with a curved mantle."""
        return sector(self.radius, self.height, self.sweep, self.elements, self.grading)


class Cylinder(_Round):
    """About the y axis, 0 ≤ y ≤ height; surfaces y-, y+, side."""

    surfaces = ("y-", "y+", "side")
    kind: Literal["cylinder"]
    """A cylinder about the y axis, 0 ≤ y ≤ height."""


class QuarterCylinder(_Round):
    """The part x, z ≥ 0 of a cylinder; surfaces x-, z- (the symmetry planes), y-, y+, side."""

    surfaces = ("y-", "y+", "side", "z-", "x-")
    cuts = ("x-", "z-")
    kind: Literal["quarter-cylinder"]
    """The part x, z ≥ 0 of a cylinder."""

    @property
    def sweep(self) -> float:
        """Angle of a quarter, in radians."""
        return np.pi / 2


class Wedge(_Round):
    """A sector of a cylinder from z = 0 to an oblique plane; surfaces z-, oblique, y-, y+, side."""

    surfaces = ("y-", "y+", "side", "z-", "oblique")
    cuts = ("z-", "oblique")
    kind: Literal["wedge"]
    """A sector of a cylinder, from the plane z = 0 to an oblique one."""
    elements: tuple[Count, Count, Count] = (8, 8, 1)
    """From the axis to the mantle; along y; around."""
    angle: Annotated[float, Field(ge=1, lt=90), Unit("degrees")] = 15.0
    """Angle between the two plane sides."""

    @property
    def sweep(self) -> float:
        """Angle of the sector, in radians."""
        return float(np.deg2rad(self.angle))


class Axisymmetric(Body):
    """The meridian of a body of revolution about the y axis; surfaces y-, y+, side and, of a hollow one, inner.

    x is the distance from the axis, so that u_1 is radial and u_2 axial, and the third direction is that of the hoop.
    Forces and volumes are those of the whole revolution. The axes of the cell turn with the angle: its x is radial, its
    y axial and its z along the hoop.
    """

    surfaces = ("y-", "y+", "side", "inner")
    kind: Literal["axisymmetric"]
    """A body of revolution about the y axis, solved in its meridian: x is the radius, y the axis."""
    radius: Length
    """Radius of the mantle about the y axis."""
    inner_radius: Annotated[float, Field(ge=0), Dimension("displacement")] = 0.0
    """Radius of the surface ``inner`` of a hollow body; 0: the axis belongs to it."""
    height: Length
    """Length along the y axis, from y = 0."""
    elements: tuple[Count, Count] = (8, 8)
    """Quadrilaterals along the radius and along y: quadratic displacement, linear pressure."""
    grading: tuple[Grading, Grading] = (1.0, 1.0)
    """Length of the last element along each of the two over that of the first."""

    @model_validator(mode="after")
    def _has_a_wall(self) -> Self:
        if self.inner_radius >= self.radius:
            raise ValueError(
                f"inner_radius = {self.inner_radius:g} leaves nothing within radius = {self.radius:g}; make it smaller"
            )
        return self

    def make(self) -> BodyMesh:
        """Return a mesh of biquadratic quadrilaterals."""
        along, up = self.grading
        x = self.inner_radius + graded(self.radius - self.inner_radius, self.elements[0], along)
        x[-1] = self.radius
        return rectangle((x, graded(self.height, self.elements[1], up)), revolved=True)


class PlaneStrain(Body):
    """[0, a] × [0, b], which nothing moves along z; surfaces x-, x+, y-, y+."""

    surfaces = ("x-", "x+", "y-", "y+")
    kind: Literal["plane-strain"]
    """A rectangle, [0, a] × [0, b], of a body that is long along z and alike everywhere along it."""
    size: tuple[Length, Length]
    """Lengths a and b along x and y."""
    depth: Length = 1.0
    """Length along z that forces and volumes are those of."""
    elements: tuple[Count, Count] = (8, 8)
    """Quadrilaterals along x and y: quadratic displacement, linear pressure."""
    grading: tuple[Grading, Grading] = (1.0, 1.0)
    """Length of the last element along each axis over that of the first."""

    @property
    def is_section(self) -> bool:
        return True

    def make(self) -> BodyMesh:
        """Return a mesh of biquadratic quadrilaterals."""
        x, y = (graded(*each) for each in zip(self.size, self.elements, self.grading, strict=True))
        return rectangle((x, y), depth=self.depth)


class MeshedBody(FromFile, Body):
    """From a file: a mesh with names for the parts of its surface, or a geometry that gmsh meshes.

    Meshes are .msh of gmsh, .inp of Abaqus, Exodus, or what meshio reads; geometries .geo, .step and .brep.
    """

    kind: Literal["file"]
    """A mesh with names for the parts of its surface, or a geometry that gmsh meshes, from a file."""
    size: Length | None = None
    """Size of the elements, for a geometry; null: for a mesh."""
    scale: Length = 1.0
    """Factor of the file's coordinates; with a unit, that of the file, such as ``1 mm``."""
    flat: Literal["axisymmetric", "plane-strain"] | None = None
    """What a mesh or geometry in the plane z = 0, or in one parallel to it, stands for: the meridian of a body of
    revolution about the y axis, x ≥ 0, or a section in plane strain; null: it is one of three dimensions."""
    depth: Length = 1.0
    """Length along z that forces and volumes are those of, with ``flat: plane-strain`` alone."""

    @model_validator(mode="after")
    def _deep_in_plane_strain(self) -> MeshedBody:
        if "depth" in self.model_fields_set and self.flat != "plane-strain":
            raise ValueError("depth belongs to 'flat: plane-strain' alone; leave it out")
        return self

    @property
    def is_section(self) -> bool:
        return self.flat == "plane-strain"

    def make(self) -> BodyMesh:
        """Quadratic or triquadratic elements; linear ones get straight edges with a node on them."""
        from porocore.macro.body.mesh_file import read_body

        path = self.checked("macro.body")
        if self.flat is None:
            return read_body(path, self.size, self.scale)
        mesh = read_body(path, self.size, self.scale, flat=True)
        if self.flat == "plane-strain":
            return replace(mesh, depth=self.depth)
        mesh = replace(mesh, revolved=True)
        on_axis = {name for name, own in mesh.surfaces.items() if np.isin(own, mesh.on_axis).all()}
        why = "it lies on the axis of revolution, where u_1 = 0 by itself and nothing can be prescribed"
        return replace(
            mesh,
            surfaces={name: own for name, own in mesh.surfaces.items() if name not in on_axis},
            unusable={**mesh.unusable, **dict.fromkeys(on_axis, why)},
        )


AnyBody = Annotated[
    Annotated[Box, Tag("box")]
    | Annotated[Cylinder, Tag("cylinder")]
    | Annotated[QuarterCylinder, Tag("quarter-cylinder")]
    | Annotated[Wedge, Tag("wedge")]
    | Annotated[Axisymmetric, Tag("axisymmetric")]
    | Annotated[PlaneStrain, Tag("plane-strain")]
    | Annotated[MeshedBody, Tag("file")],
    by_kind(Body, "box"),
]


@lru_cache(maxsize=4)
def make_body(body: Body) -> BodyMesh:
    """Return the mesh of ``body``, cached for the next load."""
    return body.make().check("macro.body")


#: Places along the longer side of a section.
RESOLUTION = 180
#: Edges are straight whose middles are off by no more than this share of the body.
STRAIGHT = 1e-9
#: Axes on the page, to the right and upwards, of the sections across x, y and z.
SIDES = {0: (2, 1), 1: (0, 2), 2: (0, 1)}


@dataclass(frozen=True, eq=False)
class Section:
    """A section through the middle of a body, across one of the axes.

    Attributes
    ----------
    across
        Axis: 0, 1 or 2.
    at
        Coordinate along it.
    ends : (2, 2)
        Least and largest coordinate to the right and upwards.
    element : (rows, columns)
        Element at each place of the grid; -1 outside the body.
    """

    across: int
    at: float
    ends: Array
    element: IntArray

    @property
    def sides(self) -> tuple[int, int]:
        """Axes to the right and upwards."""
        return SIDES[self.across]

    def image(self, values: Array | IntArray) -> Array:
        """Return the values (elements, ...) at the places of the grid, NaN outside the body."""
        found = np.asarray(values, float)[self.element]
        found[self.element < 0] = np.nan
        return found

    def places(self) -> tuple[Array, Array]:
        """Return the coordinates of columns and rows, to the right and upwards."""
        counts = self.element.shape[::-1]
        right, up = (
            low + (np.arange(n) + 0.5) / n * (high - low)
            for n, (low, high) in zip(counts, self.ends, strict=True)
        )
        return right, up


def sections(points: Array, cells: IntArray) -> tuple[Section, ...]:
    """Return the sections through the middle of a body with these nodes and elements, across z, x and y.

    A body in two dimensions has one, across z.
    """
    straight, element_of = straight_parts(points, cells)
    low, high = points.min(axis=0), points.max(axis=0)
    flat = cells.shape[1] in FLAT
    if flat:
        points, straight = _thick(points, straight, float((high - low).max()))
    parts, part_of = tetrahedra(points, straight)
    if flat:  # some in a triangle have no volume
        volumes = np.abs(np.linalg.det(parts[:, 1:] - parts[:, :1]))
        parts, part_of = (each[volumes > STRAIGHT * volumes.max()] for each in (parts, part_of))
    owner = element_of[part_of]
    # Not on a face between elements, of which either might be found.
    middle = (low + high) / 2 + 1e-4 * (high - low)
    found = []
    for across in (2,) if flat else (2, 0, 1):
        sides = list(SIDES[across])
        lengths = (high - low)[sides]
        counts = np.maximum(np.ceil(RESOLUTION * lengths / lengths.max()).astype(int), 12)
        grid = [
            low[i] + (np.arange(n) + 0.5) / n * (high - low)[i] for i, n in zip(sides, counts, strict=True)
        ]
        places = np.empty((counts[1], counts[0], 3))
        places[...] = middle
        places[..., sides[0]], places[..., sides[1]] = np.meshgrid(*grid)
        at = tetrahedron_at(parts, places.reshape(-1, 3))
        element = np.where(at < 0, -1, owner[at]).reshape(counts[1], counts[0])
        ends = np.stack([low[sides], high[sides]], axis=1)
        found.append(Section(across, float(middle[across]), ends, element))
    return tuple(found)


def straight_parts(points: Array, cells: IntArray) -> tuple[IntArray, IntArray]:
    """Return elements with straight edges in place of a body's elements, and the element that each is a part of.

    Curved hexahedra are eight each, whose corners are all of their nodes, flat elements four; others are one, their
    corners.
    """
    own = np.arange(len(cells))
    if cells.shape[1] in FLAT:
        parts = np.array(FLAT[cells.shape[1]])
        return cells[:, parts].reshape(-1, parts.shape[1]), np.repeat(own, len(parts))
    if cells.shape[1] != 27:
        return cells[:, :4], own
    corners, middles = points[cells[:, :8]], points[cells[:, 8:]]
    share = np.prod(np.where(VTK_NODES[:8] == 0, 2 - VTK_NODES[8:, None], VTK_NODES[8:, None]) / 2, axis=2)
    off = np.abs(np.einsum("mc,ecx->emx", share, corners) - middles).max(initial=0.0)
    if off <= STRAIGHT * np.ptp(points, axis=0).max():
        return cells[:, :8], own
    number = {tuple(node): i for i, node in enumerate(VTK_NODES.tolist())}
    eighths = [
        [number[tuple(corner)] for corner in (first + VTK_NODES[:8] // 2).tolist()]
        for first in VTK_NODES[:8] // 2
    ]
    return cells[:, np.array(eighths)].reshape(-1, 8), np.repeat(own, 8)


#: Quadrilaterals with straight edges within a flat element, by the number of its nodes; those of a triangle have two
#: corners in one.
FLAT = {
    9: [(0, 4, 8, 7), (4, 1, 5, 8), (8, 5, 2, 6), (7, 8, 6, 3)],
    6: [(0, 3, 5, 5), (3, 1, 4, 4), (5, 4, 2, 2), (3, 4, 5, 5)],
}


def _thick(points: Array, cells: IntArray, width: float) -> tuple[Array, IntArray]:
    """Return nodes and hexahedra of flat quadrilaterals (k, 4), as thick as the body is wide, about the plane z = 0."""
    across = np.array([0.0, 0.0, width / 2])
    return np.concatenate([points - across, points + across]), np.concatenate(
        [cells, cells + len(points)], axis=1
    )


def most_telling(among: Sequence[Section], values: Array | Callable[[Section], Array]) -> Section:
    """Return the section in which the values (elements, ...) vary most, the first of those that are alike.

    They may be those that a section shows, such as components of a vector along its sides.
    """
    spreads = []
    for section in among:
        shown = np.asarray(values(section) if callable(values) else values, float)
        inside = shown.reshape(len(shown), -1)[section.element[section.element >= 0]]
        spreads.append(float(np.nan_to_num(inside).std(axis=0).sum()) if len(inside) else -1.0)
    most = max(spreads)
    return next(s for s, spread in zip(among, spreads, strict=True) if spread >= most * (1 - 1e-2) - 1e-300)


def point_states(mesh: BodyMesh, u: Array, p: Array, elements: IntArray | None = None) -> MacroState:
    """Return H and p at all quadrature points of some elements, or of all, element by element.

    Parameters
    ----------
    mesh
        Of the body.
    u, p : (nodes, 3), (nodes,)
        Displacement and pressure at all nodes.
    elements
        Numbers of the elements; None: all.
    """
    chosen, element = slice(None) if elements is None else elements, mesh.element
    at_points = p[mesh.cells[chosen][:, : element.corners]] @ element.corner_values(element.points).T
    return MacroState(mesh.displacement_gradients(u, chosen).reshape(-1, 3, 3), at_points.ravel())
