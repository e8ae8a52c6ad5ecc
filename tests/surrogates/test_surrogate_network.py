"""Networks in numpy: values and derivatives, against one neuron after the other and differences."""

import math

import numpy as np
import pytest

from porocore.interfaces.surrogate import TrainingProgress
from porocore.surrogates.network.network import ACTIVATIONS, Network

SCALAR = {
    "sigmoid": lambda z: 1 / (1 + math.exp(-z)),
    "tanh": math.tanh,
    "softplus": lambda z: math.log1p(math.exp(z)),
}


def network(activation, widths=(3, 5, 4, 1), seed=0):
    random = np.random.default_rng(seed)
    pairs = list(zip(widths[1:], widths, strict=False))
    return Network(
        activation,
        tuple(random.normal(size=pair) for pair in pairs),
        tuple(random.normal(size=width) for width, _ in pairs),
    )


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_values_neuron_by_neuron(activation):
    net, x = network(activation, (3, 5, 4, 2)), np.random.default_rng(1).normal(size=(7, 3))
    for row, found in zip(x, net.evaluate(x), strict=True):
        a = list(row)
        for layer, (W, b) in enumerate(zip(net.weights, net.biases, strict=True)):
            z = [
                sum(w * v for w, v in zip(weights, a, strict=True)) + c
                for weights, c in zip(W, b, strict=True)
            ]
            a = z if layer == 2 else [SCALAR[activation](value) for value in z]
        np.testing.assert_allclose(found, a, rtol=1e-13)


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("widths", [(3, 1), (3, 5, 1), (3, 5, 4, 1), (2, 4, 4, 4, 1)])
def test_derivatives_are_the_slopes(activation, widths):
    net, d, h = network(activation, widths), widths[0], 1e-3
    x = np.random.default_rng(1).normal(size=(20, d))
    value, gradient, hessian = net.value_gradient_hessian(x)
    values, slopes = net.value_and_gradient(x)
    np.testing.assert_allclose(value, net.evaluate(x)[:, 0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(values, net.evaluate(x), rtol=0, atol=1e-13)
    np.testing.assert_allclose(slopes[:, :, 0], gradient, rtol=0, atol=1e-13)
    np.testing.assert_allclose(hessian, hessian.swapaxes(0, 1), rtol=0, atol=1e-13)
    for k in range(d):
        step = h * np.eye(d)[k]
        near = [net.value_gradient_hessian(x + j * step) for j in (-2, -1, 1, 2)]
        for found, place in ((gradient[k], 0), (hessian[k], 1)):
            m2, m1, p1, p2 = (derivatives[place] for derivatives in near)
            np.testing.assert_allclose(found, (m2 - 8 * m1 + 8 * p1 - p2) / (12 * h), atol=1e-8)


def test_a_sum_of_outputs_with_factors_is_the_network_with_such_a_last_layer():
    net, x = network("softplus", (3, 5, 4, 2)), np.random.default_rng(1).normal(size=(6, 3))
    factors = np.array([0.3, -2.0])
    one = Network(
        net.activation,
        (*net.weights[:2], factors[None] @ net.weights[2]),
        (*net.biases[:2], net.biases[2] @ factors[:, None]),
    )
    found = net.value_gradient_hessian(x, np.tile(factors, (6, 1)))
    for a, b in zip(found, one.value_gradient_hessian(x), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-13)


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_far_away_nothing_overflows(activation):
    net = Network(activation, (np.eye(1), np.eye(1)), (np.zeros(1), np.zeros(1)))
    with np.errstate(all="raise", under="ignore"):
        value, gradient, hessian = net.value_gradient_hessian(np.array([[-1000.0], [0.0], [1000.0]]))
    limits = {"sigmoid": (0, 0.5, 1), "tanh": (-1, 0, 1), "softplus": (0, math.log(2), 1000)}[activation]
    np.testing.assert_allclose(value, limits, atol=1e-15)
    np.testing.assert_allclose(gradient[0, [0, 2]], [0, float(activation == "softplus")], atol=1e-15)
    np.testing.assert_allclose(hessian[0, 0, [0, 2]], 0, atol=1e-15)


def test_no_states():
    value, gradient, hessian = network("tanh").value_gradient_hessian(np.zeros((0, 3)))
    assert (value.shape, gradient.shape, hessian.shape) == ((0,), (3, 0), (3, 3, 0))
    assert network("tanh").value_and_gradient(np.zeros((0, 3)))[1].shape == (3, 0, 1)


def test_words_for_what_is_no_network():
    with pytest.raises(ValueError, match="expected an activation of sigmoid, tanh, softplus, got 'relu'"):
        network("relu")
    with pytest.raises(ValueError, match="do not fit together"):
        Network("tanh", (np.ones((4, 3)), np.ones((1, 5))), (np.ones(4), np.ones(1)))
    with pytest.raises(ValueError, match="do not fit together"):
        Network("tanh", (np.ones((4, 3)),), (np.ones(3),))


def test_epochs_left_lie_between_the_fewest_and_the_most():
    assert TrainingProgress(3000, 15000, 0.1, 0.1).left == 12000
    assert TrainingProgress(3000, 15000, 0.1, 0.1, ends=6000).left == 6000
    assert TrainingProgress(3000, 15000, 0.1, 0.1, ends=3000).left == 0
    assert TrainingProgress(14000, 15000, 0.1, 0.1, ends=18000).left == 1000
