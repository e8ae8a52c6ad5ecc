"""The network of a potential in torch: the same numbers as in numpy, and torch left as it was."""

import itertools
import subprocess
import sys
import textwrap
import warnings

import numpy as np
import pytest
import torch

from porocore.errors import ConfigurationError
from porocore.surrogates.network.network import ACTIVATIONS, Network
from porocore.surrogates.portable import NumpySurrogate
from porocore.testing.expect import with_derivatives
from porocore.testing.synthetic.potential_cell import potential_training_set
from porocore_surrogate_torch.evaluator import TorchNetwork, available_device
from porocore_surrogate_torch.surrogate import TorchSurrogate
from porocore_surrogate_torch.training import TorchAutodiff, choose_device


def read_only(array):
    found = np.array(array)
    found.setflags(write=False)
    return found


def network(activation, widths):
    random = np.random.default_rng(0)
    pairs = [(b, a) for a, b in itertools.pairwise(widths)]
    return Network(
        activation,
        tuple(random.normal(size=pair) / np.sqrt(pair[1]) for pair in pairs),
        tuple(random.normal(size=b) for b, _ in pairs),
    )


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("widths", [(3, 1), (2, 24, 24, 1), (10, 24, 24, 1), (7, 40, 40, 40, 1)])
@pytest.mark.parametrize("n", [0, 1, 300])
def test_the_same_as_numpy(activation, widths, n):
    net, x = network(activation, widths), np.random.default_rng(1).uniform(-2, 2, (n, widths[0]))
    found = TorchNetwork(net, torch.device("cpu"))
    for name in ("value_gradient_hessian", "value_and_gradient"):
        for one, other in zip(getattr(found, name)(x), getattr(net, name)(x), strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.evaluate(x), net.evaluate(x), rtol=0, atol=1e-13)


