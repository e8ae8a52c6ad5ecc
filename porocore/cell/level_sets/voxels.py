"""Pores of a segmented image (Voxels): its keys, its sides, its point group, its level set."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from porocore.cell.geometry.pore_geometry import Unfolding
from porocore.cell.geometry.sides import CUBE, Sides, unit_sides
from porocore.cell.level_sets.cleaning import Cleaned, Mask, clean
from porocore.cell.level_sets.faces import blended, mismatch_note
from porocore.cell.level_sets.image import SmoothImage, read_image
from porocore.cell.level_sets.level_set import SPECKS, LevelSetGeometry, mesh_level_set
from porocore.cell.meshing.tetrahedra import Element, Phase, Tetrahedra
from porocore.cell.symmetry.point_set import group_of_voxels
from porocore.core.files.input_file import FromFile
from porocore.core.tensors.point_group import PointGroup
from porocore.core.units.dimensions import Dimension, Unit
from porocore.errors import ConfigurationError
from porocore.states import Array

#: First place of a part, and the place after its last.
Span = tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=1)]]
Edge = Annotated[float, Field(ge=1e-12, le=1e3, allow_inf_nan=False)]


class Voxels(FromFile, LevelSetGeometry):
    """The pores of a segmented image, a box of equal voxels.

    With ``repeat: mirror`` the image is the eighth of the cell, and its mirror images make the cell periodic; with
    ``repeat: periodic`` it is the whole cell, and with ``repeat: layer`` the whole cell after its outer layers were
    blended into each other. The steps of the voxels are smoothed, with the same share of pores.
    """

    kind: Literal["voxels"]
    """A segmented image of equal voxels from a ``.npy`` or TIFF file."""
    pore: int = 0
    """Value of the voxels in the pores; all others are solid."""
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
        if self.voxel_size is None:
            data.pop("voxel_size", None)
        return data

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
        """Sentences on what was blended and removed, on grains that float, and on faces that do not match."""
        return (*_periodic(self)[1], *_cleaned(self).notes)

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
        return f"image {Path(self.path).name} of {voxels} voxels, {how}"

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


@lru_cache(maxsize=2)
def _periodic(geometry: Voxels) -> tuple[Mask, tuple[str, ...]]:
    """Return the solid voxels of the image as it is repeated, and sentences on its faces."""
    path = geometry.checked("cell.geometry")
    image = read_image(path, geometry.crop)
    solid = image != geometry.pore
    if solid.all() or not solid.any():
        values, counts = np.unique(image, return_counts=True)
        shown = ", ".join(f"{v} ({c:,})" for v, c in list(zip(values, counts, strict=True))[:8])
        what = "no voxel" if solid.all() else "every voxel"
        raise ConfigurationError(
            f"cell.geometry.pore: {what} of {path} has the value {geometry.pore}; its values are {shown}"
        )
    if geometry.repeat == "layer":
        return blended(solid, geometry.layer)
    return solid, mismatch_note(solid) if geometry.repeat == "periodic" else ()


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
