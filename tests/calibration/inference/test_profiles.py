"""Intervals by profile likelihood against closed forms, and ends that are none."""

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from porocore.commands.calibration.infer import infer
from porocore.commands.calibration.minimum import Objective, minimise
from porocore.commands.calibration.problem import Misfit, NormalPrior, Unknown
from porocore.commands.calibration.profiles import confidence_interval
from tests.helpers.calibration_models import Formula, data_of, misfit_of

T = np.linspace(0.1, 2.0, 15)


def started(misfit, **how):
    return infer(misfit, misfit.at(misfit.start), rays=0, **how)


def line(prior=None, **bounds):
    bounds = {"lower": -50.0, "upper": 50.0, **bounds}
    unknowns = (Unknown("offset", 0.3, **bounds, prior=prior), Unknown("slope", 0.7, -50.0, 50.0))
    return Formula(unknowns, lambda v: v[0] + v[1] * T)


NOISE = np.random.default_rng(0).normal(size=15)


@pytest.mark.parametrize("prior", [None, NormalPrior(1.0, 0.05)])
def test_intervals_of_a_linear_model_are_exact(prior):
    misfit = misfit_of(line(prior), [1.0, 2.0], 0.1, NOISE)
    found = started(misfit)
    rows = np.stack([np.ones(15), T], axis=1) / 0.1
    target = misfit.data.values / 0.1
    if prior is not None:
        rows, target = np.vstack([rows, [1 / 0.05, 0]]), np.append(target, 1.0 / 0.05)
    best = np.linalg.solve(rows.T @ rows, rows.T @ target)
    half = 1.959963984540054 * np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    np.testing.assert_allclose(found.values, best, rtol=1e-10)
    for i, interval in enumerate(found.intervals):
        assert interval.values == pytest.approx((best[i] - half[i], best[i] + half[i]), abs=1e-8)
    rows = rows[:15]
    without = 1.959963984540054 * np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    for i, interval in enumerate(found.data_intervals):
        assert interval.values[1] - interval.values[0] == pytest.approx(2 * without[i], abs=1e-8)
    np.testing.assert_allclose(found.with_priors.deviations * 1.959963984540054, half, rtol=1e-10)
    np.testing.assert_allclose(found.without_priors.deviations * 1.959963984540054, without, rtol=1e-10)


def test_a_linear_model_takes_few_evaluations():
    found = started(misfit_of(line(), [1.0, 2.0], 0.1, NOISE))
    # The start, the best point, and one for each end.
    assert found.evaluations == 6


def test_the_profile_of_one_rate_is_its_rise():
    model = Formula((Unknown("rate", 1.0, 0.01, 20.0, "log"),), lambda v: np.exp(-v[0] * T))
    misfit = misfit_of(model, [1.3], 0.15, NOISE)
    found = started(misfit)

    def squares(rate):
        return (((np.exp(-rate * T) - misfit.data.values) / 0.15) ** 2).sum()

    best = minimize_scalar(squares, bounds=(0.1, 10), method="bounded", options={"xatol": 1e-12}).x
    rise = lambda rate: squares(rate) - squares(best) - 3.841458820694124  # noqa: E731
    expected = brentq(rise, 0.05, best), brentq(rise, best, 20.0)
    assert found.intervals[0].values == pytest.approx(expected, rel=1e-4)
    # It is far from symmetric: the normal distribution would not do.
    low, high = expected
    assert (high - best) / (best - low) > 1.3


def test_an_interval_of_two_unknowns_is_that_of_the_nested_minimum():
    unknowns = (Unknown("size", 1.0, 0.01, 20.0, "log"), Unknown("rate", 1.0, 0.01, 20.0))
    misfit = misfit_of(Formula(unknowns, lambda v: v[0] * np.exp(-v[1] * T)), [2.0, 1.3], 0.2, NOISE)
    found = started(misfit)
    y = misfit.data.values

    def squares(rate):
        shape = np.exp(-rate * T)
        size = shape @ y / (shape @ shape)
        return (((size * shape - y) / 0.2) ** 2).sum()

    best = minimize_scalar(squares, bounds=(0.1, 10), method="bounded", options={"xatol": 1e-12}).x
    rise = lambda rate: squares(rate) - squares(best) - 3.841458820694124  # noqa: E731
    expected = brentq(rise, 0.05, best), brentq(rise, best, 20.0)
    assert found.intervals[1].values == pytest.approx(expected, rel=2e-4)
    # Points of the profile lie on it.
    points, roots = found.intervals[1].coordinates, found.intervals[1].roots
    assert (np.diff(points[:, 1]) > 0).all()
    for x, root in zip(points, roots, strict=True):
        assert root**2 == pytest.approx(squares(x[1]) - squares(best), abs=5e-4)


