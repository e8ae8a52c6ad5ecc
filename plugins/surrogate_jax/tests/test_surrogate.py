"""What is particular to this plugin; what every surrogate obeys is in test_conformance.py."""

import subprocess
import sys
import textwrap
import time

import h5py
import numpy as np
import pytest

from porocore import DataError
from porocore.surrogates.file.file import read_archive
from porocore.surrogates.mean_gradient import AnchoredModel, ScaledData
from porocore.surrogates.network import training as adam
from porocore.surrogates.network.network import Network
from porocore.surrogates.network.options import MlpOptions
from porocore.surrogates.network.sobolev import unpack_layers
from porocore.surrogates.network.training import FORMAT as TRAINING_FORMAT
from porocore.surrogates.portable import NumpySurrogate
from porocore.testing.synthetic.cell import synthetic_training_set
from porocore_surrogate_jax import hooks
from porocore_surrogate_jax.evaluator import JaxNetwork
from porocore_surrogate_jax.library import JaxAutodiff, choose_device
from porocore_surrogate_jax.surrogate import JaxSurrogate


@pytest.fixture(scope="module")
def data():
    return synthetic_training_set(100, seed=1)


def test_the_surrogate_is_offered_as_jax():
    (offer,) = hooks.porocore_surrogates()
    assert (offer.name, offer.requires) == ("jax", ("jax",))
    assert offer.load() is JaxSurrogate


def test_the_papers_network_learns_the_map():
    """Three layers of 40, a sixth of the usual epochs: 0.03 % of the range of each output is measured."""
    data, unseen = synthetic_training_set(240, seed=0), synthetic_training_set(500, seed=9)
    surrogate = JaxSurrogate(epochs=2500).fit(data, seed=0)
    assert surrogate.options.hidden == (40, 40, 40)
    truth = unseen.responses.mean_grad.reshape(-1, 9)[:, [0, 4, 8]]
    error = surrogate.predict(unseen.states).mean_grad.reshape(-1, 9)[:, [0, 4, 8]] - truth
    assert (np.sqrt((error**2).mean(axis=0)) < 1e-3 * np.ptp(truth, axis=0)).all()


@pytest.mark.parametrize("activation", ["sigmoid", "tanh"])
def test_what_is_trained_is_what_is_evaluated(data, activation):
    """The loss against the model in numpy, and its gradient against differences."""
    scaled, shapes = ScaledData.from_training_set(data), [(7, 2), (5, 7), (3, 5)]
    theta = adam.first_weights(shapes, activation, np.random.default_rng(4))
    weights, biases = zip(*unpack_layers(theta, shapes), strict=True)
    sampled = JaxSurrogate(epochs=1, hidden=[2]).fit(data, seed=0).fitted.sampled
    model = AnchoredModel(
        scaled.linear, scaled.components, scaled.output_scale, Network(activation, weights, biases), sampled
    )
    error = (model.predict(data.states, tangent=False).mean_grad - data.responses.mean_grad).reshape(-1, 9)
    expected = ((error[:, scaled.components] / scaled.output_scale) ** 2).mean()
    autodiff = JaxAutodiff("cpu")
    constants = {"x": np.concatenate([scaled.x, scaled.rest]), "target": scaled.target}
    loss = autodiff.compile(adam.mean_square(autodiff.xp, shapes, activation), constants)
    value, gradient = loss(theta)
    assert value == pytest.approx(expected, rel=1e-12)
    for k in range(0, len(theta), 7):
        step = np.zeros_like(theta)
        step[k] = 1e-5
        difference = (loss(theta + step)[0] - loss(theta - step)[0]) / 2e-5
        assert difference == pytest.approx(gradient[k], rel=1e-6, abs=1e-8)


def test_adam_and_its_schedule(data):
    """The first step moves each parameter by the learning rate; the last rate is a hundredth of the first."""
    options = MlpOptions(epochs=1000, learning_rate=0.02)
    assert adam.learning_rate(options, 0) == pytest.approx(0.02)
    assert adam.learning_rate(options, 500) == pytest.approx(0.0101)
    assert adam.learning_rate(options, 1000) == pytest.approx(2e-4)
    state = adam.TrainingState.initial(np.zeros(3))
    state.step(np.array([3.0, -1e-3, 0.0]), 0.02)
    np.testing.assert_allclose(state.theta, [-0.02, 0.02, 0.0], rtol=1e-4)


