"""Closed forms: Terzaghi, Mandel, Armstrong, Lamé, layers that relax, swelling, fixed charges, Xie & Leo's clay.

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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.special import erf, jn_zeros, jv, roots_legendre

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


#: Terms of the series; at c t/a² = 1e-5 the last is exp(−400).
MANDEL_TERMS = 2000


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
        n = np.arange(MANDEL_TERMS)
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


#: Terms of the series; at H_A K t/a² = 1e-5 the last is exp(−98).
ARMSTRONG_TERMS = 1000


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
        high = jn_zeros(1, ARMSTRONG_TERMS)
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

    def creep(self, stress: float, t: float) -> float:
        """Axial strain at the time ``t`` > 0 under a sudden mean axial ``stress`` [E], whatever ``strain`` is.

        The transform of u is −ε r/2 + b I₁(q r), q² = s/(H_A K), b from the free drained mantle.
        """
        from scipy.special import ive

        a, aggregate = self.radius, self.aggregate_modulus

        def transform(rate: complex) -> Array:
            x = a * np.sqrt(rate / (aggregate * self.conductivity))
            ratio = ive(1, x) / ive(0, x)
            inner = self.shear / (aggregate * x - 2 * self.shear * ratio)  # b I₀(q a)/a of a unit strain
            edge = inner * ratio - 0.5
            mean_pressure = aggregate * (2 * edge + 1 - inner * x)
            return np.array([stress / rate / (aggregate + 2 * self.lame * edge - mean_pressure)])

        return float(inverse_laplace(transform, t)[0])


@dataclass(frozen=True)
class ThickCylinder:
    """A hollow elastic cylinder in plane strain under pressures on both faces (Lamé & Clapeyron 1833).

    The constants are those of the frame where the pores are drained, and p = 0.

    Attributes
    ----------
    inner, outer
        Radii a and b [L].
    inner_pressure, outer_pressure
        p_a and p_b, positive in compression [E].
    lame, shear
        λ and μ [E].
    """

    inner: float
    outer: float
    inner_pressure: float
    outer_pressure: float
    lame: float
    shear: float

    @property
    def _parts(self) -> tuple[float, float]:
        """Stress A that is the same everywhere, and B of ± B/r²."""
        a2, b2 = self.inner**2, self.outer**2
        uniform = (self.inner_pressure * a2 - self.outer_pressure * b2) / (b2 - a2)
        return uniform, (self.inner_pressure - self.outer_pressure) * a2 * b2 / (b2 - a2)

    def radial_stress(self, r: npt.ArrayLike) -> Array:
        """σ_rr at distances ``r`` from the axis, positive in tension [E]."""
        uniform, varying = self._parts
        return np.asarray(uniform - varying / np.asarray(r, dtype=float) ** 2)

    def hoop_stress(self, r: npt.ArrayLike) -> Array:
        """σ_θθ at distances ``r`` from the axis, positive in tension [E]."""
        uniform, varying = self._parts
        return np.asarray(uniform + varying / np.asarray(r, dtype=float) ** 2)

    def axial_stress(self) -> float:
        """σ_zz, the same everywhere, positive in tension [E]."""
        return self.lame / (self.lame + self.shear) * self._parts[0]

    def lateral(self, r: npt.ArrayLike) -> Array:
        """u_r at distances ``r`` from the axis, positive outwards [L]."""
        uniform, varying = self._parts
        r = np.asarray(r, dtype=float)
        return np.asarray(uniform / (2 * (self.lame + self.shear)) * r + varying / (2 * self.shear) / r)


#: Nodes of the contour by which a transform is inverted; the error falls as 3.89^−N down to round-off.
NODES = 24


@dataclass(frozen=True)
class SoilLayer:
    """A layer of a soil; see :class:`~porocore.macro.analytic.Terzaghi` for its constants.

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
    branches
        Strength γ and time τ of each branch by which the solid relaxes, g(t) = 1 + Σ γ exp(−t/τ); none: it is elastic.
    """

    height: float
    stiffness: float
    biot: float
    storage: float
    conductivity: float
    branches: tuple[tuple[float, float], ...] = ()

    @classmethod
    def from_coefficients(
        cls,
        coefficients: LinearCoefficients,
        height: float,
        branches: Sequence[tuple[float, float]] = (),
    ) -> SoilLayer:
        """A layer loaded along the second axis."""
        c = coefficients
        constants = (c.stiffness[1, 1, 1, 1], c.biot[1, 1], c.storage, c.conductivity[1, 1])
        stiffness, biot, storage, conductivity = map(float, constants)
        return cls(height, stiffness, biot, storage, conductivity, tuple(branches))

    def stiffening(self, rate: complex) -> complex:
        """Factor s ĝ(s) = 1 + Σ γ s τ/(1 + s τ) of the moduli of the solid at the ``rate`` s of a transform."""
        return 1 + sum(strength * rate * time / (1 + rate * time) for strength, time in self.branches)

    @property
    def capacity(self) -> float:
        """S + α²/C, fluid taken up per pressure under constant stress."""
        return self.storage + self.biot**2 / self.stiffness

    def initial_pressure(self, load: float) -> float:
        """Pressure of the undrained layer under ``load``, however the solid relaxes."""
        return self.biot * load / self.stiffness / self.capacity


class LayeredConsolidation:
    """Layers on an impermeable rigid base, drained and loaded on top, elastic or relaxing (Schiffman & Stein 1970).

    In each layer s ∂p/∂t = K ∂²p/∂y² − (α/C) ∂σ/∂t with s = S + α²/C; p and K ∂p/∂y are continuous. Of a sudden load
    the Laplace transform is a sum of exponentials in each layer, whose factors solve a small linear system; it is
    inverted along Talbot's contour [Weideman 2006, SIAM J. Numer. Anal. 44, 2342].

    Where the solid of a layer relaxes, its moduli are multiplied by s ĝ(s) in the transform: C → s ĝ C,
    1/M_B → 1/(s ĝ M_B), α and K stay (correspondence principle; Biot 1956, J. Appl. Phys. 27, 459).

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
        return after_ramp(lambda rate: self._pressure(heights, rate), t, self.ramp)

    def settlement(self, t: float) -> float:
        """Settlement of the top at the time ``t`` > 0, positive downwards [L]."""
        return float(after_ramp(lambda rate: np.array([self._settlement(rate)]), t, self.ramp)[0])

    def held_load(self, settlement: float, t: float) -> float:
        """Load that holds the top at a ``settlement`` [L], whatever ``load`` > 0 is, at the time ``t`` > 0 [E].

        It is reached at once, or linearly along the ramp.
        """

        def transform(rate: complex) -> Array:
            return np.array([self.load * settlement / (rate**2 * self._settlement(rate))])

        return float(after_ramp(transform, t, self.ramp)[0])

    def held_pressure(self, settlement: float, y: npt.ArrayLike, t: float) -> Array:
        """p at heights ``y`` (k,) at the time ``t`` > 0 while the top is held at a ``settlement`` [E]."""
        heights = np.atleast_1d(np.asarray(y, dtype=float))

        def transform(rate: complex) -> Array:
            return np.asarray(self._pressure(heights, rate) * (settlement / (rate * self._settlement(rate))))

        return after_ramp(transform, t, self.ramp)

    def _pressure(self, heights: Array, rate: complex) -> Array:
        """Return the transform of p at heights (k,) under the sudden load."""
        values = np.empty(len(heights), dtype=complex)
        base = 0.0
        for layer, (up, down) in zip(self.layers, self._factors(rate), strict=True):
            inside = (heights >= base) & (heights <= base + layer.height)
            at, q = heights[inside] - base, self._root(layer, rate)
            waves = up * np.exp(q * (at - layer.height)) + down * np.exp(-q * at)
            values[inside] = layer.initial_pressure(self.load) / rate + waves
            base += layer.height
        return values

    def _settlement(self, rate: complex) -> complex:
        """Return the transform of the settlement under the sudden load."""
        total = 0.0 + 0.0j
        for layer, (up, down) in zip(self.layers, self._factors(rate), strict=True):
            q, h = self._root(layer, rate), layer.height
            pressure = layer.initial_pressure(self.load) * h / rate
            pressure += (up + down) * (1 - np.exp(-q * h)) / q
            stiffness = layer.stiffness * layer.stiffening(rate)
            total += (self.load * h / rate - layer.biot * pressure) / stiffness
        return total

    @staticmethod
    def _root(layer: SoilLayer, rate: complex) -> complex:
        capacity = layer.capacity / layer.stiffening(rate)
        return complex(np.sqrt(rate * capacity / layer.conductivity))

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


