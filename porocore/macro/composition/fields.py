"""Fields over a body: parameters by formula, table, images or cell data, with course in time; material axes."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, InstanceOf, Tag, field_validator, model_validator

from porocore.cell.level_sets.image import SLICE_SUFFIXES, open_image, remarks, reversed_by
from porocore.core.echo import echo, suggestion
from porocore.core.files.foreign_mesh import read_mesh
from porocore.core.files.input_file import FromFile
from porocore.core.files.mesh_parts import CORNERS
from porocore.core.formulas import LONGEST, Expression, TimeFunction
from porocore.core.models.bounds import MOST_TIMES
from porocore.core.models.strict import StrictModel
from porocore.core.units import Dimension, InScales, Unit, units_now
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh, tetrahedra, tetrahedron_at
from porocore.states import Array, IntArray

#: Names that a formula of place and time may use.
COORDINATES = ("x", "y", "z", "t")


@dataclass(frozen=True, eq=False)
class Points:
    """Quadrature points at which fields are evaluated, element by element.

    Attributes
    ----------
    places : (n, 3)
        X.
    centres : (elements, 3)
        Centres of the elements, at which files and pictures are read.
    element : (n,)
        Element of each point, by its place in ``centres``.
    mesh
        Of the body; None: the places are no points of one.
    number : (n,)
        Number of each point among all of the body.
    """

    places: Array
    centres: Array
    element: IntArray
    mesh: BodyMesh | None = None
    number: IntArray | None = None

    @classmethod
    def of(cls, mesh: BodyMesh, elements: IntArray | None = None) -> Points:
        """Return the points of some elements of a body, by their numbers; None: of all."""
        chosen = np.arange(len(mesh.cells)) if elements is None else elements
        places, count = mesh.quadrature_points[chosen].reshape(-1, 3), mesh.weights.shape[1]
        number = (chosen[:, None] * count + np.arange(count)).ravel()
        return cls(places, mesh.centres[chosen], np.repeat(np.arange(len(chosen)), count), mesh, number)

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, rows: Any) -> Points:
        number = None if self.number is None else self.number[rows]
        return Points(self.places[rows], self.centres, self.element[rows], self.mesh, number)


class ParameterField(StrictModel, ABC):
    """Values of a parameter over the body.

    With ``over`` the parameter goes from ``initial`` to these values: initial + over(t) (value − initial).
    """

    initial: float | None = None
    """Value everywhere where ``over`` is 0."""
    over: TimeFunction | None = None
    """Share of the way from ``initial`` to the field that is gone at a time; null: all of it, always."""

    @model_validator(mode="after")
    def _together(self) -> ParameterField:
        if (self.initial is None) != (self.over is None):
            raise ValueError(
                "initial and over belong together: the value to begin with, and the share of the way from it"
            )
        return self

    @property
    def varies(self) -> bool:
        """True for a field that changes with time."""
        return self.over is not None

    @property
    def by_formula(self) -> bool:
        """True for a field that changes with time by a formula, between whose kinks it may go anywhere."""
        return self.over is not None and self.over.expression is not None

    @property
    def corners(self) -> tuple[float, ...]:
        """Times at which the field has a kink."""
        return () if self.over is None else self.over.corners

    @abstractmethod
    def reached(self, points: Points, time: float, key: str) -> Array:
        """Return the values (n,) to which the field comes.

        Raises
        ------
        ConfigurationError
            It has no value somewhere; the message begins with ``key``.
        """

    def in_time(self, reached: Array, time: float) -> Array:
        """Return the values (n,) at ``time`` of a field that comes to ``reached``."""
        if self.over is None or self.initial is None:
            return reached
        return np.asarray(self.initial + self.over.at(time) * (reached - self.initial))


class FormulaField(ParameterField):
    """A formula of place and time."""

    kind: Literal["formula"] = "formula"
    """A formula of place and time."""
    formula: Annotated[str, Field(max_length=LONGEST), InScales()]
    """A formula of x, y, z and t, such as ``0.2 + 0.01*y``; all are dimensionless, also where there are scales."""

    @field_validator("formula")
    @classmethod
    def _readable(cls, formula: str) -> str:
        require_formula(formula)
        return formula

    @property
    def varies(self) -> bool:
        """True for a formula of t, or with a course in time."""
        return super().varies or "t" in require_formula(self.formula).names

    @property
    def by_formula(self) -> bool:
        """True for a formula of t, or one that is gone to by a formula."""
        return super().by_formula or "t" in require_formula(self.formula).names

    def reached(self, points: Points, time: float, key: str) -> Array:
        """Return the values of the formula."""
        return formula_values(self.formula, points.places, time, key)


class FactoredField(ParameterField):
    """A field times a factor; no configuration has one."""

    field: InstanceOf[ParameterField]
    """The field."""
    factor: float
    """Factor of its values at all times."""

    @property
    def varies(self) -> bool:
        """True where the field changes with time."""
        return self.field.varies

    @property
    def by_formula(self) -> bool:
        """True where the field changes with time by a formula."""
        return self.field.by_formula

    @property
    def corners(self) -> tuple[float, ...]:
        """Times at which the field has a kink."""
        return self.field.corners

    def reached(self, points: Points, time: float, key: str) -> Array:
        """Return the values (n,) to which the field comes, without the factor."""
        return self.field.reached(points, time, key)

    def in_time(self, reached: Array, time: float) -> Array:
        """Return the values (n,) at ``time``, with the factor."""
        return self.factor * self.field.in_time(reached, time)


class TableField(ParameterField):
    """A table along one axis of the body, linear in between and constant before the first and after the last entry."""

    kind: Literal["table"]
    """A table along one axis of the body."""
    along: Literal["x", "y", "z"]
    """Axis of the coordinate."""
    table: Annotated[
        tuple[tuple[Annotated[float, Dimension("displacement")], float], ...],
        Field(min_length=1, max_length=MOST_TIMES),
    ]
    """[coordinate, value] with ascending coordinates; two equal ones make a step."""

    @field_validator("table")
    @classmethod
    def _ascends(cls, table: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        at = [place for place, _ in table]
        for k, (one, other) in enumerate(pairwise(at), start=1):
            if other < one:
                raise ValueError(
                    f"the coordinates of the table do not ascend: entry {k + 1} lies before entry {k}; sort them"
                )
        if any(at[i] == at[i + 2] for i in range(len(at) - 2)):
            raise ValueError(
                "more than two entries of the table have the same coordinate; keep two, for a step"
            )
        return table

    def reached(self, points: Points, time: float, key: str) -> Array:
        """Return the values of the table."""
        at, values = np.array(self.table).T
        return np.asarray(np.interp(points.places[:, "xyz".index(self.along)], at, values))


Line = Annotated[tuple[Annotated[float, Dimension("displacement")], ...], Field(min_length=2, max_length=100)]


class GridField(ParameterField):
    """Values on a grid along one to three axes of the body, multilinear in between and constant beyond the grid."""

    kind: Literal["grid"]
    """Values on a grid along one to three axes of the body."""
    x: Line | None = None
    """Ascending coordinates of the grid along x; null: the values do not depend on x."""
    y: Line | None = None
    """Ascending coordinates of the grid along y; null: the values do not depend on y."""
    z: Line | None = None
    """Ascending coordinates of the grid along z; null: the values do not depend on z."""
    values: Annotated[tuple[float, ...], Field(min_length=2, max_length=MOST_TIMES)]
    """Values at the nodes of the grid, x running fastest, then y, then z."""

    @model_validator(mode="after")
    def _fits(self) -> GridField:
        lines = {axis: line for axis, line in zip("xyz", (self.x, self.y, self.z), strict=True) if line}
        if not lines:
            raise ValueError("expected coordinates along one axis at least; give x, y or z")
        for axis, line in lines.items():
            if any(one >= other for one, other in pairwise(line)):
                raise ValueError(f"{axis}: expected ascending coordinates, each once, got {echo(list(line))}")
        count = math.prod(map(len, lines.values()))
        if len(self.values) != count:
            raise ValueError(
                f"values: expected {' × '.join(str(len(line)) for line in lines.values())} = {count}, one for each "
                f"node of the grid, got {len(self.values)}"
            )
        return self

    def reached(self, points: Points, time: float, key: str) -> Array:
        """Return the values between those of the nodes."""
        from scipy.interpolate import RegularGridInterpolator  # heavy, and needed here only

        lines = {i: line for i, line in enumerate((self.x, self.y, self.z)) if line}
        values = np.reshape(self.values, [len(line) for line in lines.values()], order="F")
        places = np.stack(
            [np.clip(points.places[:, axis], line[0], line[-1]) for axis, line in lines.items()], axis=1
        )
        return np.asarray(RegularGridInterpolator(tuple(lines.values()), values)(places))


def require_formula(text: str) -> Expression:
    """Return the formula of place and time.

    Raises
    ------
    ValueError
        It is none; the message says what and where.
    """
    return Expression.parse(text, COORDINATES)


def formula_values(text: str, places: Array, time: float, key: str) -> Array:
    """Return the values (n,) of a formula at ``places`` (n, 3).

    Raises
    ------
    ConfigurationError
        It has no finite value at one of them; the message begins with ``key``.
    """
    x, y, z = places.T
    values = np.broadcast_to(require_formula(text)(x=x, y=y, z=z, t=time), len(places)).astype(float)
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        at = units_now().texts(places[bad[0]], "displacement")
        raise ConfigurationError(
            f"{key}: {echo(text)} is no finite number at {at}, t = {units_now().text(time, 'time', 6)}, one of "
            f"{len(bad)} of {len(places)} points; in a formula coordinates and time are dimensionless"
        )
    return values


Length = Annotated[float, Field(gt=0), Dimension("displacement")]
#: Elements whose data are read.
KINDS = ("tetra", "tetra10", "hexahedron", "hexahedron20", "hexahedron27")


class MeasuredField(FromFile, ParameterField):
    """Values from a file, read at the centre of each element."""

    values: Annotated[tuple[tuple[float, float], ...], Field(max_length=MOST_TIMES)] = ()
    """[value in the file, parameter] with ascending values, linear in between and constant beyond; empty: the file
    holds the parameter itself."""

    @field_validator("values")
    @classmethod
    def _ascend(cls, values: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        given = [value for value, _ in values]
        for k, (one, other) in enumerate(pairwise(given), start=1):
            if other <= one:
                raise ValueError(
                    f"the values of the file do not ascend: expected more than {one:g} in entry {k + 1}, got "
                    f"{other:g}; sort them, and give each once"
                )
        return values

    @abstractmethod
    def read(self, centres: Array, key: str) -> Array:
        """Return what the file holds at the centres (elements, 3).

        Raises
        ------
        ConfigurationError
            The file cannot be read, or does not cover the body; the message begins with ``key``.
        """

    @abstractmethod
    def extent(self, key: str) -> tuple[Array, Array]:
        """Return the smallest and largest coordinates (3,) that the file covers.

        Raises
        ------
        ConfigurationError
            The file cannot be read; the message begins with ``key``.
        """

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences on what may be wrong with the file."""
        return ()

    def reached(self, points: Points, time: float, key: str) -> Array:
        """Return the values of the file at the centre of each point's element."""
        used, inverse = np.unique(points.element, return_inverse=True)
        found = self.read(points.centres[used], key)
        bad = np.flatnonzero(~np.isfinite(found))
        if len(bad):
            raise ConfigurationError(
                f"{key}.path: {Path(self.path).name} holds no finite number at {_text(points.centres[used][bad[0]])}, "
                f"in one of {len(bad)} of {len(found)} elements; fill the gaps"
            )
        if self.values:
            at, to = np.array(self.values).T
            found = np.interp(found, at, to)
        return np.asarray(found[inverse.reshape(-1)])


