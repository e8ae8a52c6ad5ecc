"""What is particular to this network; what every surrogate obeys is in test_conformance.py."""

import subprocess
import sys
import textwrap
import time
from dataclasses import replace

import h5py
import numpy as np
import pytest
import torch

from porocore import Cell, ConfigurationError, DataError, MacroState, RunFolderError
from porocore.study.notes.abilities import require_learner
from porocore.surrogates.file.file import read_archive
from porocore.surrogates.mean_gradient import AnchoredModel, ScaledData
from porocore.surrogates.network.options import MlpOptions
from porocore.surrogates.network.sobolev import layered_network
from porocore.surrogates.network.training import FORMAT as TRAINING_FORMAT
from porocore.surrogates.network.training import TrainingState, learning_rate, split
from porocore.testing.synthetic.cell import INPUTS, synthetic_training_set
from porocore.testing.synthetic.porous_family import porous_training_set
from porocore_surrogate_torch import hooks, training
from porocore_surrogate_torch.surrogate import TorchSurrogate


@pytest.fixture(scope="module")
def data():
    return synthetic_training_set(100, seed=1)


@pytest.fixture(scope="module")
def fitted(data):
    return TorchSurrogate(epochs=100, hidden=[8, 8]).fit(data, seed=0)


def linear_part(data, states):
    tangent = data.reference.tangent
    return (
        np.einsum("ijkl,nkl->nij", tangent.mean_grad_grad_u[0], states.grad_u)
        + tangent.mean_grad_p[0] * states.p[:, None, None]
    )


def test_the_surrogate_is_offered_as_torch():
    (offer,) = hooks.porocore_surrogates()
    assert (offer.name, offer.requires) == ("torch", ("torch",))
    assert offer.load() is TorchSurrogate


def test_the_network_starts_at_second_order(data, fitted):
    """A tenth of the load leaves a hundredth of the deviation from the linear limit."""
    direction = np.array([[-0.05, 0.05]])
    deviations = []
    for load in (1e-2, 1e-3):
        states = INPUTS.scatter(load * direction)
        deviation = fitted.predict(states).mean_grad - linear_part(data, states)
        deviations.append(np.abs(deviation).max())
    assert deviations[0] / deviations[1] == pytest.approx(100, rel=0.05)


def test_the_papers_network_learns_the_map():
    """Three layers of 40, a sixth of the usual epochs: 0.03 % of the range of each output is measured."""
    data, unseen = synthetic_training_set(240, seed=0), synthetic_training_set(500, seed=9)
    surrogate = TorchSurrogate(epochs=2500).fit(data, seed=0)
    assert surrogate.options.hidden == (40, 40, 40)
    truth = unseen.responses.mean_grad.reshape(-1, 9)[:, [0, 4, 8]]
    error = surrogate.predict(unseen.states).mean_grad.reshape(-1, 9)[:, [0, 4, 8]] - truth
    assert (np.sqrt((error**2).mean(axis=0)) < 1e-3 * np.ptp(truth, axis=0)).all()


def test_only_what_deviates_from_the_linear_limit_is_learned(data, fitted):
    assert ScaledData.from_training_set(data).components == (0, 4, 8)
    sheared = MacroState(np.array([[[0, 0.1, 0], [0, -0.1, 0], [0, 0, 0]]]), np.array([0.1]))
    assert fitted.predict(sheared).mean_grad[0, 0, 1] == pytest.approx(-0.11 * 0.1)


@pytest.mark.parametrize("activation", ["sigmoid", "tanh"])
def test_what_is_trained_is_what_is_evaluated(data, fitted, activation):
    """The loss in torch against the model in numpy, and its gradient against differences."""
    scaled = ScaledData.from_training_set(data)
    options = MlpOptions(hidden=(7, 5), activation=activation)
    library = training.TorchTraining(scaled, options, seed=4)
    theta = library.first_weights()
    network = layered_network(theta, library.shapes, activation)
    model = AnchoredModel(
        scaled.linear, scaled.components, scaled.output_scale, network, fitted.fitted.sampled
    )
    error = (model.predict(data.states, tangent=False).mean_grad - data.responses.mean_grad).reshape(-1, 9)
    expected = ((error[:, scaled.components] / scaled.output_scale) ** 2).mean()
    part = {
        "x": torch.tensor(np.concatenate([scaled.x, scaled.rest])),
        "target": torch.tensor(scaled.target),
    }

    def loss(weights):
        return training.mean_square(weights, library.shapes, activation, part)

    theta = torch.tensor(theta)
    assert loss(theta).item() == pytest.approx(expected, rel=1e-12)
    theta.requires_grad_()
    (gradient,) = torch.autograd.grad(loss(theta), theta)
    with torch.no_grad():
        for k in range(0, len(theta), 7):
            step = torch.zeros_like(theta)
            step[k] = 1e-5
            difference = (loss(theta + step) - loss(theta - step)).item() / 2e-5
            assert difference == pytest.approx(gradient[k].item(), rel=1e-6, abs=1e-8)


