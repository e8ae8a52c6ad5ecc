"""Fields of a parameter from files: stacks of images, cell data of meshes; from grey or data to the parameter."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator

from porocore.cell.level_sets.image import SUFFIXES, open_image, reversed_by
from porocore.core.echo import echo, suggestion
from porocore.core.files.foreign_mesh import CORNERS, read_mesh
from porocore.core.files.input_file import FromFile
from porocore.core.models.bounds import MOST_TIMES
from porocore.core.units.dimensions import Dimension
from porocore.core.units.results import spoken
from porocore.errors import ConfigurationError
from porocore.macro.body.tetrahedra import tetrahedra, tetrahedron_at
from porocore.macro.composition.field import ParameterField, Points
from porocore.states import Array

Length = Annotated[float, Field(gt=0), Dimension("displacement")]
#: Elements whose data are read.
KINDS = ("tetra", "tetra10", "hexahedron", "hexahedron27")


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

    slice_suffixes: ClassVar[tuple[str, ...]] = SUFFIXES
    kind: Literal["image"]
    """A stack of images from a ``.npy`` file with the axes [x, y, z], a TIFF file with a page for each z, or a folder
    (or pattern of names) of such slices."""
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
        """Sentences on slices that are missing, and on an image that viewers show the other way round."""
        path = Path(self.path)
        gaps = "" if self.slices is None else self.slices.gaps
        low, high = (float(end(_image(path))) for end in (np.nanmin, np.nanmax))
        why = reversed_by(path, low, high)
        view = (
            f"a viewer shows the value {low:g} of the file bright and {high:g} dark, since {why}; values are read as "
            "they are stored"
        )
        return tuple(text for text in (gaps, why and view) if text)

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
    return spoken().texts(place, "displacement")
