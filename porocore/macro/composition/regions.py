"""Regions of a body, and parameters and places at its points at a time (BodyFields), with means over elements."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, Protocol, TypeVar

import numpy as np
import numpy.typing as npt
from pydantic import Field, Tag, model_validator

from porocore.core.echo import echo, joined, suggestion
from porocore.core.models.strict import Name, StrictModel, by_kind
from porocore.core.units import Dimension, units_now
from porocore.errors import ConfigurationError
from porocore.interfaces.cell import ElementCells
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.composition.fields import (
    AXES,
    AxesField,
    Fields,
    FormulaField,
    MeasuredField,
    ParameterField,
    Points,
    as_field,
    require_formula,
)
from porocore.macro.composition.law_numbers import is_of_the_law, key_of_number, of_the_cell
from porocore.states import Array, BodyPlace, IntArray, MacroState

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
    """Its name, or its number in the file, in quotes or not."""

    def holds(self, mesh: BodyMesh, centres: Array, key: str) -> Array:
        """Return the elements of the volume."""
        if self.name in mesh.unusable_volumes:
            raise ConfigurationError(f"{key}.name: {mesh.unusable_volumes[self.name]}")
        name = self.name if self.name in mesh.volumes else mesh.volume_numbers.get(self.name)
        if name is None:
            known = ", ".join(mesh.volumes)
            told = (
                f"its volumes are {known}"
                if known
                else "it names none; give the volumes of the mesh file names"
            )
            raise ConfigurationError(f"{key}.name: the body has no volume {echo(self.name)}; {told}")
        inside = np.zeros(len(centres), bool)
        inside[mesh.volumes[name]] = True
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
                units_now().texts(end, "displacement") for end in (mesh.centres.min(0), mesh.centres.max(0))
            )
            raise ConfigurationError(
                f"{key}: none of the {len(number)} elements has its centre in this region; they lie from {low} to "
                f"{high}: move or widen it, or mesh the body finer there"
            )
        if (both := inside & (number > 0)).any():
            other = names[int(number[both][0]) - 1]
            at = units_now().texts(mesh.centres[both.argmax()], "displacement")
            raise ConfigurationError(
                f"{key}: {int(both.sum())} of its {int(inside.sum())} elements lie in the region '{other}' too, one at "
                f"{at}; regions must not overlap"
            )
        number[inside] = k
    return number


def of_regions(regions: Mapping[str, Region], rest: T, others: Mapping[str, T]) -> list[T]:
    """Return what the cell of each region has, by the number of the region.

    The rest of the body, and regions that name no cell, have ``rest``; ``others`` are those of the named cells.
    """
    return [rest, *(rest if region.cell is None else others[region.cell] for region in regions.values())]


def regions_of_cell(regions: Mapping[str, Region], cell: str | None) -> list[int]:
    """Return the numbers of the regions that have a cell; None names that of the rest of the body."""
    return [k for k, own in enumerate((None, *(region.cell for region in regions.values()))) if own == cell]


class ComposedBody(Protocol):
    """A set-up with regions and fields."""

    @property
    def regions(self) -> Mapping[str, Region]:
        """Regions by name."""

    @property
    def fields(self) -> Mapping[str, Any]:
        """Fields of the whole body by the name of the parameter, and the axes."""


class NeedsParameters(Protocol):
    """A law, as far as its parameters matter; see :class:`~porocore.interfaces.law.MacroLaw`."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters."""

    def parameters_of(self, region: int) -> tuple[str, ...]:
        """Return the names of those that a region needs."""


def require_names(setup: ComposedBody, law: NeedsParameters) -> None:
    """Refuse a field of what is no parameter of any cell, or in a region, of its own.

    Raises
    ------
    ConfigurationError
        There is one; the message names it and the parameters.
    """
    cells = [None, *(region.cell for region in setup.regions.values())]
    for k, (prefix, entries) in enumerate(sections(setup)):
        names = law.parameters_of(k) if k else law.parameters
        of = "the cell" if cells[k] is None else f"the cell '{cells[k]}'"
        for name in entries:
            if name not in names and name != AXES:
                told = suggestion(
                    name,
                    names,
                    "the parameters are",
                    "there are none; a number of the cell becomes one by {range: [lower, upper]} in its place",
                )
                raise ConfigurationError(f"{prefix}.{name}: '{name}' is no parameter of {of}; {told}")


def composition(setup: ComposedBody) -> dict[str, Any]:
    """Return regions and fields as plain data, as far as there are any; files count by content, not by path."""
    regions = {name: without_paths(region.model_dump()) for name, region in setup.regions.items()}
    fields = {
        name: entry if isinstance(entry, float | str) else without_paths(entry.model_dump())
        for name, entry in setup.fields.items()
    }
    return {key: value for key, value in (("regions", regions), ("fields", fields)) if value}


