"""Named inputs of a study."""

import numpy as np

from porocore.core.inputs.input_space import InputSpace
from porocore.states import MacroState


def test_a_state_turned_back_has_the_same_stretch_and_an_upper_triangle():
    inputs = InputSpace.from_ranges({"H11": (-1, 1), "H13": (-1, 1), "p": (0, 1)})
    rng = np.random.default_rng(0)
    H = 0.3 * rng.standard_normal((50, 3, 3))
    H[0] = np.diag([0.1, -0.2, 0.3])
    H[1] = np.diag([-3.0, 0, 0]) + 0.1  # det F < 0
    states = MacroState(H, rng.random(50))
    back = inputs.without_rotation(states)
    good = np.linalg.det(np.eye(3) + H) > 0
    assert good.sum() > 40
    F, R = np.eye(3) + H[good], np.eye(3) + back.grad_u[good]
    np.testing.assert_allclose(R.swapaxes(1, 2) @ R, F.swapaxes(1, 2) @ F, atol=1e-13)
    np.testing.assert_array_equal(back.grad_u[good][:, (1, 2, 2), (0, 0, 1)], 0)
    assert (np.diagonal(R, axis1=1, axis2=2) > 0).all()
    np.testing.assert_array_equal(back.grad_u[~good], H[~good])
    # Nothing is turned that has nothing below the diagonal, nor where that is an input.
    assert inputs.without_rotation(states[:1]).grad_u is not None
    np.testing.assert_array_equal(inputs.without_rotation(states[:1]).grad_u, H[:1])
    lower = InputSpace.from_ranges({"H21": (-1, 1)})
    np.testing.assert_array_equal(lower.without_rotation(states).grad_u, H)
