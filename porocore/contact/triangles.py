"""The signed distance of points from the planes of moving triangles, with first and second derivatives."""

from __future__ import annotations

import numpy as np

from porocore.states import Array


def project(points: Array, triangles: Array) -> tuple[Array, Array, Array]:
    """Distances (...), normals (..., 3) and barycentric coordinates (..., 3) of the feet of the perpendiculars.

    Of points (..., 3) with respect to triangles (..., 3, 3), vertices in rows; the distance is positive on the side
    that the right-handed normal points to.
    """
    first = triangles[..., 0, :]
    e1, e2 = triangles[..., 1, :] - first, triangles[..., 2, :] - first
    m = np.cross(e1, e2)
    square = (m * m).sum(axis=-1)
    r = points - first
    two = (np.cross(r, e2) * m).sum(axis=-1) / square
    three = (np.cross(e1, r) * m).sum(axis=-1) / square
    normal = m / np.sqrt(square)[..., None]
    return (r * normal).sum(axis=-1), normal, np.stack([1 - two - three, two, three], axis=-1)


def distance_derivatives(points: Array, triangles: Array) -> tuple[Array, Array, Array]:
    """g (m,), ∂g/∂z (m, 12) and ∂²g/∂z² (m, 12, 12) with z = (x, x₁, x₂, x₃), the point and the vertices.

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
    slope = (n[:, None] @ R)[:, 0] + along / a
    a = a[:, :, None]
    half = R.swapaxes(1, 2) @ P @ M / a
    half -= along[:, :, None] * across[:, None, :] / a**2
    half -= E1.swapaxes(1, 2) @ _cross(r_t) @ E2 / a
    half -= (g / 2)[:, None, None] * (M.swapaxes(1, 2) @ P @ M) / a**2
    return g, slope, half + half.swapaxes(1, 2)


def _cross(v: Array) -> Array:
    """[v]× (m, 3, 3) with [v]× b = v × b."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return out - out.swapaxes(1, 2)
