"""Derivatives of a loss by torch."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np
import torch

from porocore.errors import ConfigurationError
from porocore.states import Array
from porocore.surrogates.network.sobolev import Loss
from porocore_surrogate_torch.evaluator import available_device, one_thread


class TorchAutodiff:
    """Reverse mode in double precision, on one thread or a GPU; see :mod:`porocore.surrogates.network.sobolev`."""

    xp: ModuleType = torch

    def __init__(self, device: str) -> None:
        self.device = choose_device(device)

    def compile(self, loss: Loss, constants: dict[str, Array]) -> Callable[[Array], tuple[float, Array]]:
        """Return θ → loss and gradient by reverse mode."""
        tensors = {
            name: torch.tensor(array, dtype=torch.float64, device=self.device)
            for name, array in constants.items()
        }

        def evaluate(theta: Array) -> tuple[float, Array]:
            with one_thread(), torch.enable_grad():
                t = torch.tensor(theta, dtype=torch.float64, device=self.device, requires_grad=True)
                value = loss(t, tensors)
                value.backward()
                assert t.grad is not None
                return float(value.detach()), np.array(t.grad.cpu().numpy())

        return evaluate


def choose_device(device: str) -> torch.device:
    """Return the device of that name; ``auto`` is a GPU where there is one.

    Raises
    ------
    ConfigurationError
        A GPU is asked for and torch sees none.
    """
    if device == "cuda" and not torch.cuda.is_available():
        raise ConfigurationError("surrogate.options.device: torch sees no GPU here; choose auto or cpu")
    return available_device(device)
