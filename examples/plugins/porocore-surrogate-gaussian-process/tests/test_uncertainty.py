"""What the Gaussian process says of itself, against what it does, and against scipy's radial basis functions."""

import numpy as np
import pytest
from porocore_surrogate_gaussian_process.kernel import covariance, slopes, variance
from porocore_surrogate_gaussian_process.surrogate import GaussianProcessSurrogate
from scipy.interpolate import RBFInterpolator

from porocore.testing.synthetic.cell import INPUTS, synthetic_training_set


@pytest.fixture(scope="module")
def fitted():
    return GaussianProcessSurrogate().fit(synthetic_training_set(40, seed=1), seed=0)


def test_it_is_sure_where_it_knows_and_unsure_beyond(fitted):
    known = fitted.uncertainty(synthetic_training_set(40, seed=1).states).max()
    beyond, far = fitted.uncertainty(INPUTS.scatter([[-0.3, 0.35], [-0.4, 0.5]])).max(axis=(1, 2))
    assert 10 * known < beyond < far / 2


def test_errors_are_of_the_size_that_it_expects(fitted):
    """Few states, so that there are errors; as good as none is beyond five standard deviations."""
    unseen = synthetic_training_set(300, seed=2)
    few = GaussianProcessSurrogate().fit(synthetic_training_set(8, seed=3), seed=0)
    error = np.abs(few.predict(unseen.states).mean_grad - unseen.responses.mean_grad)[:, 1, 1]
    expected = few.uncertainty(unseen.states)[:, 1, 1]
    assert (error < 5 * expected + 1e-9).mean() > 0.97
    assert expected.mean() < 100 * error.mean()


def test_scipys_radial_basis_functions_agree(fitted):
    """An interpolation that was written by others, of the same states."""
    data, unseen = synthetic_training_set(40, seed=1), synthetic_training_set(200, seed=2)
    width = np.array(INPUTS.upper) - np.array(INPUTS.lower)
    other = RBFInterpolator(INPUTS.gather(data.states) / width, data.responses.mean_grad.reshape(-1, 9))
    found = other(INPUTS.gather(unseen.states) / width).reshape(-1, 3, 3)
    mine = fitted.predict(unseen.states).mean_grad
    truth = unseen.responses.mean_grad
    assert np.abs(found - mine).max() < 0.02 * np.ptp(truth[:, 1, 1])
    assert np.abs(mine - truth).max() < 0.1 * np.abs(found - truth).max()


def test_the_covariance_is_flat_at_rest_and_its_slopes_are_right():
    random = np.random.default_rng(0)
    x, y = random.normal(size=(5, 3)), random.normal(size=(4, 3))
    np.testing.assert_allclose(covariance(np.zeros((1, 3)), y), 0, atol=1e-15)
    np.testing.assert_allclose(slopes(np.zeros((1, 3)), y), 0, atol=1e-15)
    np.testing.assert_allclose(np.diag(covariance(x, x)), variance(x), atol=1e-14)
    for j in range(3):
        step = 1e-5 * np.eye(3)[j]
        difference = (covariance(x + step, y) - covariance(x - step, y)) / 2e-5
        np.testing.assert_allclose(slopes(x, y)[:, :, j], difference, atol=1e-8)
    assert np.linalg.eigvalsh(covariance(x, x)).min() > 0
