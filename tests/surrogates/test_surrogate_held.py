"""Potential of a cell that is held while its solid swells: energy, stress and mean gradient at rest; its file."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.core.tensors import CUBIC
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import MacroState
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.surrogates.portable import NumpySurrogate
from porocore.testing.synthetic import porous_family

STRETCH = 1.08
INPUTS = InputSpace.from_ranges({"H22": (-0.05, 0.15), "p": (0.0, 0.05)})


def respond(states):
    """The member of the family at one stretch, as a cell without parameters."""
    found = porous_family.respond(states.with_parameters(np.full((len(states), 1), STRETCH)), ("swelling",))
    return replace(found, slopes=None, conductivity=None)


def inside(n, seed):
    low, high = np.array(INPUTS.lower), np.array(INPUTS.upper)
    return INPUTS.scatter(low + (high - low) * np.random.default_rng(seed).random((n, 2)))


@pytest.fixture(scope="module")
def surrogate():
    states = inside(40, 1)
    rest = respond(MacroState.zeros(1))
    return PolynomialSurrogate().fit(
        TrainingSet(states, respond(states), INPUTS, rest, "held", {}, CUBIC), seed=0
    )


def test_a_held_cell_is_exact_at_rest_with_all_derivatives(surrogate):
    found, truth = surrogate.predict(MacroState.zeros(1)), respond(MacroState.zeros(1))
    assert truth.stress[0, 0, 0] < -0.05
    for name in ("potential", "stress", "fluid_volume", "mean_grad"):
        np.testing.assert_allclose(getattr(found, name), getattr(truth, name), atol=1e-13, err_msg=name)
    for name, value in vars(truth.tangent).items():
        if value is not None and "conductivity" not in name:
            np.testing.assert_allclose(getattr(found.tangent, name), value, atol=1e-12, err_msg=name)


def test_a_held_cell_is_followed_to_where_it_is_free(surrogate):
    states = inside(100, 2)
    found, truth = surrogate.predict(states, tangent=False), respond(states)
    for name, at in (("stress", (1, 1)), ("stress", (0, 0)), ("fluid_volume", ()), ("mean_grad", (1, 1))):
        a, b = getattr(found, name)[:, *at], getattr(truth, name)[:, *at]
        np.testing.assert_allclose(a, b, atol=2e-4 * np.ptp(b), err_msg=name)


def test_the_file_holds_what_is_at_rest(surrogate, tmp_path):
    path = tmp_path / "surrogate.h5"
    surrogate.save(path)
    states = MacroState.concatenate([MacroState.zeros(1), inside(5, 3)])
    for again in (PolynomialSurrogate.load(path), NumpySurrogate.load(path)):
        one, other = surrogate.predict(states), again.predict(states)
        for name in ("potential", "stress", "fluid_volume", "mean_grad"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
