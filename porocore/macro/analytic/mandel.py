"""Closed form by Mandel: a block squeezed between rigid plates that drains to its sides."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from porocore.states import Array

#: Terms of the series; at c t/a² = 1e-5 the last is exp(−400).
TERMS = 2000


@dataclass(frozen=True)
class Mandel:
    """A quarter 0 ≤ x ≤ a of an isotropic block in plane strain, pressed by F per length and quarter from t = 0 on.

    The plates are frictionless, the sides x = ±a free and drained (Mandel 1953; Cheng & Detournay 1988). The pressure
    in the middle rises above its first value before it falls, the Mandel–Cryer effect.

    Attributes
    ----------
    half_width
        a [L].
    force
        F > 0, compression, on the quarter per length [E L].
    lame, shear
        λ and μ of the drained frame [E].
    biot
        α [-].
    storage
        S = 1/M_B [1/E].
    conductivity
        k/μ_f.
    """

    half_width: float
    force: float
    lame: float
    shear: float
    biot: float
    storage: float
    conductivity: float

    @property
    def poisson_ratio(self) -> float:
        """Drained Poisson's ratio ν."""
        return self.lame / (2 * (self.lame + self.shear))

    @property
    def undrained_poisson_ratio(self) -> float:
        """ν_u: that of λ_u = λ + α²/S."""
        lame = self.lame + self.biot**2 / self.storage
        return lame / (2 * (lame + self.shear))

    @property
    def skempton(self) -> float:
        """B = α/(S K_u), pore pressure over mean stress in the undrained body."""
        bulk = self.lame + 2 / 3 * self.shear + self.biot**2 / self.storage
        return self.biot / (self.storage * bulk)

    @property
    def consolidation_coefficient(self) -> float:
        """c = k/(S + α²/(λ + 2μ))."""
        return self.conductivity / (self.storage + self.biot**2 / (self.lame + 2 * self.shear))

    @cached_property
    def _roots(self) -> Array:
        """Positive roots of tan s = s (1 − ν)/(ν_u − ν), one in each (n π, n π + π/2), by bisection."""
        nu, nu_u = self.poisson_ratio, self.undrained_poisson_ratio
        n = np.arange(TERMS)
        low, high = n * np.pi + 1e-9, n * np.pi + np.pi / 2
        for _ in range(60):
            middle = (low + high) / 2
            above = (-1.0) ** n * ((nu_u - nu) * np.sin(middle) - (1 - nu) * middle * np.cos(middle)) > 0
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        roots: Array = (low + high) / 2
        return roots

    def _decaying(self, t: float) -> tuple[Array, Array, Array]:
        """s, sin s and exp(−s² c t/a²)/(s − sin s cos s) with which each term begins."""
        s = self._roots
        decay = np.exp(-(s**2) * self.consolidation_coefficient * t / self.half_width**2)
        return s, np.sin(s), decay / (s - np.sin(s) * np.cos(s))

    def pressure(self, x: npt.ArrayLike, t: float) -> Array:
        """p at distances ``x`` from the middle at one time t > 0; the shape of ``x`` [E]."""
        s, sine, weight = self._decaying(t)
        shape = np.cos(np.multiply.outer(np.asarray(x, dtype=float), s) / self.half_width) - np.cos(s)
        first = 2 * self.force * self.skempton * (1 + self.undrained_poisson_ratio) / (3 * self.half_width)
        pressure: Array = first * (shape @ (sine * weight))
        return pressure

    def lateral(self, x: npt.ArrayLike, t: float) -> Array:
        """u_x at distances ``x`` from the middle at one time t > 0, positive outwards [L]."""
        s, sine, weight = self._decaying(t)
        x = np.asarray(x, dtype=float)
        nu, nu_u, scale = self.poisson_ratio, self.undrained_poisson_ratio, self.force / self.shear
        straight = scale / self.half_width * (nu / 2 - nu_u * float((sine * np.cos(s)) @ weight))
        bent = scale * (np.sin(np.multiply.outer(x, s) / self.half_width) @ (np.cos(s) * weight))
        lateral: Array = straight * x + bent
        return lateral

    def strain(self, t: float) -> float:
        """u_y/y at one time t > 0, negative: the plates approach each other."""
        s, sine, weight = self._decaying(t)
        nu, nu_u = self.poisson_ratio, self.undrained_poisson_ratio
        share = (1 - nu) / 2 - (1 - nu_u) * float((sine * np.cos(s)) @ weight)
        return -self.force / (self.shear * self.half_width) * share
