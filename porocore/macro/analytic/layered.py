"""One-dimensional consolidation of layers (LayeredConsolidation): Laplace transform in closed form, inverted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from porocore.macro.laws.linear import LinearCoefficients
from porocore.states import Array

#: Nodes of the contour by which a transform is inverted; the error falls as 3.89^−N down to round-off.
NODES = 24


@dataclass(frozen=True)
class SoilLayer:
    """A layer of a soil; see :class:`~porocore.macro.analytic.terzaghi.Terzaghi` for its constants.

    Attributes
    ----------
    height
        h [L].
    stiffness
        C, confined drained modulus [E].
    biot
        α [-].
    storage
        S = 1/M_B [1/E].
    conductivity
        K.
    """

    height: float
    stiffness: float
    biot: float
    storage: float
    conductivity: float

    @classmethod
    def from_coefficients(cls, coefficients: LinearCoefficients, height: float) -> SoilLayer:
        """A layer loaded along the second axis."""
        c = coefficients
        constants = (c.stiffness[1, 1, 1, 1], c.biot[1, 1], c.storage, c.conductivity[1, 1])
        return cls(height, *map(float, constants))

    @property
    def capacity(self) -> float:
        """S + α²/C, fluid taken up per pressure under constant stress."""
        return self.storage + self.biot**2 / self.stiffness

    def initial_pressure(self, load: float) -> float:
        """Pressure of the undrained layer under ``load``."""
        return self.biot * load / self.stiffness / self.capacity


class LayeredConsolidation:
    """Layers on an impermeable rigid base, drained and loaded on top (Schiffman & Stein 1970).

    In each layer s ∂p/∂t = K ∂²p/∂y² − (α/C) ∂σ/∂t with s = S + α²/C; p and K ∂p/∂y are continuous. Of a sudden load
    the Laplace transform is a sum of exponentials in each layer, whose factors solve a small linear system; it is
    inverted along Talbot's contour [Weideman 2006, SIAM J. Numer. Anal. 44, 2342].

    Parameters
    ----------
    layers
        From the base upwards.
    load
        P > 0, compression [E].
    ramp
        Time in which the load comes up linearly; 0: at once.
    """

    def __init__(self, layers: Sequence[SoilLayer], load: float, ramp: float = 0.0) -> None:
        self.layers, self.load, self.ramp = tuple(layers), load, ramp

    def pressure(self, y: npt.ArrayLike, t: float) -> Array:
        """p at heights ``y`` (k,) over the base at the time ``t`` > 0 [E]."""
        heights = np.atleast_1d(np.asarray(y, dtype=float))

        def transform(rate: complex) -> Array:
            values = np.empty(len(heights), dtype=complex)
            base = 0.0
            for layer, (up, down) in zip(self.layers, self._factors(rate), strict=True):
                inside = (heights >= base) & (heights <= base + layer.height)
                at, q = heights[inside] - base, self._root(layer, rate)
                waves = up * np.exp(q * (at - layer.height)) + down * np.exp(-q * at)
                values[inside] = layer.initial_pressure(self.load) / rate + waves
                base += layer.height
            return values

        return self._at(transform, t)

    def settlement(self, t: float) -> float:
        """Settlement of the top at the time ``t`` > 0, positive downwards [L]."""

        def transform(rate: complex) -> Array:
            total = 0.0 + 0.0j
            for layer, (up, down) in zip(self.layers, self._factors(rate), strict=True):
                q, h = self._root(layer, rate), layer.height
                pressure = layer.initial_pressure(self.load) * h / rate
                pressure += (up + down) * (1 - np.exp(-q * h)) / q
                total += (self.load * h / rate - layer.biot * pressure) / layer.stiffness
            return np.array([total])

        return float(self._at(transform, t)[0])

    @staticmethod
    def _root(layer: SoilLayer, rate: complex) -> complex:
        return complex(np.sqrt(rate * layer.capacity / layer.conductivity))

    def _factors(self, rate: complex) -> npt.NDArray[np.complex128]:
        """Return the factors (layers, 2) of exp(q (y − h)) and exp(−q y), y from the bottom of each layer."""
        n = len(self.layers)
        matrix, right = np.zeros((2 * n, 2 * n), dtype=complex), np.zeros(2 * n, dtype=complex)
        matrix[0, :2] = self._ends(self.layers[0], rate)[1][0]
        for i, layer in enumerate(self.layers):
            columns, (values, slopes) = slice(2 * i, 2 * i + 2), self._ends(layer, rate)
            row = 2 * i + 1
            matrix[row, columns] = values[1]
            right[row] = -layer.initial_pressure(self.load) / rate
            if i + 1 < n:
                above, (their_values, their_slopes) = self.layers[i + 1], self._ends(self.layers[i + 1], rate)
                matrix[row, row + 1 : row + 3] = -their_values[0]
                right[row] += above.initial_pressure(self.load) / rate
                matrix[row + 1, columns] = slopes[1]
                matrix[row + 1, row + 1 : row + 3] = -their_slopes[0]
        return np.asarray(np.linalg.solve(matrix, right).reshape(n, 2))

    def _ends(self, layer: SoilLayer, rate: complex) -> tuple[Array, Array]:
        """Return the exponentials (2, 2) at the bottom and at the top of a layer, and K times their slopes."""
        q = self._root(layer, rate)
        far = np.exp(-q * layer.height)
        values = np.array([[far, 1.0], [1.0, far]])
        slopes = layer.conductivity * q * values * np.array([1.0, -1.0])
        return values, slopes

    def _at(self, transform: Callable[[complex], Array], t: float) -> Array:
        """Return the response at ``t`` to the load, whose transform for a sudden one is given."""
        if self.ramp == 0:
            return _inverted(transform, t)

        def summed(rate: complex) -> Array:
            return np.asarray(transform(rate) / rate)

        whole = _inverted(summed, t)
        if t > self.ramp:
            whole = whole - _inverted(summed, t - self.ramp)
        return whole / self.ramp


def _inverted(transform: Callable[[complex], Array], t: float) -> Array:
    """Return the function at ``t`` whose Laplace transform is given."""
    a, b, c, d = 0.5017, 0.6407, 0.6122, 0.2645
    total: Array = np.zeros(1)
    # Conjugate nodes give conjugate values.
    for theta in (2 * np.arange(NODES // 2) + 1) * np.pi / NODES:
        z = NODES / t * (a * theta / np.tan(b * theta) - c + d * 1j * theta)
        slope = NODES / t * (a / np.tan(b * theta) - a * b * theta / np.sin(b * theta) ** 2 + d * 1j)
        total = total + 2 * np.real(np.exp(z * t) * np.asarray(transform(complex(z))) * slope / (1j * NODES))
    return np.asarray(total)
