"""Closed form of a layer whose solid swells and shrinks in time (SwellingLayer): one-dimensional consolidation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from porocore.macro.laws.linear import LinearCoefficients
from porocore.states import Array

#: Terms of the series, which fall as the third power of their number once the swelling has stopped to jump.
TERMS = 400


@dataclass(frozen=True)
class SwellingLayer:
    """A layer of height h on an impermeable rigid base, drained and free of load on top, whose solid swells.

    A small swelling stretch λ = 1 + e is an eigenstrain e I: the cell answers to H − e I as it does to H without
    swelling, and free swelling takes its pores along, so that

        σ = C ε − α p − B e,   ζ = α ε + S p − D e,   B = C_22kk,   D = tr α − 3 φ_f,

    with the fluid ζ that is taken up per volume, as for thermal strains of the solid alone (McTigue 1986, J. Geophys.
    Res. 91). From σ = 0 and ∂ζ/∂t = K ∂²p/∂y²

        s ∂p/∂t = K ∂²p/∂y² − g ∂e/∂t,   s = S + α²/C,   g = α B/C − D.

    With e(t) between two heights, 0 elsewhere, p is a sum of cos(m_k y/h), m_k = π (2k + 1)/2, each of which follows
    e(t) and decays with the rate K m_k²/(s h²).

    Attributes
    ----------
    height
        h [L].
    stiffness
        C, confined drained modulus [E].
    held_stress
        B, pressure on a layer that is held, drained, by its swelling e [E].
    biot
        α [-].
    storage
        S = 1/M_B [1/E].
    given_off
        D, fluid that a layer gives off that is held, drained, by its swelling e [-].
    conductivity
        K.
    history
        [t, e] with ascending times; linear in between and constant afterwards, 0 before.
    between
        Heights between which the solid swells [L]; None: everywhere.
    """

    height: float
    stiffness: float
    held_stress: float
    biot: float
    storage: float
    given_off: float
    conductivity: float
    history: Sequence[tuple[float, float]] = field(default=((0.0, 1.0),))
    between: tuple[float, float] | None = None

    @classmethod
    def from_coefficients(
        cls,
        coefficients: LinearCoefficients,
        porosity: float,
        height: float,
        history: Sequence[tuple[float, float]],
        between: tuple[float, float] | None = None,
    ) -> SwellingLayer:
        """A layer across the second axis, of the coefficients of the cell before it swells."""
        c = coefficients
        return cls(
            height,
            float(c.stiffness[1, 1, 1, 1]),
            float(np.einsum("kk->", c.stiffness[1, 1])),
            float(c.biot[1, 1]),
            c.storage,
            float(np.trace(c.biot)) - 3 * porosity,
            float(c.conductivity[1, 1]),
            history,
            between,
        )

    @property
    def capacity(self) -> float:
        """s = S + α²/C, fluid taken up per pressure under constant stress."""
        return self.storage + self.biot**2 / self.stiffness

    @property
    def consolidation_coefficient(self) -> float:
        """c_v = K/s."""
        return self.conductivity / self.capacity

    @property
    def sudden_pressure(self) -> float:
        """Pressure −g/s of the undrained layer per sudden swelling e = 1 [E]."""
        return -(self.biot * self.held_stress / self.stiffness - self.given_off) / self.capacity

    def pressure(self, y: npt.ArrayLike, t: float) -> Array:
        """p at heights ``y`` (k,) over the base at the time ``t`` [E]."""
        m, amplitudes = self._amplitudes(t)
        places = np.atleast_1d(np.asarray(y, dtype=float))[:, None] / self.height
        found: Array = np.cos(m * places) @ amplitudes
        return found

    def rise(self, t: float) -> float:
        """Rise of the top at the time ``t`` [L], ∫ (α p + B e)/C dy."""
        m, amplitudes = self._amplitudes(t)
        pressure = self.height * float((np.sin(m) / m) @ amplitudes)
        times, values = np.array(self.history, dtype=float).T
        low, high = self._ends
        swelling = float(np.interp(t, times, values, left=0.0)) * (high - low)
        return (self.biot * pressure + self.held_stress * swelling) / self.stiffness

    @property
    def _ends(self) -> tuple[float, float]:
        return (0.0, self.height) if self.between is None else self.between

    def _amplitudes(self, t: float) -> tuple[Array, Array]:
        """Return m (k,) and the amplitudes (k,) of the cosines in the pressure."""
        m = np.pi / 2 * (2.0 * np.arange(TERMS) + 1)
        low, high = self._ends
        shape = 2 / m * (np.sin(m * high / self.height) - np.sin(m * low / self.height))
        rate = self.consolidation_coefficient * m**2 / self.height**2
        followed, before = np.zeros(TERMS), (self.history[0][0], 0.0)
        for time, value in self.history:
            if before[0] > t or (time > t and time == before[0]):
                break
            change, length = value - before[1], time - before[0]
            if length == 0:  # a jump
                followed += change * np.exp(-rate * (t - time))
            else:
                end = min(time, t)
                share = np.exp(-rate * (t - end)) - np.exp(-rate * (t - before[0]))
                followed += change / length * share / rate
            before = (time, value)
        return m, self.sudden_pressure * shape * followed
