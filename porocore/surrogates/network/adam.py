"""Training the network of ``mlp``: full-batch Adam on the mean squared error, resumable to the last bit.

The loss is written once, in operations that torch and jax.numpy share, and differentiated by a library; Adam itself
is a few lines of numpy on one vector of all parameters. The learning rate falls along half a cosine to a hundredth
of its first value, and the weights with the smallest validation loss on the way are kept.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from porocore.interfaces.surrogate import TrainingProgress
from porocore.states import Array
from porocore.surrogates.mean_gradient.data import ScaledData
from porocore.surrogates.network.network import Network
from porocore.surrogates.network.options import MlpOptions
from porocore.surrogates.network.sobolev import Autodiff, Loss, activate, unpack_layers
from porocore.surrogates.network.training_state import TrainingState

#: Seconds of wall time between two checkpoints.
CHECKPOINT_INTERVAL = 2.0
#: Epochs between two looks at the validation loss, and between two reports of progress.
VALIDATION_INTERVAL = 10
REPORT_INTERVAL = 100
#: Last learning rate over the first.
DECAY = 1e-2
#: Standard deviation of the first weights times √(inputs of the layer); σ' of a sigmoid is at most 1/4.
GAIN = {"sigmoid": 2.0, "tanh": 1.0}


def train_mlp(
    data: ScaledData,
    options: MlpOptions,
    seed: int,
    autodiff: Autodiff,
    backend: str,
    checkpoint: Path | None = None,
    on_progress: Callable[[TrainingProgress], None] | None = None,
) -> Network:
    """The network with the smallest validation loss on the way.

    Raises
    ------
    DataError
        ``checkpoint`` exists and is damaged, or belongs to another backend, other data, options or another seed.
    RunFolderError
        ``checkpoint`` cannot be written.
    """
    random = np.random.default_rng(seed)
    widths = [data.x.shape[1], *options.hidden, len(data.components)]
    shapes = [(width, before) for before, width in pairwise(widths)]
    training, validation = split(data, options.validation_fraction, random)
    belongs_to = data.fingerprint(backend, options.model_dump_json(), str(seed))
    if checkpoint is not None and checkpoint.exists():
        state = TrainingState.read(checkpoint, belongs_to)
    else:
        state = TrainingState.first(first_weights(shapes, options.activation, random))
    loss = mean_square(autodiff.xp, shapes, options.activation)
    train_loss, valid_loss = (autodiff.compile(loss, constants) for constants in (training, validation))

    saved, last = time.monotonic(), _is_over(state, options)
    while not last:
        value, gradient = train_loss(state.theta)
        state.step(gradient, learning_rate(options, state.epoch))
        if state.epoch % VALIDATION_INTERVAL and state.epoch < options.epochs:
            continue
        state.look(valid_loss(state.theta)[0])
        last = _is_over(state, options)
        if checkpoint is not None and (last or time.monotonic() - saved >= CHECKPOINT_INTERVAL):
            state.write(checkpoint, belongs_to)
            saved = time.monotonic()
        if on_progress is not None and (last or state.epoch % REPORT_INTERVAL == 0):
            on_progress(TrainingProgress(state.epoch, options.epochs, value, state.validation_loss))
    layers = unpack_layers(state.best_theta, shapes)
    return Network(options.activation, tuple(W.copy() for W, _ in layers), tuple(b.copy() for _, b in layers))


def _is_over(state: TrainingState, options: MlpOptions) -> bool:
    """Whether the last epoch is done or the patience at an end; asked where the validation loss is known."""
    return state.epoch >= options.epochs or state.epoch - state.best_epoch >= options.patience


def mean_square(xp: Any, shapes: list[tuple[int, int]], activation: str) -> Loss:
    """Mean of (N(x) − N(x₀) − N'(x₀)(x − x₀) − target)²; the last row of ``x`` is x₀."""

    def evaluate(theta: Any, constants: Any) -> Any:
        x = constants["x"]
        layers = unpack_layers(theta, shapes)
        a = z = x
        slope = None
        for i, (W, b) in enumerate(layers):
            z = a @ W.T + b
            slope = W if slope is None else W @ slope
            if i < len(layers) - 1:
                a, steepness, _ = activate(xp, activation, z)
                slope = steepness[-1][:, None] * slope
        assert slope is not None
        remainder = z[:-1] - z[-1] - (x[:-1] - x[-1]) @ slope.T
        return ((remainder - constants["target"]) ** 2).mean()

    return evaluate


def learning_rate(options: MlpOptions, epoch: int) -> float:
    """Half a cosine over the epochs."""
    share = 0.5 * (1 + math.cos(math.pi * epoch / options.epochs))
    return options.learning_rate * (DECAY + (1 - DECAY) * share)


def first_weights(shapes: list[tuple[int, int]], activation: str, random: np.random.Generator) -> Array:
    """Normal weights scaled by the width before, normal biases; the anchor makes the last bias irrelevant."""
    parts = []
    for rows, columns in shapes:
        parts.append(random.normal(size=rows * columns) * GAIN[activation] / math.sqrt(columns))
        parts.append(random.normal(size=rows))
    return np.concatenate(parts)


def split(
    data: ScaledData, fraction: float, random: np.random.Generator
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Inputs ``x``, followed by the reference state, and ``target``: of the training and of the validation part."""
    order = random.permutation(len(data.x))
    count = min(max(1, round(fraction * len(order))), len(order) - 1)
    training, validation = (
        {"x": np.concatenate([data.x[rows], data.rest]), "target": data.target[rows]}
        for rows in (order[count:], order[:count])
    )
    return training, validation
