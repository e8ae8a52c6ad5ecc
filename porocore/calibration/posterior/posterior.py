"""Posterior distribution of the unknowns (Posterior): draws, credible intervals, check by exact runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from porocore.calibration.config.settings import PosteriorSettings
from porocore.calibration.posterior.check import POWERS, DensityCheck, broader_draws, checked
from porocore.calibration.posterior.ensemble import ensemble_draws
from porocore.calibration.posterior.interpolant import ResidualInterpolant
from porocore.calibration.problem import Fitted, Misfit, Unknown
from porocore.states import Array

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
                name: {"median": float(median), "interval95": list(ends)}
                for name, median, ends in zip(names, self.medians, self.intervals, strict=True)
            },
            "steps": self.coordinates.shape[0],
            "walkers": self.coordinates.shape[1],
            "autocorrelation": _finite(self.autocorrelation),
            "independent_draws": _finite(self.independent),
            "log_density_error": _finite(self.check.error),
            "total_variation": _finite(self.check.distance),
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


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
