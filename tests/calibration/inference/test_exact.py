"""Directions of which a model knows nothing: told apart from those that data do not see, with what is seen."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.commands.calibration.directions import (
    exact_directions,
    identifiable_product,
    non_identifiable_directions,
)
from porocore.commands.calibration.figures import correlation_figure, plane_figure, profile_figure
from porocore.commands.calibration.infer import infer
from porocore.commands.calibration.minimum import Objective, minimise
from porocore.commands.calibration.problem import Unknown
from tests.helpers.calibration_models import Formula, misfit_of
from tests.helpers.curve_experiment import model_of, planned, starts

T = np.linspace(0.1, 3, 30)
NOISE = np.random.default_rng(4).normal(size=30)
MODULUS = Unknown("modulus", 1.0, 0.01, 100.0, "log", unit="kPa")
PORE = Unknown("pore", 1.0, 0.2, 20.0, "log", unit="nm")
VISCOSITY = Unknown("viscosity", 1.0, 0.1, 5.0, "log", unit="mPa*s")
#: ln of the modulus, and of the conductivity pore²/viscosity.
KNOWN = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, -1.0]])


def relaxation(v):
    return v[0] * np.exp(-(v[1] ** 2) / v[2] * T)


@pytest.fixture(scope="module")
def found():
    misfit = misfit_of(Formula((MODULUS, PORE, VISCOSITY), relaxation), [2.0, 1.1, 1.3], 0.02, NOISE)
    return infer(misfit, misfit.at(misfit.start), rays=8, dependence=lambda x: KNOWN)


def test_the_direction_is_told_as_exact_and_what_is_seen_of_it(found):
    (direction,) = found.directions
    assert direction.exact
    assert direction.deviation == np.inf
    np.testing.assert_allclose(direction.direction, np.array([0, 1, 2]) / np.sqrt(5), atol=1e-12)
    (words,) = found.words
    assert words == (
        "Only the ratio pore²/viscosity is identifiable, not the two separately. pore + 21 % and viscosity + 46 % "
        "together change no curve at all. The model does not depend on it, so no test, load or quantity makes it "
        "identifiable: fix one of them, or report the identifiable combination."
    )


def test_the_interval_of_the_product_is_that_of_one_unknown(found):
    """Against the fit in which the conductivity itself is unknown."""
    alone = (MODULUS, Unknown("conductivity", 1.0, 1e-3, 1e3, "log"))
    model = Formula(alone, lambda v: v[0] * np.exp(-v[1] * T))
    misfit = misfit_of(model, [2.0, 1.1**2 / 1.3], 0.02, NOISE)
    known = infer(misfit, misfit.at(misfit.start), rays=0)
    (product,) = found.products
    assert (product.name, product.unit) == ("pore²/viscosity", "nm²/(mPa s)")
    assert product.value == pytest.approx(known.values[1], rel=1e-4)
    assert product.interval == pytest.approx(known.intervals[1].values, rel=1e-3)
    assert product.words.startswith("pore²/viscosity = 0.9")
    # An error of the curves that is worth one deviation widens both alike.
    errors = misfit.at(known.best.coordinates).jacobian @ np.array([0.0, 0.03])
    wide, other = found.with_error(errors), known.with_error(errors)
    assert wide.products[0].interval == pytest.approx(other.intervals[1].values, rel=1e-3)
    assert wide.products[0].interval != product.interval


def test_correlations_with_the_direction_mean_nothing(found):
    assert np.isnan(found.correlations[0, 1:]).all()
    assert np.isnan(found.correlations[1:, 0]).all()
    assert found.correlations[1, 2] == pytest.approx(1)
    texts = [text.get_text() for text in correlation_figure(found).axes[0].texts]
    assert texts == ["1", "–", "–", "–", "1", "> 0.9999", "–", "> 0.9999", "1"]


def test_nothing_is_shaded_where_there_is_no_interval(found):
    figure = profile_figure(found)
    shaded = [len(axes.patches) for axes in figure.axes]
    assert shaded == [1, 0, 0]
    (legend,) = figure.legends
    assert "95 % interval of the data" in [text.get_text() for text in legend.get_texts()]
    assert "95 % region of the data" not in [
        line.get_label() for line in plane_figure(found).axes[0].get_lines()
    ]


def test_one_end_alone_is_shaded_to_the_side():
    """A delay that may be zero, of which the data exclude long ones alone."""
    unknown = Unknown("delay", 0.1, 0.0, 3.0)
    misfit = misfit_of(Formula((unknown,), lambda v: np.exp(-T) * (1 + 0.1 * v[0] ** 2)), [0.1], 0.02, NOISE)
    found = infer(misfit, misfit.at(misfit.start), rays=0)
    assert found.data_intervals[0].low.value is None
    assert found.data_intervals[0].high.value is not None
    (panel,) = profile_figure(found).axes
    (band,) = panel.patches
    assert band.get_x() == pytest.approx(panel.get_xlim()[0])
    assert band.get_x() + band.get_width() == pytest.approx(found.data_intervals[0].high.value)


def test_an_exact_direction_and_one_that_the_data_do_not_see_are_told_apart():
    jacobian = np.stack([T, 2 * T, -T, 1e-6 * T**2], axis=1) * 100
    limits = np.full(4, 0.1)
    known = np.array([[1.0, 0, 0, 0], [0, 2, -1, 0], [0, 0, 0, 1]])
    first, *others = non_identifiable_directions(jacobian, limits, known)
    assert first.exact
    np.testing.assert_allclose(known @ first.direction, 0, atol=1e-12)
    assert len(others) == 2
    assert not any(each.exact for each in others)
    assert [each.exact for each in non_identifiable_directions(jacobian, limits)] == [False] * 3


def test_an_unknown_that_the_model_does_not_have():
    found = exact_directions(np.array([[1.0, 0.0]]), np.array([0.1, 0.3]))
    np.testing.assert_allclose(np.abs(found), [[0.0, 1.0]])
    assert exact_directions(np.zeros((0, 2)), np.ones(2)).shape == (2, 2)
    assert exact_directions(np.eye(2), np.ones(2)).shape == (0, 2)


def test_a_bound_near_the_best_point_is_no_end_of_the_product():
    near = Unknown("pore", 1.0, 0.999, 1.001, "log")
    free = Unknown("viscosity", 1.0, 0.1, 5.0, "log")
    misfit = misfit_of(Formula((MODULUS, near, free), relaxation), [2.0, 1.0, 1.3], 0.02, NOISE)
    best_of = Objective(misfit, np.full(3, 0.1))
    best = minimise(best_of, misfit.start, np.arange(3))
    (direction,) = non_identifiable_directions(best.fitted.jacobian, best_of.scale, KNOWN)
    product = identifiable_product(best_of, best, direction, best_of.scale)
    low, high = product.interval
    assert 0.8 * product.value < low < product.value < high < 1.2 * product.value


def test_an_experiment_knows_pore_size_and_viscosity_by_the_conductivity_alone():
    """Whatever is measured; all other unknowns of the experiment are apart."""
    plan = planned()
    model, values = model_of(plan), starts(plan)
    names = [each.unknown.name for each in plan.unknowns]
    slopes = np.array(
        [
            each.unknown.value_slope(each.unknown.coordinate(value))
            for each, value in zip(plan.unknowns, values, strict=True)
        ]
    )
    rows = model.dependence(values) * slopes
    (direction,) = exact_directions(rows, np.full(len(names), 0.1))
    expected = np.zeros(len(names))
    expected[[names.index("pore"), names.index("viscosity")]] = np.array([1, 2]) / np.sqrt(5)
    np.testing.assert_allclose(direction * np.sign(direction[names.index("pore")]), expected, atol=1e-12)
    # The curves do not know better.
    curves = model.curves(values)
    change = curves.slopes * slopes @ expected
    assert np.abs(change).max() < 1e-9 * np.abs(curves.slopes * slopes).max()
