"""Closed form by Terzaghi: one-dimensional consolidation of a layer, with compressible constituents."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import erf

from porocore.macro.laws.linear import LinearCoefficients
from porocore.states import Array

#: Below this dimensionless time the drained surface has not been felt at the bottom (error below 1e-100).
SHORT_TIME = 1e-3


@dataclass(frozen=True)
class Terzaghi:
    """A layer of height h on an impermeable rigid base, drained and loaded on top from t = 0 on.

    With σ = C ε − α p = −P and storage α ε + S p, the load first meets the undrained layer,
    p₀ = (α P/C)/(S + α²/C), and then c_v ∂²p/∂y² = ∂p/∂t with c_v = K/(S + α²/C)
    (Terzaghi 1923; Detournay & Cheng 1993, "Fundamentals of poroelasticity").

    Attributes
    ----------
    height
        h [L].
    load
        P > 0, compression [E].
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
    load: float
    stiffness: float
    biot: float
    storage: float
    conductivity: float

    @classmethod
    def from_coefficients(cls, coefficients: LinearCoefficients, height: float, load: float) -> Terzaghi:
        """A layer loaded along the second axis."""
        return cls(
            height,
            load,
            float(coefficients.stiffness[1, 1, 1, 1]),
            float(coefficients.biot[1, 1]),
            coefficients.storage,
            float(coefficients.conductivity[1, 1]),
        )

    @property
    def consolidation_coefficient(self) -> float:
        """c_v = K/(S + α²/C)."""
        return self.conductivity / (self.storage + self.biot**2 / self.stiffness)

    @property
    def initial_pressure(self) -> float:
        """Pressure p₀ of the undrained layer [E]."""
        return self.biot * self.load / self.stiffness / (self.storage + self.biot**2 / self.stiffness)

    @property
    def immediate_settlement(self) -> float:
        """Settlement at t = 0⁺ [L]."""
        return self.height * (self.load - self.biot * self.initial_pressure) / self.stiffness

    @property
    def final_settlement(self) -> float:
        """Settlement in the steady state, P h/C [L]."""
        return self.height * self.load / self.stiffness

    def dimensionless_time(self, t: npt.ArrayLike) -> Array:
        """T = c_v t/h²."""
        return np.asarray(t, dtype=float) * self.consolidation_coefficient / self.height**2

    def degree(self, t: npt.ArrayLike) -> Array:
        """Degree of consolidation, 0 at t = 0 and 1 at the end; the shape of ``t``."""
        T = self.dimensionless_time(t)
        m = _frequencies(T)
        series = 1 - (2 / m**2 * np.exp(-(m**2) * T[..., None])).sum(axis=-1)
        degree: Array = np.where(T < SHORT_TIME, 2 * np.sqrt(T / np.pi), series)
        return degree

    def pressure(self, y: npt.ArrayLike, t: npt.ArrayLike) -> Array:
        """p at heights ``y`` over the base and times ``t`` > 0 (broadcast together) [E]."""
        T = self.dimensionless_time(t)
        depth, T = np.broadcast_arrays(1 - np.asarray(y, dtype=float) / self.height, T)
        m = _frequencies(T)
        series = (2 / m * np.sin(m * depth[..., None]) * np.exp(-(m**2) * T[..., None])).sum(axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            early = erf(depth / (2 * np.sqrt(T)))
        pressure: Array = self.initial_pressure * np.where(T < SHORT_TIME, early, series)
        return pressure

    def settlement(self, t: npt.ArrayLike) -> Array:
        """Settlement of the top, positive downwards [L]; the shape of ``t``."""
        first, last = self.immediate_settlement, self.final_settlement
        return first + (last - first) * self.degree(t)


def _frequencies(T: Array) -> Array:
    """π(2k + 1)/2 up to where exp(−m² T) vanishes for every T that the series is used for."""
    shortest = max(float(np.min(T, initial=1.0)), SHORT_TIME)
    count = int(np.sqrt(40 / shortest) / np.pi) + 2
    return np.pi / 2 * (2.0 * np.arange(count, dtype=np.float64) + 1)