def test_training_leaves_torch_as_it_was(data):
    threads, dtype, state = torch.get_num_threads(), torch.get_default_dtype(), torch.get_rng_state()
    torch.set_num_threads(2)
    try:
        with torch.no_grad():
            TorchSurrogate(epochs=20).fit(data, seed=0)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(threads)
    assert torch.get_default_dtype() == dtype
    assert torch.equal(torch.get_rng_state(), state)


@pytest.mark.slow
def test_a_killed_training_ends_with_the_same_weights(data, tmp_path):
    """Killed without notice, somewhere, in another process."""
    checkpoint, resumed, whole = (tmp_path / f"{name}.h5" for name in ("training", "resumed", "whole"))
    code = f"""
        from pathlib import Path
        from porocore.testing.synthetic.cell import synthetic_training_set
        from porocore.surrogates.network import training as adam
        from porocore_surrogate_torch.surrogate import TorchSurrogate
        adam.CHECKPOINT_INTERVAL = 0.0
        data = synthetic_training_set(100, seed=1)
        TorchSurrogate(epochs=700).fit(data, seed=2, checkpoint=Path({str(checkpoint)!r}))
    """
    process = subprocess.Popen([sys.executable, "-c", textwrap.dedent(code)])
    deadline = time.monotonic() + 60
    while not checkpoint.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.05)
    process.kill()
    assert process.wait() != 0
    assert 0 < read_archive(checkpoint, TRAINING_FORMAT, 1, "")[0]["epoch"] < 700
    # In a process of their own, too: torch rounds otherwise where another library's BLAS was loaded before it.
    code += f"""
        TorchSurrogate(epochs=700).fit(data, seed=2, checkpoint=Path({str(checkpoint)!r})).save(Path({str(resumed)!r}))
        TorchSurrogate(epochs=700).fit(data, seed=2).save(Path({str(whole)!r}))
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=True)
    predictions = [TorchSurrogate.load(path).predict(data.states).mean_grad for path in (resumed, whole)]
    np.testing.assert_array_equal(*predictions)


def test_using_a_surrogate_needs_no_torch(data, fitted, tmp_path):
    fitted.save(tmp_path / "surrogate.h5")
    code = f"""
        import sys
        sys.modules["torch"] = None
        from pathlib import Path
        from porocore import MacroState
        from porocore_surrogate_torch.surrogate import TorchSurrogate
        surrogate = TorchSurrogate.load(Path({str(tmp_path / "surrogate.h5")!r}))
        print(surrogate.predict(MacroState.zeros(1)).tangent.mean_grad_p[0, 1, 1])
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=True
    )
    assert float(done.stdout) == pytest.approx(data.reference.tangent.mean_grad_p[0, 1, 1])


def test_an_edited_file_is_refused(fitted, tmp_path):
    path = tmp_path / "surrogate.h5"
    fitted.save(path)
    with h5py.File(path, "r+") as file:
        file["reference/M"][0, 0, 0, 0] += 1e-6
    with pytest.raises(DataError, match=r"surrogate\.h5: .* checksum, .*train the surrogate again"):
        TorchSurrogate.load(path)


def test_a_surrogate_is_no_checkpoint(data, fitted, tmp_path):
    path = tmp_path / "surrogate.h5"
    fitted.save(path)
    with pytest.raises(DataError, match="expected the checkpoint of a training, got a trained surrogate"):
        TorchSurrogate(epochs=100, hidden=[8, 8]).fit(data, seed=0, checkpoint=path)


def test_a_place_that_cannot_be_written_to(fitted, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RunFolderError, match="cannot write"):
        fitted.save(tmp_path / "file" / "surrogate.h5")


def test_an_untrained_surrogate_does_not_answer(tmp_path):
    with pytest.raises(RuntimeError, match="call fit or load first"):
        TorchSurrogate().predict(MacroState.zeros(1))
    with pytest.raises(RuntimeError, match="call fit or load first"):
        TorchSurrogate().save(tmp_path / "surrogate.h5")


