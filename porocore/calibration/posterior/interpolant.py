"""Residuals between the points of a fit (ResidualInterpolant), from values and Jacobians there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from porocore.calibration.problem import Fitted
from porocore.states import Array

#: Squared distance, in standard deviations, up to which points count fully for the quadratic part.
NEAR = 9.0
#: A squared distance below this is none.
NO_DISTANCE = 1e-20


class ResidualInterpolant:
    """Residuals as functions of all unknowns: a quadratic function, and what it leaves over at the points.

    What is left over is interpolated by Shepard's method with the slopes at the points. So values and slopes at the
    points are exact, and so is everything where the model is linear or quadratic.

    Parameters
    ----------
    points
        Evaluations of one misfit, priors included.
    best
        The one about which the distribution lies.
    lower, upper : (k,)
        Coordinates of the bounds.
    """

    def __init__(self, points: Sequence[Fitted], best: Fitted, lower: Array, upper: Array) -> None:
        count = len(lower)
        self.lower, self.upper, self._center = lower, upper, best.coordinates
        metric = best.jacobian.T @ best.jacobian + np.diag((upper - lower) ** -2.0)
        self._root = np.linalg.cholesky(metric)
        self._points = self.standard(np.array([each.coordinates for each in points]))
        values = np.array([each.residuals for each in points])
        slopes = np.array([np.linalg.solve(self._root, each.jacobian.T).T for each in points])
        columns = np.concatenate([values.T, slopes.transpose(1, 0, 2).reshape(values.shape[1], -1)], axis=1)
        if len(columns) > columns.shape[1]:
            # Sums of squares are kept by a rotation, after which there are as many residuals as columns.
            columns = np.asarray(np.linalg.qr(columns, mode="r"))
            values = columns[:, : len(points)].T
            slopes = columns[:, len(points) :].reshape(-1, len(points), count).transpose(1, 0, 2)
        self._quadratic = _quadratic_fit(self._points, values, slopes)
        basis, by = _basis(self._points), _basis_slopes(self._points)
        self._slopes = slopes - np.einsum("nbk,bm->nmk", by, self._quadratic)
        left = values - basis @ self._quadratic
        self._constants = left - np.einsum("nmk,nk->nm", self._slopes, self._points)

    def standard(self, coordinates: Array) -> Array:
        """Return coordinates (n, k) in standard deviations of the distribution to first order, from the best point."""
        return np.asarray((coordinates - self._center) @ self._root)

    def coordinates(self, standard: Array) -> Array:
        """Return the coordinates (n, k) that :meth:`standard` takes."""
        return np.asarray(self._center + np.linalg.solve(self._root.T, standard.T).T)

    def squares(self, standard: Array) -> Array:
        """Return the sums of squares (n,) at standard coordinates (n, k)."""
        distances = ((standard[:, None] - self._points) ** 2).sum(axis=2)
        logarithms = np.log(np.maximum(distances, NO_DISTANCE))
        # A power at which far points count for nothing, in any number of unknowns.
        power = (standard.shape[1] + 3) / 2
        weights = np.exp(-power * (logarithms - logarithms.min(axis=1, keepdims=True)))
        weights /= weights.sum(axis=1, keepdims=True)
        slopes = np.tensordot(weights, self._slopes, axes=1)
        residuals = _basis(standard) @ self._quadratic + weights @ self._constants
        residuals += np.einsum("nmk,nk->nm", slopes, standard)
        return np.asarray((residuals**2).sum(axis=1))

    def log_density(self, standard: Array) -> Array:
        """Return ln of the posterior density (n,) up to a constant; −∞ outside the bounds."""
        x = self.coordinates(standard)
        outside = ((x < self.lower) | (x > self.upper)).any(axis=1)
        found = np.full(len(x), -np.inf)
        found[~outside] = -0.5 * self.squares(standard[~outside])
        return found


def _quadratic_fit(points: Array, values: Array, slopes: Array) -> Array:
    """Return coefficients (b, m) of the quadratic function next to values (n, m) and slopes (n, m, k)."""
    weights = 1 / np.sqrt(1 + (points**2).sum(axis=1) / NEAR)
    rows = np.concatenate([_basis(points)[:, None], _basis_slopes(points).transpose(0, 2, 1)], axis=1)
    wanted = np.concatenate([values[:, None], slopes.transpose(0, 2, 1)], axis=1)
    rows, wanted = rows * weights[:, None, None], wanted * weights[:, None, None]
    found = np.linalg.lstsq(rows.reshape(-1, rows.shape[2]), wanted.reshape(-1, wanted.shape[2]), rcond=1e-10)
    return np.asarray(found[0])


def _basis(points: Array) -> Array:
    """Return 1, the coordinates and their products (n, b) at points (n, k)."""
    first, second = np.triu_indices(points.shape[1])
    return np.concatenate([np.ones((len(points), 1)), points, points[:, first] * points[:, second]], axis=1)


def _basis_slopes(points: Array) -> Array:
    """Return the derivatives (n, b, k) of the basis by the coordinates."""
    count = points.shape[1]
    first, second = np.triu_indices(count)
    unit = np.eye(count)
    linear = np.broadcast_to(np.concatenate([np.zeros((1, count)), unit]), (len(points), count + 1, count))
    products = unit[first] * points[:, second, None] + unit[second] * points[:, first, None]
    return np.concatenate([linear, products], axis=1)
