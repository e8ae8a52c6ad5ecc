"""Regions of a body in the configuration: layers, boxes, spheres, half spaces, named volumes; their elements."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import Field, Tag, model_validator

from porocore.core.echo import echo
from porocore.core.models.strict import Name, StrictModel, by_kind
from porocore.core.units.dimensions import Dimension
from porocore.core.units.results import spoken
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.composition.axes import Fields
from porocore.states import Array, IntArray

T = TypeVar("T")
Length = Annotated[float, Dimension("displacement")]
Point = Annotated[tuple[float, float, float], Dimension("displacement")]


class Region(StrictModel, ABC):
    """A part of a body: the elements whose centres lie in it."""

    cell: str | None = None
    """Name of the region's cell; null: the cell of the study."""
    fields: Fields = Field(default={})
    """Parameters of the cell and material axes in this region, instead of those of the body."""

    @abstractmethod
    def holds(self, mesh: BodyMesh, centres: Array, key: str) -> Array:
        """Return which elements, with their ``centres`` (elements, 3), belong to it, (elements,) bool.

        Raises
        ------
        ConfigurationError
            It cannot be in this body; the message begins with ``key``.
        """


class LayerRegion(Region):
    """A layer between two planes across an axis."""

    kind: Literal["layer"] = "layer"
    """A layer between two planes across an axis."""
    along: Literal["x", "y", "z"] = "y"
    """Axis across which it lies."""
    above: Length | None = None
    """Coordinate at which it begins; null: it has no lower end."""
    below: Length | None = None
    """Coordinate at which it ends; null: it has no upper end."""

    @model_validator(mode="after")
    def _bounded(self) -> LayerRegion:
        if self.above is None and self.below is None:
            raise ValueError("a layer needs at least one of above and below")
        if self.above is not None and self.below is not None and not self.above < self.below:
            raise ValueError(
                "a layer is above a plane that lies below the one that it is below; exchange them"
            )
        return self

    def holds(self, mesh: BodyMesh, centres: Array, key: str) -> Array:
        """Return the elements between the planes."""
        at = centres[:, "xyz".index(self.along)]
        low = -np.inf if self.above is None else self.above
        high = np.inf if self.below is None else self.below
        return np.asarray((at > low) & (at <= high))


class BoxRegion(Region):
    """A box along the axes."""

    kind: Literal["box"]
    """A box along the axes."""
    low: Point
    """Its corner with the smallest coordinates."""
    high: Point
    """Its corner with the largest coordinates."""

    @model_validator(mode="after")
    def _not_empty(self) -> BoxRegion:
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            raise ValueError("the box is empty; give low with smaller coordinates than high")
        return self

    def holds(self, mesh: BodyMesh, centres: Array, key: str) -> Array:
        """Return the elements in the box."""
        return np.asarray(((centres >= self.low) & (centres <= self.high)).all(axis=1))


class SphereRegion(Region):
    """All within a radius about a point."""

    kind: Literal["sphere"]
    """All within a radius about a point."""
    centre: Point
    """That point."""
    radius: Annotated[float, Field(gt=0), Dimension("displacement")]
    """Its radius."""

    def holds(self, mesh: BodyMesh, centres: Array, key: str) -> Array:
        """Return the elements in the sphere."""
        return np.asarray(np.linalg.norm(centres - np.array(self.centre), axis=1) <= self.radius)


class HalfSpaceRegion(Region):
    """All on one side of a plane."""

    kind: Literal["half-space"]
    """All on one side of a plane."""
    point: Point
    """A point of the plane."""
    normal: tuple[float, float, float]
    """Direction across the plane, into the region."""

    @model_validator(mode="after")
    def _directed(self) -> HalfSpaceRegion:
        if not any(self.normal):
            raise ValueError("normal is no direction, all of its components are zero")
        return self

    def holds(self, mesh: BodyMesh, centres: Array, key: str) -> Array:
        """Return the elements on the side to which the normal points."""
        return np.asarray((centres - np.array(self.point)) @ np.array(self.normal) > 0)


class VolumeRegion(Region):
    """A named volume of the body's file."""

    kind: Literal["volume"]
    """A named volume of the body's file, such as a physical volume of gmsh."""
    name: Annotated[Name, Field(min_length=1)]
    """Its name, or its number where it has none."""

    def holds(self, mesh: BodyMesh, centres: Array, key: str) -> Array:
        """Return the elements of the volume."""
        if self.name in mesh.unusable_volumes:
            raise ConfigurationError(f"{key}.name: {mesh.unusable_volumes[self.name]}")
        if self.name not in mesh.volumes:
            known = ", ".join(mesh.volumes)
            told = (
                f"its volumes are {known}"
                if known
                else "it names none; give the volumes of the mesh file names"
            )
            raise ConfigurationError(f"{key}.name: the body has no volume {echo(self.name)}; {told}")
        inside = np.zeros(len(centres), bool)
        inside[mesh.volumes[self.name]] = True
        return inside


AnyRegion = Annotated[
    Annotated[LayerRegion, Tag("layer")]
    | Annotated[BoxRegion, Tag("box")]
    | Annotated[SphereRegion, Tag("sphere")]
    | Annotated[HalfSpaceRegion, Tag("half-space")]
    | Annotated[VolumeRegion, Tag("volume")],
    by_kind(Region, "layer"),
]


def region_numbers(mesh: BodyMesh, regions: Mapping[str, Region]) -> IntArray:
    """Return the number of the region of each element, (elements,): 0 of the rest, then from 1 in their order.

    Raises
    ------
    ConfigurationError
        A region holds no element, or two of them hold the same.
    """
    number = np.zeros(len(mesh.cells), dtype=np.int64)
    names = list(regions)
    for k, (name, region) in enumerate(regions.items(), start=1):
        key = f"macro.regions.{name}"
        inside = region.holds(mesh, mesh.centres, key).astype(bool)
        if not inside.any():
            low, high = (
                spoken().texts(end, "displacement") for end in (mesh.centres.min(0), mesh.centres.max(0))
            )
            raise ConfigurationError(
                f"{key}: none of the {len(number)} elements has its centre in this region; they lie from {low} to "
                f"{high}: move or widen it, or mesh the body finer there"
            )
        if (both := inside & (number > 0)).any():
            other = names[int(number[both][0]) - 1]
            at = spoken().texts(mesh.centres[both.argmax()], "displacement")
            raise ConfigurationError(
                f"{key}: {int(both.sum())} of its {int(inside.sum())} elements lie in the region '{other}' too, one at "
                f"{at}; regions must not overlap"
            )
        number[inside] = k
    return number


def by_region(regions: Mapping[str, Region], rest: T, others: Mapping[str, T]) -> list[T]:
    """Return what the cell of each region has, by the number of the region.

    The rest of the body, and regions that name no cell, have ``rest``; ``others`` are those of the named cells.
    """
    return [rest, *(rest if region.cell is None else others[region.cell] for region in regions.values())]


def regions_of_cell(regions: Mapping[str, Region], cell: str | None) -> list[int]:
    """Return the numbers of the regions that have a cell; None names that of the rest of the body."""
    return [k for k, own in enumerate((None, *(region.cell for region in regions.values()))) if own == cell]
