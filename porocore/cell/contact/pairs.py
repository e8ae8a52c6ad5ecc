"""Contact pairs of the pore wall: distances of points from triangles, their derivatives, facing triangles.

The distance of a point from a triangle is that from its nearest point, in the face, on an edge or at a vertex. So the
distance from a surface of triangles is continuous; on its inner side it is continuously differentiable except where
two faces are equally near.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.spatial import cKDTree

from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.tetrahedra import shape_functions, triangle_rule
from porocore.states import Array, IntArray

#: Degree of the rule on a facet: a crease begins as a fold within the facets next to a mirror plane.
DEGREE = 7


@dataclass(frozen=True, eq=False)
class PoreSurface:
    """The pore wall as F facets of a nodes each, with q quadrature points.

    Attributes
    ----------
    facets : (F, a)
        Nodes, outward from the solid.
    N : (q, a), dN : (q, a, 2)
        Shape functions and their derivatives by the two coordinates of a facet.
    weights : (F, q)
        Undeformed area of each point.
    """

    facets: IntArray
    N: Array
    dN: Array
    weights: Array

    @property
    def area(self) -> float:
        """Undeformed area of the wall."""
        return float(self.weights.sum())


@lru_cache(maxsize=8)
def pore_surface(mesh: CellMesh) -> PoreSurface:
    """Return the pore surface of a mesh of the solid."""
    points, weights = triangle_rule(DEGREE)
    N, dN = shape_functions(points, mesh.wall.shape[1])
    tangents = np.einsum("qas,fai->fqsi", dN, mesh.points[mesh.wall])
    area = np.linalg.norm(np.cross(tangents[:, :, 0], tangents[:, :, 1]), axis=2)
    return PoreSurface(mesh.wall, N, dN, area * weights)


#: Codes of the part where the nearest point lies: the face (0), the edge after vertex k (1 + k), vertex k (4 + k).
FACE, EDGE, VERTEX = 0, 1, 4


def nearest(points: Array, triangles: Array) -> tuple[Array, IntArray, Array]:
    """Return signed distances, the parts where the nearest points lie, and cosines of direction and normal, (...).

    Points are (..., 3) and triangles (..., 3, 3), vertices in rows; positive on the side of the right-handed normal.
    """
    x = np.ascontiguousarray(np.moveaxis(points, -1, 0))
    corners = np.ascontiguousarray(np.moveaxis(triangles, (-2, -1), (0, 1)))
    m = _cross_product(corners[1] - corners[0], corners[2] - corners[0])
    normal = m / np.sqrt(_product(m, m))
    above = _product(x - corners[0], normal)
    best = np.full(above.shape, np.inf)
    where = np.zeros(above.shape, dtype=np.int64)
    inside = np.ones(above.shape, dtype=bool)
    for k in range(3):
        t, r = corners[(k + 1) % 3] - corners[k], x - corners[k]
        inside &= _product(_cross_product(t, r), m) >= 0
        share = _product(r, t) / _product(t, t)
        away = r - np.clip(share, 0.0, 1.0) * t
        distance = np.sqrt(_product(away, away))
        kind = np.where(share <= 0, VERTEX + k, np.where(share >= 1, VERTEX + (k + 1) % 3, EDGE + k))
        nearer = distance < best
        best, where = np.where(nearer, distance, best), np.where(nearer, kind, where)
    best, where = np.where(inside, np.abs(above), best), np.where(inside, FACE, where)
    cosine = np.abs(above) / np.where(best > 0, best, 1.0)
    return np.where(above < 0, -best, best), where, np.where(best > 0, cosine, 1.0)


def _product(a: Array, b: Array) -> Array:
    """Return a·b of vectors whose components come first; numpy sums over short last axes slowly."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _cross_product(a: Array, b: Array) -> Array:
    """Return a × b of vectors whose components come first."""
    return np.stack([a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)])


def distance_derivatives(points: Array, triangles: Array, where: IntArray) -> tuple[Array, Array, Array]:
    """Return g (m,), ∂g/∂z (m, 12) and ∂²g/∂z² (m, 12, 12) with z = (x, x₁, x₂, x₃), the point and the vertices.

    g is the distance from the plane of the face, from the line of an edge, or from a vertex, by ``where`` (m,).
    """
    m = len(points)
    g, gradient, hessian = np.zeros(m), np.zeros((m, 12)), np.zeros((m, 12, 12))
    rows = np.flatnonzero(where == FACE)
    g[rows], gradient[rows], hessian[rows] = _from_plane(points[rows], triangles[rows])
    for k in range(3):
        for kind, vertices in ((EDGE + k, [k, (k + 1) % 3]), (VERTEX + k, [k])):
            rows = np.flatnonzero(where == kind)
            if not len(rows):
                continue
            part = triangles[rows]
            sign = np.sign(height(points[rows], part))
            measure = _from_line if len(vertices) == 2 else _from_point
            d, first, second = measure(points[rows], part[:, vertices])
            places = np.concatenate([np.arange(3)] + [3 + 3 * v + np.arange(3) for v in vertices])
            g[rows] = sign * d
            gradient[np.ix_(rows, places)] = sign[:, None] * first
            hessian[np.ix_(rows, places, places)] = sign[:, None, None] * second
    return g, gradient, hessian