def product(upper=50.0, prior=None):
    unknowns = (
        Unknown("a", 2.0, 0.1, upper, "log", prior),
        Unknown("b", 3.0, 0.1, 50.0, "log"),
        Unknown("rate", 1.0, 0.01, 20.0, "log"),
    )
    return Formula(unknowns, lambda v: v[0] * v[1] * np.exp(-v[2] * T))


def test_a_product_names_its_direction_and_bounds_nothing():
    found = started(misfit_of(product(), [2.0, 3.0, 1.3], 0.02, NOISE))
    (direction,) = found.directions
    np.testing.assert_allclose(
        direction.direction * np.sign(direction.direction[0]), [0.5**0.5, -(0.5**0.5), 0], atol=1e-9
    )
    assert direction.deviation == np.inf
    assert found.words[0].startswith("Only the product a·b is identifiable, not the two separately. ")
    assert found.identifiable == (False, False, True)
    for interval in found.intervals[:2]:
        assert interval.values == (None, None)
    # Downwards b = 6/a meets its bound 50 first, upwards a its own: there b is 0.12.
    assert found.intervals[0].low.reason == "the data set no end here; only b at its bound 50 would"
    assert found.intervals[0].high.reason == (
        "the data do not exclude any value up to the bound of the search, 50"
    )
    low, high = found.intervals[2].values
    assert low < 1.3 < high


def test_a_profile_that_reaches_its_own_bound_has_no_end():
    found = started(misfit_of(product(upper=2.5), [2.0, 3.0, 1.3], 0.02, NOISE))
    assert found.intervals[0].high.reason == (
        "the data do not exclude any value up to the bound of the search, 2.5"
    )
    assert found.intervals[0].high.value is None


def test_a_prior_gives_an_interval_but_no_identifiability():
    prior = NormalPrior(np.log(2.0), 0.01)
    found = started(misfit_of(product(prior=prior), [2.0, 3.0, 1.3], 0.005, NOISE))
    half = 1.959963984540054 * 0.01
    assert found.intervals[0].values == pytest.approx((2 * np.exp(-half), 2 * np.exp(half)), rel=1e-5)
    assert found.data_intervals[0].values == (None, None)
    assert found.identifiable == (False, False, True)


def test_a_bound_of_another_unknown_that_hardly_matters_does_not_open_an_end():
    # The best point has b on its bound, which a has nothing to do with.
    unknowns = (Unknown("a", 1.0, 0.1, 10.0, "log"), Unknown("b", 0.5, 0.4, 5.0))
    rows = np.zeros(15)
    rows[:2] = 1.0
    model = Formula(unknowns, lambda v: v[0] * T * (1 - rows) + v[1] * rows)
    data = data_of(np.where(rows > 0, 0.3, 1.2 * T), 0.05)
    found = started(Misfit(model, data))
    assert found.values[1] == pytest.approx(0.4)
    low, high = found.intervals[0].values
    assert low < 1.2 < high
    assert found.intervals[1].low.value is None
    assert found.intervals[1].high.value == pytest.approx(
        brentq(lambda b: 2 * ((b - 0.3) ** 2 - 0.01) / 0.0025 - 3.841458820694124, 0.4, 1.0), rel=1e-3
    )


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ({"computable": ((0.9, 1.35),)}, "the experiment cannot be computed"),
        ({"trusted": ((0.9, 1.35),)}, "the surrogate leaves the states that it is trusted in"),
    ],
)
def test_a_profile_that_leaves_the_model_has_no_end(how, reason):
    model = Formula((Unknown("rate", 1.3, 0.01, 20.0),), lambda v: np.exp(-v[0] * T), **how)
    misfit = Misfit(model, data_of(np.exp(-1.3 * T), 0.15))
    interval = started(misfit).intervals[0]
    assert interval.high.value is None
    assert interval.high.reason.endswith(f"beyond it {reason}")
    assert interval.coordinates.max() <= 1.35
    assert interval.coordinates.max() > 1.33


