"""Divided differences of the logarithm, without loss of digits at coincident points.

They are the derivatives of a matrix logarithm in the eigenbasis (Daleckii & Krein 1965; Higham, Functions of
Matrices, ch. 3). With m = (x + y)/2 and z = (x − y)/(x + y) those of two points are smooth functions of z:

    ln[x, y] = artanh(z)/z / m,   ln[x, x, y] = −(1/(1 − z²) − z h(z²)) / 2 m²,   h(w) = Σ_k 2k/(2k+1) w^(k−1)
"""

from __future__ import annotations

import numpy as np

from porocore.states import Array

#: Below this |z| the series of h is summed, which is exact to round-off there; beyond it nothing cancels.
SMALL = 0.03
#: Its coefficients, highest power first.
_H = tuple(2 * k / (2 * k + 1) for k in range(6, 0, -1))
#: Keeps 0/0 away.
_TINY = 1e-300
#: Three points closer than this share of their mean are developed around it; terms of that series.
_CLOSE, _TERMS = 0.05, 12


def pair_differences(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return ln[x, y], ln[x, x, y] and ln[x, y, y] of positive numbers."""
    m: Array = (x + y) / 2
    z: Array = (x - y) / (x + y)
    w = z * z
    one_over = 1 / (1 - w)
    size = np.maximum(np.abs(z), _TINY)
    ratio = np.arctanh(size) / size
    small = np.flatnonzero(size < SMALL)
    if len(small) == z.size:
        h = _horner(_H, w)
    else:
        h = (one_over - ratio) / np.maximum(w, _TINY)
        h.reshape(-1)[small] = _horner(_H, w.reshape(-1)[small])
    scale = -0.5 / (m * m)
    zh = z * h
    return ratio / m, scale * (one_over - zh), scale * (one_over + zh)


def triple_difference(x: Array, y: Array, z: Array) -> Array:
    """Return ln[x, y, z] of positive numbers (n,) in any order."""
    low, high = np.minimum(np.minimum(x, y), z), np.maximum(np.maximum(x, y), z)
    middle = np.maximum(np.minimum(x, y), np.minimum(np.maximum(x, y), z))
    spread = high - low
    close = spread < _CLOSE * (low + high)
    found: Array = (pair_differences(low, middle)[0] - pair_differences(middle, high)[0]) / np.where(
        close, -1.0, -spread
    )
    if close.any():
        rows = np.flatnonzero(close)
        found[rows] = _series(low[rows], middle[rows], high[rows])
    return found


def _series(x: Array, y: Array, z: Array) -> Array:
    """Return Σ_k ln⁽ᵏ⁺²⁾(m)/(k+2)! h_k(x − m, y − m, z − m), h_k the complete homogeneous symmetric polynomials."""
    m = (x + y + z) / 3
    one, two, three = np.ones_like(m), np.ones_like(m), np.ones_like(m)
    a, b, c = (x - m) / m, (y - m) / m, (z - m) / m
    total = -0.5 * three
    for k in range(1, _TERMS):
        one = one * a
        two = one + b * two
        three = two + c * three
        total = total + (-1.0) ** (k + 1) / (k + 2) * three
    scaled: Array = total / m**2
    return scaled


def _horner(coefficients: tuple[float, ...], w: Array) -> Array:
    value = np.full_like(w, coefficients[0])
    for coefficient in coefficients[1:]:
        value *= w
        value += coefficient
    return value
