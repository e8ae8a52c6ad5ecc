"""Which operations of the cube take the mesh of a whole periodic cell to itself, and its regions to which."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from porocore.cell.meshing.tetrahedra import Tetrahedra, volumes
from porocore.cell.symmetry.point_set import images_of_points, kinds
from porocore.core.tensors.point_group import CUBE_OPERATIONS, Rotation, as_rotation
from porocore.states import IntArray

#: In lengths of the cell: how far the image of a node may lie from a node. Files hold no more than some ten digits.
SAME = 1e-6
#: Of volumes of tetrahedra around a node, as a share of that of the cell.
SAME_VOLUME = 1e-9

#: The region to which each goes; None where one does not go to one other as a whole.
RegionMap = Mapping[str, str] | None


def region_maps(mesh: Tetrahedra) -> dict[Rotation, RegionMap]:
    """Return the operations under which a mesh of [−½, ½]³ is the same, each with where the regions go.

    Nodes have to meet nodes and tetrahedra tetrahedra. A mesh may have fewer operations than the body that it fills.
    """
    wrapped = np.where(mesh.points == 0.5, -0.5, mesh.points)
    points, number = np.unique(wrapped, axis=0, return_inverse=True)
    cells = np.sort(number.reshape(-1)[mesh.cells], axis=1)
    corners = number.reshape(-1)[mesh.cells[:, :4]]
    own = volumes(mesh.points, mesh.cells)
    around = np.bincount(corners.ravel(), np.repeat(own, 4), minlength=len(points))
    # Nodes and middles of tetrahedra, told apart by their volumes.
    everything = np.concatenate([points, mesh.points[mesh.cells[:, :4]].mean(axis=1)])
    is_middle = np.arange(len(everything)) >= len(points)
    labels = kinds(np.column_stack([is_middle, np.concatenate([around, own])]), SAME_VOLUME)
    found: dict[Rotation, RegionMap] = {}
    for Q in CUBE_OPERATIONS:
        maps = []
        for order in images_of_points(everything, labels, SAME, Q):
            row = order[len(points) :] - len(points)
            if np.array_equal(np.sort(order[cells], axis=1), cells[row]):
                maps.append(_regions(mesh, row))
        if maps:
            best = min(maps, key=_preferred)
            known = found.get(as_rotation(Q), best)
            found[as_rotation(Q)] = min(known, best, key=_preferred)
    return found


def _regions(mesh: Tetrahedra, row: IntArray) -> RegionMap:
    """Where the regions go if each tetrahedron goes to that of ``row``."""
    if len(mesh.region_names) < 2:
        return {}
    pairs = np.unique(np.column_stack([mesh.regions, mesh.regions[row]]), axis=0)
    names = mesh.region_names
    if len(pairs) > len(np.unique(pairs[:, 0])):
        return None
    return {names[a]: names[b] for a, b in pairs if a != b}


def _preferred(regions: RegionMap) -> int:
    """Regions that stay are best, scrambled ones worst."""
    return 10**6 if regions is None else len(regions)
