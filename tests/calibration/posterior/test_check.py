"""Check of an interpolated density against integrals on a grid: a mode that its own draws never visit."""

import numpy as np
import pytest

from porocore.commands.calibration.posterior import (
    LARGEST_ERROR,
    ResidualInterpolant,
    broader_draws,
    checked,
    ensemble_draws,
)
from porocore.commands.calibration.problem import Unknown
from tests.helpers.calibration_models import Formula, misfit_of

T = np.linspace(0.5, 1.0, 4)
NOISE, LOWER, UPPER = 0.2, -1.4, 3.0


@pytest.fixture
def misfit():
    """One unknown, whose sign the data do not see: two modes, at ±1."""
    pytest.importorskip("emcee", reason="pip install emcee")
    model = Formula((Unknown("angle", 1.0, LOWER, UPPER),), lambda v: np.cos(v[0]) * T)
    return misfit_of(model, [1.0], NOISE)


def drawn(misfit, points):
    """The interpolant between points, and a function that checks it at a number of points."""
    points = [misfit.at(np.array([x])) for x in points]
    interpolant = ResidualInterpolant(points, points[0], *misfit.bounds)
    first = interpolant.standard(np.random.default_rng(0).uniform(0.5, 1.5, (32, 1)))
    draws = ensemble_draws(interpolant.log_density, first, 400, 0).flat
    broader = broader_draws(interpolant, [first, first], 400, np.random.default_rng(1))

    def check(count, seed=0):
        return checked(misfit, interpolant, draws, broader, count, np.random.default_rng(seed))

    return interpolant, check


def distance_of(misfit, interpolant):
    """Total variation distance by sums over a grid."""
    x = np.linspace(LOWER, UPPER, 2001)
    exact = np.exp(-0.5 * ((((np.cos(x)[:, None] - np.cos(1.0)) * T) / NOISE) ** 2).sum(axis=1))
    found = np.exp(interpolant.log_density(interpolant.standard(x[:, None])))
    return 0.5 * np.abs(exact / exact.sum() - found / found.sum()).sum()


def test_a_mode_that_the_draws_never_visit_is_seen_by_those_of_broader_densities(misfit):
    interpolant, check = drawn(misfit, [1.0, 0.2, 0.4, 0.6, 0.8, 1.2, 1.4, 1.6, 2.0])
    exact = distance_of(misfit, interpolant)
    # Half of the probability is in the other mode.
    assert exact == pytest.approx(0.5, abs=0.01)
    many = [check(1000, seed).distance for seed in range(4)]
    assert np.mean(many) == pytest.approx(exact, abs=2 * np.std(many, ddof=1))
    few = [check(24, seed) for seed in range(20)]
    # Draws alone nearly always say that the density is right.
    assert sum(each.error <= LARGEST_ERROR for each in few) >= 15
    assert sum(each.passed for each in few) <= 5
    failed = next(each for each in few if not each.passed)
    assert "off by up to" in failed.complaint


def test_the_distance_is_that_of_a_grid_where_both_modes_are_known(misfit):
    interpolant, check = drawn(misfit, [1.0, -1.0, *np.linspace(-1.3, 2.8, 8)])
    assert check(1000).distance == pytest.approx(distance_of(misfit, interpolant), abs=0.01)
    assert check(1000).passed


def test_half_of_the_points_are_draws_and_those_beyond_are_counted_among_these(misfit):
    _, check = drawn(misfit, [0.5, 1.5])
    found = check(9)
    assert (found.drawn, found.beyond, len(found.exact)) == (5, 0, 9)
    misfit.model.computable = ((1.0, 1.0),)
    found = check(9, seed=1)
    assert (found.beyond, found.exact) == (5, ())
    assert np.isnan(found.distance)
    assert not found.passed
