"""Training of networks by full-batch Adam: loop, state, checkpoint, resumable to the last bit.

The learning rate follows from the epoch, so there is no scheduler to keep.

All weights and biases are one vector θ. The learning rate falls along half a cosine to a hundredth of its first value,
and the weights with the smallest validation loss are kept. A library brings its own Adam, or only differentiates the
loss, which is written in operations that torch and jax.numpy share.
"""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from porocore.core.hdf5 import damaged
from porocore.errors import DataError
from porocore.interfaces.surrogate import OnProgress, TrainingProgress
from porocore.states import Array, IntArray
from porocore.surrogates.file.file import read_archive, write_archive
from porocore.surrogates.mean_gradient import ScaledData
from porocore.surrogates.network.network import Network
from porocore.surrogates.network.options import MlpOptions
from porocore.surrogates.network.sobolev import Autodiff, Loss, activate, layered_network, unpack_layers

FORMAT, VERSION = "porocore-surrogate-training", 1
#: Fields that a checkpoint holds.
ARRAYS = ("theta", "moment", "square", "best_theta")
NUMBERS: dict[str, type[Any]] = {
    "epoch": int,
    "best_epoch": int,
    "best_loss": float,
    "validation_loss": float,
}
AGAIN = "train from the beginning"
#: Constants of Kingma & Ba (2015).
BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-8


@dataclass
class TrainingState:
    """State after ``epoch`` epochs; all arrays have shape (parameters,)."""

    theta: Array
    moment: Array
    square: Array
    best_theta: Array
    epoch: int = 0
    best_epoch: int = 0
    best_loss: float = math.inf
    validation_loss: float = math.inf

    @classmethod
    def initial(cls, theta: Array) -> TrainingState:
        """Return the state before the first epoch."""
        return cls(theta.copy(), np.zeros_like(theta), np.zeros_like(theta), theta.copy())

    def step(self, gradient: Array, rate: float) -> None:
        """Take one step of Adam with a gradient (parameters,) and a learning rate."""
        self.epoch += 1
        self.moment = BETA1 * self.moment + (1 - BETA1) * gradient
        self.square = BETA2 * self.square + (1 - BETA2) * gradient * gradient
        size = np.sqrt(self.square / (1 - BETA2**self.epoch)) + EPSILON
        self.theta = self.theta - rate / (1 - BETA1**self.epoch) * self.moment / size

    def validate(self, validation_loss: float) -> None:
        """Record the validation loss; keep the weights if it is the smallest so far."""
        self.validation_loss = validation_loss
        if validation_loss < self.best_loss:
            self.best_loss, self.best_epoch = validation_loss, self.epoch
            self.best_theta = self.theta.copy()

    def write(self, path: Path, belongs_to: str) -> None:
        """Write atomically; ``belongs_to`` is a hash of the data, the options and the seed.

        Raises
        ------
        RunFolderError
            The disk is full or read-only.
        """
        header = {"belongs_to": belongs_to} | {name: getattr(self, name) for name in NUMBERS}
        write_archive(path, FORMAT, VERSION, header, {name: getattr(self, name) for name in ARRAYS})

    @classmethod
    def read(cls, path: Path, belongs_to: str) -> TrainingState:
        """Read what :meth:`write` wrote.

        Raises
        ------
        DataError
            The file is damaged, foreign, or belongs to another training.
        """
        header, arrays = read_archive(path, FORMAT, VERSION, AGAIN)
        if header.get("belongs_to") != belongs_to:
            raise DataError(
                f"{path}: this checkpoint belongs to a training with other data, options or seed; "
                f"move it elsewhere to {AGAIN}"
            )
        try:
            weights = [arrays[name] for name in ARRAYS]
            if any(w.ndim != 1 or w.shape != weights[0].shape for w in weights):
                raise ValueError(f"arrays of shapes {[w.shape for w in weights]}")
            numbers: dict[str, Any] = {name: kind(header[name]) for name, kind in NUMBERS.items()}
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise damaged(path, f"file of format {FORMAT}", error, AGAIN) from error
        theta, moment, square, best_theta = weights
        return cls(theta, moment, square, best_theta, **numbers)


#: Seconds of wall time between two checkpoints.
CHECKPOINT_INTERVAL = 2.0
#: Epochs between two validation losses, and between two reports of progress.
VALIDATION_INTERVAL = 10
REPORT_INTERVAL = 100
#: Last learning rate over the first.
DECAY = 1e-2
#: Standard deviation of the first weights times √(inputs of the layer); σ' of a sigmoid is at most 1/4.
GAIN = {"sigmoid": 2.0, "tanh": 1.0}


#: One part of the data: scaled inputs ``x``, followed by those at rest, and ``target``.
Part = dict[str, Array]


