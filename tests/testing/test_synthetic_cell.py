"""The made-up cell that surrogates are tested with: its derivatives, its identities, its rest."""

import numpy as np
import pytest

from porocore.states import MacroState
from porocore.testing.synthetic.cell import INPUTS, respond, synthetic_training_set
from porocore.testing.synthetic.response import cubic_reference

SLOPES = {
    "mean_grad": ("mean_grad_grad_u", "mean_grad_p"),
    "stress": ("stress_grad_u", "stress_p"),
    "fluid_volume": ("fluid_volume_grad_u", "fluid_volume_p"),
}


def general_states(n=5):
    rng = np.random.default_rng(3)
    return MacroState(rng.uniform(-0.1, 0.1, (n, 3, 3)), rng.uniform(-0.1, 0.2, n))


@pytest.mark.parametrize("name", [*SLOPES, "potential"])
def test_derivatives_match_differences(name):
    states, h = general_states(), 1e-4
    at = respond(states)
    if name == "potential":
        by_H, by_p = at.stress, -at.fluid_volume
    else:
        by_H, by_p = (getattr(at.tangent, slope) for slope in SLOPES[name])
    rng = np.random.default_rng(4)
    dH, dp = rng.normal(size=(3, 3)), rng.normal()
    ahead, behind = (
        getattr(respond(MacroState(states.grad_u + s * h * dH, states.p + s * h * dp)), name) for s in (1, -1)
    )
    slope = np.tensordot(by_H, dH, axes=2) + by_p * dp
    np.testing.assert_allclose((ahead - behind) / (2 * h), slope, rtol=0, atol=1e-6)


def test_reciprocity():
    tangent = respond(general_states()).tangent
    A = tangent.stress_grad_u.reshape(-1, 9, 9)
    np.testing.assert_allclose(A, A.transpose(0, 2, 1), atol=1e-14)
    np.testing.assert_array_equal(tangent.stress_p, -tangent.fluid_volume_grad_u)


def test_rest_is_free_of_stress_and_has_the_linear_limit():
    rest, linear = respond(MacroState.zeros(1)), cubic_reference()
    assert not rest.mean_grad.any()
    assert np.abs(rest.stress).max() < 1e-16
    np.testing.assert_allclose(rest.tangent.mean_grad_grad_u, linear.tangent.mean_grad_grad_u, atol=1e-15)
    np.testing.assert_allclose(rest.tangent.mean_grad_p, linear.tangent.mean_grad_p, atol=1e-15)


def test_a_training_set_is_seeded_and_spans_the_range():
    one, same, other = (synthetic_training_set(30, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(one.states.grad_u, same.states.grad_u)
    assert (one.states.p != other.states.p).any()
    x = INPUTS.gather(one.states)
    assert x.shape == (30, 2)
    np.testing.assert_allclose([x.min(axis=0), x.max(axis=0)], [INPUTS.lower, INPUTS.upper], atol=1e-15)
