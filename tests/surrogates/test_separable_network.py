"""The part of a family's potential that is a network: third order at rest, derivatives, its loss, its file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from porocore.core.tensors import CUBIC
from porocore.states import MacroState
from porocore.surrogates.family.fit import JointData
from porocore.surrogates.file.file import SurrogateMetadata, read, write
from porocore.surrogates.model import slopes_by_parameters
from porocore.surrogates.network.family_problem import NOISE, FamilyProblem, Layout
from porocore.surrogates.network.network import Network
from porocore.surrogates.network.separable import SeparableNetwork
from porocore.surrogates.polynomial.composition import TermSum
from porocore.surrogates.polynomial.monomials import Polynomial, invariant, plain
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing.synthetic.porous_family import INPUTS, porous_training_set

TERMS = {"plain": plain((0, 1, 6)), "cubic": invariant(CUBIC)}
RANDOM = np.random.default_rng(0)


def network(inputs, outputs, hidden=(6, 5), activation="tanh", seed=0):
    random = np.random.default_rng(seed)
    widths = [inputs, *hidden, outputs]
    pairs = list(zip(widths[1:], widths[:-1], strict=True))
    return Network(
        activation,
        tuple(random.normal(size=pair) for pair in pairs),
        tuple(random.normal(size=width) for width, _ in pairs),
    )


def separable(terms, l=2, activation="softplus"):
    own = network(len(terms.weights), 4, activation=activation)
    return SeparableNetwork(own, terms, network(l, 4, (3,), activation, seed=1))


def evaluated(part, y, x):
    k, n = len(part.terms.weights), y.shape[1]
    found = np.zeros(n), np.zeros((7, n)), np.zeros((7, 7, n))
    TermSum(part.terms, Polynomial.zero(k, 1), part.at(x), tuple(range(k))).start(y)(*found)
    return found


def by_differences(function, at, h=1e-3):
    """Derivatives (…, v, n) of a function (…, n) of (v, n)."""
    found = []
    for a in range(len(at)):
        step = np.zeros((len(at), 1))
        step[a] = h
        m2, m1, p1, p2 = (function(at + i * step) for i in (-2, -1, 1, 2))
        found.append((m2 - 8 * m1 + 8 * p1 - p2) / (12 * h))
    return np.stack(found, axis=-2)


@pytest.mark.parametrize("name", TERMS)
def test_the_separable_network_is_of_third_order_for_every_theta(name):
    part, x = separable(TERMS[name]), RANDOM.uniform(-1, 1, (2, 9))
    for found in evaluated(part, np.zeros((7, 9)), x):
        np.testing.assert_allclose(found, 0.0, atol=1e-13)
    way = RANDOM.normal(size=(7, 9))
    one, half = (np.abs(evaluated(part, size * way, x)[0]) for size in (2e-3, 1e-3))
    assert (one > 6 * half).all()


@pytest.mark.parametrize("name", TERMS)
@pytest.mark.parametrize("l", [0, 2])
def test_derivatives_by_y_and_theta(name, l):
    part = separable(TERMS[name], l)
    y, x = RANDOM.uniform(-0.2, 0.2, (7, 6)), RANDOM.uniform(-1, 1, (l, 6))
    value, gradient, hessian = evaluated(part, y, x)
    np.testing.assert_allclose(gradient, by_differences(lambda at: evaluated(part, at, x)[0], y), atol=1e-8)
    np.testing.assert_allclose(hessian, by_differences(lambda at: evaluated(part, at, x)[1], y), atol=1e-7)
    again, by_y, by_x, by_yx = part.by_coordinates(y, x)
    np.testing.assert_allclose(again, value, atol=1e-13)
    np.testing.assert_allclose(by_y, gradient, atol=1e-13)
    if l:
        differences = by_differences(lambda at: part.by_coordinates(y, at)[0], x)
        np.testing.assert_allclose(by_x, differences, atol=1e-8)
        differences = by_differences(lambda at: part.by_coordinates(y, at)[1], x)
        np.testing.assert_allclose(by_yx, differences, atol=1e-7)


@pytest.mark.parametrize("name", TERMS)
def test_the_loss_is_that_of_the_network_which_it_makes(name):
    """Its errors are those of the network in units of the spread of each kind, however it is written."""
    random, n, l = np.random.default_rng(3), 7, 2
    shapes = {"value": (1,), "by_y": (1, 7), "by_x": (1, l), "by_yy": (1, 7, 7), "by_yx": (1, 7, l)}
    active = (0, 1, 6) if name == "plain" else tuple(range(7))
    y = np.zeros((7, n))
    y[list(active)] = random.uniform(-0.2, 0.2, (len(active), n))
    targets = {kind: random.normal(size=(*shape, n)) for kind, shape in shapes.items()}
    data = JointData(y, random.uniform(-1, 1, (l, n)), **targets)
    divisors = {kind: random.uniform(0.5, 2, shape) for kind, shape in shapes.items()}
    divisors["by_y"][0, 6] = np.inf
    problem = FamilyProblem.from_data(data, divisors, TERMS[name], active)
    layout = Layout.from_widths(len(problem.terms.weights), l, (5, 4), "softplus")
    start = layout.first_weights(seed=2)
    theta = start + random.normal(scale=0.3, size=start.shape)
    own, factors = problem.networks(theta, layout)
    part = SeparableNetwork(own, problem.terms, factors)
    value, by_y, by_yy = evaluated(part, y, data.x)
    _, _, by_x, by_yx = part.by_coordinates(y, data.x)
    found = {"value": value, "by_y": by_y, "by_x": by_x, "by_yy": by_yy, "by_yx": by_yx}
    rows = list(active)
    of_y = {"by_y": (rows,), "by_yx": (rows,), "by_yy": np.ix_(rows, rows)}
    expected = 0.0
    for kind, values in found.items():
        squares = ((values - targets[kind][0]) ** 2).mean(axis=-1) / divisors[kind][0] ** 2
        expected += squares[of_y.get(kind, ())].sum()
    left = sum(
        ((targets[kind][0] / divisors[kind][0][..., None]) ** 2).mean(axis=-1)[of_y.get(kind, ())].sum()
        for kind in shapes
    )
    expected += NOISE * left / n * ((theta - start) ** 2).sum()
    constants = problem.constants(start)
    assert problem.loss(np, layout)(theta, constants) == pytest.approx(expected, rel=1e-10)
    # At the first weights the network is zero.
    assert problem.loss(np, layout)(start, constants) == pytest.approx(left, rel=1e-10)


@pytest.fixture(scope="module")
def model():
    """A family's polynomial with a random network on top."""
    fitted = PolynomialSurrogate(degree=4).fit(porous_training_set(30, 1), seed=0).fitted
    part = separable(plain(fitted.active).subset((0, 1)))
    own = part.network
    scaled = replace(own, weights=(*own.weights[:-1], 1e-2 * own.weights[-1]))
    return replace(fitted, network=replace(part, network=scaled))


