"""Surrogates, each with its default options: the same facts whoever offers it, and the same map within its error."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.commands.crosscheck.comparison import SPREAD
from porocore.errors import ConfigurationError
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.laws.closure import CLOSURES
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.states import MacroState
from porocore.testing.expect import RESPONSES, with_derivatives
from porocore.testing.synthetic.cell import INPUTS, synthetic_training_set
from porocore.testing.synthetic.response import CONDUCTIVITY, SOLID_FRACTION

DATA, UNSEEN, BETWEEN = (synthetic_training_set(n, seed) for n, seed in ((150, 1), (40, 2), (400, 3)))


@pytest.fixture(scope="module")
def fitted(load):
    """``fitted(name)`` is trained once on the made-up cell."""

    @cache
    def make(name):
        return load("surrogate", name).fit(DATA, seed=4)

    return make


def errors(surrogate, data):
    """Largest error of each response in the trained range, over the span of the component that varies most."""
    predicted = surrogate.predict(data.states, tangent=False)
    inside = ~predicted.flagged
    assert inside.sum() > 0.5 * len(inside)
    return {
        name: np.abs(getattr(predicted, name) - getattr(data.responses, name))[inside].max()
        / np.ptp(getattr(data.responses, name), axis=0).max()
        for name in RESPONSES
        if getattr(predicted, name) is not None
    }


def test_a_surrogate_learns_the_responses_that_it_offers(surrogate, fitted):
    found = errors(fitted(surrogate), UNSEEN)
    assert found
    assert max(found.values()) < Surrogate.expected_error, found


def test_two_agree_within_their_errors(surrogate_pair, fitted):
    one, other = map(fitted, surrogate_pair)
    measured = errors(one, UNSEEN), errors(other, UNSEEN)
    a, b = (each.predict(BETWEEN.states, tangent=False) for each in (one, other))
    inside = ~(a.flagged | b.flagged)
    for name in measured[0].keys() & measured[1].keys():
        span = np.ptp(getattr(BETWEEN.responses, name), axis=0).max()
        difference = np.abs(getattr(a, name) - getattr(b, name))[inside].max() / span
        assert difference < SPREAD * (measured[0][name] + measured[1][name]), name


def test_the_undeformed_cell_is_exact(surrogate, fitted):
    """Each in what it offers, so that all linear limits are the same."""
    rest = fitted(surrogate).predict(MacroState.zeros(1))
    known = dict(with_derivatives(DATA.reference))
    for name, slopes in with_derivatives(rest):
        np.testing.assert_allclose(getattr(rest, name), getattr(DATA.reference, name), rtol=0, atol=1e-11)
        for slope, expected in zip(slopes, known[name], strict=True):
            np.testing.assert_allclose(slope, expected, rtol=0, atol=1e-10, err_msg=name)


def test_the_trained_range_is_the_same_for_all(surrogate, fitted):
    x = np.array([[-0.08, 0.1], [-0.21, 0.1], [-0.1, 0.3], [0.0, 0.0], [-0.08, 0.1]])
    states = INPUTS.scatter(x)
    states.grad_u[4, 0, 2] = 0.02
    found = fitted(surrogate).predict(states, tangent=False)
    assert found.flagged.tolist() == [False, True, True, False, True]
    assert (found.status == 0).all()
    assert found.tangent is None


def test_a_trained_surrogate_has_the_identity_of_its_data(surrogate, fitted, tmp_path):
    trained = fitted(surrogate)
    trained.save(tmp_path / "surrogate.h5")
    for each in (trained, type(trained).load(tmp_path / "surrogate.h5")):
        assert (each.identity, each.inputs) == (DATA.identity, DATA.inputs)


def test_a_trained_surrogate_serves_a_closure(surrogate, fitted):
    """At least one of the closures can be made with what it offers, and answers with an exact tangent."""
    usable = []
    for name, closure in CLOSURES.items():
        try:
            law = ClosedLaw(fitted(surrogate), closure(SOLID_FRACTION, NeoHookean(), CONDUCTIVITY))
        except ConfigurationError:
            continue
        usable.append(name)
        states, h = DATA.states[:6], 1e-5
        response = law.respond(states, np.zeros((6, 3)), law.initial(6))
        moved = [
            law.respond(MacroState(states.grad_u, states.p + k * h), np.zeros((6, 3)), law.initial(6)).stress
            for k in (-1, 1)
        ]
        slope = (moved[1] - moved[0]) / (2 * h)
        np.testing.assert_allclose(slope, response.tangent.stress_p, rtol=0, atol=1e-7)
    assert usable
