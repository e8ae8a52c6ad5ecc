"""Bounded least squares (Objective) and precision to first order (LinearPrecision)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from porocore.commands.calibration.problem import MANY_VALUES, Fitted, Misfit
from porocore.errors import SolveError
from porocore.states import Array, IntArray

#: A decrease of the sum of squares that is expected to be smaller than this ends the search.
EXPECTED_DECREASE = 1e-4
#: Steps of one search.
MOST_STEPS = 40
#: Least damping, a share of the largest squared singular value: directions of round-off do not move.
LEAST_DAMPING = 1e-16
#: First damping after a step that fails, the same share, and the factor of the next ones.
FIRST_DAMPING, DAMPING_FACTOR = 1e-4, 10.0
#: Largest damping; a step that fails there is given up.
MOST_DAMPING = 1e4


class Objective:
    """Weighted residuals with or without priors; the same point is never evaluated twice.

    Parameters
    ----------
    misfit
        Of model and data.
    scale : (k,)
        Lengths by which the coordinates are measured: the limits of identifiability.
    priors
        Whether priors count.
    tell
        Called with what is computed next, for the progress.
    """

    def __init__(
        self,
        misfit: Misfit,
        scale: Array,
        priors: bool = True,
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.misfit, self.scale, self._priors, self.tell = misfit, scale, priors, tell
        self.lower, self.upper = misfit.bounds
        self._known: dict[bytes, Fitted | SolveError] = {}

    def without_priors(self) -> Objective:
        """Return the objective of the data alone, which shares all evaluations."""
        made = Objective(self.misfit, self.scale, priors=False, tell=self.tell)
        made._known = self._known
        return made

    def add(self, fitted: Fitted) -> None:
        """Take over an evaluation that was made elsewhere."""
        self._known[fitted.coordinates.tobytes()] = self._kept(fitted)

    @property
    def evaluations(self) -> int:
        """Points that are known."""
        return len(self._known)

    @property
    def points(self) -> tuple[Fitted, ...]:
        """Evaluations that could be computed, in the order they were made, priors included."""
        return tuple(each for each in self._known.values() if isinstance(each, Fitted))

    def at(self, coordinates: Array) -> Fitted:
        """Return residuals and Jacobian at coordinates (k,); of very many data :attr:`Fitted.reduced`.

        Raises
        ------
        SolveError
            The experiment cannot be computed there.
        """
        x = np.array(coordinates, dtype=float)
        key = x.tobytes()
        if key not in self._known:
            try:
                self._known[key] = self._kept(_finite(self.misfit.at(x)))
            except SolveError as error:
                self._known[key] = error
        found = self._known[key]
        if isinstance(found, SolveError):
            raise found
        return found if self._priors else found.of_data

    def _kept(self, fitted: Fitted) -> Fitted:
        """Return what is kept of an evaluation: with very many data, no more than steps and sums of squares need."""
        return fitted.reduced if len(self.misfit.data.values) > MANY_VALUES else fitted

    def step(self, fitted: Fitted, free: IntArray, moved: Array, damping: float = 0.0) -> Array:
        """Return the step (k,) of the free coordinates that minimises the linear residuals within the bounds.

        Parameters
        ----------
        fitted
            Residuals and Jacobian here.
        free
            Indices of the coordinates that move.
        moved : (k,)
            A move of the others, which is given.
        damping
            Weight of the step, in units of the largest squared singular value.
        """
        from scipy.optimize import lsq_linear

        step = np.array(moved, dtype=float)
        if not len(free):
            return step
        rows = fitted.jacobian[:, free] * self.scale[free]
        weight = np.sqrt(max(damping, LEAST_DAMPING)) * max(float(np.linalg.norm(rows, 2)), 1e-300)
        x, scale = fitted.coordinates[free], self.scale[free]
        low, high = (self.lower[free] - x) / scale, (self.upper[free] - x) / scale
        found = lsq_linear(
            np.vstack([rows, weight * np.eye(len(free))]),
            -np.concatenate([fitted.residuals + fitted.jacobian @ step, np.zeros(len(free))]),
            bounds=(np.minimum(low, 0.0), np.maximum(high, 0.0)),
            method="bvls",
        )
        step[free] = found.x * scale
        return step

    def inside(self, coordinates: Array) -> Array:
        """Return coordinates that round-off has put beyond a bound on it."""
        return np.clip(coordinates, self.lower, self.upper)


@dataclass(frozen=True, eq=False)
class Minimum:
    """Least sum of squares over some coordinates.

    Attributes
    ----------
    fitted
        Residuals and Jacobian at it, but for a last linear step.
    residuals
        Residuals after that step, to first order.
    """

    fitted: Fitted
    residuals: Array

    @property
    def squares(self) -> float:
        """Sum of squares at the minimum, twice the cost; what the last step would gain is taken off."""
        return float(self.residuals @ self.residuals)


def minimise(
    objective: Objective, start: Array, free: IntArray, tolerance: float = EXPECTED_DECREASE
) -> Minimum:
    """Return the minimum over the free coordinates by Gauss–Newton steps, damped where they fail.

    A trial point that cannot be computed counts as a step that fails.

    Raises
    ------
    SolveError
        The experiment cannot be computed at the start.
    """
    here, damping = objective.at(objective.inside(start)), 0.0
    nothing = np.zeros(len(here.coordinates))
    for _ in range(MOST_STEPS):
        step = objective.step(here, free, nothing, damping)
        linear = here.residuals + here.jacobian @ step
        expected = 2 * here.cost - float(linear @ linear)
        if expected < tolerance:
            break
        trial = _tried(objective, here.coordinates + step)
        if trial is not None and trial.cost < here.cost - 1e-4 * expected / 2:
            here, damping = trial, damping / DAMPING_FACTOR if damping > FIRST_DAMPING else 0.0
            continue
        if damping >= MOST_DAMPING:
            break
        damping = max(damping * DAMPING_FACTOR, FIRST_DAMPING)
    # A large damping expects little because it moves little; what is left is then not known.
    is_last = damping == 0.0 and 0.0 <= expected < tolerance
    return Minimum(here, linear if is_last else here.residuals)


def _finite(fitted: Fitted) -> Fitted:
    if not (np.isfinite(fitted.residuals).all() and np.isfinite(fitted.jacobian).all()):
        raise SolveError("the predicted curves, or their derivatives, are not finite numbers")
    return fitted


def _tried(objective: Objective, coordinates: Array) -> Fitted | None:
    try:
        return objective.at(objective.inside(coordinates))
    except SolveError:
        return None


#: Singular values below this share of the largest are round-off: the data do not depend on the direction.
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
    def _floored(self) -> Array:
        """Singular values, those of round-off replaced by what round-off can hide."""
        floor = ROUND_OFF * float(self.singular_values[0]) + float(np.finfo(np.float64).tiny)
        return np.maximum(self.singular_values, floor)

    @property
    def is_round_off(self) -> npt.NDArray[np.bool_]:
        """True for singular values that are zero to round-off, (k,)."""
        return np.asarray(self.singular_values < self._floored)

    @property
    def covariance(self) -> Array:
        """Covariance of the coordinates (k, k) as far as round-off allows, always finite."""
        scaled = self.directions / self._floored[:, None]
        return np.asarray(scaled.T @ scaled)

    @property
    def deviations(self) -> Array:
        """Standard deviations of the coordinates (k,); infinite where a direction of round-off moves one."""
        lost = (np.abs(self.directions[self.is_round_off]) > 1e-6).any(axis=0)
        return np.where(lost, np.inf, self.spread)

    @property
    def spread(self) -> Array:
        """Deviations (k,) as far as round-off allows, always finite, to compare unknowns by them."""
        return np.sqrt(np.diag(self.covariance))

    def moves_with(self, slopes: Array) -> tuple[Array, float]:
        """Return covariances (k,) with the coordinates, and deviation, of a number with slopes (k,) by these.

        The deviation is infinite where a direction of round-off moves the number; else such directions do not count.
        """
        along, lost = self.directions @ slopes, self.is_round_off
        size = float(np.linalg.norm(slopes))
        if (np.abs(along[lost]) > 1e-6 * size).any():
            return np.full_like(slopes, np.nan), np.inf
        scaled = np.where(lost, 0.0, along / self._floored)
        covariances = self.directions.T @ np.where(lost, 0.0, scaled / self._floored)
        return np.asarray(covariances), float(np.linalg.norm(scaled))

    @property
    def correlations(self) -> Array:
        """Correlations of the coordinates (k, k), with their limits where deviations are infinite."""
        return self.covariance / np.outer(self.spread, self.spread)
