"""Training by torch: its Adam for ``mlp`` (Kingma & Ba 2015), derivatives of a loss, choice of the device."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import torch

from porocore.errors import ConfigurationError
from porocore.interfaces.surrogate import OnProgress
from porocore.states import Array, IntArray
from porocore.surrogates.mean_gradient import ScaledData
from porocore.surrogates.network.network import Network
from porocore.surrogates.network.options import MlpOptions
from porocore.surrogates.network.sobolev import Loss, unpack_layers
from porocore.surrogates.network.training import BETA1, BETA2, EPSILON, GAIN, MlpTraining, Part, TrainingState
from porocore_surrogate_torch.evaluator import available_device, one_thread

Tensors = dict[str, torch.Tensor]


class TorchTraining(MlpTraining):
    """Training by torch on one thread or a GPU; torch's number of threads is put back."""

    def __init__(self, data: ScaledData, options: MlpOptions, seed: int) -> None:
        super().__init__(data, options, seed, "torch")
        self._generator = torch.Generator().manual_seed(seed)
        self._device = choose_device(options.device)

    def run(self, checkpoint: Path | None = None, on_progress: OnProgress | None = None) -> Network:
        """Return the network with the smallest validation loss, trained on one thread."""
        with one_thread(), torch.enable_grad():
            return super().run(checkpoint, on_progress)

    def permutation(self, count: int) -> IntArray:
        """Return a random order by torch."""
        order: IntArray = torch.randperm(count, generator=self._generator).numpy()
        return order

    def first_weights(self) -> Array:
        """Return normal weights scaled by the width before and normal biases."""
        parts = []
        for rows, columns in self.shapes:
            parts.append(GAIN[self.options.activation] / math.sqrt(columns) * self._normal(rows * columns))
            parts.append(self._normal(rows))
        theta: Array = torch.cat(parts).numpy()
        return theta

    def start(self, state: TrainingState, training: Part, validation: Part) -> None:
        """Put the data and the state on the device."""
        self._state = state
        self._training, self._validation = (
            {name: self._tensor(array) for name, array in part.items()} for part in (training, validation)
        )
        self._theta = self._tensor(state.theta).requires_grad_()
        self._moment, self._square = self._tensor(state.moment), self._tensor(state.square)

    def step(self, rate: float) -> None:
        """Take one step of Adam in the order of torch.optim.Adam, whose import takes 1.3 s, to the same last bit."""
        self._loss = mean_square(self._theta, self.shapes, self.options.activation, self._training)
        (gradient,) = torch.autograd.grad(self._loss, self._theta)
        self._state.epoch += 1
        first, second = 1 - BETA1**self._state.epoch, 1 - BETA2**self._state.epoch
        with torch.no_grad():
            self._moment.lerp_(gradient, 1 - BETA1)
            self._square.mul_(BETA2).addcmul_(gradient, gradient, value=1 - BETA2)
            size = (self._square.sqrt() / second**0.5).add_(EPSILON)
            self._theta.addcdiv_(self._moment, size, value=-rate / first)

    def losses(self) -> tuple[float, float]:
        """Copy the parameters and their moments into the state and return both losses."""
        self._state.theta, self._state.moment, self._state.square = (
            tensor.detach().cpu().numpy().copy() for tensor in (self._theta, self._moment, self._square)
        )
        with torch.no_grad():
            validation = mean_square(self._theta, self.shapes, self.options.activation, self._validation)
        return self._loss.item(), validation.item()

    def _normal(self, count: int) -> torch.Tensor:
        return torch.randn(count, generator=self._generator, dtype=torch.float64)

    def _tensor(self, array: Array) -> torch.Tensor:
        return torch.tensor(array, dtype=torch.float64, device=self._device)


def mean_square(
    theta: torch.Tensor, shapes: list[tuple[int, int]], activation: str, part: Tensors
) -> torch.Tensor:
    """Return the mean of (N(x) − N(x₀) − N'(x₀)(x − x₀) − target)²; the last row of ``x`` is x₀."""
    x = part["x"]
    layers = unpack_layers(theta, shapes)
    a, slope, z = x, torch.empty(0), x
    for i, (W, b) in enumerate(layers):
        z = torch.addmm(b, a, W.T)
        slope = W @ slope if i else W
        if i < len(layers) - 1:
            a = torch.sigmoid(z) if activation == "sigmoid" else torch.tanh(z)
            rest = a[-1]
            slope = (rest * (1 - rest) if activation == "sigmoid" else 1 - rest * rest)[:, None] * slope
    remainder = z[:-1] - z[-1] - (x[:-1] - x[-1]) @ slope.T
    return ((remainder - part["target"]) ** 2).mean()


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