def test_predictions_with_a_network_have_exact_derivatives(model):
    states = porous_training_set(5, 3).states
    # One of them beyond the box, where the network comes to rest.
    grad_u = states.grad_u.copy()
    grad_u[0, 1, 1] = 0.06
    states = replace(states, grad_u=grad_u + RANDOM.uniform(-0.02, 0.02, (5, 3, 3)))
    found, slopes, h = model.predict(states, tangent=True), slopes_by_parameters(model, states), 1e-4

    def stress(k, parameter):
        moved = states.grad_u.copy(), states.p.copy(), states.parameters.copy()
        if parameter:
            moved[2][:, 1] += k * h
        else:
            moved[0][:, 1, 1] += k * h
        response = model.predict(MacroState(*moved), tangent=False)
        return response.stress, response.potential

    for parameter, by in ((False, found.tangent.stress_grad_u[..., 1, 1]), (True, slopes.stress[..., 1])):
        m2, m1, p1, p2 = (stress(k, parameter) for k in (-2, -1, 1, 2))
        for place, slope in ((0, by), (1, slopes.potential[:, 1] if parameter else found.stress[:, 1, 1])):
            difference = (m2[place] - 8 * m1[place] + 8 * p1[place] - p2[place]) / (12 * h)
            np.testing.assert_allclose(slope, difference, atol=1e-8)


def test_at_rest_nothing_changes(model):
    rest = MacroState.zeros(8).with_parameters(
        np.random.default_rng(1).uniform(*INPUTS.parameter_ranges.T, (8, 2))
    )
    alone = replace(model, network=None).predict(rest, tangent=True)
    both = model.predict(rest, tangent=True)
    np.testing.assert_allclose(both.stress, alone.stress, atol=1e-14)
    np.testing.assert_allclose(both.tangent.stress_grad_u, alone.tangent.stress_grad_u, atol=1e-13)


def test_a_file_keeps_the_network(model, tmp_path):
    path = tmp_path / "family.h5"
    write(path, model, SurrogateMetadata("torch", {}, "family"))
    states = porous_training_set(6, 2).states
    known, found = (each.predict(states, tangent=True) for each in (model, read(path)[0]))
    for name in ("potential", "stress", "fluid_volume"):
        np.testing.assert_array_equal(getattr(found, name), getattr(known, name))
