"""Thinnest wall and narrowest pore of an image, in elements of the cell's mesh."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.level_sets.agreement import count_text, disagreements, voxel_edges
from porocore.cell.level_sets.thickness import least_thickness
from porocore.cell.level_sets.voxels import Voxels
from porocore.core.units.results import length_text

#: Elements across a wall or a pore below which bending or flow through it is not resolved.
FEWEST = 2.0
#: Voxels across a wall or a pore that the smoothed image still has.
SEEN = 2.0


def resolution(cell: Cell, length: float | None = None) -> Iterator[str]:
    """Yield the size of the elements in voxels, how many lie across the thinnest parts of an image, and notes.

    The notes are on parts with too few elements, and on what the meshes have otherwise than the image. Nothing is known
    of cells that are no images. ``length`` is that of the cell in metres, if it is known.
    """
    geometry = cell.geometry
    if not isinstance(geometry, Voxels):
        return
    solid = geometry.solid
    whole = geometry.unfolding == "whole"
    voxel = voxel_edges(geometry)
    for key, size in (("size", cell.mesh.size), ("fluid_size", cell.mesh.fluid_size)):
        text = "" if length is None else f", {length_text(size * length)}"
        yield f"  mesh.{key} {size:g} is {size / voxel.min():.2g} voxels{text}"
    notes = []
    for name, phase, key, size in (
        ("thinnest wall", solid, "size", cell.mesh.size),
        ("narrowest pore", ~solid, "fluid_size", cell.mesh.fluid_size),
    ):
        thickness = least_thickness(phase, voxel, periodic=whole)
        if not np.isfinite(thickness):
            continue
        elements, voxels = thickness / size, thickness / voxel.min()
        yield (
            f"  {name}: some {voxels:.2g} voxels or {thickness:.2g} of the cell, {count_text(elements)} of "
            f"mesh.{key}"
        )
        if elements < FEWEST and voxels >= SEEN:
            notes.append(
                f"note: {count_text(elements)} across the {name} resolve it poorly; cell.mesh.{key}: "
                f"{thickness / FEWEST:.2g} has {FEWEST:g} there"
            )
    yield from notes
    yield from (f"note: {note}" for note in disagreements(cell))
