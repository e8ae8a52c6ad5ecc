"""The built-in surrogate, held to the laws of every surrogate and of every potential."""

import numpy as np
import pytest

from porocore.errors import ConfigurationError, DataError
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing import PotentialSuite
from porocore.testing.synthetic.potential_cell import potential_training_set


class TestPolynomial(PotentialSuite):
    kit_version = "5"
    random = resumable = False
    invalid_options = (
        {"no_such_option": 1},
        {"degree": 1},
        {"degree": 2.5},
        {"degree": True},
        {"model": "mlp"},
    )

    @classmethod
    def make_surrogate(cls):
        return PolynomialSurrogate()


def test_general_states_of_a_cubic_cell():
    """Sheared and rotated states from 25 solves: terms of the cube's symmetry leave less than 0.1 %."""
    unseen = potential_training_set(200, seed=9)
    predicted = PolynomialSurrogate().fit(potential_training_set(25, seed=1), seed=0).predict(unseen.states)
    for name, limit in (("stress", 1e-3), ("fluid_volume", 1e-3), ("potential", 1e-3), ("mean_grad", 5e-3)):
        truth = getattr(unseen.responses, name).reshape(200, -1)
        error = getattr(predicted, name).reshape(200, -1) - truth
        assert np.sqrt((error**2).mean()) < limit * np.ptp(truth, axis=0).max(), name
    truth = unseen.responses.tangent.stress_grad_u
    error = predicted.tangent.stress_grad_u - truth
    assert np.sqrt((error**2).mean()) < 2e-2 * np.abs(truth).max()


def test_degree_is_what_was_asked_for_or_what_the_data_allow():
    data = potential_training_set(12, seed=1)
    assert PolynomialSurrogate(degree=3).fit(data, seed=0).settings == {"degree": 3}
    # 12 states give 96 equations, and the 38 monomials of degree 4 are the most that have two each.
    assert PolynomialSurrogate(degree=7).fit(data, seed=0).settings == {"degree": 4}


def test_words_for_what_is_missing():
    with pytest.raises(ConfigurationError, match=r"surrogate\.options\.order: .* its option is degree"):
        PolynomialSurrogate(order=3)
    with pytest.raises(ConfigurationError, match=r"surrogate\.model: expected potential .*got 'mlp'"):
        PolynomialSurrogate(model="mlp")
    data = potential_training_set(12, seed=1)
    data.responses.status[1:] = 1
    with pytest.raises(DataError, match="at least two stable training states, got 1"):
        PolynomialSurrogate().fit(data, seed=0)
