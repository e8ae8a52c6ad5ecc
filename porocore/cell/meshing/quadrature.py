"""Quadrature rules of tetrahedra and triangles, the same for every backend."""

from __future__ import annotations

from functools import lru_cache
from itertools import permutations

import numpy as np
from scipy.special import roots_jacobi

from porocore.states import Array

LARGEST_DEGREE = 12


@lru_cache(maxsize=16)
def tetrahedron_rule(degree: int) -> tuple[Array, Array]:
    """Return points (q, 3) and weights (q,) on the unit tetrahedron, exact for polynomials up to ``degree``.

    One point for degree 1, four for 2, fourteen up to 5 (Walkington 2000, Quadrature on simplices of arbitrary
    dimension), and products of Gauss–Jacobi rules beyond. The weights sum to 1/6; all are positive.

    Raises
    ------
    ValueError
        The degree is not between 1 and 12.
    """
    if not 1 <= degree <= LARGEST_DEGREE:
        raise ValueError(f"expected a degree from 1 to {LARGEST_DEGREE}, got {degree}")
    if degree == 1:
        rule = np.full((1, 3), 0.25), np.full(1, 1 / 6)
    elif degree == 2:
        rule = _corners((5 - np.sqrt(5)) / 20), np.full(4, 1 / 24)
    elif degree <= 5:
        near, far = 0.31088591926330060980, 0.092735250310891226402
        middle = 0.045503704125649649492
        edge = sorted(set(permutations([middle, middle, 0.5 - middle, 0.5 - middle])))
        points = np.concatenate([_corners(near), _corners(far), np.array(edge)[:, :3]])
        weights = np.repeat(
            [0.018781320953002641800, 0.012248840519393658257, 0.0070910034628469110730], [4, 4, 6]
        )
        rule = points, weights
    else:
        rule = _conical((degree + 2) // 2)
    for part in rule:
        part.setflags(write=False)
    return rule


def _corners(a: float) -> Array:
    """Return the four points with barycentric coordinates (a, a, a, 1 − 3a)."""
    return a + np.vstack([np.zeros(3), np.eye(3) * (1 - 4 * a)])


def _conical(n: int) -> tuple[Array, Array]:
    """Return the rule of n × n × n Gauss–Jacobi points of the cube, collapsed to the tetrahedron."""
    (x, wx), (y, wy), (z, wz) = (
        ((s + 1) / 2, w / 2 ** (k + 1)) for k in range(3) for s, w in [roots_jacobi(n, k, 0)]
    )
    X, Y, Z = np.meshgrid(x, y, z, indexing="ij")
    points = np.stack([X * (1 - Y) * (1 - Z), Y * (1 - Z), Z], axis=-1).reshape(-1, 3)
    weights = (wx[:, None, None] * wy[:, None] * wz).ravel()
    return points, weights


@lru_cache(maxsize=16)
def triangle_rule(degree: int) -> tuple[Array, Array]:
    """Return points (q, 2) and weights (q,) on the unit triangle, exact for polynomials up to ``degree``.

    Products of Gauss–Jacobi rules; the weights sum to ½ and are positive.

    Raises
    ------
    ValueError
        The degree is not between 1 and 12.
    """
    if not 1 <= degree <= LARGEST_DEGREE:
        raise ValueError(f"expected a degree from 1 to {LARGEST_DEGREE}, got {degree}")
    n = degree // 2 + 1
    (x, wx), (y, wy) = (((s + 1) / 2, w / 2 ** (k + 1)) for k in range(2) for s, w in [roots_jacobi(n, k, 0)])
    X, Y = np.meshgrid(x, y, indexing="ij")
    rule = np.column_stack([(X * (1 - Y)).ravel(), Y.ravel()]), (wx[:, None] * wy).ravel()
    for part in rule:
        part.setflags(write=False)
    return rule
