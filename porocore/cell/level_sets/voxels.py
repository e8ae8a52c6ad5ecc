"""Geometry from a segmented image."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from porocore.cell.geometry.part import Unfolding
from porocore.cell.level_sets.cleaning import Cleaned, Mask, clean
from porocore.cell.level_sets.image import SmoothImage, read_image
from porocore.cell.level_sets.level_set import LevelSetGeometry
from porocore.cell.symmetry.point_set import group_of_voxels
from porocore.core.files.input_file import FromFile
from porocore.core.tensors.point_group import PointGroup
from porocore.core.units.dimensions import Unit
from porocore.errors import ConfigurationError

#: First place of a part, and the place after its last.
Span = tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=1)]]


class Voxels(FromFile, LevelSetGeometry):
    """The pores of a segmented image of equal voxels.

    With ``repeat: mirror`` the image is the eighth [0, ½]³, and its mirror images make the cell periodic; with
    ``repeat: periodic`` it is the whole cell. The steps of the voxels are smoothed, with the same share of pores.
    """

    kind: Literal["voxels"]
    """A segmented image of equal voxels from a ``.npy`` or TIFF file."""
    pore: int = 0
    """Value of the voxels in the pores; all others are solid."""
    repeat: Literal["mirror", "periodic"] = "mirror"
    """``mirror``: the image is the eighth of the cell, ``periodic``: it is the whole cell."""
    crop: Annotated[tuple[Span, Span, Span] | None, Unit("voxels")] = None
    """First voxel of the part that is used, and the one after its last, along x, y and z; null: all of the image."""
    drop_grains: bool = False
    """True: pieces of the solid apart from its largest one become pores."""
    fill_pores: Annotated[int, Field(ge=0), Unit("voxels")] = 0
    """Pieces of the pores of at most so many voxels become solid."""
    smoothing: Annotated[float, Field(ge=0, le=10), Unit("voxels")] = 1.0
    """Standard deviation of the Gaussian that smooths the steps of the voxels."""

    @property
    def solid(self) -> Mask:
        """True for solid voxels, (n, n, n), after cropping and cleaning.

        Raises
        ------
        ConfigurationError
            The file is no segmented image, has changed, or has one phase only.
        """
        return _cleaned(self).solid

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what cleaning removed, and on grains that float."""
        return _cleaned(self).notes

    @property
    def porosity(self) -> float:
        """Share of pore voxels in the image."""
        return 1 - float(self.solid.mean())

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
        return f"image {Path(self.path).name} of {len(self.solid)}³ voxels, {self.repeat}"

    def level_set(self) -> SmoothImage:
        return _smooth(self)


@lru_cache(maxsize=2)
def _cleaned(geometry: Voxels) -> Cleaned:
    path = geometry.checked("cell.geometry")
    image = read_image(path, geometry.crop)
    found = clean(
        image != geometry.pore,
        periodic=geometry.repeat == "periodic",
        drop_grains=geometry.drop_grains,
        fill_pores=geometry.fill_pores,
    )
    if found.solid.all() or not found.solid.any():
        values, counts = np.unique(image, return_counts=True)
        shown = ", ".join(f"{v} ({c:,})" for v, c in list(zip(values, counts, strict=True))[:8])
        what = "no voxel" if found.solid.all() else "every voxel"
        cleaned = ", and small pores were filled" if found.filled else ""
        raise ConfigurationError(
            f"cell.geometry.pore: {what} of {path} has the value {geometry.pore}{cleaned}; its values are {shown}"
        )
    found.solid.setflags(write=False)
    return found


@lru_cache(maxsize=2)
def _point_group(geometry: Voxels) -> PointGroup:
    return group_of_voxels(geometry.solid, mirror=geometry.repeat == "mirror")


@lru_cache(maxsize=2)
def _smooth(geometry: Voxels) -> SmoothImage:
    mirror = geometry.repeat == "mirror"
    return SmoothImage(geometry.solid, geometry.smoothing, 0.0 if mirror else -0.5, 0.5, mirror=mirror)
