"""The network with exact first derivatives, evaluated in numpy.

Using a trained surrogate so needs no torch, and for the sizes in question numpy is as fast.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Network:
    """N(x) = W_L a_{L-1} + b_L, a_l = σ(W_l a_{l-1} + b_l), a_0 = x, for rows x of d inputs.

    Attributes
    ----------
    activation : {"sigmoid", "tanh"}
        σ of the hidden layers.
    weights
        W_l (width of layer l, width of the layer before).
    biases
        b_l (width of layer l).
    """

    activation: str
    weights: tuple[Array, ...]
    biases: tuple[Array, ...]

    def evaluate(self, x: Array) -> Array:
        """Values (n, outputs) at ``x`` (n, d)."""
        return self._run(x, slopes=False)[0]

    def evaluate_with_slopes(self, x: Array) -> tuple[Array, Array]:
        """Values (n, outputs) and derivatives ∂N_o/∂x_k (d, n, outputs), the input first."""
        return self._run(x, slopes=True)

    def _run(self, x: Array, slopes: bool) -> tuple[Array, Array]:
        d, n = x.shape[1], len(x)
        a = x
        # ∂a/∂x (d, n, width), pushed forward from layer to layer; the input leads so that the multiplication by
        # σ' (n, width) runs over contiguous memory.
        J = np.zeros((d, 0, 0))
        for layer, (W, b) in enumerate(zip(self.weights, self.biases, strict=True)):
            z = a @ W.T
            z += b
            if slopes:
                if layer == 0:
                    J = np.repeat(W.T[:, None, :], n, axis=1)
                else:
                    J = (J.reshape(d * n, W.shape[1]) @ W.T).reshape(d, n, len(W))
            if layer == len(self.weights) - 1:
                return z, J
            a = self._activate(z)
            if slopes:
                J *= a * (1 - a) if self.activation == "sigmoid" else 1 - a * a
        raise AssertionError("a network has at least one layer")

    def _activate(self, z: Array) -> Array:
        """σ(z), in place."""
        if self.activation == "tanh":
            return np.tanh(z, out=z)
        # σ(z) = (1 + tanh(z/2))/2 does not overflow, however negative z is.
        z *= 0.5
        np.tanh(z, out=z)
        z += 1
        z *= 0.5
        return z
