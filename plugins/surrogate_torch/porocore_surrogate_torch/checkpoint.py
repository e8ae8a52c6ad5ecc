"""Where a training stands: the weights, the moments of Adam, the best weights, and the epoch.

The learning rate follows from the epoch, so there is no scheduler to keep.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import torch

from porocore import DataError
from porocore.surrogates.file.archive import read_archive, write_archive

FORMAT, VERSION = "porocore-surrogate-training", 1
ADVICE = "remove it to train from the beginning"


@dataclass
class TrainingState:
    """State after ``epoch`` epochs; all tensors (weights and biases,) float64."""

    theta: torch.Tensor
    moment: torch.Tensor
    square: torch.Tensor
    best_theta: torch.Tensor
    epoch: int = 0
    best_epoch: int = 0
    best_loss: float = math.inf
    validation_loss: float = math.inf

    @classmethod
    def first(cls, theta: torch.Tensor) -> TrainingState:
        """Before the first epoch."""
        return cls(theta, torch.zeros_like(theta), torch.zeros_like(theta), theta.clone())

    def move(self, device: torch.device) -> None:
        """Put all tensors on a device."""
        self.theta, self.best_theta = self.theta.to(device), self.best_theta.to(device)
        self.moment, self.square = self.moment.to(device), self.square.to(device)

    def look(self, validation_loss: float) -> None:
        """Keep the weights if their validation loss is the smallest so far."""
        self.validation_loss = validation_loss
        if validation_loss < self.best_loss:
            self.best_loss, self.best_epoch = validation_loss, self.epoch
            self.best_theta = self.theta.detach().clone()

    def restore(self, adam: torch.optim.Adam) -> None:
        """Put the moments into an optimiser of ``theta``."""
        if self.epoch:
            moments = {
                "step": torch.tensor(float(self.epoch), dtype=torch.float32),
                "exp_avg": self.moment,
                "exp_avg_sq": self.square,
            }
            adam.load_state_dict({"state": {0: moments}, "param_groups": adam.state_dict()["param_groups"]})

    def write(self, path: Path, belongs_to: str, adam: torch.optim.Adam) -> None:
        """Write atomically; ``belongs_to`` is a hash of the data, the options and the seed."""
        moments = adam.state[self.theta]
        header = {
            "belongs_to": belongs_to,
            "epoch": self.epoch,
            "best_epoch": self.best_epoch,
            "best_loss": self.best_loss,
            "validation_loss": self.validation_loss,
        }
        arrays = {
            "theta": self.theta.detach().cpu().numpy(),
            "moment": moments["exp_avg"].cpu().numpy(),
            "square": moments["exp_avg_sq"].cpu().numpy(),
            "best_theta": self.best_theta.cpu().numpy(),
        }
        write_archive(path, FORMAT, VERSION, header, arrays)

    @classmethod
    def read(cls, path: Path, belongs_to: str) -> TrainingState:
        """Read what :meth:`write` wrote.

        Raises
        ------
        DataError
            The file is damaged, foreign, or belongs to another training.
        """
        header, arrays = read_archive(path, FORMAT, VERSION, ADVICE)
        if header.pop("belongs_to") != belongs_to:
            raise DataError(
                f"{path}: this checkpoint belongs to a training with other data, options or seed; {ADVICE}"
            )
        theta, moment, square, best = (
            torch.tensor(arrays[name], dtype=torch.float64)
            for name in ("theta", "moment", "square", "best_theta")
        )
        return cls(theta, moment, square, best, **header)
