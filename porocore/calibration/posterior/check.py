"""Check of an interpolated density by exact runs (DensityCheck), at its draws and at those of broader densities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from porocore.calibration.posterior.ensemble import ensemble_draws
from porocore.calibration.posterior.interpolant import ResidualInterpolant
from porocore.calibration.problem import Fitted, Misfit
from porocore.errors import SolveError
from porocore.states import Array

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
