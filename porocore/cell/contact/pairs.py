"""Search for contact pairs: points of the wall, and the triangles of the wall or of its images that they face."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from scipy.spatial import cKDTree

from porocore.cell.contact.pore_surface import PoreSurface
from porocore.cell.contact.triangles import height, nearest
from porocore.states import Array, IntArray

#: The triangles of a facet (VTK order of its six nodes).
SUBTRIANGLES = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
#: Range of the search, in largest accepted penetrations.
REACH = 1.5
#: Two walls face each other where the product of their normals lies below this.
OPPOSED = -0.5
#: Smallest cosine of the normal and the direction to a nearest point on an edge or a vertex; with a smaller one the
#: point lies beside the wall.
BESIDE = 0.9
#: Only walls that face each other across the undeformed pore may touch; a wall behind a facet is the other side of the
#: solid, however thin. Tolerance as a sine, for facets in one plane.
BEHIND = 1e-3


@dataclass(frozen=True, eq=False)
class Image:
    """Image of the wall, shifted by periods or reflected.

    Attributes
    ----------
    x, X : (nodes, 3)
        Deformed and undeformed position of the image of each node.
    reflected
        True for a reflection, which reverses the orientation of the facets.
    """

    x: Array
    X: Array
    reflected: bool = False


@dataclass(frozen=True, eq=False)
class Pairs:
    """Contact pairs: m points of the wall, each with the triangle that it faces.

    Attributes
    ----------
    N : (m, a)
        Shape functions at the point.
    weights : (m,)
        Undeformed area of the point.
    own : (m, a)
        Nodes of its facet.
    other : (m, 3)
        Nodes whose images are the triangle, outward from the solid.
    where : (m,)
        Part of the triangle that is nearest: face, edge or vertex, see :mod:`porocore.cell.contact.triangles`.
    number, distance : (m,)
        Number of the point, and its distance from the triangle at the search.
    """

    N: Array
    weights: Array
    own: IntArray
    other: IntArray
    where: IntArray
    number: IntArray
    distance: Array

    def __getitem__(self, rows: IntArray) -> Pairs:
        """Return the pairs in some rows."""
        return Pairs(*(getattr(self, f.name)[rows] for f in fields(self)))

    def penetrating(self, x: Array, images: Array) -> tuple[Pairs, Array, Array]:
        """Return the pairs behind the face of their triangle, with positions of point and triangle, by nodes x."""
        points = np.einsum("ma,mai->mi", self.N, x[self.own])
        corners = images[self.other]
        rows = np.flatnonzero(height(points, corners) < 0)
        return self[rows], points[rows], corners[rows]


#: Contact pairs of the wall with each of its images, shifted by periods (3,).
ContactPairs = list[tuple[Array, Pairs]]


def nearest_only(images: list[Pairs]) -> list[Pairs]:
    """Return the pairs with the nearest triangle of each point among several images."""
    distance = np.concatenate([pairs.distance for pairs in images])
    number = np.concatenate([pairs.number for pairs in images])
    image = np.repeat(np.arange(len(images)), [len(pairs.number) for pairs in images])
    row = np.concatenate([np.arange(len(pairs.number)) for pairs in images])
    order = np.lexsort((distance, number))
    chosen = order[np.unique(number[order], return_index=True)[1]]
    return [pairs[np.sort(row[chosen][image[chosen] == i])] for i, pairs in enumerate(images)]


def find_pairs(surface: PoreSurface, x: Array, X: Array, image: Image, reach: float) -> Pairs:
    """Return the points within ``reach`` of a facing triangle, before or behind it; x, X (nodes, 3)."""
    slave, master = _facing(surface, x, X, image, reach)
    triangles = surface.facets[:, SUBTRIANGLES if surface.facets.shape[1] == 6 else np.array([[0, 1, 2]])]
    if image.reflected:
        triangles = triangles[:, :, ::-1]
    points = np.einsum("qa,pai->pqi", surface.N, x[surface.facets[slave]])
    gaps, where, cosines = nearest(points[:, :, None], image.x[triangles[master]][:, None])
    pair, point, triangle = np.nonzero((np.abs(gaps) < reach) & (cosines > BESIDE))
    number = slave[pair] * len(surface.N) + point
    order = np.lexsort((np.abs(gaps[pair, point, triangle]), number))
    chosen = order[np.unique(number[order], return_index=True)[1]]
    pair, point, triangle = pair[chosen], point[chosen], triangle[chosen]
    return Pairs(
        surface.N[point],
        surface.weights[slave[pair], point],
        surface.facets[slave[pair]],
        triangles[master[pair], triangle],
        where[pair, point, triangle],
        slave[pair] * len(surface.N) + point,
        np.abs(gaps[pair, point, triangle]),
    )


def _facing(
    surface: PoreSurface, x: Array, X: Array, image: Image, reach: float
) -> tuple[IntArray, IntArray]:
    """Return pairs of facets, of the wall and of the image, that are near and face each other."""
    corners = surface.facets[:, :3]
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
    before, _, _ = _shape(X[corners])
    other, normal, _ = _shape(image.X[corners], reflected=image.reflected)
    away = before[slave] - other[master]
    ahead = (away * normal[master]).sum(axis=1) >= -BEHIND * np.linalg.norm(away, axis=1)
    return slave[ahead], master[ahead]


def _shape(corners: Array, *, reflected: bool = False) -> tuple[Array, Array, Array]:
    """Return centres, unit normals (F, 3) and radii (F,) of triangles (F, 3, 3)."""
    centres = corners.mean(axis=1)
    m = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    sign = -1.0 if reflected else 1.0
    return centres, sign * m / np.linalg.norm(m, axis=1)[:, None], radii