class ImageField(MeasuredField):
    """A stack of images, each voxel of which has one value; it has to cover the body."""

    slice_suffixes: ClassVar[tuple[str, ...]] = SLICE_SUFFIXES
    kind: Literal["image"]
    """A stack of images from a ``.npy`` file with the axes [x, y, z], a TIFF file with a page for each z, a MetaImage,
    NIfTI or NRRD file, or a folder (or pattern of names) of slices."""
    voxel_size: Length | tuple[Length, Length, Length]
    """Edge of a voxel, or its edges along x, y and z; with a unit, such as 50 um, or as a multiple of the length."""
    origin: Annotated[tuple[float, float, float], Dimension("displacement")] = (0.0, 0.0, 0.0)
    """Corner of the image with the smallest coordinates, in the body."""

    def extent(self, key: str) -> tuple[Array, Array]:
        """Return the corners of the image."""
        with _told_with(key):
            image = _image(self.checked(key))
        low = np.array(self.origin)
        return low, low + self._edges * image.shape

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences on slices that are missing, other doubts, and an image that viewers show the other way round."""
        path = Path(self.path)
        low, high = (float(end(_image(path))) for end in (np.nanmin, np.nanmax))
        why = reversed_by(path, low, high)
        view = (
            f"a viewer shows the value {low:g} of the file bright and {high:g} dark, since {why}; values are read as "
            "they are stored"
        )
        return (*remarks(path), *((view,) if why else ()))

    @property
    def _edges(self) -> Array:
        """Edges of a voxel (3,)."""
        return np.broadcast_to(np.asarray(self.voxel_size, float), 3)

    def read(self, centres: Array, key: str) -> Array:
        """Return the value of the voxel in which each centre lies."""
        with _told_with(key):
            image = _image(self.checked(key))
        index = np.floor((centres - np.array(self.origin)) / self._edges).astype(np.int64)
        outside = ((index < 0) | (index >= image.shape)).any(axis=1)
        if outside.any():
            low, high = self.extent(key)
            raise ConfigurationError(
                f"{key}: the image of {' × '.join(map(str, image.shape))} voxels reaches from {_text(low)} to "
                f"{_text(high)}, but {int(outside.sum())} of {len(centres)} elements lie outside, one at "
                f"{_text(centres[outside.argmax()])}; check voxel_size, origin and the order of its axes"
            )
        return np.asarray(image[tuple(index.T)], float)


class DataField(MeasuredField):
    """Data of the elements of a mesh, which has to cover the body."""

    kind: Literal["data"]
    """Data of the elements of a mesh that meshio reads, such as ``.vtu``."""
    data: Annotated[str, Field(min_length=1)]
    """Name of the data."""
    scale: Length = 1.0
    """Factor of the file's coordinates; with a unit, that of the file, such as ``1 mm``."""

    def extent(self, key: str) -> tuple[Array, Array]:
        """Return the corners of the box around the elements of the file."""
        corners, _, _ = _mesh_data(self.checked(key), self.data, key)
        nodes = (corners * self.scale).reshape(-1, 3)
        return nodes.min(axis=0), nodes.max(axis=0)

    def read(self, centres: Array, key: str) -> Array:
        """Return the data of the element of the file in which each centre lies."""
        path = self.checked(key)
        corners, element, data = _mesh_data(path, self.data, key)
        found = tetrahedron_at(corners * self.scale, centres)
        if (outside := found < 0).any():
            low, high = self.extent(key)
            raise ConfigurationError(
                f"{key}: the mesh of {path.name} reaches from {_text(low)} to {_text(high)}, but "
                f"{int(outside.sum())} of {len(centres)} elements of the body lie outside its elements, one at "
                f"{_text(centres[outside.argmax()])}; check scale"
            )
        return np.asarray(data[element[found]])


