"""Periodicity of a mesh: nodes of opposite faces matched to the last bit, classes of facets."""

from __future__ import annotations

import numpy as np

from porocore.cell.geometry.sides import Sides
from porocore.cell.meshing.tetrahedra import boundary_facets
from porocore.errors import ConfigurationError
from porocore.states import Array, IntArray

#: Tolerances of a node on a face and of partners on opposite faces, in lengths of the cell.
ON_FACE, PARTNER = 1e-6, 1e-4


def matched(points: Array, cells: IntArray, sides: Sides, what: str) -> Array:
    """Return the nodes (N, 3) of a mesh of a cell, with nodes of opposite faces at exactly the same places.

    The tetrahedra are those of both phases; messages begin with ``what``, the name of the mesh.

    Raises
    ------
    ConfigurationError
        A face has nodes or facets without partners on the opposite face.
    """
    from scipy.spatial import cKDTree  # slow to import

    half = np.array(sides) / 2
    for face in (-half, half):
        points = np.where(np.abs(points - face) < ON_FACE, face, points)
    for axis, name in enumerate("xyz"):
        others = np.array([i for i in range(3) if i != axis])
        low, high = (np.flatnonzero(points[:, axis] == side) for side in (-half[axis], half[axis]))
        distance, partner = cKDTree(points[low][:, others]).query(points[high][:, others])
        back, _ = cKDTree(points[high][:, others]).query(points[low][:, others])
        missing = int((distance > PARTNER).sum() + (back > PARTNER).sum())
        faces = f"{name} = ±{half[axis]:.4g} ({len(low)} and {len(high)} nodes)"
        if missing:
            raise ConfigurationError(
                f"{what}: not periodic along {name}: {missing} nodes of the faces {faces} have no partner on the "
                f"opposite face; the largest distance to the nearest node there is "
                f"{max(distance.max(), back.max()):.3g} of the cell's length; mesh one face and copy it to the other "
                "(gmsh: setPeriodic)"
            )
        if len(low) != len(high) or len(np.unique(partner)) < len(high):
            raise ConfigurationError(
                f"{what}: not periodic along {name}: several nodes of the faces {faces} lie within {PARTNER:g} of the "
                "cell's length of one node of the opposite face; mesh one face, no finer than that, and copy it to "
                "the other (gmsh: setPeriodic)"
            )
        points[np.ix_(high, others)] = points[np.ix_(low[partner], others)]
    _check_facets(points, cells, half, what)
    return points


def facet_classes(points: Array, facets: IntArray, first: Array, last: Array) -> IntArray:
    """Return the number (K,) of each facet (K, 3) of the box from ``first`` to ``last``; partners have the same one.

    Facets are identified by their nodes in the block, not by the periodic classes of these: where one or two elements
    span a period, different facets have corners of the same classes.
    """
    corners = np.sort(facets[:, :3], axis=1)
    for axis in range(3):
        low, high = (np.flatnonzero(points[:, axis] == side) for side in (first[axis], last[axis]))
        others = np.delete(points, axis, axis=1)
        _, place = np.unique(others[np.concatenate([low, high])], axis=0, return_inverse=True)
        place = place.reshape(-1)
        partner = np.full(int(place.max(initial=-1)) + 1, -1)
        partner[place[: len(low)]] = low
        below = np.full(len(points), -1)
        below[high] = partner[place[len(low) :]]
        images = below[corners]
        there = (images >= 0).all(axis=1)
        corners[there] = np.sort(images[there], axis=1)
    return np.unique(corners, axis=0, return_inverse=True)[1].reshape(-1)


def _check_facets(points: Array, cells: IntArray, half: Array, what: str) -> None:
    """Refuse a mesh with boundary facets inside the cell, or with different facets on opposite faces."""
    boundary = boundary_facets(cells[:, :4])
    on_face = (np.abs(points[boundary]) == half).all(axis=1).any(axis=1)
    if not on_face.all():
        raise ConfigurationError(
            f"{what}: {int((~on_face).sum())} facets inside of the cell belong to one tetrahedron only; solid and "
            "fluid must fill the cell and share their nodes on the wall"
        )
    alone = int((np.bincount(facet_classes(points, boundary, -half, half)) == 1).sum())
    if alone:
        raise ConfigurationError(
            f"{what}: not periodic: the nodes of opposite faces match, but {alone} facets between them do not; mesh "
            "one face and copy it to the other (gmsh: setPeriodic)"
        )
