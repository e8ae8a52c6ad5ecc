"""Networks evaluated by JAX: compiled, and a batch at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from porocore.states import Array
from porocore.surrogates.network.network import Network
from porocore.surrogates.network.sobolev import activate
from porocore_surrogate_jax.library import choose_device, compiled

#: Rows of one call. What is compiled for one size serves all batches, cut into pieces of this many rows, the rest
#: filled up to a power of two: so no more than eight sizes are ever compiled, whatever sizes are asked for.
LARGEST, SMALLEST = 1024, 8

Layers = list[tuple[Any, Any]]


class JaxNetwork:
    """An :class:`~porocore.surrogates.network.network.Evaluator` of the numbers in ``network``.

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
        self.network = network
        self.move(device)

    def move(self, device: str) -> None:
        """Evaluate on another device from now on."""
        self.device = choose_device(device)
        pairs = zip(self.network.weights, self.network.biases, strict=True)
        self._layers: Layers = [
            (jax.device_put(W, self.device), jax.device_put(b, self.device)) for W, b in pairs
        ]

    def evaluate(self, x: Array) -> Array:
        """See :class:`~porocore.surrogates.network.network.Evaluator`."""
        (values,) = self._call("values", x)
        return values

    def slopes(self, x: Array) -> tuple[Array, Array]:
        """See :class:`~porocore.surrogates.network.network.Evaluator`."""
        values, slopes = self._call("slopes", x)
        return values, slopes

    def curvatures(self, x: Array) -> tuple[Array, Array, Array]:
        """See :class:`~porocore.surrogates.network.network.Evaluator`."""
        return self.begin(x)()

    def begin(self, x: Array) -> Callable[[], tuple[Array, Array, Array]]:
        """See :func:`porocore.surrogates.network.network.begun`."""
        finish = self._start("curvatures", x)

        def curvatures() -> tuple[Array, Array, Array]:
            value, gradient, hessian = finish()
            return value, gradient, hessian

        return curvatures

    def _call(self, what: str, x: Array) -> list[Array]:
        return self._start(what, x)()

    def _start(self, what: str, x: Array) -> Callable[[], list[Array]]:
        kind, states = _KINDS[what]
        function = _compiled(kind, self.network.activation, self.device)
        pieces = []
        for start, rows, filled in _pieces(len(x)):
            piece = x[start : start + rows]
            if filled > rows:
                piece = np.concatenate([piece, np.zeros((filled - rows, x.shape[1]))])
            # Calls return before they are done; the next piece is prepared meanwhile.
            pieces.append((rows, function(self._layers, piece)))

        def finish() -> list[Array]:
            found = []
            for i, axis in enumerate(states):
                parts = [
                    np.asarray(outputs[i])[(slice(None),) * axis + (slice(rows),)] for rows, outputs in pieces
                ]
                found.append(np.concatenate(parts, axis))  # a copy: JAX's own arrays are read-only
            return found

        return finish


def _pieces(n: int) -> Iterator[tuple[int, int, int]]:
    """First row, rows, and rows when filled up; for no rows at all one piece of none."""
    start = 0
    while True:
        rows = min(n - start, LARGEST)
        yield start, rows, max(SMALLEST, 1 << (rows - 1).bit_length() if rows else 0)
        start += rows
        if start >= n:
            return


@cache
def _compiled(kind: Callable[..., Any], activation: str, device: jax.Device) -> Callable[..., Any]:
    """Once, for all networks of one activation."""
    return compiled(partial(kind, activation), device)


def _values(activation: str, layers: Layers, x: Any) -> Any:
    for W, b in layers[:-1]:
        x = activate(jnp, activation, x @ W.T + b)[0]
    W, b = layers[-1]
    return (x @ W.T + b,)


def _pushed(activation: str, layers: Layers, x: Any) -> tuple[Any, Any, list[tuple[Any, Any, Any]]]:
    """z (n, o) and J = ∂z/∂x (d, n, o); J, σ′ and σ″ of each hidden layer before its activation."""
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


def _next(W: Any, J: Any, d: int, n: int) -> Any:
    if J is None:
        return jnp.broadcast_to(W.T[:, None, :], (d, n, len(W)))
    return (J.reshape(d * n, -1) @ W.T).reshape(d, n, -1)


def _slopes(activation: str, layers: Layers, x: Any) -> Any:
    return _pushed(activation, layers, x)[:2]


def _curvatures(activation: str, layers: Layers, x: Any) -> Any:
    """With δ_l = ∂N/∂a_l the Hessian is Σ_l J_lᵀ diag(δ_l σ″) J_l; half the work of a derivative of a derivative."""
    z, J, hidden = _pushed(activation, layers, x)
    d, n = J.shape[:2]
    last = layers[-1][0]
    delta = jnp.broadcast_to(last, (n, last.shape[1]))
    hessian = jnp.zeros((d, d, n))
    for index in range(len(hidden) - 1, -1, -1):
        J_l, slope, curvature = hidden[index]
        bend = delta * curvature
        if index:
            hessian = hessian + jnp.einsum("inw,jnw->ijn", J_l * bend, J_l)
        else:  # J is the same everywhere
            W = layers[0][0]
            squares = (W[:, :, None] * W[:, None, :]).reshape(len(W), d * d)
            hessian = hessian + (squares.T @ bend.T).reshape(d, d, n)
        delta = (delta * slope) @ layers[index][0]
    return z[:, 0], delta.T, hessian


#: What is called, and which axis of each of its outputs counts the rows of x.
_KINDS: dict[str, tuple[Callable[..., Any], tuple[int, ...]]] = {
    "values": (_values, (0,)),
    "slopes": (_slopes, (0, 1)),
    "curvatures": (_curvatures, (0, 1, 2)),
}