def covered_lines(
    sections: Iterator[tuple[str, Mapping[str, Any]]], body: tuple[Array, Array]
) -> Iterator[str]:
    """Yield what each file of a field covers, beside the smallest and largest coordinates (3,) of the body.

    A length without a unit is a multiple of the length scale; one that was meant in another unit may cover the body
    all the same.

    Raises
    ------
    ConfigurationError
        A file cannot be read.
    """
    of_body = f"the body {_text(body[0])} to {_text(body[1])}"
    for prefix, entries in sections:
        for name, entry in entries.items():
            if isinstance(entry, MeasuredField):
                low, high = entry.extent(f"{prefix}.{name}")
                yield f"{prefix}.{name}: {entry.file_name} covers {_text(low)} to {_text(high)}, {of_body}"
                yield from (f"note: {prefix}.{name}: {remark}" for remark in entry.remarks)


@contextmanager
def _told_with(key: str) -> Iterator[None]:
    """Let the message of a file that cannot be read begin with the key of its path, unless it has one."""
    try:
        yield
    except ConfigurationError as error:
        told = str(error)
        raise ConfigurationError(told if told.startswith(key) else f"{key}.path: {told}") from None


@lru_cache(maxsize=4)
def _image(path: Path) -> Any:
    return open_image(path, grey=True)


