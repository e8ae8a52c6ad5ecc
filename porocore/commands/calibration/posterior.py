"""Posterior distribution of the unknowns (Posterior): ensemble of walkers, interpolant, exact checks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np
from scipy.special import logsumexp

from porocore.commands.calibration.problem import Fitted, Misfit, Unknown
from porocore.commands.calibration.settings import PosteriorSettings
from porocore.errors import ConfigurationError, SolveError
from porocore.states import Array

#: Share of the steps that are left out at the beginning.
BURN_IN = 0.25
#: Steps between two reports of the progress.
REPORTED = 100


@dataclass(frozen=True, eq=False)
class EnsembleDraws:
    """Draws of all walkers.

    Attributes
    ----------
    steps : (s, w, k)
        Position of each walker after each step that is kept.
    autocorrelation
        Steps after which a walker has forgotten where it was, the largest of the k; NaN where there are too few.
    """

    steps: Array
    autocorrelation: float

    @property
    def flat(self) -> Array:
        """All draws, (s·w, k)."""
        return self.steps.reshape(-1, self.steps.shape[2])


def require_emcee() -> Any:
    """Return the package emcee.

    Raises
    ------
    ConfigurationError
        It cannot be imported.
    """
    try:
        return import_module("emcee")
    except ImportError as error:
        raise ConfigurationError(
            f"needs emcee, which cannot be imported here ({error}); pip install emcee, or remove the section"
        ) from error


def ensemble_draws(
    log_density: Callable[[Array], Array],
    first: Array,
    steps: int,
    seed: int,
    tell: Callable[[int], None] = lambda step: None,
) -> EnsembleDraws:
    """Return draws from a density by affine-invariant stretch moves (Goodman & Weare 2010).

    Parameters
    ----------
    log_density
        Its logarithm (n,) at points (n, k).
    first : (w, k)
        First positions of the walkers.
    steps
        Steps of each walker; the first quarter is left out.
    seed
        Of the random numbers.
    tell
        Called with the number of steps that are done, now and then.
    """
    emcee = require_emcee()
    sampler = emcee.EnsembleSampler(*first.shape, log_density, vectorize=True)
    start = emcee.State(first, random_state=np.random.RandomState(seed).get_state())
    for step, _ in enumerate(sampler.sample(start, iterations=steps, skip_initial_state_check=True)):
        if step % REPORTED == 0:
            tell(step)
    kept = np.asarray(sampler.get_chain(discard=int(BURN_IN * steps)), dtype=float)
    with np.errstate(invalid="ignore", divide="ignore"):
        times = emcee.autocorr.integrated_time(kept, quiet=True, tol=0)
    return EnsembleDraws(kept, float(np.max(times)))


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


#: Root mean square error of ln of the density at draws, and total variation distance of the distributions, from which
#: a check is not passed. No probability, so no place of a median or of an end either, is off by more than the latter.
LARGEST_ERROR, LARGEST_DISTANCE = 0.1, 0.05
#: Powers of the broader densities, the least broad one first. Where the interpolated density is too low by mistake,
#: its own draws never come; those of a power of it do.
POWERS = (0.5, 0.25)
#: Draws of a broader density by which its integral is estimated.
ENOUGH = 4000


@dataclass(frozen=True, eq=False)
class DensityCheck:
    """Exact evaluations next to an interpolated density, and the errors that they show.

    Attributes
    ----------
    exact
        Evaluations.
    error
        Root mean square of (interpolated − exact) ln of the density at draws, less its mean; NaN where fewer than two
        could be computed.
    distance
        Total variation distance between the interpolated and the exact distribution, between 0 and 1, estimated from
        all evaluations by their importance weights; NaN likewise.
    drawn, beyond
        Number of draws that were checked, and of those that could not be computed or leave the trusted states.
    """

    exact: tuple[Fitted, ...]
    error: float
    distance: float
    drawn: int
    beyond: int

    @property
    def passed(self) -> bool:
        """True where both errors are small enough."""
        return self.error <= LARGEST_ERROR and self.distance <= LARGEST_DISTANCE

    @property
    def complaint(self) -> str:
        """One sentence on what is to be doubted where it is not passed."""
        return (
            f"the posterior is drawn from a density whose ln is off by {self.error:.2g} (root mean square at "
            f"{self.drawn} draws), expected at most {LARGEST_ERROR:g}, and whose probabilities are off by up to "
            f"{self.distance:.2g}, expected at most {LARGEST_DISTANCE:g}; raise posterior.checks, narrow the bounds, "
            "or rely on the intervals of the profiles"
        )


def checked(
    misfit: Misfit,
    interpolant: ResidualInterpolant,
    draws: Array,
    broader: Sequence[Array],
    count: int,
    random: np.random.Generator,
) -> DensityCheck:
    """Return the check of an interpolated density at some of its draws and of those of broader densities.

    Half of the points are draws, the others come from the densities to the powers :data:`POWERS` in turn. Together they
    are points of the mixture of these densities, which is nowhere much smaller than the interpolated one (defensive
    importance sampling, Hesterberg 1995, Technometrics 37:185–194).

    Parameters
    ----------
    misfit
        Gives the exact residuals.
    interpolant
        Gives the interpolated ones.
    draws : (n, k)
        Draws from its density in standard coordinates.
    broader : each (n, k)
        The same of its powers.
    count
        Number of points.
    random
        Chooses them.
    """
    drawn = (count + 1) // 2
    shares = np.array([drawn, *(len(range(i, count - drawn, len(POWERS))) for i in range(len(POWERS)))])
    points = [
        each[random.choice(len(each), int(share), replace=False)]
        for each, share in zip([draws, *broader], shares, strict=True)
    ]
    exact, costs, kept, beyond = [], [], [], 0
    for i, standard in enumerate(np.concatenate(points)):
        try:
            found = misfit.at(interpolant.coordinates(standard[None])[0])
        except SolveError:
            beyond += i < drawn
            continue
        beyond += i < drawn and found.prediction.flagged
        exact.append(found)
        costs.append(found.cost)
        kept.append((i < drawn, standard))
    if len(kept) < 2:
        return DensityCheck(tuple(exact), np.nan, np.nan, drawn, beyond)
    interpolated = interpolant.log_density(np.array([standard for _, standard in kept]))
    errors = -np.array(costs) - interpolated
    own = errors[[is_draw for is_draw, _ in kept]]
    error = float(np.std(own, ddof=1)) if len(own) > 1 else np.nan
    chance = _log_mixture(interpolated, shares / count, _log_integrals(interpolant, broader))
    return DensityCheck(tuple(exact), error, _distance(errors, interpolated - chance), drawn, beyond)


def broader_draws(
    interpolant: ResidualInterpolant, first: Sequence[Array], steps: int, random: np.random.Generator
) -> list[Array]:
    """Return draws (n, k) of each power of an interpolated density, from first positions (w, k) for each."""
    found = []
    for power, start in zip(POWERS, first, strict=True):

        def log_density(standard: Array, power: float = power) -> Array:
            return power * interpolant.log_density(standard)

        found.append(ensemble_draws(log_density, start, steps, int(random.integers(2**31))).flat)
    return found


def _log_integrals(interpolant: ResidualInterpolant, broader: Sequence[Array]) -> Array:
    """Return ln of the integrals of the density and of its powers, less that of the broadest."""
    powers, found = [1.0, *POWERS], [0.0]
    for i in reversed(range(len(broader))):
        some = broader[i][:: max(1, len(broader[i]) // ENOUGH)]
        logarithms = (powers[i] - powers[i + 1]) * interpolant.log_density(some)
        found.insert(0, found[0] + float(logsumexp(logarithms)) - np.log(len(some)))
    return np.array(found)


def _log_mixture(log_density: Array, shares: Array, log_integrals: Array) -> Array:
    """Return ln of the mixture's density (n,) where ln of the interpolated one is (n,)."""
    powers = np.array([1.0, *POWERS])
    return np.asarray(logsumexp(np.outer(log_density, powers) - log_integrals, b=shares, axis=1))


