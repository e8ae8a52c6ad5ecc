"""Evaluation of a network by torch: values, gradients, Hessians; the GPU that there is, one thread."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import torch

from porocore.states import Array
from porocore.surrogates.network.network import Derivatives, Evaluator, Network

Three = tuple[torch.Tensor, torch.Tensor, torch.Tensor]


class TorchNetwork(Evaluator):
    """A network evaluated on a processor or a GPU, in double precision.

    No graph is recorded. With J_l = ∂z_l/∂x and δ_l = ∂N/∂a_l the Hessian is Σ_l J_lᵀ diag(δ_l σ″(z_l)) J_l.

    Parameters
    ----------
    network
        Weights and biases.
    device
        Device of the evaluation.
    """

    def __init__(self, network: Network, device: torch.device) -> None:
        self.network, self.device = network, device
        self._weights = [self._tensor(W) for W in network.weights]
        self._biases = [self._tensor(b) for b in network.biases]

    @property
    def as_numpy(self) -> Network:
        """The same network in numpy."""
        return self.network

    def evaluate(self, x: Array) -> Array:
        """Return the values (n, o) at x (n, d)."""
        with one_thread(), torch.no_grad():
            a = self._tensor(x)
            for layer, (W, b) in enumerate(zip(self._weights, self._biases, strict=True)):
                if layer:
                    a = _activate(self.network.activation, a, 0)[0]
                a = torch.addmm(b, a, W.T)
            return _numpy(a)

    def value_and_gradient(self, x: Array) -> tuple[Array, Array]:
        """Return the values (n, o) and ∂N_o/∂x_k (d, n, o)."""
        with one_thread(), torch.no_grad():
            n, d = x.shape
            z, layers = self._hidden(self._tensor(x), 1)
            W = self._weights[-1]
            if not layers:
                return _numpy(z), _numpy(W.T[:, None, :].expand(d, n, -1))
            J, slope, _ = layers[-1]
            J = ((J * slope[:, None, :]).reshape(n * d, W.shape[1]) @ W.T).reshape(n, d, len(W))
            return _numpy(z), _numpy(J.permute(1, 0, 2))

    def value_gradient_hessian(self, x: Array, factors: Array | None = None) -> Derivatives:
        """Return value (n,), gradient (d, n) and Hessian (d, d, n) of one output, or of a sum with ``factors``."""
        with one_thread(), torch.no_grad():
            z, layers = self._hidden(self._tensor(x), 2)
            n, d = x.shape
            hessian = torch.zeros((n, d, d), dtype=torch.float64, device=self.device)
            last, c = self._weights[-1], None if factors is None else self._tensor(factors)
            delta = last.expand(n, -1) if c is None else c @ last  # ∂N/∂a of the last hidden layer
            for layer in range(len(layers) - 1, -1, -1):
                J, slope, curvature = layers[layer]
                weight = delta * curvature
                if layer:
                    hessian = torch.baddbmm(hessian, J * weight[:, None, :], J.transpose(1, 2))
                else:  # J is the same everywhere
                    W = self._weights[0]
                    squares = (W[:, :, None] * W[:, None, :]).reshape(len(W), d * d)
                    hessian += (weight @ squares).reshape(n, d, d)
                delta = (delta * slope) @ self._weights[layer]
            value = z[:, 0] if c is None else (z * c).sum(1)
            return _numpy(value), _numpy(delta.T), _numpy(hessian.permute(1, 2, 0))

    def _hidden(self, x: torch.Tensor, order: int) -> tuple[torch.Tensor, list[Three]]:
        """Return values (n, o), and ∂z/∂x (n, d, width), σ′ and σ″ of each hidden layer."""
        n, d = x.shape
        layers: list[Three] = []
        z = torch.addmm(self._biases[0], x, self._weights[0].T)
        for layer, (W, b) in enumerate(zip(self._weights[1:], self._biases[1:], strict=True)):
            a, slope, curvature = _activate(self.network.activation, z, order)
            if layer:
                before, steep, _ = layers[-1]
                V = self._weights[layer]
                J = ((before * steep[:, None, :]).reshape(n * d, V.shape[1]) @ V.T).reshape(n, d, len(V))
            else:
                J = self._weights[0].T.expand(n, d, -1)
            layers.append((J, slope, curvature))
            z = torch.addmm(b, a, W.T)
        return z, layers

    def _tensor(self, array: Array) -> torch.Tensor:
        # Torch warns of an array that is not writable, as those from a file or of a broadcast; "W" copies it.
        return torch.as_tensor(np.require(array, np.float64, ["C", "W"]), device=self.device)


def available_device(name: str) -> torch.device:
    """Return the GPU for ``cuda`` and ``auto`` where torch sees one, else the processor."""
    return torch.device("cuda" if name != "cpu" and torch.cuda.is_available() else "cpu")


def _numpy(tensor: torch.Tensor) -> Array:
    array: Array = tensor.contiguous().cpu().numpy()
    return array


def _activate(name: str, z: torch.Tensor, order: int) -> Three:
    """Return σ(z) and, up to ``order``, σ′ and σ″."""
    none = z
    if name == "tanh":
        a = torch.tanh(z)
        slope = 1 - a * a if order else none
        return a, slope, -2 * a * slope if order > 1 else none
    s = torch.sigmoid(z)
    slope = s * (1 - s) if order else none
    if name == "sigmoid":
        return s, slope, slope * (1 - 2 * s) if order > 1 else none
    # torch.nn.functional.softplus becomes linear above a threshold.
    return torch.log1p(torch.exp(-z.abs())) + z.clamp(min=0), s, slope


@contextmanager
def one_thread() -> Iterator[None]:
    """Use one thread: the order of a sum depends on their number, and such small matrices need no more."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