def _mesh_data(path: Path, name: str, key: str) -> tuple[Array, Any, Array]:
    """Return corners of tetrahedra (k, 4, 3), the element of each (k,), and the data of the elements."""
    with _told_with(key):
        mesh = read_mesh(path)
    if name not in mesh.data:
        advice = suggestion(name, mesh.data, "its data of elements are", "it has no data of elements")
        raise ConfigurationError(
            f"{key}.data: {path.name} has no data {echo(name)} of its elements; {advice}"
        )
    corners, element, data, count = [], [], [], 0
    for kind, values in mesh.data[name].items():
        if kind not in KINDS:
            continue
        if values.ndim != 1:
            raise ConfigurationError(
                f"{key}.data: expected one number for each element, got {echo(name)} of the shape {values.shape}"
            )
        nodes = mesh.elements[3][kind][:, : CORNERS[kind]]
        of_kind, number = tetrahedra(mesh.points, nodes)
        corners.append(of_kind)
        element.append(number + count)
        data.append(values)
        count += len(nodes)
    if not count:
        raise ConfigurationError(f"{key}.path: {path.name} has no {', '.join(KINDS)} elements")
    return np.concatenate(corners), np.concatenate(element), np.concatenate(data)


def _text(place: Any) -> str:
    return units_now().texts(place, "displacement")


