"""Closed form by Armstrong: unconfined compression of a poroelastic cylinder between plates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.special import jn_zeros, jv

from porocore.states import Array

#: Terms of the series; at H_A K t/a² = 1e-5 the last is exp(−98).
TERMS = 1000


@dataclass(frozen=True)
class UnconfinedCompression:
    """A cylinder of incompressible solid and fluid, squeezed by the axial strain ε at once or along a ramp.

    It drains through its free mantle. The radial displacement obeys H_A K (u″ + u′/r − u/r²) = u̇ + ε̇ r/2, because what
    leaves is what the volume loses (Armstrong, Lai & Mow 1984, J. Biomech. Eng. 106:165–173). Its roots are those of
    J₁(x) = x J₀(x) (1 − ν)/(1 − 2ν).

    Attributes
    ----------
    radius
        a [L].
    strain
        ε, negative in compression, reached at the end of the ramp.
    lame, shear
        λ and μ of the drained frame [E]; the aggregate modulus is H_A = λ + 2μ.
    conductivity
        K = k/μ_f.
    ramp
        Time over which the strain is brought up linearly; 0: at once.
    """

    radius: float
    strain: float
    lame: float
    shear: float
    conductivity: float
    ramp: float = 0.0

    @property
    def poisson_ratio(self) -> float:
        """Drained Poisson's ratio ν."""
        return self.lame / (2 * (self.lame + self.shear))

    @property
    def aggregate_modulus(self) -> float:
        """H_A = λ + 2μ [E]."""
        return self.lame + 2 * self.shear

    @cached_property
    def _roots(self) -> Array:
        """Roots, one between any two neighbouring roots of J₁, by bisection."""
        ratio = self.aggregate_modulus / (2 * self.shear)
        high = jn_zeros(1, TERMS)
        low = np.concatenate([[1e-9], high[:-1]])
        sign = np.sign(jv(0, high))
        for _ in range(60):
            middle = (low + high) / 2
            above = sign * (ratio * middle * jv(0, middle) - jv(1, middle)) > 0
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        return np.asarray((low + high) / 2)

    @cached_property
    def _weights(self) -> Array:
        """Coefficients of J₁(s r/a) in the decaying part of u at t = 0+, (ν − ½) ε r."""
        s = self._roots
        slope = jv(0, s) - jv(1, s) / s
        norm = (slope**2 + (1 - 1 / s**2) * jv(1, s) ** 2) / 2
        return np.asarray((self.poisson_ratio - 0.5) * self.strain * self.radius * jv(2, s) / s / norm)

    def _decay(self, t: float) -> tuple[float, Array]:
        """Share of the strain at ``t``, and what is left of each term."""
        rate = self._roots**2 * self.aggregate_modulus * self.conductivity / self.radius**2
        if self.ramp == 0:
            return 1.0, np.exp(-rate * t)
        share, past = min(t / self.ramp, 1.0), max(t - self.ramp, 0.0)
        return share, (np.exp(-rate * past) - np.exp(-rate * t)) / (rate * self.ramp)

    def lateral(self, r: npt.ArrayLike, t: float) -> Array:
        """u_r at distances ``r`` from the axis at one time t > 0; the shape of ``r`` [L]."""
        share, left = self._decay(t)
        r = np.asarray(r, dtype=float)
        terms = jv(1, np.multiply.outer(r / self.radius, self._roots))
        return np.asarray(-self.poisson_ratio * share * self.strain * r + terms @ (self._weights * left))

    def pressure(self, r: npt.ArrayLike, t: float) -> Array:
        """p at distances ``r`` from the axis at one time t > 0 [E]."""
        _, left = self._decay(t)
        s = self._roots
        spread = jv(0, np.multiply.outer(np.asarray(r, dtype=float) / self.radius, s)) - jv(0, s)
        return np.asarray(self.aggregate_modulus / self.radius * (spread @ (s * self._weights * left)))

    def stress(self, t: float) -> float:
        """Mean axial stress on the plates at one time t > 0, negative in compression [E]."""
        share, left = self._decay(t)
        s, aggregate = self._roots, self.aggregate_modulus
        edge = float(self.lateral(self.radius, t)) / self.radius
        swelling = -2 * self.poisson_ratio * share * self.strain + float(
            (s * jv(0, s) / self.radius) @ (self._weights * left)
        )
        mean_pressure = aggregate * (2 * edge - swelling)
        return aggregate * share * self.strain + 2 * self.lame * edge - mean_pressure
