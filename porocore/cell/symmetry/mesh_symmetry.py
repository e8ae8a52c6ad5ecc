"""Operations of the cube that map the mesh of a whole cell, and its regions, onto themselves."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from porocore.cell.geometry.sides import CUBE, Sides
from porocore.cell.meshing.tetrahedra import Tetrahedra, volumes
from porocore.cell.symmetry.point_set import images_of_points, kinds
from porocore.core.tensors.point_group import CUBE_OPERATIONS, Rotation, as_rotation
from porocore.states import IntArray

#: Tolerance of the image of a node, in lengths of the cell; files hold about ten digits.
SAME = 1e-6
#: Tolerance of the volume of the tetrahedra around a node, in volumes of the cell.
SAME_VOLUME = 1e-9

#: Image of each region by name; None where a region is not mapped onto one region.
RegionMap = Mapping[str, str] | None


def region_maps(mesh: Tetrahedra, sides: Sides = CUBE) -> dict[Rotation, RegionMap]:
    """Return the operations that map the mesh of a whole cell onto itself, each with the images of the regions.

    Nodes are mapped onto nodes and tetrahedra onto tetrahedra. A mesh may have fewer symmetries than its body.
    """
    half = np.array(sides) / 2
    wrapped = np.where(mesh.points == half, -half, mesh.points)
    points, number = np.unique(wrapped, axis=0, return_inverse=True)
    cells = np.sort(number.reshape(-1)[mesh.cells], axis=1)
    corners = number.reshape(-1)[mesh.cells[:, :4]]
    own = volumes(mesh.points, mesh.cells)
    around = np.bincount(corners.ravel(), np.repeat(own, 4), minlength=len(points))
    # Nodes and centres of tetrahedra are distinguished by their volumes.
    everything = np.concatenate([points, mesh.points[mesh.cells[:, :4]].mean(axis=1)])
    is_middle = np.arange(len(everything)) >= len(points)
    labels = kinds(np.column_stack([is_middle, np.concatenate([around, own])]), SAME_VOLUME)
    found: dict[Rotation, RegionMap] = {}
    for Q in CUBE_OPERATIONS:
        if not np.array_equal(np.abs(Q) @ half, half):
            continue
        maps = []
        for order in images_of_points(everything, labels, SAME, Q, sides):
            row = order[len(points) :] - len(points)
            if np.array_equal(np.sort(order[cells], axis=1), cells[row]):
                maps.append(_regions(mesh, row))
        if maps:
            best = min(maps, key=_preferred)
            known = found.get(as_rotation(Q), best)
            found[as_rotation(Q)] = min(known, best, key=_preferred)
    return found


def _regions(mesh: Tetrahedra, row: IntArray) -> RegionMap:
    """Return the images of the regions if each tetrahedron is mapped onto that of ``row``."""
    if len(mesh.region_names) < 2:
        return {}
    pairs = np.unique(np.column_stack([mesh.regions, mesh.regions[row]]), axis=0)
    names = mesh.region_names
    if len(pairs) > len(np.unique(pairs[:, 0])):
        return None
    return {names[a]: names[b] for a, b in pairs if a != b}


def _preferred(regions: RegionMap) -> int:
    """Return the rank of a map: regions that stay come first, regions that are not mapped come last."""
    return 10**6 if regions is None else len(regions)
