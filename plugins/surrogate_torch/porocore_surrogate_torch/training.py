"""Training: full-batch Adam on the mean squared error, deterministic to the last bit, and resumable.

All weights and biases are one vector θ, so that the state of Adam is two more vectors. Adam as in Kingma & Ba
(2015); the learning rate falls along half a cosine to a hundredth of its first value.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

import torch

from porocore import TrainingProgress
from porocore.surrogates.mean_gradient.data import ScaledData
from porocore.surrogates.network.network import Network
from porocore.surrogates.network.options import MlpOptions
from porocore_surrogate_torch.autodiff import choose_device
from porocore_surrogate_torch.checkpoint import TrainingState
from porocore_surrogate_torch.evaluator import one_thread

Shapes: TypeAlias = list[tuple[int, ...]]

#: Seconds of wall time between two checkpoints.
CHECKPOINT_INTERVAL = 2.0
#: Epochs between two looks at the validation loss, and between two reports of progress.
VALIDATION_INTERVAL = 10
REPORT_INTERVAL = 100
#: Last learning rate over the first.
DECAY = 1e-2
#: Standard deviation of the first weights times √(inputs of the layer); σ' of a sigmoid is at most 1/4.
GAIN = {"sigmoid": 2.0, "tanh": 1.0}


def train(
    data: ScaledData,
    options: MlpOptions,
    seed: int,
    checkpoint: Path | None = None,
    on_progress: Callable[[TrainingProgress], None] | None = None,
) -> Network:
    """The network with the smallest validation loss on the way.

    Raises
    ------
    DataError
        ``checkpoint`` exists and is damaged, or belongs to other data, options or another seed.
    """
    with one_thread(), torch.enable_grad():
        return _train(data, options, seed, checkpoint, on_progress)


def _train(
    data: ScaledData,
    options: MlpOptions,
    seed: int,
    checkpoint: Path | None,
    on_progress: Callable[[TrainingProgress], None] | None,
) -> Network:
    generator = torch.Generator().manual_seed(seed)
    shapes = _shapes(data.x.shape[1], options.hidden, len(data.components))
    x_train, y_train, x_valid, y_valid = _split(data, options.validation_fraction, generator)
    belongs_to = data.fingerprint(options.model_dump_json(), str(seed))
    state = TrainingState.read(checkpoint, belongs_to) if checkpoint and checkpoint.exists() else None
    state = state or TrainingState.first(_first_weights(shapes, options.activation, generator))
    state.move(choose_device(options.device))
    x_train, y_train, x_valid, y_valid = (
        tensor.to(state.theta.device) for tensor in (x_train, y_train, x_valid, y_valid)
    )

    theta = state.theta.requires_grad_()
    adam = torch.optim.Adam([theta], lr=options.learning_rate, foreach=False)
    state.restore(adam)
    saved = time.monotonic()
    last = _is_over(state, options)
    while not last:
        for group in adam.param_groups:
            group["lr"] = _learning_rate(options, state.epoch)
        adam.zero_grad()
        loss = _loss(theta, shapes, options.activation, x_train, y_train)
        loss.backward()  # type: ignore[no-untyped-call]
        adam.step()
        state.epoch += 1
        if state.epoch % VALIDATION_INTERVAL and state.epoch < options.epochs:
            continue
        with torch.no_grad():
            state.look(_loss(theta, shapes, options.activation, x_valid, y_valid).item())
        last = _is_over(state, options)
        if checkpoint and (last or time.monotonic() - saved >= CHECKPOINT_INTERVAL):
            state.write(checkpoint, belongs_to, adam)
            saved = time.monotonic()
        if on_progress and (last or state.epoch % REPORT_INTERVAL == 0):
            on_progress(TrainingProgress(state.epoch, options.epochs, loss.item(), state.validation_loss))
    return _as_network(state.best_theta, shapes, options.activation)


def _is_over(state: TrainingState, options: MlpOptions) -> bool:
    """Whether the last epoch is done or the patience at an end; asked where the validation loss is known."""
    return state.epoch >= options.epochs or state.epoch - state.best_epoch >= options.patience


def _loss(
    theta: torch.Tensor, shapes: Shapes, activation: str, x: torch.Tensor, target: torch.Tensor
) -> torch.Tensor:
    """Mean of (N(x) − N(x₀) − N'(x₀)(x − x₀) − target)²; the last row of ``x`` is x₀."""
    layers = _layers(theta, shapes)
    a, slope, z = x, torch.empty(0), x
    for i, (W, b) in enumerate(layers):
        z = torch.addmm(b, a, W.T)
        slope = W @ slope if i else W
        if i < len(layers) - 1:
            a = torch.sigmoid(z) if activation == "sigmoid" else torch.tanh(z)
            rest = a[-1]
            slope = (rest * (1 - rest) if activation == "sigmoid" else 1 - rest * rest)[:, None] * slope
    remainder = z[:-1] - z[-1] - (x[:-1] - x[-1]) @ slope.T
    return ((remainder - target) ** 2).mean()


def _learning_rate(options: MlpOptions, epoch: int) -> float:
    share = 0.5 * (1 + math.cos(math.pi * epoch / options.epochs))
    return options.learning_rate * (DECAY + (1 - DECAY) * share)


def _shapes(inputs: int, hidden: tuple[int, ...], outputs: int) -> Shapes:
    """Of W and b, layer by layer."""
    widths = [inputs, *hidden, outputs]
    return [shape for before, width in pairwise(widths) for shape in ((width, before), (width,))]


def _layers(theta: torch.Tensor, shapes: Shapes) -> list[tuple[torch.Tensor, torch.Tensor]]:
    parts = torch.split(theta, [math.prod(shape) for shape in shapes])
    views = [part.view(shape) for part, shape in zip(parts, shapes, strict=True)]
    return list(zip(views[::2], views[1::2], strict=True))


def _first_weights(shapes: Shapes, activation: str, generator: torch.Generator) -> torch.Tensor:
    """Normal weights scaled by the width before, normal biases; the anchor makes the last bias irrelevant."""
    parts = []
    for shape in shapes:
        gain = 1.0 if len(shape) == 1 else GAIN[activation] / math.sqrt(shape[1])
        parts.append(gain * torch.randn(math.prod(shape), generator=generator, dtype=torch.float64))
    return torch.cat(parts)


def _split(data: ScaledData, fraction: float, generator: torch.Generator) -> tuple[torch.Tensor, ...]:
    """Inputs, followed by the reference state, and targets: of the training part, then of the validation part."""
    order = torch.randperm(len(data.x), generator=generator)
    valid = min(max(1, round(fraction * len(order))), len(order) - 1)
    x, rest, y = (torch.tensor(array, dtype=torch.float64) for array in (data.x, data.rest, data.target))
    parts = (order[valid:], order[:valid])
    return tuple(tensor for rows in parts for tensor in (torch.cat([x[rows], rest]), y[rows]))


def _as_network(theta: torch.Tensor, shapes: Shapes, activation: str) -> Network:
    layers = [(W.numpy().copy(), b.numpy().copy()) for W, b in _layers(theta.detach().cpu(), shapes)]
    weights, biases = zip(*layers, strict=True)
    return Network(activation, weights, biases)
