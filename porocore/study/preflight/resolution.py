"""Element size of an image's mesh in voxels; elements across its thinnest wall and narrowest pore."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.level_sets.agreement import FEWEST, at_most, count_text, disagreements, voxel_edges
from porocore.cell.level_sets.level_set import lattice_edges
from porocore.cell.level_sets.thickness import least_thickness
from porocore.cell.level_sets.voxels import Voxels
from porocore.core.units.results import length_text

#: Difference of the real from the given size of the elements from which both are told, as a share.
SAME = 1e-3
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
        yield f"  mesh.{key} {size:g} {_edge_text(geometry, size, length)}"
    notes = []
    for name, phase, key, size in (
        ("thinnest wall", solid, "size", cell.mesh.size),
        ("narrowest pore", ~solid, "fluid_size", cell.mesh.fluid_size),
    ):
        thickness = least_thickness(phase, voxel, periodic=whole)
        if not np.isfinite(thickness):
            continue
        elements, voxels = thickness / lattice_edges(geometry, size)[0], thickness / voxel.min()
        yield (
            f"  {name}, by the largest ball in it: some {_voxels(geometry, thickness)} or {thickness:.2g} of the cell, "
            f"{count_text(elements)} of mesh.{key}"
        )
        if elements < FEWEST and voxels >= SEEN:
            notes.append(
                f"note: {count_text(elements)} across the {name} resolve it poorly; cell.mesh.{key}: "
                f"{at_most(thickness / FEWEST):g} has {FEWEST:g} there"
            )
    yield from notes
    yield from (f"note: {note}" for note in disagreements(cell, tried=True))


def _voxels(geometry: Voxels, length: float) -> str:
    """Return a length of the cell in voxels; where they are no cubes, in the shortest of their edges."""
    voxel = voxel_edges(geometry)
    count = f"{length / voxel.min():.2g} voxels"
    return count if np.ptp(voxel) <= SAME * voxel.min() else f"{count} along {'xyz'[voxel.argmin()]}"


def _edge_text(geometry: Voxels, size: float, length: float | None) -> str:
    """Return the real edge of the elements of a size, and between which sizes the mesh is the same."""
    edge, coarser = lattice_edges(geometry, size)
    voxels = _voxels(geometry, edge)
    if length is not None:
        voxels += f", {length_text(edge * length)}"
    if abs(edge - size) < SAME * size:
        return f"is {voxels}"
    # Rounded into the range.
    low, high = np.ceil(edge * 1e4) / 1e4, np.floor(coarser * (1 - 1e-9) * 1e4) / 1e4
    same = f"from {low:g} to {high:g}" if np.isfinite(coarser) else f"from {low:g} on"
    return (
        f"becomes {edge:.3g}, so that whole elements fill the cell: {voxels}; any size {same} gives this mesh"
    )