def _distance(errors: Array, log_weights: Array) -> float:
    """Return the total variation distance of two densities from points of a third.

    Parameters
    ----------
    errors : (n,)
        ln of the exact density over the interpolated one, up to a constant.
    log_weights : (n,)
        ln of the interpolated one over that of the points.
    """
    interpolated = np.exp(log_weights - logsumexp(log_weights))
    exact = np.exp(log_weights + errors - logsumexp(log_weights + errors))
    return 0.5 * float(np.abs(exact - interpolated).sum())


#: Times that points are added.
MOST_ROUNDS = 4
#: The broader densities of a check have so many times fewer steps.
SHORTER = 4
#: Steps a walker makes in so many autocorrelation times, for the draws to be worth their number (emcee's rule).
LONG = 50
#: Bins of the draws; an end is none where the density at a bound is larger than this share of the highest bin,
#: which on a normal distribution it is within 1.96 standard deviations.
BINS, AT_BOUND = 30, 0.15


@dataclass(frozen=True, eq=False)
class Posterior:
    """Draws from the posterior distribution.

    Attributes
    ----------
    unknowns
        The k unknowns.
    coordinates : (s, w, k)
        Draws of w walkers at s steps, each unknown in its coordinate.
    autocorrelation
        Steps after which a walker has forgotten where it was.
    check
        Last check of the interpolated density that the draws are from.
    runs
        Evaluations for all checks.
    """

    unknowns: tuple[Unknown, ...]
    coordinates: Array
    autocorrelation: float
    check: DensityCheck
    runs: int

    @cached_property
    def values(self) -> Array:
        """All draws as values of the unknowns, (s·w, k)."""
        flat = self.coordinates.reshape(-1, len(self.unknowns))
        return np.stack(
            [np.exp(x) if one.scale == "log" else x for one, x in zip(self.unknowns, flat.T, strict=True)],
            axis=1,
        )

    @property
    def medians(self) -> Array:
        """Medians (k,) of the values."""
        return np.asarray(np.median(self.values, axis=0))

    @property
    def intervals(self) -> tuple[tuple[float | None, float | None], ...]:
        """Credible intervals of 95 %, 2.5 % on each side; None for an end where the density goes on at a bound."""
        ends = np.quantile(self.values, [0.025, 0.975], axis=0)
        cut = [self._cut(i) for i in range(len(self.unknowns))]
        return tuple(
            (None if below else float(low), None if above else float(high))
            for low, high, (below, above) in zip(*ends, cut, strict=True)
        )

    @property
    def independent(self) -> float:
        """Number of independent draws that these are worth."""
        return float(self.coordinates.shape[0] * self.coordinates.shape[1] / self.autocorrelation)

    @property
    def complaints(self) -> tuple[str, ...]:
        """Sentences on what is to be doubted."""
        steps, found = len(self.coordinates), []
        if not steps >= LONG * self.autocorrelation:
            found.append(
                f"the posterior has {steps} steps of each walker, expected at least {LONG} autocorrelation times of "
                f"{self.autocorrelation:.3g} steps; raise posterior.steps"
            )
        if not self.check.passed:
            found.append(self.check.complaint)
        if self.check.beyond:
            found.append(
                f"{self.check.beyond} of {self.check.drawn} checked draws of the posterior cannot be computed, or "
                "leave the states that the surrogate is trusted in; narrow the bounds, or sample wider ranges"
            )
        return tuple(found)

    def entries(self) -> dict[str, Any]:
        """Return the entry of a JSON file; medians and intervals in the units of the unknowns."""
        names = [one.name for one in self.unknowns]
        return {
            "unknowns": {
                name: {"median": median, "interval95": ends}
                for name, median, ends in zip(names, self.medians, self.intervals, strict=True)
            },
            "steps": self.coordinates.shape[0],
            "walkers": self.coordinates.shape[1],
            "autocorrelation": self.autocorrelation,
            "independent_draws": self.independent,
            "log_density_error": self.check.error,
            "total_variation": self.check.distance,
            "checked": self.check.drawn,
            "beyond": self.check.beyond,
            "runs": self.runs,
        }

    def _cut(self, index: int) -> tuple[bool, bool]:
        """Return whether the density of an unknown goes on at its lower and at its upper bound."""
        one, x = self.unknowns[index], self.coordinates[..., index].ravel()
        low, high = one.coordinate(one.lower), one.coordinate(one.upper)
        counts, edges = np.histogram(x, BINS)
        width, most = edges[1] - edges[0], AT_BOUND * counts.max()
        return (
            bool(edges[0] - low < width and counts[0] > most),
            bool(high - edges[-1] < width and counts[-1] > most),
        )


