"""Search for contact pairs: points of the wall, and the triangles of the wall or images that they face."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

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
#: Share by which a distance may be wrong.
ROUND_OFF = 1e-9


@dataclass(frozen=True, eq=False)
class FacetShapes:
    """Centres (F, 3), unit normals (F, 3) and radii (F,) of the corner triangles of the wall's facets."""

    centres: Array
    normals: Array
    radii: Array

    @classmethod
    def from_nodes(cls, surface: PoreSurface, x: Array, *, reflected: bool = False) -> FacetShapes:
        """Return the shapes of the facets of nodes x; a reflection reverses their orientation."""
        corners = x[surface.facets[:, :3]]
        centres = corners.mean(axis=1)
        m = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
        sign = -1.0 if reflected else 1.0
        return cls(centres, sign * m / np.linalg.norm(m, axis=1)[:, None], radii)

    def shifted(self, by: Array) -> FacetShapes:
        """Return the shapes after a translation."""
        return replace(self, centres=self.centres + by)

    @cached_property
    def tree(self) -> cKDTree:
        """Search tree of the centres."""
        return cKDTree(self.centres)


class Wall:
    """The wall of a mesh, or an image of it: deformed and undeformed positions x, X (nodes, 3), and its facets."""

    def __init__(self, surface: PoreSurface, x: Array, X: Array, *, reflected: bool = False) -> None:
        self.surface, self.x, self._X, self.reflected = surface, x, X, reflected

    @cached_property
    def deformed(self) -> FacetShapes:
        """Shapes of the deformed facets."""
        return FacetShapes.from_nodes(self.surface, self.x, reflected=self.reflected)

    @cached_property
    def undeformed(self) -> FacetShapes:
        """Shapes of the undeformed facets."""
        return FacetShapes.from_nodes(self.surface, self._X, reflected=self.reflected)

    def shifted(self, by: Array, before: Array) -> Wall:
        """Return the image after translations of the deformed and of the undeformed wall."""
        image = Wall(self.surface, self.x + by, self._X, reflected=self.reflected)
        image.deformed, image.undeformed = self.deformed.shifted(by), self.undeformed.shifted(before)
        return image


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


def find_pairs(wall: Wall, image: Wall, reach: float) -> Pairs:
    """Return the points of a wall within ``reach`` of a facing triangle of an image, before or behind it."""
    surface = wall.surface
    slave, master = _facing(wall, image, reach)
    triangles = surface.facets[:, SUBTRIANGLES if surface.facets.shape[1] == 6 else np.array([[0, 1, 2]])]
    if image.reflected:
        triangles = triangles[:, :, ::-1]
    points = np.einsum("qa,pai->pqi", surface.N, wall.x[surface.facets[slave]])
    pair, point, triangle = _near_planes(points, image.x[triangles[master]], reach)
    gaps, where, cosines = nearest(points[pair, point], image.x[triangles[master[pair], triangle]])
    gaps = np.abs(gaps)
    kept = np.flatnonzero((gaps < reach) & (cosines > BESIDE))
    pair, point, triangle = pair[kept], point[kept], triangle[kept]
    gaps, where = gaps[kept], where[kept]
    number = slave[pair] * len(surface.N) + point
    order = np.lexsort((gaps, number))
    chosen = order[np.unique(number[order], return_index=True)[1]]
    pair, point, triangle = pair[chosen], point[chosen], triangle[chosen]
    return Pairs(
        surface.N[point],
        surface.weights[slave[pair], point],
        surface.facets[slave[pair]],
        triangles[master[pair], triangle],
        where[chosen],
        number[chosen],
        gaps[chosen],
    )


def _near_planes(points: Array, corners: Array, reach: float) -> tuple[IntArray, IntArray, IntArray]:
    """Return pair, point and triangle where a point lies within ``reach`` of the plane of a triangle.

    Only these can be within ``reach`` of the triangle. ``points`` are (pairs, q, 3), ``corners`` (pairs, t, 3, 3).
    """
    first = corners[:, :, 0]
    normals = np.cross(corners[:, :, 1] - first, corners[:, :, 2] - first)
    normals /= np.linalg.norm(normals, axis=2)[:, :, None]
    heights = points @ normals.swapaxes(1, 2)
    heights -= (normals * first).sum(axis=2)[:, None]
    pair, point, triangle = np.nonzero(np.abs(heights) < (1 + ROUND_OFF) * reach)
    return pair, point, triangle


def _facing(wall: Wall, image: Wall, reach: float) -> tuple[IntArray, IntArray]:
    """Return pairs of facets, of the wall and of the image, that are near and face each other."""
    own, other = wall.deformed, image.deformed
    span = 2 * float(own.radii.max()) + reach
    low, high = own.centres.min(axis=0) - span, own.centres.max(axis=0) + span
    near = np.flatnonzero(((other.centres > low) & (other.centres < high)).all(axis=1))
    if not len(near):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    found = own.tree.sparse_distance_matrix(cKDTree(other.centres[near]), span, output_type="ndarray")
    slave, master = found["i"].astype(np.int64), near[found["j"].astype(np.int64)]
    close = found["v"] < own.radii[slave] + own.radii[master] + reach
    opposed = (own.normals[slave] * other.normals[master]).sum(axis=1) < OPPOSED
    kept = np.flatnonzero(close & opposed)
    slave, master = slave[kept], master[kept]
    away = wall.undeformed.centres[slave] - image.undeformed.centres[master]
    ahead = (away * image.undeformed.normals[master]).sum(axis=1) >= -BEHIND * np.linalg.norm(away, axis=1)
    return slave[ahead], master[ahead]
