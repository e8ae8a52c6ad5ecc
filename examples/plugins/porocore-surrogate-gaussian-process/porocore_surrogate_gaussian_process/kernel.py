"""The covariance of a smooth random function that is zero at the origin and starts off flat.

Of a Gaussian process g with the covariance exp(−|x − y|²/2), the process g(x) − g(0) − x·∇g(0) has the covariance

    k(x, y) = exp(−|x − y|²/2) − (1 + x·y)(exp(−|x|²/2) + exp(−|y|²/2) − 1)

so that what is known at rest, value and slope, holds exactly and for every draw.
"""

from __future__ import annotations

import numpy as np


def covariance(x, y):
    """k (n, m) between points (n, d) and (m, d), in lengths of correlation."""
    ex, ey, products = _decay(x), _decay(y), x @ y.T
    return ex[:, None] * ey * np.exp(products) - (1 + products) * (ex[:, None] + ey - 1)


def slopes(x, y):
    """∂k/∂x (n, m, d)."""
    ex, ey, products = _decay(x), _decay(y), x @ y.T
    near = (ex[:, None] * ey * np.exp(products))[:, :, None] * (y - x[:, None])
    flat = y * (ex[:, None] + ey - 1)[:, :, None]
    return near - flat + ((1 + products) * ex[:, None])[:, :, None] * x[:, None]


def variance(x):
    """k(x, x) (n,)."""
    squares = (x**2).sum(axis=1)
    return 1 - (1 + squares) * (2 * _decay(x) - 1)


def _decay(x):
    return np.exp(-(x**2).sum(axis=1) / 2)
