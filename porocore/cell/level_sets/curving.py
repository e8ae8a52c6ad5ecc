"""Both phases in second-order tetrahedra, whose mid-edge nodes on the wall lie on the level set."""

from __future__ import annotations

import numpy as np

from porocore.cell.level_sets.cutting import LevelSet, TwoPhases, onto
from porocore.cell.level_sets.lattice import Lattice
from porocore.cell.meshing.shape_functions import FACETS
from porocore.cell.meshing.tetrahedra import (
    Element,
    Phase,
    Tetrahedra,
    least_stretch,
    order_by_place,
    used,
    with_middles,
)
from porocore.states import Array, IntArray

#: A curved element gets straight edges if its smallest volume element is below this share of the straight one's.
LEAST_STRETCH = 0.2
#: Largest motion of a mid-edge node, as a share of its edge; one that would move farther stays.
FARTHEST = 0.35
#: Tolerance of a point on the wall, relative to the largest value of the level set.
FOUND = 1e-9


def phases(
    mesh: TwoPhases, lattice: Lattice, level_set: LevelSet, element: Element
) -> dict[Phase, Tetrahedra]:
    """Return both phases in linear elements, or in quadratic ones with mid-edge nodes on the wall.

    An element that would fold keeps straight edges, and so do its neighbours along those edges. Nodes on a side of the
    lattice stay there, and those on opposite sides of a periodic one move together.
    """
    points, cells = mesh.points, mesh.cells
    if element != "linear":
        points, cells, edges = with_middles(points, cells)
        if element == "quadratic-curved":
            points = _curved(mesh, points, cells, edges, lattice, level_set)
    return {"solid": _phase(points, cells[mesh.solid]), "fluid": _phase(points, cells[~mesh.solid])}


def _phase(points: Array, cells: IntArray) -> Tetrahedra:
    """Return the elements of a phase with their nodes, both numbered by place."""
    points, cells = used(points, cells)
    elements, nodes = order_by_place(points, cells)
    return Tetrahedra(points[nodes], np.argsort(nodes)[cells[elements]])


def _curved(
    mesh: TwoPhases, points: Array, cells: IntArray, edges: IntArray, lattice: Lattice, level_set: LevelSet
) -> Array:
    n = len(mesh.points)
    on_wall = _wall_edges(mesh, edges)
    if lattice.periodic:
        on_wall = _with_images(points[n:], on_wall, lattice)
    straight = points[n:][on_wall]
    low, high = lattice.low, lattice.high
    wrapped = np.where(straight == high, low, straight) if lattice.periodic else straight
    places, image = np.unique(wrapped, axis=0, return_inverse=True)
    image = image.reshape(-1)
    ends = onto(level_set, places, (places == low) | (places == high))
    moves = ends - places
    length = np.linalg.norm(mesh.points[edges[on_wall, 0]] - mesh.points[edges[on_wall, 1]], axis=1)
    longest = np.full(len(places), np.inf)
    np.minimum.at(longest, image, FARTHEST * length)
    # Beside a ridge of the wall the projection onto it may fail.
    found = np.abs(level_set.value(ends)) <= FOUND * np.abs(level_set.value(mesh.points)).max()
    kept = found & (np.linalg.norm(moves, axis=1) < longest)
    number = np.full(len(points), -1)
    number[n:][on_wall] = image
    touched = cells[(number[cells] >= 0).any(axis=1)]
    while True:
        curved = points.copy()
        curved[n:][on_wall] += np.where(kept[:, None], moves, 0.0)[image]
        curved[n:] = np.where(points[n:] == low, low, np.where(points[n:] == high, high, curved[n:]))
        folded = touched[least_stretch(curved, touched) < LEAST_STRETCH]
        spoiled = np.unique(number[folded])
        spoiled = spoiled[(spoiled >= 0) & kept[spoiled]]
        if not len(spoiled):
            return curved
        kept[spoiled] = False


def _with_images(middles: Array, chosen: IntArray, lattice: Lattice) -> IntArray:
    """Return the chosen rows of ``middles`` (E, 3) and all their periodic images.

    Beside the sides of the box an edge may belong to the wall while its image lies within one phase.
    """
    side = np.flatnonzero(((middles == lattice.low) | (middles == lattice.high)).any(axis=1))
    wrapped = np.where(middles[side] == lattice.high, lattice.low, middles[side])
    _, image = np.unique(wrapped, axis=0, return_inverse=True)
    image = image.reshape(-1)
    of_chosen = image[np.isin(side, chosen)]
    return np.union1d(chosen, side[np.isin(image, of_chosen)])


def _wall_edges(mesh: TwoPhases, edges: IntArray) -> IntArray:
    """Return the rows of edges (E, 2) that belong to facets between the two phases."""
    facets = np.sort(mesh.cells[:, FACETS[:, :3]].reshape(-1, 3), axis=1)
    solid = np.repeat(mesh.solid, 4)
    unique, inverse = np.unique(facets, axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    of_solid = np.bincount(inverse[solid], minlength=len(unique))
    of_fluid = np.bincount(inverse[~solid], minlength=len(unique))
    wall = unique[(of_solid > 0) & (of_fluid > 0)]
    ends = np.unique(wall[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2), axis=0)
    n = int(mesh.cells.max()) + 1
    return np.flatnonzero(np.isin(edges[:, 0] * n + edges[:, 1], ends[:, 0] * n + ends[:, 1]))