#: A direction shorter than this, or a sine of two directions below it, determines no axes.
SHORTEST = 1e-9
#: A number with a unit of angles.
_ANGLE = re.compile(
    r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(deg|degrees?|°|rad|radians?)", re.IGNORECASE
)


def _form(value: Any) -> Any:
    """Return the branch of a field: a number, a text, or the ``kind`` of a section."""
    if isinstance(value, StrictModel):
        return getattr(value, "kind", None)
    if isinstance(value, dict):
        return value.get("kind", "formula")
    return "text" if isinstance(value, str) else "number"


def _readable(text: str) -> str:
    require_formula(text)
    return text


#: Text of a formula of x, y, z and t.
Formula = Annotated[str, AfterValidator(_readable), InScales()]
_Fields = (
    Annotated[float, Tag("number")]
    | Annotated[Formula, Tag("text")]
    | Annotated[FormulaField, Tag("formula")]
    | Annotated[TableField, Tag("table")]
    | Annotated[GridField, Tag("grid")]
    | Annotated[ImageField, Tag("image")]
    | Annotated[DataField, Tag("data")]
)
#: A number, a formula, or a section with a ``kind``.
AnyField = Annotated[_Fields, Discriminator(_form)]
Component = float | Formula
Direction = tuple[Component, Component, Component]