def sample_posterior(
    misfit: Misfit,
    points: Sequence[Fitted],
    best: Fitted,
    settings: PosteriorSettings,
    tell: Callable[[str, float], None] = lambda words, share: None,
) -> Posterior:
    """Return draws from the posterior distribution of the unknowns.

    Its density goes with exp(−S/2), where S is the sum of squares with priors; without a prior it is flat in the
    coordinate between the bounds. The residuals are interpolated between the points, and some draws are computed
    exactly. Where these show a larger error than :data:`LARGEST_ERROR` they become points, and the draws are made anew.

    Parameters
    ----------
    misfit
        Of model and data.
    points
        Evaluations of it, such as those of an inference.
    best
        Its best point.
    settings
        Steps, walkers, checks, seed.
    tell
        Called with what is done and its share of all.

    Raises
    ------
    ConfigurationError
        emcee is missing.
    """
    random = np.random.default_rng(settings.seed)
    known, runs = [*points], 0
    lower, upper = misfit.bounds
    walkers = settings.walkers_of(len(lower))
    for round_ in range(MOST_ROUNDS + 1):
        interpolant = ResidualInterpolant(known, best, lower, upper)

        def show(step: int, round_: int = round_) -> None:
            tell(f"step {step} of {settings.steps}", (round_ + step / settings.steps) / (MOST_ROUNDS + 1))

        first = interpolant.standard(_scattered(interpolant, walkers, random))
        draws = ensemble_draws(
            interpolant.log_density, first, settings.steps, int(random.integers(2**31)), show
        )
        starts = [interpolant.standard(_scattered(interpolant, walkers, random)) for _ in POWERS]
        broader = broader_draws(interpolant, starts, max(settings.steps // SHORTER, 100), random)
        check = checked(misfit, interpolant, draws.flat, broader, settings.checks, random)
        runs += settings.checks
        if check.passed or check.beyond > check.drawn / 2:
            break
        known += check.exact
    coordinates = interpolant.coordinates(draws.flat).reshape(draws.steps.shape)
    return Posterior(
        tuple(misfit.unknowns),
        coordinates,
        draws.autocorrelation,
        check,
        runs,
    )


def _scattered(interpolant: ResidualInterpolant, count: int, random: np.random.Generator) -> Array:
    """Return points (count, k) of the distribution to first order, folded into the bounds."""
    x = interpolant.coordinates(random.standard_normal((count, len(interpolant.lower))))
    room = interpolant.upper - interpolant.lower
    return np.asarray(interpolant.lower + room - np.abs((x - interpolant.lower) % (2 * room) - room))