def height(points: Array, triangles: Array) -> Array:
    """Return a multiple (m,) of the height over the triangle's plane, of the sign of the distance."""
    first = triangles[:, 0]
    m = np.cross(triangles[:, 1] - first, triangles[:, 2] - first)
    return np.asarray(((points - first) * m).sum(axis=1))


def _from_plane(points: Array, triangles: Array) -> tuple[Array, Array, Array]:
    """Return the distance from the plane of a face, its gradient and its Hessian.

    With m = e₁ × e₂, a = |m|, n = m/a, r = x − x₁, g = r·n and r_t = r − g n:
    δg = n·δr + r_t·δm/a and δ²g = 2 δr·δn + (r_t·δ²m − 2 (r_t·δm)(n·δm)/a − g |P δm|²/a)/a, where P = I − n nᵀ,
    δn = P δm/a and δ²m = 2 δe₁ × δe₂.
    """
    x1 = triangles[:, 0]
    e1, e2 = triangles[:, 1] - x1, triangles[:, 2] - x1
    m = np.cross(e1, e2)
    a = np.linalg.norm(m, axis=1)[:, None]
    n = m / a
    r = points - x1
    g = (r * n).sum(axis=1)
    r_t = r - g[:, None] * n
    size, one = len(points), np.eye(3)
    R, E1, E2 = (np.zeros((size, 3, 12)) for _ in range(3))
    R[:, :, :3], R[:, :, 3:6] = one, -one
    E1[:, :, 3:6], E1[:, :, 6:9] = -one, one
    E2[:, :, 3:6], E2[:, :, 9:] = -one, one
    M = _cross(e1) @ E2 - _cross(e2) @ E1
    P = one - n[:, :, None] * n[:, None, :]
    along, across = (r_t[:, None] @ M)[:, 0], (n[:, None] @ M)[:, 0]
    gradient = (n[:, None] @ R)[:, 0] + along / a
    a = a[:, :, None]
    half = R.swapaxes(1, 2) @ P @ M / a
    half -= along[:, :, None] * across[:, None, :] / a**2
    half -= E1.swapaxes(1, 2) @ _cross(r_t) @ E2 / a
    half -= (g / 2)[:, None, None] * (M.swapaxes(1, 2) @ P @ M) / a**2
    return g, gradient, half + half.swapaxes(1, 2)


def _from_line(points: Array, ends: Array) -> tuple[Array, Array, Array]:
    """Return the distance d from a line, its gradient and its Hessian by the point and the two ends (m, 9).

    With t the edge, L its length, c = t/L, e the direction of the distance, b = c × e, s the share of the foot and
    w = δr − s δt: δd = e·w and δ²d = (b·w)²/d − 2 (c·w)(e·δt)/L − d (e·δt)²/L².
    """
    r, t = points - ends[:, 0], ends[:, 1] - ends[:, 0]
    L = np.linalg.norm(t, axis=1)
    c = t / L[:, None]
    s = (r * c).sum(axis=1) / L
    foot = r - s[:, None] * t
    d = np.linalg.norm(foot, axis=1)
    safe = np.maximum(d, 1e-300)
    e = foot / safe[:, None]
    one = np.eye(3)
    w, dt = np.zeros((len(points), 3, 9)), np.zeros((len(points), 3, 9))
    w[:, :, :3] = one
    w[:, :, 3:6] = -(1 - s)[:, None, None] * one
    w[:, :, 6:] = -s[:, None, None] * one
    dt[:, :, 3:6], dt[:, :, 6:] = -one, one
    ew, cw, bw = ((v[:, None] @ w)[:, 0] for v in (e, c, np.cross(c, e)))
    et = (e[:, None] @ dt)[:, 0] / L[:, None]
    mixed = cw[:, :, None] * et[:, None, :]
    hessian = bw[:, :, None] * bw[:, None, :] / safe[:, None, None] - mixed - mixed.swapaxes(1, 2)
    return d, ew, hessian - d[:, None, None] * et[:, :, None] * et[:, None, :]


def _from_point(points: Array, vertices: Array) -> tuple[Array, Array, Array]:
    """Return the distance d from a vertex, its gradient and its Hessian by the point and the vertex (m, 6)."""
    r = points - vertices[:, 0]
    d = np.linalg.norm(r, axis=1)
    safe = np.maximum(d, 1e-300)
    e = r / safe[:, None]
    P = (np.eye(3) - e[:, :, None] * e[:, None, :]) / safe[:, None, None]
    both = np.concatenate([np.concatenate([P, -P], axis=2), np.concatenate([-P, P], axis=2)], axis=1)
    return d, np.concatenate([e, -e], axis=1), both


def _cross(v: Array) -> Array:
    """Return [v]× (m, 3, 3) with [v]× b = v × b."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return out - out.swapaxes(1, 2)


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
        Part of the triangle that is nearest: face, edge or vertex, see :mod:`porocore.cell.contact.pairs`.
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