def test_arrays_that_are_not_writable_are_taken_without_a_warning():
    net, x = network("tanh", (3, 8, 1)), np.broadcast_to([0.1, -0.2, 0.3], (5, 3))
    frozen = Network(net.activation, *(tuple(map(read_only, each)) for each in (net.weights, net.biases)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Torch gives this warning once in a process.
        torch.set_warn_always(True)
        try:
            found = TorchNetwork(frozen, torch.device("cpu")).evaluate(read_only(x))
        finally:
            torch.set_warn_always(False)
    np.testing.assert_allclose(found, net.evaluate(x), rtol=0, atol=1e-13)


def test_several_outputs():
    net, x = network("tanh", (3, 8, 4)), np.random.default_rng(1).uniform(-2, 2, (50, 3))
    for one, other in zip(
        TorchNetwork(net, torch.device("cpu")).value_and_gradient(x), net.value_and_gradient(x), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-13)


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_far_away_nothing_overflows(activation):
    net = Network(activation, (np.eye(1), np.eye(1)), (np.zeros(1), np.zeros(1)))
    x = np.array([[-1000.0], [1000.0]])
    for one, other in zip(
        TorchNetwork(net, torch.device("cpu")).value_gradient_hessian(x),
        net.value_gradient_hessian(x),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, atol=1e-14)


def test_torchs_own_differentiation_agrees():
    """Against torch.autograd, which shares none of it."""
    net = network("softplus", (4, 9, 7, 1))
    x = np.random.default_rng(1).uniform(-1, 1, (6, 4))

    def value(point):
        a = point
        for i, (W, b) in enumerate(zip(net.weights, net.biases, strict=True)):
            a = torch.tensor(W) @ (torch.nn.functional.softplus(a) if i else a) + torch.tensor(b)
        return a[0]

    _, gradient, hessian = TorchNetwork(net, torch.device("cpu")).value_gradient_hessian(x)
    for row, point in enumerate(torch.tensor(x)):
        expected = torch.autograd.functional.jacobian(value, point)
        np.testing.assert_allclose(gradient[:, row], expected, rtol=0, atol=1e-12)
        expected = torch.autograd.functional.hessian(value, point)
        np.testing.assert_allclose(hessian[:, :, row], expected, rtol=0, atol=1e-12)


@pytest.fixture(scope="module")
def fitted():
    options = {"iterations": 60, "hidden": [8], "anchor": "polynomial"}
    return TorchSurrogate(model="potential", **options).fit(potential_training_set(20, seed=1), seed=0)


def test_numpy_predicts_the_same_from_the_file(fitted, tmp_path):
    fitted.save(tmp_path / "surrogate.h5")
    states = potential_training_set(40, seed=3).states
    one, other = fitted.predict(states), NumpySurrogate.load(tmp_path / "surrogate.h5").predict(states)
    for name in ("potential", "stress", "fluid_volume", "mean_grad"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=0, atol=1e-13)
    for (_, slopes), (_, others) in zip(with_derivatives(one), with_derivatives(other), strict=True):
        for a, b in zip(slopes, others, strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)


def test_torch_is_left_as_it_was(fitted):
    threads, dtype, state = torch.get_num_threads(), torch.get_default_dtype(), torch.get_rng_state()
    torch.set_num_threads(2)
    try:
        fitted.predict(potential_training_set(5, seed=3).states)
        TorchSurrogate(model="potential", iterations=5, hidden=[4]).fit(potential_training_set(9), seed=0)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(threads)
    assert torch.get_default_dtype() == dtype
    assert torch.equal(torch.get_rng_state(), state)
    assert torch.is_grad_enabled()


def test_gradient_of_a_loss():
    function = TorchAutodiff("cpu").compile(
        lambda theta, constants: ((theta * constants["a"]) ** 2).sum(), {"a": np.array([1.0, 2.0, 3.0])}
    )
    value, gradient = function(np.array([1.0, -1.0, 2.0]))
    assert value == 41
    np.testing.assert_array_equal(gradient, [2, -8, 36])


def test_general_states_of_a_cubic_cell():
    """50 solves; the network knows the symmetry of the cube by its terms."""
    unseen = potential_training_set(200, seed=9)
    surrogate = TorchSurrogate(model="potential", iterations=300).fit(potential_training_set(50, 1), seed=0)
    predicted = surrogate.predict(unseen.states)
    assert surrogate.fitted.network.terms.name == "invariant"
    for name in ("stress", "fluid_volume"):
        truth = getattr(unseen.responses, name).reshape(200, -1)
        error = getattr(predicted, name).reshape(200, -1) - truth
        assert np.sqrt((error**2).mean()) < 3e-3 * np.ptp(truth, axis=0).max(), name
    truth = unseen.responses.tangent.stress_grad_u
    error = predicted.tangent.stress_grad_u - truth
    assert np.sqrt((error**2).mean()) < 2e-2 * np.abs(truth).max()


def test_without_symmetry_and_without_slopes():
    data = potential_training_set(20, seed=1)
    surrogate = TorchSurrogate(
        model="potential", iterations=20, hidden=[4], symmetry="none", derivatives=False
    ).fit(data, seed=0)
    assert surrogate.fitted.network.terms.name == "plain"
    assert len(surrogate.fitted.network.terms.weights) == 7


def test_a_gpu_that_is_not_there():
    if torch.cuda.is_available():
        assert choose_device("auto").type == available_device("cuda").type == "cuda"
        return
    assert choose_device("auto").type == available_device("cuda").type == "cpu"
    with pytest.raises(ConfigurationError, match=r"surrogate\.options\.device: torch sees no GPU"):
        choose_device("cuda")


@pytest.mark.skipif(not torch.cuda.is_available(), reason="torch sees no GPU")
@pytest.mark.parametrize(
    "options", [{"model": "potential", "iterations": 50, "hidden": [8]}, {"model": "mlp", "epochs": 200}]
)
def test_a_gpu_learns_the_same(options):
    data, unseen = potential_training_set(40, seed=1), potential_training_set(20, seed=2)
    one, other = (
        TorchSurrogate(**options, device=device).fit(data, seed=0).predict(unseen.states).mean_grad
        for device in ("cpu", "cuda")
    )
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-4)


def test_reading_a_polynomial_needs_no_torch(tmp_path):
    code = f"""
        import sys
        sys.modules["torch"] = None
        from pathlib import Path
        from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
        from porocore.testing.synthetic.potential_cell import potential_training_set
        from porocore_surrogate_torch.surrogate import TorchSurrogate
        path = Path({str(tmp_path / "surrogate.h5")!r})
        data = potential_training_set(20, seed=1)
        PolynomialSurrogate().fit(data, seed=0).save(path)
        print(TorchSurrogate.load(path).predict(data.states).stress.shape)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "(20, 3, 3)"
