"""Signed distance of points from moving triangles, with its first and second derivatives.

It is the distance from the nearest point of the triangle, in the face, on an edge or at a vertex. So the distance from
a surface of triangles is continuous; on its inner side it is continuously differentiable except where two faces are
equally near.
"""

from __future__ import annotations

import numpy as np

from porocore.states import Array, IntArray

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