def without_paths(data: Any) -> Any:
    """Return nested data without the paths of files, which count by their content."""
    if isinstance(data, dict):
        return {key: without_paths(value) for key, value in data.items() if key != "path"}
    return data


def field_corners(setup: ComposedBody) -> Iterator[float]:
    """Yield the times at which a field or the axes have a kink."""
    for _, entries in sections(setup):
        for entry in entries.values():
            if not isinstance(entry, float | str):
                yield from entry.corners


def sections(setup: ComposedBody) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the keys of all mappings of fields, with these: that of the body, then those of the regions."""
    yield "macro.fields", setup.fields
    for name, region in setup.regions.items():
        yield f"macro.regions.{name}.fields", region.fields


def by_region(setup: ComposedBody, name: str, present: Sequence[int]) -> Iterator[tuple[str, list[int], Any]]:
    """Yield key, numbers of the regions and value of each field of that name; regions without have the body's."""
    own = {
        k: (_key(f"macro.regions.{region}.fields", name, settings.cell), settings.fields[name])
        for k, (region, settings) in enumerate(setup.regions.items(), start=1)
        if name in settings.fields
    }
    if name in setup.fields:
        yield body_key(name), [k for k in present if k not in own], setup.fields[name]
    for k, (key, value) in own.items():
        yield key, [k], value


def body_key(name: str) -> str:
    """Return the key of the value of a parameter that goes for the whole body."""
    return _key("macro.fields", name, None)


def _key(section: str, name: str, cell: str | None) -> str:
    """Return the key of a field in a section; that of a number of a law, of which ``cell`` may have its own."""
    return key_of_number(name, cell) if is_of_the_law(name) else f"{section}.{name}"


def without_a_value(setup: ComposedBody, name: str, missing: Sequence[int]) -> str:
    """Return the complaint that a parameter has no value in the regions of these numbers."""
    regions = ["the rest of the body", *(f"the region '{region}'" for region in setup.regions)]
    where = ", ".join(regions[k] for k in missing) if setup.regions else "the body"
    return (
        f"macro.fields.{name}: missing; the cell has the parameter '{name}', which has no value in {where}: add "
        f"'{name}:' with a number or a field"
    )


#: Times from the beginning to the end at which fields are looked at, beside their kinks; and more for those that change
#: by a formula, at shares of the golden ratio, so that no period of it hides between them.
TIMES, MORE_TIMES, GOLDEN = 21, 100, (np.sqrt(5) - 1) / 2


@dataclass(frozen=True)
class CellRanges:
    """Ranges of the parameters of the cell of each region, by its number: that of the rest of the body first."""

    by_region: Sequence[Mapping[str, tuple[float, float]]]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters of all cells, each once."""
        return tuple(dict.fromkeys(name for ranges in self.by_region for name in ranges))

    def parameters_of(self, region: int) -> tuple[str, ...]:
        """Return the names of those that a region's cell has."""
        return tuple(self.by_region[region])


@dataclass(frozen=True, eq=False)
class CellsAtPoints:
    """Parameters and places at n points at one time.

    Attributes
    ----------
    parameters : (n, m)
        None: the law has no parameters.
    place
        None: the body has neither regions nor axes.
    """

    parameters: Array | None = None
    place: BodyPlace | None = None

    def given_to(self, states: MacroState) -> MacroState:
        """Return the states with these parameters and places."""
        if self.parameters is None and self.place is None:
            return states
        return replace(states, parameters=self.parameters, place=self.place)


#: Those of a body of one cell without parameters.
EVERYWHERE_ALIKE = CellsAtPoints()


@dataclass(frozen=True, eq=False)
class _Piece:
    """A field on the points that have it, with its key, and where it comes to if that does not change with time."""

    key: str
    rows: IntArray
    points: Points
    field: ParameterField
    reached: Array | None

    def at(self, time: float) -> Array:
        found = self.field.reached(self.points, time, self.key) if self.reached is None else self.reached
        return self.field.in_time(found, time)


