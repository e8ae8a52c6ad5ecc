"""Evaluation of a network by JAX, compiled and in batches: values, gradients, Hessians."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from porocore.states import Array
from porocore.surrogates.network.network import Derivatives, Evaluator, Network
from porocore.surrogates.network.sobolev import activate
from porocore_surrogate_jax.library import choose_device, compiled

#: Rows of one call. Batches are cut into pieces of the largest size, and the rest is filled up to a power of two, so
#: that at most eight sizes are compiled.
LARGEST, SMALLEST = 1024, 8

Layers = list[tuple[jax.Array, jax.Array]]
Arrays = tuple[jax.Array, ...]
#: Activation, layers, x and, for some, factors of the outputs → the results.
Function = Callable[..., Arrays]


class JaxNetwork(Evaluator):
    """A network compiled by JAX.

    Parameters
    ----------
    network
        Weights and biases.
    device
        ``auto``, ``cpu`` or ``cuda``.

    Raises
    ------
    ConfigurationError
        A GPU is asked for and JAX sees none.
    """

    def __init__(self, network: Network, device: str = "cpu") -> None:
        self.network, self.device = network, choose_device(device)
        pairs = zip(network.weights, network.biases, strict=True)
        self._layers: Layers = [
            (jax.device_put(W, self.device), jax.device_put(b, self.device)) for W, b in pairs
        ]

    @property
    def as_numpy(self) -> Network:
        """The same network in numpy."""
        return self.network

    def evaluate(self, x: Array) -> Array:
        """Return the values (n, o) at x (n, d)."""
        (values,) = self._start(VALUES, x)()
        return values

    def value_and_gradient(self, x: Array) -> tuple[Array, Array]:
        """Return the values (n, o) and ∂N_o/∂x_k (d, n, o)."""
        values, gradient = self._start(GRADIENT, x)()
        return values, gradient

    def value_gradient_hessian(self, x: Array, factors: Array | None = None) -> Derivatives:
        """Return value (n,), gradient (d, n) and Hessian (d, d, n) of one output, or of a sum with ``factors``."""
        return self.start(x, factors)()

    def start(self, x: Array, factors: Array | None = None) -> Callable[[], Derivatives]:
        """Start the same in the background; return a function that waits for the result."""
        finish = self._start(HESSIAN, *(x,) if factors is None else (x, factors))

        def derivatives() -> Derivatives:
            value, gradient, hessian = finish()
            return value, gradient, hessian

        return derivatives

    def _start(self, kind: Kind, *given: Array) -> Callable[[], list[Array]]:
        function = _compiled(kind.function, self.network.activation, self.device)
        pieces = []
        for start, rows, filled in _pieces(len(given[0])):
            piece = [array[start : start + rows] for array in given]
            if filled > rows:
                piece = [np.concatenate([part, np.zeros((filled - rows, part.shape[1]))]) for part in piece]
            # Calls return before they are done; the next piece is prepared meanwhile.
            pieces.append((rows, function(self._layers, *piece)))

        def finish() -> list[Array]:
            found = []
            for i, axis in enumerate(kind.axes):
                parts = [
                    np.asarray(outputs[i])[(slice(None),) * axis + (slice(rows),)] for rows, outputs in pieces
                ]
                found.append(np.concatenate(parts, axis))  # a copy: JAX's own arrays are read-only
            return found

        return finish


def _pieces(n: int) -> Iterator[tuple[int, int, int]]:
    """Yield the first row, the rows and the filled-up rows of each piece; of no rows, one empty piece."""
    start = 0
    while True:
        rows = min(n - start, LARGEST)
        yield start, rows, max(SMALLEST, 1 << (rows - 1).bit_length() if rows else 0)
        start += rows
        if start >= n:
            return


@cache
def _compiled(function: Function, activation: str, device: jax.Device) -> Callable[..., Arrays]:
    """Compile once for all networks of one activation."""
    return compiled(partial(function, activation), device)


def _values(activation: str, layers: Layers, x: jax.Array) -> Arrays:
    for W, b in layers[:-1]:
        x = activate(jnp, activation, x @ W.T + b)[0]
    W, b = layers[-1]
    return (x @ W.T + b,)


def _forward(
    activation: str, layers: Layers, x: jax.Array
) -> tuple[jax.Array, jax.Array, list[tuple[jax.Array, jax.Array, jax.Array]]]:
    """Return z (n, o) and J = ∂z/∂x (d, n, o); and J, σ′ and σ″ of each hidden layer before its activation."""
    n, d = x.shape
    a, J, hidden = x, None, []
    for W, b in layers[:-1]:
        z = a @ W.T + b
        J = _next(W, J, d, n)
        a, slope, curvature = activate(jnp, activation, z)
        hidden.append((J, slope, curvature))
        J = J * slope
    W, b = layers[-1]
    return a @ W.T + b, _next(W, J, d, n), hidden


def _next(W: jax.Array, J: jax.Array | None, d: int, n: int) -> jax.Array:
    if J is None:
        return jnp.broadcast_to(W.T[:, None, :], (d, n, len(W)))
    return (J.reshape(d * n, -1) @ W.T).reshape(d, n, -1)


def _gradient(activation: str, layers: Layers, x: jax.Array) -> Arrays:
    return _forward(activation, layers, x)[:2]


def _hessian(activation: str, layers: Layers, x: jax.Array, factors: jax.Array | None = None) -> Arrays:
    """Return value, gradient and Hessian Σ_l J_lᵀ diag(δ_l σ″) J_l with δ_l = ∂N/∂a_l, which factors begin.

    This is half the work of a derivative of a derivative.
    """
    z, J, hidden = _forward(activation, layers, x)
    d, n = J.shape[:2]
    last = layers[-1][0]
    delta = jnp.broadcast_to(last, (n, last.shape[1])) if factors is None else factors @ last
    hessian = jnp.zeros((d, d, n))
    for index in range(len(hidden) - 1, -1, -1):
        J_l, slope, curvature = hidden[index]
        weight = delta * curvature
        if index:
            hessian = hessian + jnp.einsum("inw,jnw->ijn", J_l * weight, J_l)
        else:  # J is the same everywhere
            W = layers[0][0]
            squares = (W[:, :, None] * W[:, None, :]).reshape(len(W), d * d)
            hessian = hessian + (squares.T @ weight.T).reshape(d, d, n)
        delta = (delta * slope) @ layers[index][0]
    return z[:, 0] if factors is None else (z * factors).sum(axis=1), delta.T, hessian


class Kind(NamedTuple):
    """A function that is compiled, and the axis of each output that counts the rows of x."""

    function: Function
    axes: tuple[int, ...]


VALUES, GRADIENT, HESSIAN = Kind(_values, (0,)), Kind(_gradient, (0, 1)), Kind(_hessian, (0, 1, 2))
