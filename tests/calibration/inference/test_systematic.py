"""A known error of the predicted curves: how far it moves the best values, and intervals that hold it."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.commands.calibration.infer import infer
from porocore.commands.calibration.problem import Misfit, NormalPrior, Unknown
from porocore.commands.calibration.suggestions import SMALL, SystematicError, shift_words
from tests.helpers.calibration_models import Formula, data_of, misfit_of

T = np.linspace(0.1, 2.0, 40)
TRUTH, DEVIATION = np.array([2.0, 1.3]), 0.02
UNKNOWNS = (Unknown("size", 1.0, 0.01, 20.0, "log"), Unknown("rate", 1.0, 0.01, 20.0, unit="1/s"))


def decay(v):
    return v[0] * np.exp(-v[1] * T)


def late(v, delay=0.02):
    """The same with an error as that of long steps: everything comes late."""
    return v[0] * np.exp(-v[1] * (T - delay))


def inferred(noise, unknowns=UNKNOWNS, formula=late):
    values = decay(TRUTH) + DEVIATION * noise
    misfit = Misfit(Formula(unknowns, formula), data_of(values, DEVIATION, T))
    return infer(misfit, misfit.at(misfit.start), rays=0)


def errors(found):
    at = found.values
    return (late(at) - decay(at)) / DEVIATION


def test_exact_curves_have_their_best_values_where_it_is_said():
    """Against the fit of the exact model to the same data."""
    noise = np.random.default_rng(1).normal(size=len(T))
    found, exact = inferred(noise), inferred(noise, formula=decay)
    told = found.with_error(errors(found)).systematic
    moved = found.best.coordinates + told.shift
    deviations = exact.with_priors.deviations
    assert np.abs(exact.best.coordinates - found.best.coordinates).max() > 2 * deviations.min()
    np.testing.assert_allclose(moved, exact.best.coordinates, atol=0.1 * deviations.min())
    np.testing.assert_allclose(told.deviations, told.shift / found.with_priors.deviations, rtol=1e-9)


def test_the_intervals_hold_the_truth_that_they_would_miss():
    """Over 100 made-up experiments: 95 % of the intervals with the error, far fewer without it."""
    rng, without, counted = np.random.default_rng(5), 0, 0
    for _ in range(100):
        found = inferred(rng.normal(size=len(T)))
        wide = found.with_error(errors(found))
        assert wide.systematic.counted
        for one, interval in ((0, found.intervals[0]), (1, wide.intervals[0])):
            low, high = interval.values
            held = low < TRUTH[0] < high
            without, counted = (without, counted + held) if one else (without + held, counted)
        low, high = wide.intervals[0].values
        old_low, old_high = found.intervals[0].values
        assert (low, high) != (old_low, old_high)
        assert low == old_low or high == old_high
    assert without < 70
    assert counted >= 93


def test_a_small_error_leaves_the_intervals_alone():
    found = inferred(np.random.default_rng(2).normal(size=len(T)))
    small = errors(found) * SMALL / found.with_error(errors(found)).systematic.size
    told = found.with_error(0.99 * small)
    assert told.intervals is found.intervals
    assert told.systematic.is_small
    assert not told.systematic.counted
    assert found.with_error(1.01 * small).systematic.counted
    # Made-up data have the same error.
    same = found.with_error(errors(found), counts=False)
    assert same.intervals is found.intervals
    assert same.systematic.size > SMALL


def test_a_widened_interval_may_leave_an_unknown_not_identifiable():
    found = inferred(np.zeros(len(T)))
    assert found.identifiable == (True, True)
    wide = found.with_error(8 * errors(found))
    assert wide.identifiable[0] is False


def test_an_error_has_no_effect_against_a_sharp_prior():
    unknowns = (replace(UNKNOWNS[0], prior=NormalPrior(float(np.log(2.0)), 1e-4)), UNKNOWNS[1])
    found = inferred(np.zeros(len(T)), unknowns)
    told = found.with_error(errors(found))
    assert abs(told.systematic.shift[0]) < 1e-5
    low, high = told.intervals[0].values
    assert high - low < 1e-3
    # By the data alone it moves.
    low, high = told.data_intervals[0].values
    assert high - low > 0.05


def test_an_end_that_is_moved_beyond_the_bounds_is_none():
    unknowns = (replace(UNKNOWNS[0], lower=2.0, start=2.1), UNKNOWNS[1])
    found = inferred(np.zeros(len(T)), unknowns, lambda v: late(v, -0.05))
    at = found.values
    told = found.with_error((late(at, -0.05) - decay(at)) / DEVIATION)
    low = told.intervals[0].low
    assert found.intervals[0].low.value is not None
    assert low.value is None
    assert low.reason == "an error of the curves moves it beyond the bound of the search, 2"


def test_what_is_not_seen_is_moved_by_nothing():
    unknowns = (*UNKNOWNS, Unknown("other", 1.0, 0.01, 20.0, "log"))
    misfit = misfit_of(Formula(unknowns, lambda v: decay(v) * v[2]), [2.0, 1.3, 1.0], DEVIATION)
    jacobian = misfit.at(np.array([np.log(2.0), 1.3, 0.0])).jacobian
    told = SystematicError.at_best(np.full(len(T), 0.1), jacobian, np.full(3, 0.1))
    assert told.deviations[0] == told.deviations[2] == 0
    assert told.deviations[1] != 0
    assert np.isfinite(told.shift).all()
    # The part that the unknowns cannot follow moves nothing either.
    left = np.linalg.svd(jacobian)[0][:, -1]
    assert SystematicError.at_best(left, jacobian, np.full(3, 0.1)).size < 1e-9


def test_the_moves_in_words():
    error = SystematicError(np.ones(3), np.array([0.0, 0.1]), np.array([0.0, 3.0]), 3.0)
    told = shift_words(UNKNOWNS, np.array([0.0, 1.3]), error)
    assert told == "rate would be 1.4 1/s instead of 1.3 1/s (3 standard deviations away)"
    both = replace(error, deviations=np.full(2, 0.1), size=0.9)
    assert "combinations of unknowns would move by 0.9 standard deviations" in shift_words(
        UNKNOWNS, np.zeros(2), both
    )


@pytest.mark.parametrize("size", [1.0, 1e6])
def test_moves_do_not_depend_on_units(size):
    jacobian = np.random.default_rng(3).normal(size=(30, 2)) @ np.diag([10.0, 2.0])
    factors = np.array([size, 1.0])
    one = SystematicError.at_best(np.ones(30), jacobian, np.full(2, 0.1))
    other = SystematicError.at_best(np.ones(30), jacobian / factors, 0.1 * factors)
    np.testing.assert_allclose(other.shift, one.shift * factors, rtol=1e-9)
    np.testing.assert_allclose(other.deviations, one.deviations, rtol=1e-9)
