"""Precision to first order against closed forms of linear regression."""

import numpy as np
import pytest

from porocore.commands.calibration.minimum import LinearPrecision


def test_a_straight_line_has_the_textbooks_covariance():
    t, sigma = np.linspace(0, 1, 11), 0.1
    found = LinearPrecision.from_jacobian(np.stack([np.ones(11), t], axis=1) / sigma)
    mean, spread = t.mean(), ((t - t.mean()) ** 2).sum()
    expected = sigma**2 * np.array(
        [[1 / 11 + mean**2 / spread, -mean / spread], [-mean / spread, 1 / spread]]
    )
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-12)
    np.testing.assert_allclose(found.deviations**2, np.diag(expected), rtol=1e-12)
    assert found.correlations[0, 1] == pytest.approx(-mean * np.sqrt(11 / (t**2).sum()), rel=1e-12)


def test_singular_values_are_those_of_numpy():
    rows = np.random.default_rng(1).normal(size=(20, 4))
    found = LinearPrecision.from_jacobian(rows)
    np.testing.assert_allclose(found.singular_values, np.linalg.svd(rows)[1], rtol=1e-12)


def test_what_is_not_seen_has_no_covariance_but_a_correlation():
    a, b = np.random.default_rng(1).normal(size=(2, 9))
    found = LinearPrecision.from_jacobian(np.stack([a, a, b], axis=1))
    assert list(found.is_round_off) == [False, False, True]
    assert np.isinf(found.deviations[:2]).all()
    # The third is as good as if the first two were one.
    other = LinearPrecision.from_jacobian(np.stack([a, b], axis=1))
    assert found.deviations[2] == pytest.approx(other.deviations[1], rel=1e-6)
    assert found.correlations[0, 1] == pytest.approx(-1, abs=1e-6)


def test_fewer_data_than_unknowns_leave_directions():
    found = LinearPrecision.from_jacobian(np.array([[3.0, 4.0]]))
    np.testing.assert_allclose(found.singular_values, [5.0, 0.0], atol=1e-15)
    assert np.isinf(found.deviations).all()
