"""Regions of a body in the configuration, their elements, and the laws of bodies that have some."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from typing import Annotated, Any, Literal, Protocol, TypeVar

import numpy as np
from pydantic import Field, Tag, model_validator

from porocore.core.echo import echo, suggestion
from porocore.core.fields import Batch
from porocore.core.models.strict import Name, StrictModel, by_kind
from porocore.core.units import Dimension, spoken
from porocore.errors import ConfigurationError
from porocore.interfaces.law import (
    LawMemory,
    MacroLaw,
    MacroResponse,
    MemoryChanges,
    PointChanges,
    ResponseChanges,
    fingerprint,
)
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.composition.axes import AXES, Fields
from porocore.states import Array, IntArray, MacroState

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


def of_regions(regions: Mapping[str, Region], rest: T, others: Mapping[str, T]) -> list[T]:
    """Return what the cell of each region has, by the number of the region.

    The rest of the body, and regions that name no cell, have ``rest``; ``others`` are those of the named cells.
    """
    return [rest, *(rest if region.cell is None else others[region.cell] for region in regions.values())]


def regions_of_cell(regions: Mapping[str, Region], cell: str | None) -> list[int]:
    """Return the numbers of the regions that have a cell; None names that of the rest of the body."""
    return [k for k, own in enumerate((None, *(region.cell for region in regions.values()))) if own == cell]


B = TypeVar("B", bound=Batch)


class RegionLaw(MacroLaw):
    """A law that asks for each point the law of its region.

    The tangent is constant where that of each law is, and the noise is the largest. Parameters are those of all laws
    together, each name once.

    Parameters
    ----------
    laws
        Law of each region by the region's number: that of the rest of the body first, then the others in the order of
        the configuration.

    Raises
    ------
    ConfigurationError
        There is no law.
    """

    def __init__(self, laws: Sequence[MacroLaw]) -> None:
        if not laws:
            raise ConfigurationError("laws of regions: expected a law for each region, got none")
        self.laws = tuple(laws)
        self.name = " + ".join(dict.fromkeys(law.name for law in self.laws))
        self.identity = fingerprint("regions", *(law.identity for law in self.laws))
        self.noise = max(law.noise for law in self.laws)
        self.constant_tangent = all(law.constant_tangent for law in self.laws)
        self.parameters = tuple(dict.fromkeys(name for law in self.laws for name in law.parameters))
        first = {id(law): k for k, law in reversed(list(enumerate(self.laws)))}
        self._first_alike = np.array([first[id(law)] for law in self.laws])
        self._columns = [[self.parameters.index(name) for name in law.parameters] for law in self.laws]

    @classmethod
    def by_name(cls, regions: Sequence[str], laws: Mapping[str, MacroLaw], rest: MacroLaw) -> RegionLaw:
        """Return the law of ``regions``, by their names in the configuration; those without a law have ``rest``.

        Raises
        ------
        ConfigurationError
            A law is given for a region that is not there.
        """
        for name in laws:
            if name not in regions:
                known = ", ".join(regions) or "none"
                raise ConfigurationError(
                    f"laws of regions: there is no region '{name}'; the regions are {known}"
                )
        return cls([rest, *(laws.get(name, rest) for name in regions)])

    @classmethod
    def by_cell(
        cls, regions: Mapping[str, Region], rest: MacroLaw, others: Mapping[str, MacroLaw]
    ) -> MacroLaw:
        """Return the law of a body with ``regions``, by the law of each cell that they name.

        ``rest`` is that of the cell of the rest of the body, which is the law of all where there are no ``others``.
        """
        return cls(of_regions(regions, rest, others)) if others else rest

    def parameters_of(self, region: int) -> tuple[str, ...]:
        """Return those of the region's law; see :class:`MacroLaw`."""
        return self.laws[region].parameters if region < len(self.laws) else ()

    def initial(self, n: int) -> LawMemory:
        """Return the memory at rest of n points of the rest of the body."""
        return self.laws[0].initial(n)

    def initial_at(self, points: MacroState) -> LawMemory:
        """Return the memory at rest, by the law of each point's region."""
        parts = [
            (rows, law.initial_at(self._seen(points[rows], k))) for k, law, rows in self._regions(points)
        ]
        return replace(_joined(LawMemory, parts, len(points)), states=points.at_rest())

    def respond(
        self, states: MacroState, grad_p: Array, memory: LawMemory, *, tangent: bool = True
    ) -> MacroResponse:
        """Return the response of the law of each point's region."""
        return self.respond_to_each(states, [grad_p], memory, tangent=tangent)[0]

    def respond_to_each(
        self, states: MacroState, gradients: Sequence[Array], memory: LawMemory, *, tangent: bool = True
    ) -> list[MacroResponse]:
        """Return the responses to several gradients of the pressure; see :class:`MacroLaw`."""
        found: list[list[tuple[IntArray, MacroResponse]]] = [[] for _ in gradients]
        for k, law, rows in self._regions(states):
            responses = law.respond_to_each(
                self._seen(_chosen(states, rows, len(states)), k),
                [grad_p if len(rows) == len(states) else grad_p[rows] for grad_p in gradients],
                self._memory_seen(_chosen(memory, rows, len(states)), k),
                tangent=tangent,
            )
            for parts, response in zip(found, responses, strict=True):
                parts.append((rows, response))
        joined = [_joined(MacroResponse, parts, len(states)) for parts in found]
        return [replace(each, memory=replace(each.memory, states=states)) for each in joined]

    def respond_to_changes(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        changes: PointChanges,
        before: MemoryChanges,
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return the responses of the laws and their derivatives; see :class:`MacroLaw`."""
        n, responses, found = len(states), [], []
        for k, law, rows in self._regions(states):
            response, derivatives = law.respond_to_changes(
                self._seen(_chosen(states, rows, n), k),
                grad_p if len(rows) == n else grad_p[rows],
                self._memory_seen(_chosen(memory, rows, n), k),
                self._changes_seen(_chosen(changes, rows, n), k),
                _chosen(before, rows, n),
            )
            responses.append((rows, response))
            found.append((rows, derivatives))
        whole = _joined(MacroResponse, responses, n)
        whole = replace(whole, memory=replace(whole.memory, states=states))
        return whole, _joined(ResponseChanges, found, n)

    def before_accept(self, response: MacroResponse, memory: LawMemory) -> LawMemory | None:
        """Ask the law of each region; a changed memory of one leaves those of the others as they are."""
        parts, changed = [], False
        for k, law, rows in self._regions(response.memory.states):
            part = response[rows]
            part = replace(part, memory=self._memory_seen(part.memory, k))
            old = self._memory_seen(memory[rows], k)
            new = law.before_accept(part, old)
            changed |= new is not None
            parts.append((rows, old if new is None else new))
        if not changed:
            return None
        return replace(_joined(LawMemory, parts, len(memory.states)), states=memory.states)

    def reasons(self, states: MacroState) -> list[str]:
        """Return the reasons that the laws know; see :class:`MacroLaw`."""
        found = [""] * len(states)
        for k, law, rows in self._regions(states):
            for row, reason in zip(rows, law.reasons(self._seen(states[rows], k)), strict=True):
                found[row] = reason
        return found

    def _regions(self, states: MacroState) -> list[tuple[int, MacroLaw, IntArray]]:
        """Return each law that is asked, with the number of its first region and its points; regions may share one.

        Raises
        ------
        ValueError
            The states do not tell their region, or one of a region without a law.
        """
        if states.place is None:
            raise ValueError("expected states with the number of their region (place)")
        region = states.place.region
        if len(region) and not 0 <= region.min() <= region.max() < len(self.laws):
            raise ValueError(
                f"expected regions from 0 to {len(self.laws) - 1}, for which there are laws, got {region.max()}"
            )
        asked = self._first_alike[region]
        numbers = np.unique(asked) if self._first_alike.any() and len(region) else [0]
        return [(int(k), self.laws[k], np.flatnonzero(asked == k)) for k in numbers]

    def _seen(self, states: MacroState, k: int) -> MacroState:
        """Return the states with the parameters of law ``k`` alone, in its order."""
        theta = states.parameters
        if theta is not None and self._columns[k] == list(range(theta.shape[1])):
            return states
        return replace(
            states, parameters=theta[:, self._columns[k]] if theta is not None and self._columns[k] else None
        )

    def _changes_seen(self, changes: PointChanges, k: int) -> PointChanges:
        """Return the changes of the parameters of law ``k`` alone."""
        theta, columns = changes.parameters, self._columns[k]
        return replace(changes, parameters=theta[:, columns] if theta is not None and columns else None)

    def _memory_seen(self, memory: LawMemory, k: int) -> LawMemory:
        return replace(memory, states=self._seen(memory.states, k))


def _chosen(batch: B, rows: IntArray, n: int) -> B:
    """Return some of n points of a batch, and the batch itself where these are all."""
    return batch if len(rows) == n else batch[rows]


def _joined(kind: type[B], parts: Sequence[tuple[IntArray, B]], n: int) -> B:
    """Return a batch of n rows from parts, each with its rows; NaN where a part leaves out what another has."""
    if len(parts) == 1:
        return parts[0][1]
    values: dict[str, Any] = {}
    for f in fields(kind):  # type: ignore[arg-type]
        found = [(rows, getattr(part, f.name)) for rows, part in parts]
        there = [(rows, value) for rows, value in found if value is not None]
        if not there:
            values[f.name] = None
            continue
        first = there[0][1]
        if isinstance(first, MacroState):  # of a memory, which gets the states of all points
            values[f.name] = MacroState.zeros(n)
        elif isinstance(first, Batch):
            values[f.name] = _joined(type(first), there, n)
        else:
            whole = np.empty((n, *first.shape[1:]), dtype=first.dtype)
            if len(there) < len(found):
                whole[:] = np.nan
            for rows, value in there:
                whole[rows] = value
            values[f.name] = whole
    return kind(**values)


class NearestMemberLaw(RegionLaw):
    """A law that asks at each point the law of the member whose parameters lie nearest.

    Parameters
    ----------
    laws
        Laws of k members, which have no parameters themselves.
    values : (k, m)
        Parameters of the members.
    ranges
        Ranges of the m parameters by name, in which distances are measured.

    Raises
    ------
    ConfigurationError
        There is no law.
    """

    def __init__(
        self, laws: Sequence[MacroLaw], values: Array, ranges: dict[str, tuple[float, float]]
    ) -> None:
        super().__init__(laws)
        self.parameters = tuple(ranges)
        self._spans = np.array([high - low for low, high in ranges.values()])
        self._values = np.asarray(values, float)
        self.identity = fingerprint("members", self.identity, self._values)

    def parameters_of(self, region: int) -> tuple[str, ...]:
        """Return all names; see :class:`MacroLaw`."""
        return self.parameters

    def _regions(self, states: MacroState) -> list[tuple[int, MacroLaw, IntArray]]:
        """Return number, law and points of each member that is the nearest somewhere.

        Raises
        ------
        ValueError
            The states have no parameters.
        """
        if states.parameters is None:
            raise ValueError("expected states with parameters")
        away = (states.parameters[:, None, :] - self._values) / self._spans
        nearest = (away**2).sum(axis=2).argmin(axis=1)
        return [(int(k), self.laws[k], np.flatnonzero(nearest == k)) for k in np.unique(nearest)]

    def _seen(self, states: MacroState, k: int) -> MacroState:
        """Return the states without parameters, which a member has not."""
        return replace(states, parameters=None)

    def _changes_seen(self, changes: PointChanges, k: int) -> PointChanges:
        """Return the changes without parameters.

        Raises
        ------
        ConfigurationError
            A parameter changes, of which the nearest member does not know.
        """
        if changes.parameters is not None and changes.parameters.any():
            raise ConfigurationError(
                f"the law '{self.name}' of the nearest members of a family jumps with its parameters, so that a run "
                "has no sensitivities to them; choose a surrogate of the family"
            )
        return replace(changes, parameters=None)


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
    regions = {name: _without_paths(region.model_dump()) for name, region in setup.regions.items()}
    fields = {
        name: entry if isinstance(entry, float | str) else _without_paths(entry.model_dump())
        for name, entry in setup.fields.items()
    }
    return {key: value for key, value in (("regions", regions), ("fields", fields)) if value}


def _without_paths(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _without_paths(value) for key, value in data.items() if key != "path"}
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
        k: (f"macro.regions.{region}.fields.{name}", settings.fields[name])
        for k, (region, settings) in enumerate(setup.regions.items(), start=1)
        if name in settings.fields
    }
    if name in setup.fields:
        yield f"macro.fields.{name}", [k for k in present if k not in own], setup.fields[name]
    for k, (key, value) in own.items():
        yield key, [k], value


def without_a_value(setup: ComposedBody, name: str, missing: Sequence[int]) -> str:
    """Return the complaint that a parameter has no value in the regions of these numbers."""
    regions = ["the rest of the body", *(f"the region '{region}'" for region in setup.regions)]
    where = ", ".join(regions[k] for k in missing) if setup.regions else "the body"
    return (
        f"macro.fields.{name}: missing; the cell has the parameter '{name}', which has no value in {where}: add "
        f"'{name}:' with a number or a field"
    )
