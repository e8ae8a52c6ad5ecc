"""State of a training by Adam: weights, moments, one step, checkpoint file.

The learning rate follows from the epoch, so there is no scheduler to keep.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from porocore.core.hdf5 import damaged
from porocore.errors import DataError
from porocore.states import Array
from porocore.surrogates.file.archive import read_archive, write_archive

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