def test_curves_that_are_no_numbers_end_a_profile():
    model = Formula(
        (Unknown("rate", 1.3, 0.01, 20.0),), lambda v: np.exp(-v[0] * T) + (np.nan if v[0].real > 1.35 else 0)
    )
    interval = started(Misfit(model, data_of(np.exp(-1.3 * T), 0.15))).intervals[0]
    assert interval.high.reason.endswith("beyond it the experiment cannot be computed")


def test_trials_beyond_the_model_do_not_hurt_an_end_within_it():
    # The first step of the lower end overshoots to where nothing can be computed.
    model = Formula((Unknown("rate", 1.3, -5.0, 20.0),), lambda v: np.exp(-v[0] * T))
    misfit = Misfit(model, data_of(np.exp(-1.3 * T), 0.15))
    low, high = started(misfit).intervals[0].values
    model.computable = model.trusted = ((low - 0.01, high + 0.01),)
    assert started(misfit).intervals[0].values == pytest.approx((low, high), rel=1e-3)


def test_a_fit_that_was_no_minimum_is_told_and_mended():
    # The first basin, at the start, is less deep than the other one.
    model = Formula(
        (Unknown("x", -1.0, -3.0, 3.0),), lambda v: np.array([(v[0] ** 2 - 1) * 2, (v[0] - 1) / 1.2])
    )
    misfit = Misfit(model, data_of([0.0, 0.0], 1.0))
    found = started(misfit)
    assert found.moved
    assert found.values[0] == pytest.approx(1.0, abs=1e-3)


def test_evaluations_are_counted_once():
    model = product()
    misfit = misfit_of(model, [2.0, 3.0, 1.3], 0.02, NOISE)
    calls = model.calls
    found = infer(misfit, misfit.at(misfit.start), rays=4)
    assert found.evaluations == model.calls - calls


def test_the_minimum_keeps_bounds():
    objective = Objective(misfit_of(line(upper=0.5), [1.0, 2.0], 0.1), np.ones(2))
    found = minimise(objective, np.array([0.3, 0.7]), np.arange(2))
    assert found.fitted.coordinates[0] == 0.5
    # The slope is the best one beside it.
    expected = ((1.0 + 2.0 * T - 0.5) @ T) / (T @ T)
    assert found.fitted.coordinates[1] == pytest.approx(expected, rel=1e-10)


def test_an_end_of_a_model_that_is_nearly_linear_takes_one_evaluation_and_is_exact():
    unknowns = (Unknown("level", 2.0, 0.1, 50.0, "log"), Unknown("rate", 0.5, 0.01, 50.0, "log"))
    misfit = misfit_of(Formula(unknowns, lambda v: v[0] * np.exp(-v[1] * T)), [2.0, 0.5], 0.1, NOISE)
    objective = Objective(misfit, np.ones(2))
    best = minimise(objective, misfit.start, np.arange(2))
    before = objective.evaluations
    found = confidence_interval(objective, best, 1)
    assert objective.evaluations == before + 2

    def squares(rate):
        # The best level at a rate is linear least squares.
        shape, data = np.exp(-rate * T) / 0.1, misfit.data.values / 0.1
        return data @ data - (shape @ data) ** 2 / (shape @ shape)

    rate = minimize_scalar(squares, bounds=(0.3, 0.8), method="bounded", options={"xatol": 1e-10}).x
    rise = squares(rate) + 1.959963984540054**2
    ends = brentq(lambda r: squares(r) - rise, 0.2, rate), brentq(lambda r: squares(r) - rise, rate, 1.0)
    assert found.values == pytest.approx(ends, abs=1e-3 * (ends[1] - ends[0]))


def test_an_end_beyond_a_bound_is_none_however_near_it_is():
    # At the bound the root of the rise is 1.90 of the 1.96, from where a Newton step would reach it.
    half = 1.9 / np.linalg.norm(T / 0.1)
    best = float(T @ (2.0 * T + 0.1 * NOISE)) / float(T @ T)
    model = Formula((Unknown("slope", 1.9, 0.1, best + half),), lambda v: v[0] * T)
    (interval,) = started(misfit_of(model, [2.0], 0.1, NOISE)).intervals
    assert interval.high.value is None
    assert interval.low.value is not None
