"""Bounded least squares (Objective), first-order precision, and non-identifiable directions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from porocore.commands.calibration.problem import Fitted, Misfit
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
    """

    def __init__(self, misfit: Misfit, scale: Array, priors: bool = True) -> None:
        self.misfit, self.scale, self._priors = misfit, scale, priors
        self.lower, self.upper = misfit.bounds
        self._known: dict[bytes, Fitted | SolveError] = {}

    def without_priors(self) -> Objective:
        """Return the objective of the data alone, which shares all evaluations."""
        made = Objective(self.misfit, self.scale, priors=False)
        made._known = self._known
        return made

    def add(self, fitted: Fitted) -> None:
        """Take over an evaluation that was made elsewhere."""
        self._known[fitted.coordinates.tobytes()] = fitted

    @property
    def evaluations(self) -> int:
        """Points that are known."""
        return len(self._known)

    @property
    def points(self) -> tuple[Fitted, ...]:
        """Evaluations that could be computed, in the order they were made, priors included."""
        return tuple(each for each in self._known.values() if isinstance(each, Fitted))

    def at(self, coordinates: Array) -> Fitted:
        """Return residuals and Jacobian at coordinates (k,).

        Raises
        ------
        SolveError
            The experiment cannot be computed there.
        """
        x = np.array(coordinates, dtype=float)
        key = x.tobytes()
        if key not in self._known:
            try:
                self._known[key] = _finite(self.misfit.at(x))
            except SolveError as error:
                self._known[key] = error
        found = self._known[key]
        if isinstance(found, SolveError):
            raise found
        if self._priors:
            return found
        data = len(self.misfit.data.values)
        return Fitted(x, found.prediction, found.residuals[:data], found.jacobian[:data])

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
        """Deviations (k,) as far as round-off allows, always finite, to compare unknowns by them."""
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


#: A move that changes what a model knows of its unknowns by less than this share is exact: round-off.
EXACT = 1e-12
#: The step of a direction moves no unknown further than so many limits of the rule.
MOST_LIMITS = 4.0


@dataclass(frozen=True, eq=False)
class UnseenDirection:
    """Non-identifiable combination of unknowns.

    Attributes
    ----------
    direction : (k,)
        Unit vector over the coordinates.
    deviation
        Standard deviation along it by the data alone; infinite where they do not depend on it.
    step : (k,)
        A move of the coordinates along it: one standard deviation, or less where that is far.
    change
        Largest change of a measured value by the step to first order, in standard deviations of that value.
    exact
        True where the model does not depend on it, so that no measurement makes it identifiable.
    """

    direction: Array
    deviation: float
    step: Array
    change: float
    exact: bool = False


def exact_directions(dependence: Array, limits: Array) -> Array:
    """Return the directions (n, k), in limits, along which a model knows nothing of its unknowns.

    Parameters
    ----------
    dependence : (r, k)
        Derivatives, by the coordinates, of all that the model knows of them.
    limits : (k,)
        Of the coordinates.
    """
    rows = dependence * limits
    sizes = np.linalg.norm(rows, axis=1)
    rows = rows[sizes > 0] / sizes[sizes > 0, None]
    if not len(rows):
        return np.eye(len(limits))
    _, values, right = np.linalg.svd(rows)
    rank = int((values > EXACT * values[0]).sum())
    return _sparse(right[rank:])


def unseen_directions(
    jacobian: Array, limits: Array, dependence: Array | None = None
) -> tuple[UnseenDirection, ...]:
    """Return the non-identifiable directions of weighted data, the least identifiable one first.

    The coordinates are measured in their limits: a step by one is what makes an unknown not identifiable. In these
    units the singular vectors of the Jacobian are independent, with deviations 1/s. A direction is non-identifiable
    where one standard deviation along it moves some unknown beyond its limit. Where several are, any combination
    is; the ones with the fewest unknowns are taken as long as they are non-identifiable, too.

    Parameters
    ----------
    jacobian : (m, k)
        Derivatives of the measured values, over their standard deviations, by the coordinates; without priors.
    limits : (k,)
        Of the coordinates, by the rule of identifiability.
    dependence : (r, k)
        Derivatives, by the coordinates, of all that the model knows of the unknowns; exact directions are separated
        from the others and come first. None: it is not known.
    """
    k = len(limits)
    exact = np.zeros((0, k)) if dependence is None else exact_directions(dependence, limits)
    # The others are sought among what is left.
    rest = np.linalg.svd(exact)[2][len(exact) :] if len(exact) else np.eye(k)
    precision = LinearPrecision.from_jacobian(jacobian * limits @ rest.T)
    others = precision.directions @ rest
    unseen = others[np.abs(others).max(axis=1, initial=0.0) > precision.singular_values]
    sparse = _sparse(unseen)
    if all(_is_unseen(jacobian * limits, each) for each in sparse):
        unseen = sparse
    largest = float(precision.singular_values.max(initial=0.0))
    order = np.argsort(np.linalg.norm(jacobian @ (unseen * limits).T, axis=0), kind="stable")
    found = [_direction(jacobian, limits, each, largest, exact=True) for each in exact]
    return (*found, *(_direction(jacobian, limits, unseen[i], largest) for i in order))


def _beyond_limits(precision: LinearPrecision) -> npt.NDArray[np.bool_]:
    """Return True for singular vectors, in limits, along which one deviation moves an unknown beyond its limit."""
    return np.asarray(np.abs(precision.directions).max(axis=1) > precision.singular_values)


def unseen_count(jacobian: Array, limits: Array) -> int:
    """Return the number of non-identifiable directions of weighted data; see :func:`unseen_directions`."""
    return int(_beyond_limits(LinearPrecision.from_jacobian(jacobian * limits)).sum())


def _is_unseen(scaled: Array, direction: Array) -> bool:
    return float(np.abs(direction).max()) > float(np.linalg.norm(scaled @ direction))


def _sparse(directions: Array) -> Array:
    """Return unit directions (n, k) of the same span, each zero at the pivots of all others."""
    from scipy.linalg import qr

    if len(directions) < 2:
        return directions
    _, _, order = qr(directions, mode="economic", pivoting=True)
    made = np.linalg.solve(directions[:, order[: len(directions)]], directions)
    made[np.abs(made) < 1e-12] = 0.0
    return np.asarray(made / np.linalg.norm(made, axis=1, keepdims=True))


def _direction(
    jacobian: Array, limits: Array, scaled: Array, largest: float, exact: bool = False
) -> UnseenDirection:
    """Return the direction of a unit vector in limits; ``largest`` is the largest singular value there."""
    moves = np.abs(scaled)
    # The first unknown that counts goes up.
    scaled = scaled * np.sign(scaled[int((moves > moves.max() / 10).argmax())])
    seen = float(np.linalg.norm(jacobian @ (scaled * limits)))
    deviation = np.inf if exact or seen <= ROUND_OFF * largest else 1 / seen
    step = scaled * limits * min(deviation, MOST_LIMITS / float(np.abs(scaled).max()))
    length = float(np.linalg.norm(scaled * limits))
    change = float(np.abs(jacobian @ step).max(initial=0.0))
    return UnseenDirection(scaled * limits / length, deviation * length, step, change, exact)


def significant(direction: Array, limits: Array, share: float = 0.02) -> Iterator[int]:
    """Yield the unknowns that a direction moves, in limits, by more than a share of its largest move."""
    moves = np.abs(direction) / limits
    yield from (int(i) for i in np.flatnonzero(moves > share * moves.max()))
