"""Feed-forward network in numpy (Network) with two derivatives; interface of its evaluation."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from porocore.states import Array

ACTIVATIONS = ("sigmoid", "tanh", "softplus")
#: Value (n,), gradient (d, n) and Hessian (d, d, n).
Derivatives = tuple[Array, Array, Array]


class Evaluator(ABC):
    """Evaluation of a network with its derivatives: numpy here, torch or jax in a plugin.

    All take x (n, d) and return values (n, o); derivatives lead with the input.
    """

    @property
    @abstractmethod
    def as_numpy(self) -> Network:
        """The same network in numpy."""

    @abstractmethod
    def evaluate(self, x: Array) -> Array:
        """Return the values (n, o)."""

    @abstractmethod
    def value_and_gradient(self, x: Array) -> tuple[Array, Array]:
        """Return the values (n, o) and ∂N_o/∂x_k (d, n, o)."""

    @abstractmethod
    def value_gradient_hessian(self, x: Array, factors: Array | None = None) -> Derivatives:
        """Return value (n,), gradient (d, n) and Hessian (d, d, n) of a network with one output.

        With ``factors`` (n, o) of the sum of the o outputs, each multiplied by its factor.
        """

    def start(self, x: Array, factors: Array | None = None) -> Callable[[], Derivatives]:
        """Start the same, in the background if the library can, and return a function that waits for the result."""
        return partial(self.value_gradient_hessian, x, factors)


@dataclass(frozen=True, eq=False)
class Network(Evaluator):
    """N(x) = W_L a_{L-1} + b_L, a_l = σ(W_l a_{l-1} + b_l), a_0 = x, for rows x of d inputs.

    Attributes
    ----------
    activation : {"sigmoid", "tanh", "softplus"}
        σ of the hidden layers.
    weights
        W_l (width of layer l, width of the layer before).
    biases
        b_l (width of layer l).
    """

    activation: str
    weights: tuple[Array, ...]
    biases: tuple[Array, ...]

    def __post_init__(self) -> None:
        if self.activation not in ACTIVATIONS:
            raise ValueError(f"expected an activation of {', '.join(ACTIVATIONS)}, got {self.activation!r}")
        widths = [w.shape for w in self.weights]
        if any(a[0] != b[1] for a, b in itertools.pairwise(widths)) or any(
            b.shape != w[:1] for b, w in zip(self.biases, widths, strict=True)
        ):
            raise ValueError(f"layers of shapes {widths} do not fit together")

    @property
    def as_numpy(self) -> Network:
        """The network itself."""
        return self

    def evaluate(self, x: Array) -> Array:
        """Evaluate layer by layer."""
        a = x
        for W, b in zip(self.weights[:-1], self.biases[:-1], strict=True):
            z = a @ W.T
            z += b
            a = _activate(self.activation, z, 0)[0]
        values: Array = a @ self.weights[-1].T + self.biases[-1]
        return values

    def value_and_gradient(self, x: Array) -> tuple[Array, Array]:
        """Evaluate value and gradient, pushed forward from layer to layer."""
        d, n = x.shape[1], len(x)
        a, J = x, np.repeat(np.eye(d)[:, None, :], n, axis=1)
        for layer, (W, b) in enumerate(zip(self.weights, self.biases, strict=True)):
            if layer:
                a, slope, _ = _activate(self.activation, a, 1)
                J *= slope
                J = (J.reshape(d * n, W.shape[1]) @ W.T).reshape(d, n, len(W))
            else:
                J = np.repeat(W.T[:, None, :], n, axis=1)
            a = a @ W.T + b
        return a, J

    def value_gradient_hessian(self, x: Array, factors: Array | None = None) -> Derivatives:
        """Evaluate value, gradient and Hessian.

        With J_l = ∂z_l/∂x and δ_l = ∂N/∂a_l the Hessian is Σ_l J_lᵀ diag(δ_l σ″(z_l)) J_l. Factors of the outputs
        begin δ.
        """
        n, d = x.shape
        layers: list[tuple[Array, Array, Array]] = []
        z = x @ self.weights[0].T + self.biases[0]
        for layer, (W, b) in enumerate(zip(self.weights[1:], self.biases[1:], strict=True)):
            a, slope, curvature = _activate(self.activation, z, 2)
            if layer:
                before, steep, _ = layers[-1]
                V = self.weights[layer]
                J: Array = ((before * steep[:, None]).reshape(n * d, V.shape[1]) @ V.T).reshape(n, d, len(V))
            else:
                J = np.broadcast_to(self.weights[0].T, (n, d, len(z.T)))
            layers.append((J, slope, curvature))
            z = a @ W.T + b
        hessian = np.zeros((n, d, d))
        last = self.weights[-1]
        delta: Array = (  # ∂N/∂a, layer by layer
            np.broadcast_to(last, (n, last.shape[1])) if factors is None else factors @ last
        )
        for layer in range(len(layers) - 1, -1, -1):
            J, slope, curvature = layers[layer]
            weight = delta * curvature
            if layer:
                hessian += (J * weight[:, None]) @ np.ascontiguousarray(J.swapaxes(1, 2))
            else:  # J is the same everywhere
                W = self.weights[0]
                hessian += (weight @ (W[:, :, None] * W[:, None, :]).reshape(len(W), d * d)).reshape(n, d, d)
            delta = (delta * slope) @ self.weights[layer]
        return (
            z[:, 0] if factors is None else (z * factors).sum(axis=1),
            np.ascontiguousarray(delta.T),
            np.ascontiguousarray(hessian.reshape(n, d * d).T).reshape(d, d, n),
        )


def _activate(name: str, z: Array, order: int) -> tuple[Array, Array, Array]:
    """Return σ(z) and, up to ``order``, σ′ and σ″."""
    none = np.empty(0)
    if name == "tanh":
        a = np.tanh(z)
        slope = 1 - a * a if order else none
        return a, slope, -2 * a * slope if order > 1 else none
    if name == "softplus":
        e = np.exp(-np.abs(z))
        a = np.log1p(e) + np.maximum(z, 0)
        if not order:
            return a, none, none
        s = np.where(z < 0, e, 1.0) / (1 + e)
        return a, s, s * (1 - s) if order > 1 else none
    s = z / 2  # (1 + tanh(z/2))/2 does not overflow, however negative z is
    np.tanh(s, out=s)
    s += 1
    s /= 2
    slope = s * (1 - s) if order else none
    return s, slope, slope * (1 - 2 * s) if order > 1 else none