class BodyFields:
    """Fields and regions of a body at the quadrature points of some elements, at any time.

    Parameters
    ----------
    setup
        Regions and fields.
    mesh
        Of the body.
    law
        Whose parameters are needed.
    elements
        Numbers of the elements; None: all.

    Attributes
    ----------
    varies
        Whether anything changes with time.
    turned
        Whether there are material axes.
    names, regions
        Parameters of the law, and names of the regions.

    Raises
    ------
    ConfigurationError
        A field is of no parameter, a parameter has no field somewhere, regions are empty or overlap, or a file does not
        suit the body.
    """

    def __init__(
        self, setup: ComposedBody, mesh: BodyMesh, law: NeedsParameters, elements: IntArray | None = None
    ) -> None:
        self.names = names = law.parameters
        self.regions = tuple(setup.regions)
        require_names(setup, law)
        self._pieces: list[list[_Piece]] = []
        self._axes: list[tuple[str, IntArray, Points, AxesField]] = []
        self.varies, self.turned = False, False
        self._last: tuple[float, CellsAtPoints] | None = None
        if not names and not setup.regions and not setup.fields:
            self._last = 0.0, EVERYWHERE_ALIKE
            return
        numbers = region_numbers(mesh, setup.regions)
        chosen = np.arange(len(mesh.cells)) if elements is None else elements
        count = mesh.weights.shape[1]
        self.points = Points.of(mesh, chosen)
        self._region = np.repeat(numbers[chosen], count)
        self._collect(setup, law, numbers)

    def _collect(self, setup: ComposedBody, law: NeedsParameters, numbers: IntArray) -> None:
        present = [int(k) for k in np.unique(numbers)]
        for name in self.names:
            found = [*by_region(setup, name, present)]
            given = {k for _, ks, _ in found for k in ks}
            missing = [k for k in present if k not in given and name in law.parameters_of(k)]
            if missing:
                raise ConfigurationError(without_a_value(setup, name, missing))
            pieces = []
            for key, ks, value in found:
                having = [k for k in ks if name in law.parameters_of(k)]
                rows, field = np.flatnonzero(np.isin(self._region, having)), as_field(value)
                points = self.points[rows]
                fixed = not _moves(field)
                reached = field.reached(points, 0.0, key) if fixed else None
                pieces.append(_Piece(key, rows, points, field, reached))
                self.varies |= field.varies
            self._pieces.append(pieces)
        for key, ks, axes in by_region(setup, AXES, present):
            rows = np.flatnonzero(np.isin(self._region, ks))
            self._axes.append((key, rows, self.points[rows], axes))
            self.varies |= axes.varies
            self.turned = True

    def at(self, time: float) -> CellsAtPoints:
        """Return parameters and places at ``time``; the same object as before where nothing has changed.

        Raises
        ------
        ConfigurationError
            A formula has no value at a point.
        """
        if self._last is not None and (not self.varies or self._last[0] == time):
            return self._last[1]
        n = len(self.points)
        parameters = np.full((n, len(self.names)), np.nan) if self.names else None
        for column, pieces in enumerate(self._pieces):
            for piece in pieces:
                assert parameters is not None
                parameters[piece.rows, column] = piece.at(time)
        axes = np.broadcast_to(np.eye(3), (n, 3, 3)).copy() if self._axes else None
        for key, rows, points, field in self._axes:
            assert axes is not None
            axes[rows] = field.rotations(points, time, key)
        place = BodyPlace(self._region, axes, self.points.places)
        self._last = time, CellsAtPoints(parameters, place)
        return self._last[1]

    def held(self, time: float) -> BodyFields:
        """Return the fields of the body at ``time`` as those of all times."""
        found = copy(self)
        found._last, found.varies = (time, self.at(time)), False
        return found

    def in_region(self, region: str | None, n: int) -> npt.NDArray[np.bool_]:
        """Return which of the n points lie in a region, (n,); all without its name.

        Raises
        ------
        ConfigurationError
            There is no such region.
        """
        if region is None:
            return np.ones(n, bool)
        if region not in self.regions:
            known = suggestion(region, self.regions, "the regions are", "it has none")
            raise ConfigurationError(f"macro.regions: the body has no region {echo(region)}; {known}")
        return np.asarray(self._region == 1 + self.regions.index(region))

    def with_field(self, name: str, region: str | None = None) -> npt.NDArray[np.bool_]:
        """Return the points (n,) that have a parameter in a region, or by the field of the body without its name.

        Raises
        ------
        ConfigurationError
            There is no such region.
        """
        n = len(self.points)
        inside, having = self.in_region(region, n), np.zeros(n, bool)
        for piece in self._pieces[self.names.index(name)]:
            if region is not None or piece.key == body_key(name):
                having[piece.rows] = True
        return np.logical_and(inside, having)

    def require_within(self, ranges: CellRanges, times: Collection[float]) -> None:
        """Refuse a field that leaves the range of its parameter, in the cell that is there, at one of ``times``.

        Raises
        ------
        ConfigurationError
            It does; the message names key, place, time and range.
        """
        for name, pieces in zip(self.names, self._pieces, strict=True):
            for piece in pieces:
                regions = self._region[piece.rows]
                for time in times if piece.field.varies else (0.0,):
                    values = piece.at(time)
                    for k in np.unique(regions):
                        rows = np.flatnonzero(regions == k)
                        _require_within(piece, name, values, rows, ranges.by_region[k][name], time)


