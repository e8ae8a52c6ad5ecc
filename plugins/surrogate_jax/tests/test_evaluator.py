"""What is compiled against what is not, against numpy, and against differences."""

import logging
import subprocess
import sys
import textwrap

import jax
import numpy as np
import pytest

from porocore import ConfigurationError, MacroState, TrainingSet
from porocore.core.inputs import NAMES, InputSpace
from porocore.core.tensors import CUBIC
from porocore.surrogates.network.network import ACTIVATIONS, Network
from porocore.surrogates.network.sobolev import SobolevProblem
from porocore.surrogates.polynomial.monomials import invariant
from porocore.surrogates.potential import PotentialData
from porocore.testing.synthetic.cell import respond
from porocore_surrogate_jax import evaluator, library
from porocore_surrogate_jax.evaluator import LARGEST, JaxNetwork
from porocore_surrogate_jax.library import JaxAutodiff


def network(d=3, hidden=(7, 5), outputs=1, activation="tanh", seed=0):
    random = np.random.default_rng(seed)
    widths = [d, *hidden, outputs]
    pairs = list(zip(widths[1:], widths[:-1], strict=True))
    return Network(
        activation,
        tuple(random.normal(size=pair) for pair in pairs),
        tuple(random.normal(size=pair[0]) for pair in pairs),
    )


def points(n, d=3):
    return np.random.default_rng(1).uniform(-1, 1, (n, d))


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_jit_against_eager(activation):
    """In jax 0.7.1 an index by a constant array within vmap within jit gave wrong values without a word."""
    compiled, x = JaxNetwork(network(7, (40, 40, 40), activation=activation)), points(64, 7)
    jitted = compiled.value_gradient_hessian(x), compiled.value_and_gradient(x), (compiled.evaluate(x),)
    with jax.disable_jit():
        eager = compiled.value_gradient_hessian(x), compiled.value_and_gradient(x), (compiled.evaluate(x),)
    for one, other in zip(jitted, eager, strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * np.abs(b).max())


def test_the_loss_compiled_and_not():
    """The Sobolev loss of a cubic cell in all seven variables against numpy, and its gradient against differences."""
    inputs = InputSpace(NAMES, (-0.1,) * 9 + (0.0,), (0.1,) * 10)
    states = inputs.scatter(np.random.default_rng(3).uniform(inputs.lower, inputs.upper, (9, 10)))
    rest = respond(MacroState.zeros(1))
    data = PotentialData.from_training_set(
        TrainingSet(states, respond(states), inputs, rest, "made-up", {}, CUBIC)
    )
    problem = SobolevProblem.from_remainder(data, *data.remainder, invariant(CUBIC))
    shapes = [(6, problem.x.shape[1]), (5, 6), (1, 5)]
    theta = np.random.default_rng(0).normal(size=sum(rows * (columns + 1) for rows, columns in shapes))
    autodiff = JaxAutodiff("cpu")
    loss = autodiff.compile(problem.loss(autodiff.xp, shapes, "softplus"), problem.constants())
    value, gradient = loss(theta)
    in_numpy = problem.loss(np, shapes, "softplus")
    assert value == pytest.approx(in_numpy(theta, problem.constants()), rel=1e-12)
    for k in range(0, len(theta), 9):
        step = np.zeros_like(theta)
        step[k] = 1e-6
        up, down = (in_numpy(theta + sign * step, problem.constants()) for sign in (1, -1))
        assert gradient[k] == pytest.approx((up - down) / 2e-6, rel=1e-5, abs=1e-7 * np.abs(gradient).max())


def test_derivatives_against_differences():
    compiled, x, h = JaxNetwork(network()), points(5), 1e-4
    value, gradient, hessian = compiled.value_gradient_hessian(x)
    np.testing.assert_allclose(compiled.evaluate(x)[:, 0], value, rtol=0, atol=1e-13)
    for k in range(3):
        step = h * np.eye(3)[k]
        up, down = compiled.value_gradient_hessian(x + step), compiled.value_gradient_hessian(x - step)
        np.testing.assert_allclose(gradient[k], (up[0] - down[0]) / (2 * h), rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(hessian[k], (up[1] - down[1]) / (2 * h), rtol=1e-5, atol=1e-5)


def test_several_outputs():
    plain, x = network(2, (6,), outputs=4, activation="sigmoid"), points(11, 2)
    values, slopes = JaxNetwork(plain).value_and_gradient(x)
    assert slopes.shape == (2, 11, 4)
    for a, b in zip((values, slopes), plain.value_and_gradient(x), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-13)


@pytest.mark.parametrize("n", [0, 1, 8, 9, LARGEST, LARGEST + 1, 2 * LARGEST + 3])
def test_any_number_of_rows(n):
    plain, x = network(), points(n)
    several, factors = network(outputs=2), np.random.default_rng(2).normal(size=(n, 2))
    found = [*JaxNetwork(plain).value_gradient_hessian(x)]
    found += JaxNetwork(several).value_gradient_hessian(x, factors)
    expected = [*plain.value_gradient_hessian(x), *several.value_gradient_hessian(x, factors)]
    for a, b in zip(found, expected, strict=True):
        assert a.shape == b.shape
        assert a.dtype == np.float64
        assert a.flags.writeable
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)


def test_few_sizes_are_compiled_whatever_is_asked_for():
    """And one compilation serves all networks of one shape."""
    evaluator._compiled.cache_clear()
    for n in range(1, 2300, 13):
        JaxNetwork(network(seed=n)).evaluate(points(n))
    jitted = evaluator._compiled(evaluator._values, "tanh", library.choose_device("cpu"))
    assert jitted._cache_size() == 8


def test_a_gpu_that_is_not_there(monkeypatch):
    def none(backend=None):
        if backend == "gpu":
            raise RuntimeError("Unknown backend gpu")
        return jax.devices("cpu")

    monkeypatch.setattr(library.jax, "local_devices", none)
    library.choose_device.cache_clear()
    assert library.choose_device("auto").platform == "cpu"
    with pytest.raises(ConfigurationError, match=r"surrogate\.options\.device: jax sees no GPU here"):
        library.choose_device("cuda")
    library.choose_device.cache_clear()


def test_64_bits_are_set_with_the_library_and_not_before():
    """And neither the search for a GPU nor anything else is reported."""
    code = """
        import jax
        import porocore
        from porocore_surrogate_jax import hooks
        assert not jax.config.jax_enable_x64
        hooks.porocore_surrogates()[0].load()
        assert jax.config.jax_enable_x64
        from porocore_surrogate_jax.library import choose_device
        print(choose_device("auto").platform in ("cpu", "gpu"))
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["True"]
    assert done.stderr == ""


def test_logging_is_left_as_it_was():
    logger = logging.getLogger("jax._src.xla_bridge")
    before = logger.level
    library.choose_device.cache_clear()
    library.choose_device("auto")
    assert logger.level == before
