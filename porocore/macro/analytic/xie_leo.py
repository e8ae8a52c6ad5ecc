"""Closed form by Xie & Leo (2004): large-strain consolidation of a clay layer.

A saturated layer is drained on top and loaded by q at t = 0 beyond the load and the self-weight under which it rests.
In the Lagrangian coordinate a, the depth below the surface before q, the paper has

- a constant coefficient of volume compressibility, m = −de/dσ′/(1 + e), so that J = (1 + e)/(1 + e₀) = exp(−m Δσ′),
- a permeability k = k₀ J², and incompressible water and grains.

With u the excess over the pressure at rest, Δσ′ = q − u, for self-weight and buoyancy do not change. The flow of water
relative to the grains is (k₀ J²/γ_w) (1/J) ∂u/∂a through reference area, and ∂J/∂a = m J ∂u/∂a, so

    ∂J/∂t = c ∂²J/∂a²   with c = k₀/(m γ_w):

linear diffusion from J = 1 to J = exp(−m q). The void ratio e₀(a), which self-weight makes depend on depth, drops out
of J, settlement and pressure.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import roots_legendre

from porocore.macro.analytic.terzaghi import Terzaghi
from porocore.states import Array


@dataclass(frozen=True)
class XieLeo:
    """The layer, drained on top, impermeable below (PTIB in the paper), in closed form.

    Attributes
    ----------
    load
        q, sudden [kPa].
    height
        H before the load [m].
    permeability
        k₀ [m/s].
    compressibility
        m [1/kPa].
    unit_weight
        γ_w [kN/m³].
    """

    load: float = 100.0
    height: float = 10.0
    permeability: float = 1e-9
    compressibility: float = 4e-3
    unit_weight: float = 10.0

    @property
    def final_stretch(self) -> float:
        """Final J, exp(−m q)."""
        return float(np.exp(-self.compressibility * self.load))

    @property
    def final_settlement(self) -> float:
        """Final settlement of the surface [m]."""
        return self.height * (1 - self.final_stretch)

    @property
    def conductivity(self) -> float:
        """k₀/γ_w [m²/(kPa s)]."""
        return self.permeability / self.unit_weight

    @property
    def _diffusion(self) -> Terzaghi:
        """J falls from 1 to its last value as the pressure does in a linear layer of modulus 1/m and load 1."""
        return Terzaghi(self.height, 1.0, 1 / self.compressibility, 1.0, 0.0, self.conductivity)

    def stretch(self, depth: npt.ArrayLike, t: float) -> Array:
        """J = (1 + e)/(1 + e₀) at depths a and one time."""
        y = self.height - np.asarray(depth, dtype=float)
        last = self.final_stretch
        stretch: Array = last + (1 - last) * self._diffusion.pressure(y, t)
        return stretch

    def pressure(self, depth: npt.ArrayLike, t: float) -> Array:
        """u, the excess pore pressure at depths a and one time [kPa]."""
        pressure: Array = self.load + np.log(self.stretch(depth, t)) / self.compressibility
        return pressure

    def settlement(self, t: npt.ArrayLike) -> Array:
        """Settlement of the surface, positive downwards; the shape of ``t`` [m]."""
        settlement: Array = self.final_settlement * self._diffusion.degree(t)
        return settlement

    def degree_by_pressure(self, t: float) -> float:
        """1 − mean of u over a, of the load; by Gauss's rule on 40 parts."""
        x, weights = roots_legendre(10)
        edges = np.linspace(0, self.height, 41)
        a = (edges[:-1, None] + (x + 1) / 2 * np.diff(edges)[:, None]).ravel()
        mean = float(np.tile(weights, 40) @ self.pressure(a, t)) / 80
        return 1 - mean / self.load