def test_training_data_that_cannot_be_used_are_refused(data):
    surrogate = TorchSurrogate(epochs=10)
    lost = data.responses.mean_grad.copy()
    lost[3] = np.nan
    with pytest.raises(DataError, match="1 of 100 training states hold no values"):
        surrogate.fit(replace(data, responses=replace(data.responses, mean_grad=lost)), seed=0)
    moved = data.states.grad_u.copy()
    moved[:2, 0, 0] = 0.1
    with pytest.raises(
        DataError, match="2 of 100 training states move a component besides the inputs H22, p"
    ):
        surrogate.fit(replace(data, states=MacroState(moved, data.states.p)), seed=0)
    with pytest.raises(DataError, match="tangent=True"):
        surrogate.fit(replace(data, reference=replace(data.reference, tangent=None)), seed=0)
    with pytest.raises(DataError, match="at least two training states, got 1"):
        surrogate.fit(replace(data, states=data.states[:1], responses=data.responses[:1]), seed=0)


def test_options_are_refused_with_their_keys():
    with pytest.raises(ConfigurationError) as error:
        TorchSurrogate(epoch=10, activation="relu", hidden=[40, -1])
    assert str(error.value).splitlines() == [
        "surrogate.options.hidden: expected a list of at most 20 layer widths, whole numbers from 1 to 1024, such as "
        "[40, 40, 40], got [40, -1]",
        "surrogate.options.activation: expected 'sigmoid' or 'tanh', got 'relu'",
        "surrogate.options.epoch: the torch surrogate has no such option for this model; did you mean 'epochs'?",
    ]


def test_options_as_yaml_gives_them():
    """YAML 1.1 reads 1e-3 as a text."""
    assert MlpOptions.parse({"learning_rate": "1e-3", "hidden": [8, 8]}, "torch").learning_rate == 1e-3


def test_its_adam_is_that_of_torch_to_the_last_bit(data):
    """Also in epoch 1270, the first in which a square root and a power of one half round differently."""
    options, begins = MlpOptions(hidden=(40, 40), epochs=1280), 1260
    own = training.TorchTraining(ScaledData.from_training_set(data), options, seed=3)
    parts = split(own.data, options.validation_fraction, own.permutation(len(own.data.x)))
    state = replace(TrainingState.initial(own.first_weights()), epoch=begins)
    theta = torch.tensor(state.theta, requires_grad=True)
    adam = torch.optim.Adam([theta], foreach=False)
    zeros = {name: torch.zeros_like(theta) for name in ("exp_avg", "exp_avg_sq")}
    adam.state[theta] = {"step": torch.tensor(float(begins)), **zeros}
    with training.one_thread():
        own.start(state, *parts)
        for epoch in range(begins, options.epochs):
            rate = learning_rate(options, epoch)
            own.step(rate)
            adam.param_groups[0]["lr"] = rate
            adam.zero_grad()
            training.mean_square(theta, own.shapes, options.activation, own._training).backward()
            adam.step()
        own.losses()
    assert state.epoch == options.epochs
    assert np.array_equal(state.theta, theta.detach().numpy())
    moments = adam.state[theta]
    assert np.array_equal(state.moment, moments["exp_avg"].numpy())
    assert np.array_equal(state.square, moments["exp_avg_sq"].numpy())


def test_a_cell_with_parameters_is_refused_by_name():
    """The potential of the same library learns it."""
    with pytest.raises(
        ConfigurationError, match=r"surrogate\.model: mlp .* \(radius, poisson_ratio\); choose potential"
    ):
        TorchSurrogate().fit(porous_training_set(4), seed=0)
    family = Cell(geometry={"radius": {"range": [0.2, 0.25]}})
    with pytest.raises(
        ConfigurationError, match=r"surrogate\.model: mlp of 'torch' learns no .*cell\.geometry\.radius"
    ):
        require_learner(TorchSurrogate(), "torch", family)
    require_learner(TorchSurrogate(model="potential"), "torch", family)


def test_a_training_does_not_wait_for_the_compiler_of_torch():
    """Its import takes as long as that of torch."""
    code = """
        import sys
        from porocore.testing.synthetic.cell import synthetic_training_set
        from porocore_surrogate_torch.surrogate import TorchSurrogate
        TorchSurrogate(epochs=20, hidden=[4]).fit(synthetic_training_set(30, seed=1), seed=0)
        print("torch" in sys.modules, "torch._dynamo" in sys.modules)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["True", "False"]