def _require_within(
    piece: _Piece, name: str, values: Array, rows: IntArray, ends: tuple[float, float], time: float
) -> None:
    """Refuse values that leave their range at the points ``rows`` of a piece."""
    low, high = ends
    outside = np.maximum(low - values[rows], values[rows] - high)
    if outside.max() <= 1e-9 * (high - low):
        return
    worst = int(rows[outside.argmax()])
    at = units_now().texts(piece.points.places[worst], "displacement")
    when = f", t = {units_now().text(time, 'time', 6)}" if piece.field.varies else ""
    raw = isinstance(piece.field, MeasuredField) and not piece.field.values
    hint = (
        "; without 'values: [[value in the file, parameter], …]' the file holds the parameter itself"
        if raw
        else ""
    )
    if isinstance(piece.field, FormulaField) and units_now().given:
        used = [name for name in "xyz" if name in require_formula(piece.field.formula).names]
        count = f"; in its formula {joined(used)} {'is' if len(used) == 1 else 'are'} in multiples of"
        hint = f"{count} {units_now().text(1.0, 'displacement')}" if used else ""
    raise ConfigurationError(
        f"{piece.key}: the field is {values[worst]:.6g} at {at}{when}, beyond the range [{low:g}, {high:g}] of the "
        f"parameter '{name}'; narrow the field, or widen the range{hint}"
    )


def field_times(setup: ComposedBody, end: float) -> list[float]:
    """Return times from 0 to ``end`` at which fields that change are looked at: their kinks, and others between."""
    corners = [time for time in field_corners(setup) if time < end]
    entries = [entry for _, fields in sections(setup) for entry in fields.values()]
    by_formula = any(as_field(entry).by_formula for entry in entries if not isinstance(entry, AxesField))
    more = np.arange(1, MORE_TIMES + 1) * GOLDEN % 1.0 * end if by_formula else np.zeros(0)
    return sorted({*np.linspace(0.0, end, TIMES).tolist(), *more.tolist(), *corners})


def require_composition(
    setup: ComposedBody,
    mesh: BodyMesh,
    ranges: CellRanges,
    end: float,
) -> None:
    """Refuse regions and fields that do not suit the body or the cells with parameters of these ``ranges``.

    Fields that change are looked at from t = 0 to ``end``.

    Raises
    ------
    ConfigurationError
        See :class:`BodyFields`; or a field leaves the range of its parameter at some time.
    """
    times = field_times(setup, end)
    body = BodyFields(setup, mesh, ranges)
    body.require_within(ranges, times)
    for time in times if body.turned and body.varies else (0.0,):
        body.at(time)


def _moves(field: ParameterField) -> bool:
    """Tell whether the value to which the field comes depends on time itself, not by ``over`` alone."""
    return field.model_copy(update={"over": None, "initial": None}).varies


def kept_cells(
    body: BodyFields, regions: Sequence[str], times: Sequence[float], means: Callable[[Array], Array]
) -> ElementCells | None:
    """Return the cells of a body's elements at the kept times; None where they are alike.

    Parameters
    ----------
    body
        Fields of the body at some points.
    regions
        Names of its regions.
    times
        At least one.
    means
        Returns the means over all elements (elements, ...) of values at these points (points, ...).
    """
    at = [body.at(time) for time in (times if body.varies else times[:1])]
    place = at[0].place
    if place is None:
        return None
    # The law's own numbers are no parameters of the cells.
    names = of_the_cell(body.names)
    columns = [body.names.index(name) for name in names]
    values = [means(each.parameters[:, columns]) for each in at if each.parameters is not None and names]
    axes = [means(each.place.axes) for each in at if each.place is not None and each.place.axes is not None]
    if not (regions or names or axes):
        return None
    return ElementCells(
        np.rint(means(place.region.astype(float))).astype(np.int64),
        tuple(regions),
        names,
        np.stack(values) if values else None,
        nearest_rotations(np.stack(axes)) if axes else None,
    )


def cells_of_elements(
    setup: ComposedBody, mesh: BodyMesh, law: NeedsParameters, times: Sequence[float]
) -> ElementCells | None:
    """Return the cells of all elements of a mesh; see :func:`kept_cells`.

    Raises
    ------
    ConfigurationError
        See :class:`~porocore.macro.composition.regions.BodyFields`.
    """
    return kept_cells(BodyFields(setup, mesh, law), tuple(setup.regions), times, mesh.means)


def nearest_rotations(matrices: Array) -> Array:
    """Return the rotations (..., 3, 3) that lie nearest to matrices, such as means of rotations."""
    U, _, V = np.linalg.svd(matrices)
    U[..., -1] *= np.sign(np.linalg.det(U @ V))[..., None]
    return np.asarray(U @ V)