def after_ramp(transform: Callable[[complex], Array], t: float, ramp: float) -> Array:
    """Return the response at ``t`` to a load that rises until ``ramp``, by superposition.

    Parameters
    ----------
    transform
        Laplace transform of the response to a sudden load; see :func:`inverse_laplace`.
    t
        Time.
    ramp
        Time until which the load rises linearly; 0: it is sudden.
    """
    if ramp == 0:
        return inverse_laplace(transform, t)

    def summed(rate: complex) -> Array:
        return np.asarray(transform(rate) / rate)

    whole = inverse_laplace(summed, t)
    if t > ramp:
        whole = whole - inverse_laplace(summed, t - ramp)
    return whole / ramp


def inverse_laplace(transform: Callable[[complex], Array], t: float) -> Array:
    """Return the function at ``t`` > 0 whose Laplace transform is given, along Talbot's contour.

    Its singularities lie on the negative real axis [Weideman 2006, SIAM J. Numer. Anal. 44, 2342].

    Parameters
    ----------
    transform
        Values (k,) at a complex rate; those at conjugate rates are conjugate.
    t
        Time.
    """
    a, b, c, d = 0.5017, 0.6407, 0.6122, 0.2645
    total: Array = np.zeros(1)
    # Conjugate nodes give conjugate values.
    for theta in (2 * np.arange(NODES // 2) + 1) * np.pi / NODES:
        z = NODES / t * (a * theta / np.tan(b * theta) - c + d * 1j * theta)
        slope = NODES / t * (a / np.tan(b * theta) - a * b * theta / np.sin(b * theta) ** 2 + d * 1j)
        total = total + 2 * np.real(np.exp(z * t) * np.asarray(transform(complex(z))) * slope / (1j * NODES))
    return np.asarray(total)


#: Modes that are summed; the last one matters before T = 1e-5 alone.
MODES = 150


def excess_force(share: float, times: Array) -> Array:
    """Return by which share of its final value the force on a layer is larger, at times T = c_v t/h².

    The layer is drained on one face, and both faces have had their displacement since T = 0. With σ = C ε − α p the
    stress is the same everywhere, σ = C ε̄ − α p̄, and ∂p/∂t − r ∂p̄/∂t = c_v ∂²p/∂y² with p̄ the mean of p. Its modes
    cos(x y/h) − cos x have tan x = −x (1 − r)/r, so that x = n π where the constituents are incompressible, r = 1.

    Parameters
    ----------
    share
        r = (α²/C)/(1/M_B + α²/C), at most 1.
    times
        T > 0.
    """
    from scipy.optimize import brentq  # slow to import

    x = np.arange(1, MODES + 1) * np.pi
    if share < 1:

        def fault(x: float) -> float:
            return float(share * np.sin(x) + (1 - share) * x * np.cos(x))

        ends = [(n * np.pi - np.pi / 2, n * np.pi) for n in range(1, MODES + 1)]
        x = np.array([brentq(fault, *pair, xtol=1e-13) for pair in ends])
    cos2 = np.cos(x) ** 2
    weights = 2 * cos2 / (share + (1 - share) * cos2)
    return np.asarray(np.exp(-np.multiply.outer(times, x**2)) @ weights)


def relaxed(share: float, left: float) -> float | None:
    """Return the time T at which the force is within ``left`` of its final value; None if it begins within it.

    Parameters
    ----------
    share
        r as of :func:`excess_force`.
    left
        Share of the final force.
    """
    if share <= 0 or share / max(1 - share, 1e-300) <= left:
        return None

    def more(T: float) -> float:
        return float(excess_force(share, np.array([T]))[0]) - left

    from scipy.optimize import brentq

    low, high = 1e-5, 10.0
    return float(brentq(more, low, high, xtol=1e-12)) if more(low) > 0 else None


#: Terms of the series, which fall as the third power of their number once the swelling has stopped to jump.
SWELLING_TERMS = 400


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
        m = np.pi / 2 * (2.0 * np.arange(SWELLING_TERMS) + 1)
        low, high = self._ends
        shape = 2 / m * (np.sin(m * high / self.height) - np.sin(m * low / self.height))
        rate = self.consolidation_coefficient * m**2 / self.height**2
        followed, before = np.zeros(SWELLING_TERMS), (self.history[0][0], 0.0)
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


#: States at which an equilibrium is looked for on one side, before it is said that there is none.
MOST_STRAINS = 60


@dataclass(frozen=True)
class ChargedCell:
    """A cell with fixed charges in Donnan equilibrium with a bath, by scalar equations.

    In the pores c₊ c₋ = c*² and c₊ − c₋ = c_F, so that c± = c* exp(± ψ) with sinh ψ = c_F/(2 c*), and by van 't Hoff
    π = R T Φ (c₊ + c₋ − 2 c*) = 2 R T Φ c* (cosh ψ − 1) (Overbeek 1956; Lai, Hou & Mow 1991). The pressure of the fluid
    is p = π + μ, with 0 for the effective pressure μ wherever nothing flows and a surface touches the bath.

    Attributes
    ----------
    response
        P_E (3, 3) [E] and φ of the cell at H (3, 3) and p.
    charge
        c_F0 φ_f0, fixed charges per reference volume.
    bath
        c* > 0.
    osmotic
        R T Φ, pressure per concentration [E].
    """

    response: Callable[[Array, float], tuple[Array, float]]
    charge: float
    bath: float
    osmotic: float

    def osmotic_pressure(self, fluid: float) -> float:
        """Osmotic pressure π of the pores with the fluid volume φ [E]."""
        potential = np.arcsinh(self.charge / fluid / (2 * self.bath))
        return float(4 * self.osmotic * self.bath * np.sinh(potential / 2) ** 2)

    def pressure(self, H: Array, effective: float = 0.0) -> float:
        """p at H and the effective pressure μ, the root of p − π(φ(H, p)) = μ [E]."""
        from scipy.optimize import brentq  # slow to import

        def fault(p: float) -> float:
            return p - self.osmotic_pressure(self.response(H, p)[1]) - effective

        # φ grows with p, so that π is largest at the smallest p.
        most = effective + self.osmotic_pressure(self.response(H, effective)[1])
        return float(brentq(fault, effective, most, xtol=1e-16, rtol=1e-15)) if most > effective else most

    def equilibrium(self, direction: Array, load: float = 0.0) -> tuple[float, float]:
        """Strain e and pressure p of the cell in the bath, H = e N, where N : P_E = −``load`` [E].

        N = I without a load is free swelling of an isotropic cell, N = e₂ ⊗ e₂ confined compression.

        Raises
        ------
        ValueError
            There is none between e = −0.9 and 2.
        """
        from scipy.optimize import brentq

        def fault(strain: float) -> float:
            H = strain * direction
            return float(np.sum(direction * self.response(H, self.pressure(H))[0])) + load

        at_zero = fault(0.0)
        if at_zero == 0:
            return 0.0, self.pressure(0.0 * direction)
        ends = np.linspace(0.0, 2.0 if at_zero < 0 else -0.9, MOST_STRAINS + 1)
        for before, strain in pairwise(ends):
            if fault(strain) * at_zero <= 0:
                found = float(brentq(fault, before, strain, xtol=1e-15, rtol=1e-14))
                return found, self.pressure(found * direction)
        raise ValueError(f"expected an equilibrium between 0 and {ends[-1]:g}, found none")


@dataclass(frozen=True)
class ChargedLayer:
    """A layer with fixed charges on an impermeable rigid base, in a bath on top, near an equilibrium.

    With δσ = C δε − α δp, δφ = α δε + S δp and δp = δμ + π′ δφ + π_c δc*, the sum m = δμ + π_c δc* is the pressure of
    a layer without charges that has the constants

        C_app = C − α² π′/(1 − π′ S),   α_app = α/(1 − π′ S),   S_app = S/(1 − π′ S).

    A sudden change of the bath leaves the fluid where it is, m = 0, and then m rises to π_c δc* from the top.

    Attributes
    ----------
    height
        h [L].
    stiffness
        C, confined drained modulus at the equilibrium, at constant p [E].
    biot
        α [-].
    storage
        S = 1/M_B [1/E].
    conductivity
        K.
    slope
        π′ = dπ/dφ < 0 [E].
    by_bath
        π_c = ∂π/∂c* < 0 [E per concentration].
    """

    height: float
    stiffness: float
    biot: float
    storage: float
    conductivity: float
    slope: float
    by_bath: float

    @property
    def apparent(self) -> SoilLayer:
        """The layer without charges that answers alike."""
        less = 1 - self.slope * self.storage
        stiffness = self.stiffness - self.biot**2 * self.slope / less
        return SoilLayer(self.height, stiffness, self.biot / less, self.storage / less, self.conductivity)

    def loaded(self, load: float) -> Terzaghi:
        """The layer under a sudden ``load`` > 0 on top, whose pressure is the change of μ."""
        a = self.apparent
        return Terzaghi(a.height, load, a.stiffness, a.biot, a.storage, a.conductivity)

    def effective_pressure(self, change: float, y: npt.ArrayLike, t: npt.ArrayLike) -> Array:
        """μ at heights ``y`` over the base and times ``t`` > 0 after a sudden ``change`` of c* [E]."""
        unit = self.loaded(1.0)
        return -self.by_bath * change / unit.initial_pressure * unit.pressure(y, t)

    def rise(self, change: float, t: npt.ArrayLike) -> Array:
        """Rise of the top at times ``t`` after a sudden ``change`` of c*; the shape of ``t`` [L]."""
        a = self.apparent
        final = a.height * a.biot * self.by_bath * change / a.stiffness
        return np.asarray(final * self.loaded(1.0).degree(t))


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
