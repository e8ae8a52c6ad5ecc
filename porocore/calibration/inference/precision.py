"""Precision of a fit to first order (LinearPrecision): singular values, covariance, deviations, correlations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from porocore.states import Array

#: Singular values below this share of the largest are round-off: the direction is not seen at all.
ROUND_OFF = 1e-9


@dataclass(frozen=True, eq=False)
class LinearPrecision:
    """Normal distribution of the coordinates that has the Jacobian of a fit.

    Attributes
    ----------
    singular_values : (k,)
        Of the weighted Jacobian, largest first.
    directions : (k, k)
        Unit directions over the coordinates, one a row, that belong to them.
    """

    singular_values: Array
    directions: Array

    @classmethod
    def from_jacobian(cls, jacobian: Array) -> LinearPrecision:
        """Return the precision by a weighted Jacobian (m, k)."""
        # A square factor has the same singular values, and k of them where there are fewer data than unknowns.
        k = jacobian.shape[1]
        square = np.zeros((k, k))
        factor = np.linalg.qr(jacobian, mode="r")
        square[: len(factor)] = factor
        _, values, directions = np.linalg.svd(square)
        return cls(values, directions)

    @property
    def _seen(self) -> Array:
        """Singular values, those of round-off replaced by what round-off can hide."""
        floor = ROUND_OFF * float(self.singular_values[0]) + float(np.finfo(np.float64).tiny)
        return np.maximum(self.singular_values, floor)

    @property
    def is_unseen(self) -> npt.NDArray[np.bool_]:
        """True for singular values that are zero to round-off, (k,)."""
        return np.asarray(self.singular_values < self._seen)

    @property
    def covariance(self) -> Array:
        """Covariance of the coordinates (k, k); infinite or NaN for those that a direction of round-off moves."""
        covariance = self._finite_covariance
        lost = ~np.isfinite(self.deviations)
        covariance[lost] = np.nan
        covariance[:, lost] = np.nan
        np.fill_diagonal(covariance, self.deviations**2)
        return covariance

    @property
    def deviations(self) -> Array:
        """Standard deviations of the coordinates (k,); infinite where a direction of round-off moves one."""
        lost = (np.abs(self.directions[self.is_unseen]) > 1e-6).any(axis=0)
        return np.where(lost, np.inf, self.spread)

    @property
    def spread(self) -> Array:
        """Deviations (k,) as far as round-off lets them be told, always finite, to compare unknowns by them."""
        return np.sqrt(np.diag(self._finite_covariance))

    def moves_with(self, slopes: Array) -> tuple[Array, float]:
        """Return covariances (k,) with the coordinates, and deviation, of a number with slopes (k,) by these.

        The deviation is infinite where a direction of round-off moves the number; else such directions do not count.
        """
        along, lost = self.directions @ slopes, self.is_unseen
        size = float(np.linalg.norm(slopes))
        if (np.abs(along[lost]) > 1e-6 * size).any():
            return np.full_like(slopes, np.nan), np.inf
        scaled = np.where(lost, 0.0, along / self._seen)
        covariances = self.directions.T @ np.where(lost, 0.0, scaled / self._seen)
        return np.asarray(covariances), float(np.linalg.norm(scaled))

    @property
    def correlations(self) -> Array:
        """Correlations of the coordinates (k, k), with their limits where deviations are infinite."""
        return self._finite_covariance / np.outer(self.spread, self.spread)

    @property
    def _finite_covariance(self) -> Array:
        scaled = self.directions / self._seen[:, None]
        return np.asarray(scaled.T @ scaled)
