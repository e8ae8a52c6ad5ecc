"""Named inputs of a study."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.errors import ConfigurationError
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


FAMILY = InputSpace.from_ranges(
    {"H22": (-0.4, 0.1), "p": (0, 0.2)}, {"radius": (0.15, 0.3), "swelling": (1, 2)}
)


def test_parameters_are_the_last_inputs():
    assert FAMILY.names == ("H22", "p", "radius", "swelling")
    x = np.array([[-0.2, 0.1, 0.2, 1.5], [0.0, 0.0, 0.25, 1.0]])
    states = FAMILY.scatter(x)
    np.testing.assert_array_equal(states.parameters, x[:, 2:])
    np.testing.assert_array_equal(FAMILY.gather(states), x)
    np.testing.assert_array_equal(
        states.grad_u, InputSpace.from_ranges({"H22": (-1, 1)}).scatter(x[:, :1]).grad_u
    )
    turned = FAMILY.without_rotation(replace(states, grad_u=states.grad_u + 0.1 * np.eye(3, k=-1)))
    np.testing.assert_array_equal(turned.parameters, states.parameters)
    np.testing.assert_array_equal(states[1:].parameters, x[1:, 2:])
    joined = MacroState.concatenate([states, states])
    np.testing.assert_array_equal(joined.parameters, np.concatenate([x, x])[:, 2:])
    assert not FAMILY.moves_other(states).any()


def test_states_without_their_parameters_are_refused():
    with pytest.raises(
        ConfigurationError, match=r"a value of each parameter \(radius, swelling\) with every state"
    ):
        FAMILY.gather(MacroState.zeros(2))
    plain = InputSpace.from_ranges({"H22": (-1, 1)})
    with pytest.raises(ConfigurationError, match="2 parameters of a cell, but none were sampled"):
        plain.gather(MacroState.zeros(2).with_parameters([0.2, 1.0]))
    with pytest.raises(ValueError, match="same number of parameters"):
        MacroState.concatenate([MacroState.zeros(1), MacroState.zeros(1).with_parameters([0.2])])
    with pytest.raises(ValueError, match=r"parameters \(n, m\) with n = 2"):
        MacroState(np.zeros((2, 3, 3)), np.zeros(2), np.zeros((1, 1)))


@pytest.mark.parametrize(
    ("names", "parameters", "told"),
    [
        (("radius", "H22"), ("radius",), "as the last inputs"),
        (("H22", "radius"), (), "unknown input 'radius'"),
        (("H22", "p"), ("p",), "cannot name a parameter"),
        (("H22", "radius", "radius"), ("radius", "radius"), "given twice"),
    ],
)
def test_names_of_parameters_are_checked(names, parameters, told):
    with pytest.raises(ConfigurationError, match=told):
        InputSpace(names, (0.0,) * len(names), (1.0,) * len(names), parameters)


def test_a_space_without_parameters_is_written_as_before():
    """Hashes of data sets and trainings hang on this text."""
    plain = InputSpace(("H22", "p"), (-0.2, 0.0), (0.1, 0.3))
    assert repr(plain) == "InputSpace(names=('H22', 'p'), lower=(-0.2, 0.0), upper=(0.1, 0.3))"
    assert "parameters=('radius', 'swelling')" in repr(FAMILY)
