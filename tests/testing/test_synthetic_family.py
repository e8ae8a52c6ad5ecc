"""The made-up family: derivatives and slopes are those of its energy."""

import numpy as np

from porocore.states import MacroState
from porocore.testing.synthetic.family import INPUTS, respond

STEP = 1e-5


def test_slopes_are_those_of_the_responses():
    rng = np.random.default_rng(0)
    low, high = np.array(INPUTS.lower), np.array(INPUTS.upper)
    states = INPUTS.scatter(low + (high - low) * rng.random((20, len(INPUTS))))
    states = MacroState(states.grad_u + 0.05 * rng.standard_normal((20, 3, 3)), states.p, states.parameters)
    slopes = respond(states).slopes
    for k in range(2):
        ends = [respond(states.with_parameters(states.parameters + s * STEP * np.eye(2)[k])) for s in (1, -1)]
        for name in ("potential", "stress", "fluid_volume", "mean_grad"):
            difference = (getattr(ends[0], name) - getattr(ends[1], name)) / (2 * STEP)
            np.testing.assert_allclose(getattr(slopes, name)[..., k], difference, atol=1e-9)


def test_derivatives_are_those_of_the_energy():
    rng = np.random.default_rng(1)
    states = MacroState(
        0.1 * rng.standard_normal((9, 3, 3)), 0.1 * rng.random(9), np.tile([0.4, 1.7], (9, 1))
    )
    response = respond(states)
    moved = np.zeros((9, 3, 3))
    moved[np.arange(9), np.arange(9) // 3, np.arange(9) % 3] = STEP
    ends = [respond(MacroState(states.grad_u + s * moved, states.p, states.parameters)) for s in (1, -1)]
    by_H = np.array([response.stress[i].flat[i] for i in range(9)])
    np.testing.assert_allclose((ends[0].potential - ends[1].potential) / (2 * STEP), by_H, atol=1e-9)
    rows = np.arange(9)
    tangent = response.tangent.stress_grad_u.reshape(9, 3, 3, 9)[rows, :, :, rows]
    np.testing.assert_allclose((ends[0].stress - ends[1].stress) / (2 * STEP), tangent, atol=1e-8)
    ends = [respond(MacroState(states.grad_u, states.p + s * STEP, states.parameters)) for s in (1, -1)]
    np.testing.assert_allclose(
        (ends[0].potential - ends[1].potential) / (2 * STEP), -response.fluid_volume, atol=1e-9
    )
    np.testing.assert_allclose(
        (ends[0].fluid_volume - ends[1].fluid_volume) / (2 * STEP), response.tangent.fluid_volume_p, atol=1e-8
    )
    np.testing.assert_allclose(
        (ends[0].stress - ends[1].stress) / (2 * STEP), response.tangent.stress_p, atol=1e-9
    )
