"""Kinds of bodies in the configuration: Box, Cylinder, QuarterCylinder, Wedge, MeshedBody; their cuts."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from functools import lru_cache
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, Tag, field_validator

from porocore.core.files.input_file import FromFile
from porocore.core.models.bounds import MOST_ELEMENTS
from porocore.core.models.strict import Name, StrictModel, by_kind
from porocore.core.units.dimensions import Dimension, Unit
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.body.structured import box, graded, sector

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
    def symmetry_planes(self) -> tuple[str, ...]:
        """Surfaces that may be symmetry planes."""
        return self.cuts if self.symmetry is None else self.symmetry

    @field_validator("elements", check_fields=False)
    @classmethod
    def _so_many(cls, elements: tuple[int, int, int]) -> tuple[int, int, int]:
        if math.prod(elements) > MOST_ELEMENTS:
            raise ValueError(
                f"{' × '.join(map(str, elements))} are {math.prod(elements)} elements; at most {MOST_ELEMENTS} are made"
            )
        return elements

    @abstractmethod
    def make(self) -> BodyMesh:
        """Return its mesh, the same on every machine."""

    @abstractmethod
    def coarsened(self, elements: int) -> Body:
        """Return the same body with at most about ``elements`` along each axis, where the kind can be coarsened."""


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

    def coarsened(self, elements: int) -> Box:
        """Return a copy with at most so many elements along each axis."""
        return self.model_copy(update={"elements": tuple(min(n, elements) for n in self.elements)})


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

    def coarsened(self, elements: int) -> Body:
        """Return a copy with at most so many elements along each axis."""
        return self.model_copy(update={"elements": tuple(min(n, elements) for n in self.elements)})


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


class MeshedBody(FromFile, Body):
    """From a file: a mesh with names for the parts of its surface, or a geometry that gmsh meshes.

    .msh of gmsh, anything else that meshio reads, or .geo, .step and .brep.
    """

    kind: Literal["file"]
    """A mesh with names for the parts of its surface, or a geometry that gmsh meshes, from a file."""
    size: Length | None = None
    """Size of the elements, for a geometry; null: for a mesh."""
    scale: Length = 1.0
    """Factor of the file's coordinates; with a unit, that of the file, such as ``1 mm``."""

    def make(self) -> BodyMesh:
        """Quadratic tetrahedra or triquadratic hexahedra; linear elements get straight edges with a node on them."""
        from porocore.macro.body.mesh_file import read_body

        return read_body(self.checked("macro.body"), self.size, self.scale)

    def coarsened(self, elements: int) -> MeshedBody:
        """Return this body, which cannot be coarsened."""
        return self


AnyBody = Annotated[
    Annotated[Box, Tag("box")]
    | Annotated[Cylinder, Tag("cylinder")]
    | Annotated[QuarterCylinder, Tag("quarter-cylinder")]
    | Annotated[Wedge, Tag("wedge")]
    | Annotated[MeshedBody, Tag("file")],
    by_kind(Body, "box"),
]


@lru_cache(maxsize=4)
def make_body(body: Body) -> BodyMesh:
    """Return the mesh of ``body``, cached for the next load."""
    return body.make().check("macro.body")
