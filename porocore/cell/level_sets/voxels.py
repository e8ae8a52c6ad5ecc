"""Pores of a segmented image (Voxels): its keys, its sides, its point group, its level set."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from porocore.cell.geometry.pore_geometry import Unfolding
from porocore.cell.geometry.sides import CUBE, Sides, unit_sides
from porocore.cell.level_sets.cleaning import Cleaned, Mask, clean
from porocore.cell.level_sets.faces import blended, mismatch_note
from porocore.cell.level_sets.grey import GreyValues, assumed, not_segmented, phases
from porocore.cell.level_sets.image import (
    SUFFIXES,
    SmoothImage,
    open_image,
    read_image,
    reversed_by,
    stated_voxel,
)
from porocore.cell.level_sets.level_set import SPECKS, LevelSetGeometry, mesh_level_set
from porocore.cell.meshing.tetrahedra import Element, Phase, Tetrahedra
from porocore.cell.symmetry.point_set import group_of_voxels
from porocore.core.files.input_file import FromFile
from porocore.core.tensors.point_group import PointGroup
from porocore.core.units.dimensions import Dimension, Unit
from porocore.core.units.results import length_text
from porocore.errors import ConfigurationError
from porocore.states import Array

#: Error of K by the smoothing, measured in ``benchmarks/channels_of_voxels.py``.
ROUNDED = (
    "K of an image: its smoothing rounds corners, by which straight square channels of 10, 20 and 40 voxels conduct "
    "5.8, 1.9 and 0.6 % more than they should with 'smoothing: 1', and 2.2, 0.9 and 0.4 % with 0 (docs/cell.md, Round "
    "and square channels)"
)
#: Units of lengths in image files: other names, and metres.
UNITS = {"micron": "um", "microns": "um", "µm": "um", "\\u00B5m": "um", "\u03bcm": "um", "inch": "in"}
METRES = {"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0}
#: Larger voxels [m] are most likely a number without a unit, in µm or mm.
HUGE = 1e-3
#: Share by which the edges of a voxel may differ from those that its file states.
SAME = 0.01
#: First place of a part, and the place after its last.
Span = tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=1)]]
Edge = Annotated[float, Field(ge=1e-12, le=1e3, allow_inf_nan=False)]


class Voxels(FromFile, LevelSetGeometry):
    """The pores of a segmented image, a box of equal voxels.

    With ``repeat: mirror`` the image is the eighth of the cell, and its mirror images make the cell periodic; with
    ``repeat: periodic`` it is the whole cell, and with ``repeat: layer`` the whole cell after its outer layers were
    blended into each other. The steps of the voxels are smoothed, with the same share of pores.
    """

    slice_suffixes: ClassVar[tuple[str, ...]] = SUFFIXES
    kind: Literal["voxels"]
    """A segmented image of equal voxels from a ``.npy`` or TIFF file, or from slices along z in files of their own:
    ``path`` is that of their folder, or a pattern such as ``slices/scan_*.tif``."""
    pore: int = 0
    """Value of the voxels in the pores; all others are solid."""
    threshold: Annotated[float, Field(allow_inf_nan=False)] | Literal["otsu"] | None = None
    """Of a grey image, in place of ``pore``: the voxels of at most this value are the pores. ``otsu``: it is chosen by
    Otsu's method from all voxels of the file."""
    bright_pores: bool = False
    """True: the voxels above ``threshold`` are the pores, and the others solid."""
    repeat: Literal["mirror", "periodic", "layer"] = "mirror"
    """``mirror``: the image is the eighth of the cell, ``periodic``: it is the whole cell, ``layer``: it becomes a cell
    by a layer at its faces in which opposite sides of the image are blended."""
    layer: Annotated[int, Field(ge=1), Unit("voxels")] = 8
    """Thickness of that layer; the cell is smaller than the image by it along each axis."""
    voxel_size: Annotated[Edge | tuple[Edge, Edge, Edge] | None, Dimension("displacement", si=True)] = None
    """Edge of a voxel, or its edges along x, y and z, such as 12 um; null: a cube of any size."""
    crop: Annotated[tuple[Span, Span, Span] | None, Unit("voxels")] = None
    """First voxel of the part that is used, and the one after its last, along x, y and z; null: all of the image."""
    drop_grains: bool = False
    """True: pieces of the solid apart from its largest one become pores, and so do specks that come loose in the mesh,
    of up to 2 % of the solid."""
    fill_pores: Annotated[int, Field(ge=0), Unit("voxels")] = 0
    """Pieces of the pores of at most so many voxels become solid."""
    smoothing: Annotated[float, Field(ge=0, le=10), Unit("voxels")] = 1.0
    """Standard deviation of the Gaussian that smooths the steps of the voxels."""

    @model_serializer(mode="wrap")
    def _only_what_is_given(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data: dict[str, Any] = handler(self)
        if self.repeat != "layer":
            data.pop("layer", None)
        if self.threshold is None:
            data.pop("threshold", None)
            data.pop("bright_pores", None)
        else:
            data.pop("pore", None)
        if self.voxel_size is None:
            data.pop("voxel_size", None)
        return data

    @model_validator(mode="after")
    def _one_way_to_the_pores(self) -> Self:
        if self.threshold is None and self.bright_pores:
            raise ValueError(
                "bright_pores belongs to threshold, which is missing; give it, such as 'threshold: otsu'"
            )
        if self.threshold is not None and "pore" in self.model_fields_set:
            raise ValueError(
                "expected either pore, of a segmented image, or threshold, of a grey one, got both"
            )
        return self

    @property
    def level(self) -> float | None:
        """Value that parts pores and solid of a grey image; None: it is a segmented one.

        Raises
        ------
        ConfigurationError
            The file is no image of numbers.
        """
        return _grey(Path(self.path), self.sha256).otsu if self.threshold == "otsu" else self.threshold

    def pores_of(self, values: npt.NDArray[Any]) -> Mask:
        """Return True for those values of voxels that are pores."""
        level = self.level
        return np.asarray(values == self.pore if level is None else (values > level) == self.bright_pores)

    @property
    def solid(self) -> Mask:
        """True for solid voxels, (n₁, n₂, n₃), after cropping, blending and cleaning.

        Raises
        ------
        ConfigurationError
            The file is no segmented image, has changed, or has one phase only.
        """
        return _cleaned(self).solid

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on the values of the voxels, on what was blended and removed, and on grains that float."""
        slices = () if self.slices is None else (self.slices.summary,)
        values = () if self.repeat != "layer" else (_periodic(self)[1],)
        return (*slices, *self._of_values, *values, *_cleaned(self).notes)

    @property
    def _of_values(self) -> tuple[str, ...]:
        grey, level = _grey(Path(self.path), self.sha256), self.level
        if level is None:
            told = "pore" in self.model_fields_set
            return phases(grey, self.pore) if told else (*assumed(grey, self.pore), *phases(grey, self.pore))
        how = "by Otsu's method" if self.threshold == "otsu" else "as given"
        side = "above it" if self.bright_pores else "up to it"
        return (f"threshold {level:g}, {how}; values are {grey.extent}, and the voxels {side} are pores",)

    @property
    def value_warnings(self) -> tuple[str, ...]:
        """Sentences on a file of any size that is not segmented, lacks slices, or looks otherwise in a viewer."""
        grey = _grey(Path(self.path), self.sha256)
        found = () if self.threshold is not None else not_segmented(grey, self.pore)
        gaps = "" if self.slices is None else self.slices.gaps
        return (*([gaps] if gaps else ()), *self._of_view(grey), *found)

    def _of_view(self, grey: GreyValues) -> tuple[str, ...]:
        """Return a sentence on a file of which a viewer shows low values brighter than high ones."""
        low, high = grey.values[0], grey.values[-1]
        why = reversed_by(Path(self.path), low, high)
        if not why:
            return ()
        if self.threshold is not None:
            darker, pores = (
                self.bright_pores,
                f"the voxels {'above' if self.bright_pores else 'up to'} the threshold",
            )
            other = f"bright_pores: {str(not darker).lower()}"
        else:
            darker, pores = self.pore != low, f"the voxels of the value {self.pore}"
            other = f"pore: {low if darker else high:g}"
        taken, meant = ("dark", "bright") if darker else ("bright", "dark")
        then = (
            f"so the pores, {pores}, are what a viewer shows {taken}: if they are what it shows {meant}, write "
            f"'{other}'"
            if self.threshold is not None or self.pore in (low, high)
            else f"so check 'pore: {self.pore}'"
        )
        return (
            f"a viewer shows the value {low:g} of the file bright and {high:g} dark, since {why}; values are read as "
            f"they are stored, {then}",
        )

    @property
    def _of_edges(self) -> tuple[str, ...]:
        """A sentence on a file that states other edges of its voxels."""
        stated = stated_voxel(Path(self.path))
        if stated is None:
            return ()
        edges, unit = np.array(stated[0]), UNITS.get(stated[1], stated[1])
        given = np.broadcast_to(1.0 if self.voxel_size is None else self.voxel_size, 3)
        metres = METRES.get(unit)
        same = edges * metres if metres and self.voxel_size is not None else edges * given[0] / edges[0]
        if np.abs(same / given - 1).max() <= SAME:
            return ()
        shown = f"[{', '.join(f'{edge:.6g} {unit}' for edge in edges)}]"
        taken = (
            "takes them for cubes" if self.voxel_size is None else f"has {length_text(*map(float, given))}"
        )
        return (
            f"the file states that its voxels are {shown} along x, y, z, and cell.geometry {taken}; if the file is "
            f"right, write 'voxel_size: {_edges_as_key(edges, unit)}'",
        )

    @property
    def _of_huge_voxels(self) -> tuple[str, ...]:
        """A sentence on voxels of more than a millimetre."""
        if self.voxel_size is None or np.max(self.voxel_size) <= HUGE:
            return ()
        edges = length_text(*np.broadcast_to(self.voxel_size, 3).tolist())
        cell = length_text(*(self.length or 0.0) * np.array(self.sides))
        number = np.max(self.voxel_size)
        unit = f", such as '{number:g} um'" if number >= 1 else ""
        return (
            f"cell.geometry.voxel_size was read as {edges}, so that the cell is {cell} large; a number without a unit "
            f"is in metres: if another is meant, write it{unit}",
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        faces = mismatch_note(_periodic(self)[0]) if self.repeat == "periodic" else ()
        return (*self.value_warnings, *(self._of_edges or self._of_huge_voxels), *faces)

    @property
    def error_of_flow(self) -> str:
        return ROUNDED

    @property
    def porosity(self) -> float:
        """Share of pore voxels in the image."""
        return 1 - float(self.solid.mean())

    @property
    def sides(self) -> Sides:
        """Sides of the box of voxels."""
        return unit_sides(self._edges)

    @property
    def length(self) -> float | None:
        if self.voxel_size is None:
            return None
        return math.cbrt(math.prod(self._edges)) * (2 if self.repeat == "mirror" else 1)

    @property
    def _edges(self) -> Array:
        """Edges of the image along each axis, (3,), in metres if the size of a voxel is given, else in voxels."""
        return np.multiply(self.solid.shape, 1.0 if self.voxel_size is None else self.voxel_size)

    @property
    def unfolding(self) -> Unfolding:
        """The eighth with mirrors, else the whole cell."""
        return "eighth" if self.repeat == "mirror" else "whole"

    @property
    def point_group(self) -> PointGroup:
        """Point group of the voxels, exactly."""
        return _point_group(self)

    @property
    def description(self) -> str:
        shape = self.solid.shape
        voxels = f"{shape[0]}³" if len(set(shape)) == 1 else " × ".join(map(str, shape))
        how = f"with a periodic layer of {self.layer}" if self.repeat == "layer" else self.repeat
        return f"image {self.file_name} of {voxels} voxels, {how}"

    def specification(self) -> dict[str, Any]:
        """Return all that the cell depends on; of the size of a voxel that is its shape."""
        data = super().specification()
        size = data.pop("voxel_size", None)
        if isinstance(size, list) and unit_sides(size) != CUBE:
            data["voxel_size"] = [round(edge / size[0], 9) for edge in size]
        if self.drop_grains:
            data["specks"] = SPECKS
        return data

    def level_set(self) -> SmoothImage:
        return _smooth(self)

    def tetrahedra(self, size: float, element: Element) -> dict[Phase, Tetrahedra]:
        return mesh_level_set(self, self.level_set(), size, element, drop_specks=self.drop_grains)


def stated_size(path: Path) -> str:
    """Return what to write as ``voxel_size`` by what the file states; empty where it states no lengths."""
    if (stated := stated_voxel(path)) is None:
        return ""
    unit = UNITS.get(stated[1], stated[1])
    return _edges_as_key(np.array(stated[0]), unit) if unit in METRES else ""


def _edges_as_key(edges: Array, unit: str) -> str:
    if np.abs(edges / edges[0] - 1).max() <= SAME:
        return f"{edges[0]:.6g} {unit}"
    return f"[{', '.join(f'{edge:.6g} {unit}' for edge in edges)}]"


@lru_cache(maxsize=2)
def _grey(path: Path, sha256: str | None) -> GreyValues:
    """Return the values of all voxels of a file with this content."""
    found = GreyValues.of(open_image(path, grey=True))
    if not len(found.values):
        raise ConfigurationError(f"{path}: expected a number in every voxel, got none in any")
    return found


@lru_cache(maxsize=2)
def _periodic(geometry: Voxels) -> tuple[Mask, str]:
    """Return the solid voxels of the image as it is repeated, and a sentence on sides that were blended."""
    path = geometry.checked("cell.geometry")
    image = read_image(path, geometry.crop, grey=geometry.threshold is not None)
    if missing := image.size - np.count_nonzero(np.isfinite(image)):
        raise ConfigurationError(
            f"{path}: expected a number in every voxel, got {missing:,} of {image.size:,} that are infinite or no "
            "number; leave them out with cell.geometry.crop, or fill them"
        )
    pores = geometry.pores_of(image)
    if pores.all() or not pores.any():
        found = GreyValues.of(image)
        if len(found.values) == 1:
            key = "pore" if geometry.threshold is None else "threshold"
            why = (
                "so Otsu's method finds no two classes"
                if geometry.threshold == "otsu"
                else "so there is one phase"
            )
            raise ConfigurationError(
                f"cell.geometry.{key}: expected an image of pores and solid, got the value {found.values[0]:g} in "
                f"every voxel of {path}{'' if geometry.crop is None else ' within crop'}, {why}; check the file"
            )
        which = "every voxel" if pores.all() else "no voxel"
        level = geometry.level
        if level is None:
            if not_segmented(found, geometry.pore):
                hint = "; give 'threshold: otsu' in place of pore"
            else:
                hint = "; write " + " or ".join(f"'pore: {value:g}'" for value in found.values)
            default = (
                "" if "pore" in geometry.model_fields_set else ", which stands for pores where none is given"
            )
            raise ConfigurationError(
                f"cell.geometry.pore: {which} of {path} has the value {geometry.pore}{default}; its values are "
                f"{found.extent}{hint}"
            )
        side = "above" if geometry.bright_pores else "at or below"
        raise ConfigurationError(
            f"cell.geometry.threshold: {which} of {path} is {side} {level:g}; its values are {found.extent}"
        )
    if geometry.repeat == "layer":
        return blended(~pores, geometry.layer)
    return ~pores, ""


@lru_cache(maxsize=2)
def _cleaned(geometry: Voxels) -> Cleaned:
    found = clean(
        _periodic(geometry)[0],
        periodic=geometry.repeat != "mirror",
        drop_grains=geometry.drop_grains,
        fill_pores=geometry.fill_pores,
    )
    if found.solid.all() or not found.solid.any():
        what = "solid" if found.solid.all() else "pores"
        raise ConfigurationError(
            f"cell.geometry: only {what} are left of {geometry.path} after its pores were filled or its faces blended; "
            "give smaller values of fill_pores or layer"
        )
    found.solid.setflags(write=False)
    return found


@lru_cache(maxsize=2)
def _point_group(geometry: Voxels) -> PointGroup:
    return group_of_voxels(geometry.solid, mirror=geometry.repeat == "mirror", sides=geometry.sides)


@lru_cache(maxsize=2)
def _smooth(geometry: Voxels) -> SmoothImage:
    mirror, high = geometry.repeat == "mirror", np.array(geometry.sides) / 2
    return SmoothImage(
        geometry.solid, geometry.smoothing, np.zeros(3) if mirror else -high, high, mirror=mirror
    )
