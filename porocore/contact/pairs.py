"""Which points of the wall face which triangles of the wall or of an image of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from porocore.contact.triangles import project
from porocore.contact.wall import Wall
from porocore.states import Array, IntArray

#: The triangles of a facet (VTK order of its six nodes).
SUBTRIANGLES = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
#: Walls face each other where the product of their normals lies below this.
OPPOSED = -0.5
#: How far beside a triangle the foot of a perpendicular may lie, in barycentric coordinates.
BESIDE = 0.05
#: Facets that are neighbours and convex as seen from the pore do not touch, however thin the solid between them is.
CONVEX = 1e-3


@dataclass(frozen=True, eq=False)
class Image:
    """The wall once more: shifted by periods, or reflected.

    Attributes
    ----------
    x, X : (nodes, 3)
        Where the image of each node is, deformed and undeformed.
    reflected
        A reflection turns the facets round.
    """

    x: Array
    X: Array
    reflected: bool = False


@dataclass(frozen=True, eq=False)
class Pairs:
    """m points of the wall, each with the triangle that it is held against.

    Attributes
    ----------
    N : (m, a)
        Shape functions at the point.
    weights : (m,)
        Its undeformed area.
    own : (m, a)
        Nodes of its facet.
    other : (m, 3)
        Nodes whose images are the triangle, outward from the solid.
    """

    N: Array
    weights: Array
    own: IntArray
    other: IntArray


def find_pairs(wall: Wall, x: Array, X: Array, image: Image, reach: float) -> Pairs:
    """Points that lie within ``reach`` of an opposite triangle's plane, before it or behind; x, X (nodes, 3)."""
    slave, master = _facing(wall, x, X, image, reach)
    triangles = wall.facets[:, SUBTRIANGLES if wall.facets.shape[1] == 6 else np.array([[0, 1, 2]])]
    if image.reflected:
        triangles = triangles[:, :, ::-1]
    points = np.einsum("qa,pai->pqi", wall.N, x[wall.facets[slave]])
    gaps, _, weights = project(points[:, :, None], image.x[triangles[master]][:, None])
    beside = np.maximum(-weights.min(axis=-1), 0.0)
    pair, point, triangle = np.nonzero((np.abs(gaps) < reach) & (beside < BESIDE))
    number = slave[pair] * len(wall.N) + point
    # The triangle that the point lies above, and of several the nearest: so g changes continuously when a point
    # slides from one triangle to the next, over an edge or a groove.
    order = np.lexsort((np.abs(gaps[pair, point, triangle]), beside[pair, point, triangle], number))
    chosen = order[np.unique(number[order], return_index=True)[1]]
    pair, point, triangle = pair[chosen], point[chosen], triangle[chosen]
    return Pairs(
        wall.N[point],
        wall.weights[slave[pair], point],
        wall.facets[slave[pair]],
        triangles[master[pair], triangle],
    )


def _facing(wall: Wall, x: Array, X: Array, image: Image, reach: float) -> tuple[IntArray, IntArray]:
    """Pairs of facets, of the wall and of the image, that are near and face each other."""
    corners = wall.facets[:, :3]
    centres, normals, radii = _shape(x[corners])
    others, other_normals, _ = _shape(image.x[corners], reflected=image.reflected)
    span = 2 * float(radii.max()) + reach
    near = np.flatnonzero(
        ((others > centres.min(axis=0) - span) & (others < centres.max(axis=0) + span)).all(axis=1)
    )
    if not len(near):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    found = cKDTree(centres).sparse_distance_matrix(cKDTree(others[near]), span, output_type="ndarray")
    slave, master = found["i"].astype(np.int64), near[found["j"].astype(np.int64)]
    close = found["v"] < radii[slave] + radii[master] + reach
    opposed = (normals[slave] * other_normals[master]).sum(axis=1) < OPPOSED
    kept = np.flatnonzero(close & opposed)
    slave, master = slave[kept], master[kept]
    between = np.abs(X[corners[slave]][:, :, None] - image.X[corners[master]][:, None]).max(axis=-1)
    neighbours = (between < 1e-9).any(axis=(1, 2))
    before, _, _ = _shape(X[corners])
    other, normal, _ = _shape(image.X[corners], reflected=image.reflected)
    away = before[slave] - other[master]
    convex = (away * normal[master]).sum(axis=1) < -CONVEX * np.linalg.norm(away, axis=1)
    kept = np.flatnonzero(~(neighbours & convex))
    return slave[kept], master[kept]


def _shape(corners: Array, *, reflected: bool = False) -> tuple[Array, Array, Array]:
    """Centres, unit normals (F, 3) and radii (F,) of triangles (F, 3, 3)."""
    centres = corners.mean(axis=1)
    m = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    sign = -1.0 if reflected else 1.0
    return centres, sign * m / np.linalg.norm(m, axis=1)[:, None], radii
