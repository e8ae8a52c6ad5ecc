"""Spheres of triangles, and their files."""

from __future__ import annotations

import numpy as np


def icosphere(radius: float, halvings: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (v, 3) and triangles (20 · 4^halvings, 3) of an icosahedron whose edges are halved onto the sphere."""
    g = (1 + 5**0.5) / 2
    points = np.array([(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0)], dtype=float)
    points = np.concatenate([np.roll(points, k, axis=1) for k in range(3)])
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    near = np.abs(distances - 2) < 1e-9
    triangles = np.array(
        [
            (i, j, k)
            for i in range(12)
            for j in range(i)
            for k in range(j)
            if near[i, j] and near[j, k] and near[i, k]
        ]
    )
    for _ in range(halvings):
        edges, number = np.unique(
            np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1),
            axis=0,
            return_inverse=True,
        )
        ab, bc, ca = (len(points) + number.reshape(-1, 3)).T
        points = np.concatenate([points, points[edges].mean(axis=1)])
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        a, b, c = triangles.T
        triangles = np.concatenate(
            [np.stack(each, axis=1) for each in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
    points = radius * points / np.linalg.norm(points, axis=1, keepdims=True)
    x = points[triangles]
    inward = np.einsum("ti,ti->t", np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), x.sum(axis=1)) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    return points, triangles


def write_stl(path, points, triangles):
    """Write triangles as text STL, and return the path."""
    lines = ["solid body"]
    for corners in points[triangles].tolist():
        lines += ["facet normal 0 0 0", "outer loop", *(f"vertex {x!r} {y!r} {z!r}" for x, y, z in corners)]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid body", ""]))
    return path