class AxesField(StrictModel):
    """Material axes, in which the cell stands in the body.

    Either turned by ``angle`` about the line ``about``, or with the first two axes along ``first`` and ``second``, of
    which the second is made perpendicular to the first.
    """

    kind: Literal["axes"] = "axes"
    """Material axes."""
    about: tuple[float, float, float] | None = None
    """Direction of the line about which the axes are turned, counter-clockwise where it points to the reader."""
    angle: Annotated[AnyField | None, Unit("degrees")] = None
    """Angle by which they are turned."""
    first: Direction | None = None
    """Direction of the cell's first axis: three numbers or formulas of x, y, z and t."""
    second: Direction | None = None
    """Direction of the cell's second axis."""

    @model_validator(mode="before")
    @classmethod
    def _turn_by_their_angle(cls, data: Any) -> Any:
        if isinstance(data, dict) and (given := [key for key in ("initial", "over") if key in data]):
            raise ValueError(
                f"expected initial and over under 'angle:', got {' and '.join(given)} beside it; write "
                "'angle: {formula: 12*y, initial: 0, over: {ramp: 1, until: 100}}'"
            )
        return data

    @field_validator("angle", mode="before")
    @classmethod
    def _in_degrees(cls, angle: Any) -> Any:
        given = _ANGLE.fullmatch(angle.strip()) if isinstance(angle, str) else None
        if given is not None:
            number, unit = float(given[1]), given[2].lower()
            degrees = number if unit.startswith(("d", "°")) else np.rad2deg(number)
            raise ValueError(f"an angle is in degrees, without a unit; write {degrees:g}, got {echo(angle)}")
        return angle

    @model_validator(mode="after")
    def _one_way(self) -> AxesField:
        turned, directed = (self.about, self.angle), (self.first, self.second)
        for pair, words in ((turned, "about and angle"), (directed, "first and second")):
            if (pair[0] is None) != (pair[1] is None):
                raise ValueError(f"{words} belong together")
        if (self.about is None) == (self.first is None):
            raise ValueError("expected either about and angle, or first and second")
        if self.about is not None and np.linalg.norm(self.about) < SHORTEST:
            raise ValueError("about is no direction, all of its components are zero")
        return self

    @property
    def varies(self) -> bool:
        """True for axes that change with time."""
        texts = (component for component in (*(self.first or ()), *(self.second or ())))
        moves = any(isinstance(text, str) and "t" in require_formula(text).names for text in texts)
        return moves or (self.angle is not None and as_field(self.angle).varies)

    @property
    def corners(self) -> tuple[float, ...]:
        """Times at which the axes have a kink."""
        return () if self.angle is None else as_field(self.angle).corners

    def rotations(self, points: Points, time: float, key: str) -> Array:
        """Return the rotations (n, 3, 3) whose columns are the axes.

        Raises
        ------
        ConfigurationError
            A direction has no length somewhere, or both are along one line; the message begins with ``key``.
        """
        if self.about is not None and self.angle is not None:
            angle = as_field(self.angle)
            degrees = angle.in_time(angle.reached(points, time, f"{key}.angle"), time)
            return _turns(np.array(self.about), np.deg2rad(degrees))
        assert self.first is not None
        assert self.second is not None
        first = _unit(_direction(self.first, points, time, f"{key}.first"), points, f"{key}.first")
        second = _direction(self.second, points, time, f"{key}.second")
        across = second - np.einsum("ni,ni->n", first, second)[:, None] * first
        across = _unit(across, points, f"{key}.second", "has no part perpendicular to the first axis")
        return np.stack([first, across, np.cross(first, across)], axis=-1)


def _entry_form(value: Any) -> Any:
    """Return the branch of an entry of ``fields``, where a section without a ``kind`` may be of axes."""
    if (
        isinstance(value, dict)
        and "kind" not in value
        and {"about", "angle", "first", "second"} & value.keys()
    ):
        return "axes"
    return _form(value)


#: A field of a parameter, or the material axes.
AnyEntry = Annotated[_Fields | Annotated[AxesField, Tag("axes")], Discriminator(_entry_form)]
#: Name of the entry that holds the material axes.
AXES = "axes"


def _well_named(entries: dict[str, Any]) -> dict[str, Any]:
    """Refuse axes under another name, and parameters called ``axes``."""
    for name, entry in entries.items():
        if (name == AXES) != isinstance(entry, AxesField):
            raise ValueError(
                f"'{AXES}' are the material axes: expected about and angle, or first and second"
                if name == AXES
                else f"material axes are given under the name '{AXES}', not '{name}'"
            )
    return entries


#: Fields by the name of their parameter, and the axes.
Fields = Annotated[dict[str, AnyEntry], AfterValidator(_well_named)]


def as_field(value: Any) -> ParameterField:
    """Return the field of a number or a text, and any other as it is."""
    if isinstance(value, ParameterField):
        return value
    return FormulaField(formula=value if isinstance(value, str) else repr(float(value)))


def _direction(components: Direction, points: Points, time: float, key: str) -> Array:
    columns = [
        formula_values(component, points.places, time, key)
        if isinstance(component, str)
        else np.full(len(points), component)
        for component in components
    ]
    return np.stack(columns, axis=1)


def _unit(vectors: Array, points: Points, key: str, fault: str = "has no length") -> Array:
    length = np.linalg.norm(vectors, axis=1)
    if len(length) and length.min() < SHORTEST:
        at = units_now().texts(points.places[length.argmin()], "displacement")
        raise ConfigurationError(f"{key}: the direction {fault} at {at}, so that it gives no axis there")
    return np.asarray(vectors / length[:, None])


def _turns(about: Array, angle: Array) -> Array:
    """Return the rotations (n, 3, 3) about one line by the angles (n,) [Rodrigues]."""
    a = about / np.linalg.norm(about)
    cross = np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + (1 - cosine) * (cross @ cross))
