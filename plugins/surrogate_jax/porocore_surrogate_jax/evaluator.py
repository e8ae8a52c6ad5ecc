"""Networks evaluated by JAX: compiled, and a batch at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from porocore.states import Array
from porocore.surrogates.network import Network
from porocore.surrogates.sobolev import activate
from porocore_surrogate_jax.library import choose_device, compiled

#: Rows of one call. What is compiled for one size serves all batches, cut into pieces of this many rows, the rest
#: filled up to a power of two: so no more than eight sizes are ever compiled, whatever sizes are asked for.
LARGEST, SMALLEST = 1024, 8

Layers = list[tuple[Any, Any]]


class JaxNetwork:
    """An :class:`~porocore.surrogates.network.Evaluator` of the numbers in ``network``.

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
        """See :class:`~porocore.surrogates.network.Evaluator`."""
        (values,) = self._call("values", x)
        return values

    def slopes(self, x: Array) -> tuple[Array, Array]:
        """See :class:`~porocore.surrogates.network.Evaluator`."""
        values, slopes = self._call("slopes", x)
        return values, np.moveaxis(slopes, 2, 0)

    def curvatures(self, x: Array) -> tuple[Array, Array, Array]:
        """See :class:`~porocore.surrogates.network.Evaluator`."""
        value, gradient, hessian = self._call("curvatures", x)
        return value, gradient.T, np.moveaxis(hessian, 0, -1)

    def _call(self, what: str, x: Array) -> list[Array]:
        function = _function(what, self.network.activation, self.device)
        pieces = []
        for start, rows, filled in _pieces(len(x)):
            piece = x[start : start + rows]
            if filled > rows:
                piece = np.concatenate([piece, np.zeros((filled - rows, x.shape[1]))])
            # Calls return before they are done; the next piece is prepared meanwhile.
            pieces.append((rows, function(self._layers, jax.device_put(piece, self.device))))
        columns = zip(*([np.asarray(part)[:rows] for part in parts] for rows, parts in pieces), strict=True)
        return [np.concatenate(column) for column in columns]  # a copy: JAX's own arrays are read-only


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
def _function(what: str, activation: str, device: jax.Device) -> Callable[..., Any]:
    """Compiled once, for all networks of one activation."""
    kinds = {"values": _values, "slopes": _slopes, "curvatures": _curvatures}
    return compiled(partial(kinds[what], activation), device)


def _forward(activation: str, layers: Layers, x: Any) -> Any:
    """N (o,) at one x (d,)."""
    for W, b in layers[:-1]:
        x = activate(jnp, activation, W @ x + b)[0]
    W, b = layers[-1]
    return W @ x + b


def _values(activation: str, layers: Layers, x: Any) -> Any:
    return (jax.vmap(partial(_forward, activation, layers))(x),)


def _slopes(activation: str, layers: Layers, x: Any) -> Any:
    def both(y: Any) -> Any:
        value = _forward(activation, layers, y)
        return value, value

    def one(y: Any) -> Any:
        slopes, value = jax.jacfwd(both, has_aux=True)(y)
        return value, slopes

    return jax.vmap(one)(x)


def _curvatures(activation: str, layers: Layers, x: Any) -> Any:
    """Forward over reverse."""

    def scalar(y: Any) -> Any:
        return _forward(activation, layers, y)[0]

    def slope(y: Any) -> Any:
        value, gradient = jax.value_and_grad(scalar)(y)
        return gradient, (value, gradient)

    def one(y: Any) -> Any:
        hessian, (value, gradient) = jax.jacfwd(slope, has_aux=True)(y)
        return value, gradient, hessian

    return jax.vmap(one)(x)
