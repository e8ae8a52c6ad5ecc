"""Fits of a family are the same on any number of threads, and hardly depend on the seed of a network."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from porocore.plugins.registry import registry
from porocore.testing.synthetic.porous_family import porous_training_set

NETWORK = {"model": "potential", "iterations": 60}
BETWEEN = porous_training_set(40, 9)


def stress(backend, options, seed, count=40):
    fitted = registry().get("surrogate", backend)(**options).fit(porous_training_set(count, 1), seed=seed)
    return fitted.predict(BETWEEN.states).stress


@pytest.mark.parametrize(("backend", "options"), [("polynomial", {}), ("torch", NETWORK), ("jax", NETWORK)])
def test_fits_are_the_same_to_the_last_bit_on_one_thread_and_on_two(backend, options):
    found = []
    for threads in (1, 2):
        with threadpool_limits(threads, user_api="blas"):
            found.append(stress(backend, options, seed=0))
    np.testing.assert_array_equal(*found)


def test_a_network_does_not_follow_the_equations_of_few_members_at_will():
    """Without a prior two seeds of 8 members differ as much as the polynomial alone is wrong."""
    one, other = (stress("torch", {"model": "potential"}, seed, count=8) for seed in (0, 1))
    error = np.abs(one - BETWEEN.responses.stress).max()
    assert np.abs(one - other).max() < 0.02 * error