class MlpTraining(ABC):
    """Training of one network: the loop is here; a library draws random numbers, evaluates the loss and steps.

    Attributes
    ----------
    data, options
        Training data and settings.
    shapes
        (width, width before) of each layer.
    """

    def __init__(self, data: ScaledData, options: MlpOptions, seed: int, backend: str) -> None:
        self.data, self.options = data, options
        widths = data.x.shape[1], *options.hidden, len(data.components)
        self.shapes = [(width, before) for before, width in pairwise(widths)]
        self._owner = data.fingerprint(backend, options.model_dump_json(), str(seed))

    @abstractmethod
    def permutation(self, count: int) -> IntArray:
        """Return a random order of the training states; drawn before the first weights."""

    @abstractmethod
    def first_weights(self) -> Array:
        """Return random weights and biases of all layers."""

    @abstractmethod
    def start(self, state: TrainingState, training: Part, validation: Part) -> None:
        """Continue from a state."""

    @abstractmethod
    def step(self, rate: float) -> None:
        """Take one step of Adam and count the epoch."""

    @abstractmethod
    def losses(self) -> tuple[float, float]:
        """Bring the state up to date; return the training loss before the last step and the validation loss."""

    def run(self, checkpoint: Path | None = None, on_progress: OnProgress | None = None) -> Network:
        """Return the network with the smallest validation loss.

        Raises
        ------
        DataError
            ``checkpoint`` exists and is damaged, or belongs to another backend, other data, options or another seed.
        RunFolderError
            ``checkpoint`` cannot be written.
        """
        options = self.options
        parts = split(self.data, options.validation_fraction, self.permutation(len(self.data.x)))
        if checkpoint is not None and checkpoint.exists():
            state = TrainingState.read(checkpoint, self._owner)
        else:
            state = TrainingState.initial(self.first_weights())
        self.start(state, *parts)
        saved, last = time.monotonic(), _is_over(state, options)
        while not last:
            self.step(learning_rate(options, state.epoch))
            if state.epoch % VALIDATION_INTERVAL and state.epoch < options.epochs:
                continue
            loss, validation_loss = self.losses()
            state.validate(validation_loss)
            last = _is_over(state, options)
            if checkpoint is not None and (last or time.monotonic() - saved >= CHECKPOINT_INTERVAL):
                state.write(checkpoint, self._owner)
                saved = time.monotonic()
            if on_progress is not None and (last or state.epoch % REPORT_INTERVAL == 0):
                ends = state.best_epoch + options.patience
                on_progress(TrainingProgress(state.epoch, options.epochs, loss, validation_loss, ends))
        return layered_network(state.best_theta, self.shapes, options.activation)


class AutodiffTraining(MlpTraining):
    """Training by Adam in numpy, with gradients by the library of ``autodiff``."""

    def __init__(
        self, data: ScaledData, options: MlpOptions, seed: int, backend: str, autodiff: Autodiff
    ) -> None:
        super().__init__(data, options, seed, backend)
        self._random, self._autodiff = np.random.default_rng(seed), autodiff

    def permutation(self, count: int) -> IntArray:
        """Return a random order by numpy."""
        return self._random.permutation(count)

    def first_weights(self) -> Array:
        """Return random weights by numpy."""
        return first_weights(self.shapes, self.options.activation, self._random)

    def start(self, state: TrainingState, training: Part, validation: Part) -> None:
        """Compile the losses of both parts."""
        loss = mean_square(self._autodiff.xp, self.shapes, self.options.activation)
        self._state, self._loss = state, math.nan
        self._train, self._validate = (self._autodiff.compile(loss, part) for part in (training, validation))

    def step(self, rate: float) -> None:
        """Take one step in numpy."""
        self._loss, gradient = self._train(self._state.theta)
        self._state.step(gradient, rate)

    def losses(self) -> tuple[float, float]:
        """Return both losses; the state is up to date."""
        return self._loss, self._validate(self._state.theta)[0]


def _is_over(state: TrainingState, options: MlpOptions) -> bool:
    """Return whether the last epoch is done or the patience is exhausted."""
    return state.epoch >= options.epochs or state.epoch - state.best_epoch >= options.patience


def mean_square(xp: Any, shapes: list[tuple[int, int]], activation: str) -> Loss:
    """Return the loss, the mean of (N(x) − N(x₀) − N'(x₀)(x − x₀) − target)²; the last row of ``x`` is x₀."""

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
    """Return the learning rate, half a cosine over the epochs."""
    share = 0.5 * (1 + math.cos(math.pi * epoch / options.epochs))
    return options.learning_rate * (DECAY + (1 - DECAY) * share)


def first_weights(shapes: list[tuple[int, int]], activation: str, random: np.random.Generator) -> Array:
    """Return normal weights scaled by the width before and normal biases; the anchor cancels the last bias."""
    parts = []
    for rows, columns in shapes:
        parts.append(random.normal(size=rows * columns) * GAIN[activation] / math.sqrt(columns))
        parts.append(random.normal(size=rows))
    return np.concatenate(parts)


def split(data: ScaledData, fraction: float, order: IntArray) -> tuple[Part, Part]:
    """Return the training and the validation part of the states in a random order."""
    count = min(max(1, round(fraction * len(order))), len(order) - 1)
    training, validation = (
        {"x": np.concatenate([data.x[rows], data.rest]), "target": data.target[rows]}
        for rows in (order[count:], order[:count])
    )
    return training, validation