def test_the_validation_part_is_the_asked_share(data):
    scaled = ScaledData.from_training_set(data)
    training, validation = adam.split(scaled, 0.15, np.random.default_rng(0).permutation(100))
    assert (len(training["target"]), len(validation["target"])) == (85, 15)
    rows = np.concatenate([training["x"][:-1], validation["x"][:-1]])
    np.testing.assert_array_equal(np.sort(rows, axis=0), np.sort(scaled.x, axis=0))
    for part in (training, validation):
        np.testing.assert_array_equal(part["x"][-1:], scaled.rest)


@pytest.mark.slow
def test_a_killed_training_ends_with_the_same_weights(data, tmp_path):
    """Killed without notice, somewhere, in another process."""
    checkpoint = tmp_path / "training.h5"
    code = f"""
        from pathlib import Path
        from porocore.testing.synthetic.cell import synthetic_training_set
        from porocore.surrogates.network import training as adam
        from porocore_surrogate_jax.surrogate import JaxSurrogate
        adam.CHECKPOINT_INTERVAL = 0.0
        data = synthetic_training_set(100, seed=1)
        JaxSurrogate(epochs=700).fit(data, seed=2, checkpoint=Path({str(checkpoint)!r}))
    """
    process = subprocess.Popen([sys.executable, "-c", textwrap.dedent(code)])
    deadline = time.monotonic() + 60
    while not checkpoint.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.05)
    process.kill()
    assert process.wait() != 0
    assert 0 < read_archive(checkpoint, TRAINING_FORMAT, 1, "")[0]["epoch"] < 700
    resumed = JaxSurrogate(epochs=700).fit(data, seed=2, checkpoint=checkpoint)
    whole = JaxSurrogate(epochs=700).fit(data, seed=2)
    np.testing.assert_array_equal(
        resumed.predict(data.states).mean_grad, whole.predict(data.states).mean_grad
    )


def test_its_file_needs_no_jax(data, tmp_path):
    path = tmp_path / "surrogate.h5"
    fitted = JaxSurrogate(epochs=50, hidden=[5]).fit(data, seed=0)
    fitted.save(path)
    code = f"""
        import sys
        sys.modules["jax"] = None
        from pathlib import Path
        from porocore import MacroState
        from porocore.surrogates.portable import NumpySurrogate
        surrogate = NumpySurrogate.load(Path({str(path)!r}))
        print(surrogate.predict(MacroState.zeros(1)).tangent.mean_grad_p[0, 1, 1])
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=True
    )
    assert float(done.stdout) == pytest.approx(data.reference.tangent.mean_grad_p[0, 1, 1])


def test_a_file_trained_for_a_gpu_is_used_without_one(data, tmp_path):
    fitted = JaxSurrogate(epochs=50, hidden=[5]).fit(data, seed=0)
    fitted.settings["device"] = "cuda"
    fitted.save(tmp_path / "surrogate.h5")
    loaded = JaxSurrogate.load(tmp_path / "surrogate.h5")
    assert isinstance(loaded.fitted.network, JaxNetwork)
    assert loaded.fitted.network.device == choose_device("auto")
    plain = NumpySurrogate.load(tmp_path / "surrogate.h5")
    np.testing.assert_allclose(
        loaded.predict(data.states).mean_grad, plain.predict(data.states).mean_grad, rtol=0, atol=1e-12
    )


def test_an_edited_file_is_refused(data, tmp_path):
    path = tmp_path / "surrogate.h5"
    JaxSurrogate(epochs=20, hidden=[5]).fit(data, seed=0).save(path)
    with h5py.File(path, "r+") as file:
        file["reference/M"][0, 0, 0, 0] += 1e-6
    with pytest.raises(DataError, match=r"surrogate\.h5: .* checksum, .*train the surrogate again"):
        JaxSurrogate.load(path)


def test_a_network_on_a_polynomial_improves_on_it(data):
    """What the polynomial leaves over is small; the training must begin all the same."""
    errors, reports = [], []
    for iterations in (1, 300):
        fitted = JaxSurrogate(model="potential", anchor="polynomial", hidden=[10, 10], iterations=iterations)
        fitted.fit(data, seed=0, on_progress=reports.append)
        errors.append(fitted.accuracy["slopes of W on the training states"])
    assert reports[-1].epoch > 20
    assert errors[1] < 0.2 * errors[0]
