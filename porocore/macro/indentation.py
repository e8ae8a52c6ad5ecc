"""Indentation of half spaces and layers: rigid indenters, elastic and poroelastic bodies, published fits.

A rigid frictionless indenter of revolution of profile f(r), f(0) = 0, is pressed by δ into z ≥ 0. With

    g(x) = x ∫₀ˣ f′(r)/√(x² − r²) dr

the surface of an elastic half space obeys δ = g(a), F = 2 E* ∫₀ᵃ (δ − g(x)) dx, with the contact radius a and
E* = E/(1 − ν²) (Sneddon 1965, Int. J. Eng. Sci. 3:47–57; Popov, Heß & Willert 2019, Handbook of Contact Mechanics).
A poroelastic half space has the same ends, E* = 4 G at first (incompressible constituents) and 2 G/(1 − ν) at last.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.special import eval_legendre, j0, roots_legendre, spherical_jn

from porocore.core.fields import provided
from porocore.macro.analytic import NODES, after_ramp, inverse_laplace
from porocore.states import Array

Complex = npt.NDArray[np.complex128]

#: Points of Gauss's rule over the profile and over the contact.
GAUSS = 60


class Indenter(ABC):
    """A rigid body of revolution whose foremost point touches the half space at depth 0."""

    @abstractmethod
    def slope(self, r: Array) -> Array:
        """f′ at distances ``r`` from the axis [-]."""

    @abstractmethod
    def curvature(self, r: Array) -> Array:
        """f″ at distances ``r`` from the axis [1/L]."""

    @property
    def corners(self) -> tuple[float, ...]:
        """Distances from the axis where f′ is not smooth [L]."""
        return ()

    @property
    def fixed_radius(self) -> float | None:
        """Contact radius of a punch with a sharp edge [L]; None where it grows with the depth."""
        return None

    @property
    def limit(self) -> float:
        """Distance from the axis at which the body ends [L]."""
        return np.inf

    def effective_profile(self, x: npt.ArrayLike) -> Array:
        """g at distances ``x`` [L]; the shape of ``x``."""
        x = np.asarray(x, dtype=float)
        return x * self._over_angles(x, self.slope)

    def effective_slope(self, x: npt.ArrayLike) -> Array:
        """g′ at distances ``x`` > 0 [-]; the shape of ``x``."""

        def integrand(r: Array) -> Array:
            return self.slope(r) + r * self.curvature(r)

        return self._over_angles(np.asarray(x, dtype=float), integrand)

    def _over_angles(self, x: Array, function: Callable[[Array], Array]) -> Array:
        """Return the integral of a function of r = x sin φ over φ from 0 to π/2."""
        points, weights = roots_legendre(GAUSS)
        total = np.zeros_like(x)
        inner = [np.arcsin(np.minimum(c, x) / np.maximum(x, 1e-300)) for c in self.corners]
        ends = [np.zeros_like(x), *inner, np.full_like(x, np.pi / 2)]
        for low, high in pairwise(ends):
            angles = low[..., None] + (high - low)[..., None] * (points + 1) / 2
            total += (high - low) / 2 * (function(x[..., None] * np.sin(angles)) @ weights)
        return total


@dataclass(frozen=True)
class Paraboloid(Indenter):
    """f = r²/(2 R), Hertz's sphere (Hertz 1881, J. reine angew. Math. 92:156–171).

    Attributes
    ----------
    radius
        R [L].
    """

    radius: float

    def slope(self, r: Array) -> Array:
        return r / self.radius

    def curvature(self, r: Array) -> Array:
        return np.full_like(r, 1 / self.radius)


@dataclass(frozen=True)
class Sphere(Indenter):
    """f = R − √(R² − r²); g = x artanh(x/R) (Sneddon 1965).

    Attributes
    ----------
    radius
        R [L].
    """

    radius: float

    def slope(self, r: Array) -> Array:
        return np.asarray(r / np.sqrt(self.radius**2 - r**2))

    def curvature(self, r: Array) -> Array:
        return np.asarray(self.radius**2 / (self.radius**2 - r**2) ** 1.5)

    @property
    def limit(self) -> float:
        return self.radius


@dataclass(frozen=True)
class Cone(Indenter):
    """A cone whose tip is a sphere that touches it; g = (π/2) x cot θ where the tip is sharp (Love 1939; Sneddon 1965).

    Attributes
    ----------
    angle
        θ, between axis and surface [degrees].
    tip
        Radius of the tip [L].
    """

    angle: float
    tip: float = 0.0

    def slope(self, r: Array) -> Array:
        theta = np.deg2rad(self.angle)
        if self.tip == 0:
            return np.full_like(r, 1 / np.tan(theta))
        round_part = np.minimum(r, self.corners[0])
        return np.asarray(round_part / np.sqrt(self.tip**2 - round_part**2))

    def curvature(self, r: Array) -> Array:
        if self.tip == 0:
            return np.zeros_like(r)
        round_part = np.minimum(r, self.corners[0])
        return np.where(r < self.corners[0], self.tip**2 / (self.tip**2 - round_part**2) ** 1.5, 0.0)

    @property
    def corners(self) -> tuple[float, ...]:
        return (self.tip * float(np.cos(np.deg2rad(self.angle))),) if self.tip else ()


@dataclass(frozen=True)
class Punch(Indenter):
    """A flat cylinder whose edge is an arc (Ciavarella 1999, J. Strain Anal. 34:137–148, for small contact on the arc).

    Attributes
    ----------
    radius
        Of the cylinder [L].
    edge
        Radius of the arc [L]; 0: sharp, and the contact radius is that of the cylinder (Sneddon 1946).
    """

    radius: float
    edge: float = 0.0

    def slope(self, r: Array) -> Array:
        past = np.maximum(r - (self.radius - self.edge), 0.0)
        return np.asarray(past / np.sqrt(self.edge**2 - past**2)) if self.edge else np.zeros_like(r)

    def curvature(self, r: Array) -> Array:
        past = np.maximum(r - (self.radius - self.edge), 0.0)
        curved = self.edge**2 / (self.edge**2 - past**2) ** 1.5 if self.edge else np.zeros_like(r)
        return np.where(past > 0, curved, 0.0)

    @property
    def corners(self) -> tuple[float, ...]:
        return (self.radius - self.edge,) if self.edge else ()

    @property
    def fixed_radius(self) -> float | None:
        return None if self.edge else self.radius

    @property
    def limit(self) -> float:
        return self.radius


@dataclass(frozen=True)
class ElasticIndentation:
    """An elastic half space or layer below a rigid frictionless indenter; small strain.

    With the contact pressure p(r) = φ(a)/√(a² − r²) − ∫ᵣᵃ φ′(x)/√(x² − r²) dx

        φ(x) + (2/π) ∫₀ᵃ ∫₀^∞ (L(ξ h) − 1) cos ξx cos ξs dξ φ(s) ds = (E*/π) (δ − g(x)),   F = 2 π ∫₀ᵃ φ dx,

    where L is the compliance of a layer of thickness h over that of a half space (Lebedev & Ufliand 1958; Hayes, Keer,
    Herrmann & Mockros 1972, J. Biomech. 5:541–551), and φ(a) = 0 unless the edge is sharp.

    Attributes
    ----------
    indenter
        Its profile.
    shear
        G [E].
    poisson
        ν.
    thickness
        h of a layer on a rigid base [L]; None: a half space.
    base
        Whether the layer is bonded to the base or slides on it.
    """

    indenter: Indenter
    shear: float
    poisson: float
    thickness: float | None = None
    base: Literal["bonded", "smooth"] = "bonded"

    @property
    def reduced_modulus(self) -> float:
        """E* = E/(1 − ν²) = 2 G/(1 − ν) [E]."""
        return 2 * self.shear / (1 - self.poisson)

    def compliance(self, x: npt.ArrayLike) -> Array:
        """L of a layer at x = ξ h > 0, the share of a half space's surface displacement; the shape of ``x``."""
        x = np.asarray(x, dtype=float)
        far, four = np.exp(-2 * x), 3 - 4 * self.poisson
        if self.base == "smooth":
            return np.asarray((1 - far) ** 2 / (1 - far**2 + 4 * x * far))
        above = four * (1 - far**2) - 4 * x * far
        return np.asarray(above / (four * (1 + far**2) + (4 * x**2 + 1 + four**2) * far))

    def contact_radius(self, depth: float) -> float:
        """a at the ``depth`` δ > 0 [L].

        Raises
        ------
        ValueError
            Where the whole of the indenter is in contact before.
        """
        if self.indenter.fixed_radius is not None:
            return self.indenter.fixed_radius

        def missing(a: float) -> float:
            *_, unit, profile = self._density(a, np.array([a]))
            return float(profile[0] - depth * unit[0])

        from scipy.optimize import brentq  # slow to import

        # The body's own end is left out, where its slope is infinite.
        limit = self.indenter.limit
        high = min(depth, limit * (1 - 1e-12))
        while missing(high) < 0:
            if high >= limit * (1 - 1e-12):
                raise ValueError(f"at the depth {depth:g} all of the indenter is in contact")
            high = min(2 * high, limit * (1 - 1e-12))
        return float(brentq(missing, 1e-12 * high, high, xtol=1e-14 * high, rtol=1e-14))

    def force(self, depth: float) -> float:
        """F at the ``depth`` δ > 0, positive in compression [E L²]."""
        _, weights, unit, profile = self._density(self.contact_radius(depth))
        return float(2 * self.reduced_modulus * (weights @ (depth * unit - profile)))

    def pressure(self, r: npt.ArrayLike, depth: float) -> Array:
        """Contact pressure at distances ``r`` from the axis, 0 outside the contact [E]; the shape of ``r``."""
        a, r = self.contact_radius(depth), np.asarray(r, dtype=float)
        inside = r < a
        within = np.where(inside, r, 0.0)
        points, weights = roots_legendre(GAUSS)
        pressure = np.zeros_like(r)
        corners = [np.maximum(c, within) for c in self.indenter.corners if c < a]
        for low, high in pairwise([within, *corners, np.full_like(within, a)]):
            # x = √(r² + v²) takes the root at r away, squares take that away with which g′ rises at a corner.
            first, last = (np.sqrt(np.maximum(end**2 - within**2, 0.0)) for end in (low, high))
            v = first[..., None] + (last - first)[..., None] * ((points + 1) / 2) ** 2
            x = np.sqrt(within[..., None] ** 2 + v**2)
            slope = self.indenter.effective_slope(x) + self._layer_slope(x, a, depth)
            pressure += (last - first) * ((slope / x) @ (weights * (points + 1) / 2))
        if self.indenter.fixed_radius is not None:
            *_, unit, profile = self._density(a, np.array([a]))
            pressure += float(depth * unit[0] - profile[0]) / np.sqrt(a**2 - within**2)
        return np.where(inside, self.reduced_modulus / np.pi * pressure, 0.0)

    def _density(self, a: float, at: Array | None = None) -> tuple[Array, Array, Array, Array]:
        """Return points x, weights, and φ π/E* there, or ``at`` others, of a unit depth and of the profile g."""
        # A wide contact of a thin layer has a rim as wide as the layer is thick.
        wide = 0 if self.thickness is None else int(12 * a / self.thickness)
        points, weights = roots_legendre(max(GAUSS, wide))
        ends = np.array([0.0, *(c for c in self.indenter.corners if c < a), a])[:, None]
        lengths = np.diff(ends, axis=0)
        x, w = (ends[:-1] + lengths * (points + 1) / 2).ravel(), (lengths * weights / 2).ravel()
        given = np.stack([np.ones_like(x), self.indenter.effective_profile(x)], axis=1)
        found = given
        if self.thickness is not None:
            found = np.linalg.solve(np.eye(len(x)) + self._kernel(x, x, a) * w, given)
        if at is not None:
            given = np.stack([np.ones_like(at), self.indenter.effective_profile(at)], axis=1)
            found = given - (self._kernel(at, x, a) * w) @ found if self.thickness is not None else given
        return x, w, found[:, 0], found[:, 1]

    def _waves(self, a: float) -> tuple[Array, Array]:
        """Return ξ, and the weights (2/π) (L − 1) dξ."""
        points, weights = roots_legendre(8)
        thickness = provided(self.thickness)
        # L − 1 dies out as exp(−2 ξ h); cos ξx is resolved up to x = a.
        parts = int(np.ceil(24 * max(1.0, a / thickness)))
        xi = ((np.arange(parts)[:, None] + (points + 1) / 2) * (24 / thickness / parts)).ravel()
        lost = self.compliance(xi * thickness) - 1
        return xi, 2 / np.pi * lost * np.tile(weights, parts) * (12 / thickness / parts)

    def _kernel(self, x: Array, s: Array, a: float) -> Array:
        xi, weights = self._waves(a)
        return np.asarray((np.cos(np.multiply.outer(x, xi)) * weights) @ np.cos(np.multiply.outer(xi, s)))

    def _layer_slope(self, x: Array, a: float, depth: float) -> Array | float:
        """Return −φ′ π/E* at ``x``, less g′, at a depth."""
        if self.thickness is None:
            return 0.0
        s, w, unit, profile = self._density(a)
        xi, weights = self._waves(a)
        transform = np.cos(np.multiply.outer(xi, s)) @ (w * (depth * unit - profile))
        return np.asarray(-np.sin(np.multiply.outer(x, xi)) @ (weights * xi * transform))


#: Polynomials for the contact pressure, and for the pore pressure or the flux below the indenter.
TERMS = 12

Drainage = Literal["sealed", "drained"]


@dataclass(frozen=True)
class PoroelasticIndentation:
    """A poroelastic half space into which a rigid frictionless indenter is pressed by ``depth`` at t = 0, and held.

    Surface displacement w, contact pressure N, pore pressure p and the flow −∂p/∂z of the surface z = 0 are linear in
    the undrained part P and the diffusing part Q of the pressure. Of their Laplace and Hankel transforms, with
    γ = √(ξ² + s/c) and H = λ + 2 G,

        w = m P/(2 ξ),   N = β P + κ ξ/(γ + ξ) Q,   p = P + Q,   −∂p/∂z = ξ P + γ Q,
        β = α + (λ + G) S/α,   m = β/G + S/α,   κ = 2 G α/H,   c = K/(S + α²/H).

    Below the indenter w is given, outside N = 0; p or the flow vanishes below and outside. These are dual integral
    equations, here for the coefficients of Legendre polynomials, by Galerkin's method after Abel's transform (cf.
    Agbezuge & Deresiewicz 1974, Isr. J. Technol. 12:322–338; Liu & Huang 2019, Int. J. Mech. Sci., for a drained
    surface, and 2021 for one that is sealed below the indenter alone).

    The contact radius is that of the elastic half space, the same at first and at last. In between that of a smooth
    indenter is some 3 % larger; the force feels this to second order, and through the wider sealed zone.

    Attributes
    ----------
    indenter
        Its profile.
    depth
        δ [L].
    shear, poisson
        G [E] and ν of the drained frame.
    conductivity
        K = k/μ_f.
    biot
        α [-].
    storage
        S = 1/M_B [1/E]; 0: incompressible constituents.
    under, outside
        Drainage of the surface below the indenter and outside.
    sealed_radius
        Radius of the zone that is sealed while the surface outside is drained [L]; None: that of the contact.
    ramp
        Time in which the depth comes up linearly, over a contact of its last radius: exact for a punch with a sharp
        edge. 0: at once.
    """

    indenter: Indenter
    depth: float
    shear: float
    poisson: float
    conductivity: float
    biot: float = 1.0
    storage: float = 0.0
    under: Drainage = "sealed"
    outside: Drainage = "drained"
    sealed_radius: float | None = None
    ramp: float = 0.0

    @property
    def aggregate_modulus(self) -> float:
        """H = λ + 2 G = 2 G (1 − ν)/(1 − 2 ν) [E]."""
        return 2 * self.shear * (1 - self.poisson) / (1 - 2 * self.poisson)

    @property
    def diffusivity(self) -> float:
        """c = K/(S + α²/H); 2 (1 − ν)/(1 − 2 ν) G K where the constituents are incompressible."""
        return self.conductivity / (self.storage + self.biot**2 / self.aggregate_modulus)

    @property
    def undrained_poisson(self) -> float:
        """ν_u: that of λ_u = λ + α²/S."""
        _, m, beta = self._constants
        return 1 - self.shear * m / (2 * beta)

    @cached_property
    def contact_radius(self) -> float:
        """Contact radius a [L]."""
        return self._elastic(self.poisson).contact_radius(self.depth)

    @cached_property
    def instantaneous_force(self) -> float:
        """F at t = 0⁺ [E L²]."""
        return self._elastic(self.undrained_poisson).force(self.depth)

    @cached_property
    def relaxed_force(self) -> float:
        """F in the end [E L²]."""
        return self._elastic(self.poisson).force(self.depth)

    def dimensionless_time(self, t: npt.ArrayLike) -> Array:
        """τ = c t/a²."""
        return np.asarray(t, dtype=float) * self.diffusivity / self.contact_radius**2

    def force(self, t: float) -> float:
        """F at the time ``t`` > 0, positive in compression [E L²]."""
        return 2 * np.pi * self.contact_radius * float(self._at(lambda solution: solution[:1], t)[0])

    def relaxation(self, t: float) -> float:
        """(F(t) − F(∞))/(F(0) − F(∞)) at the time ``t`` > 0."""
        last = self.relaxed_force
        return (self.force(t) - last) / (self.instantaneous_force - last)

    def creep(self, force: float, t: float) -> float:
        """Depth at the time ``t`` > 0 of a punch with a sharp edge under a sudden ``force`` [L].

        Raises
        ------
        ValueError
            For an indenter whose contact radius depends on its depth.
        """
        if self.indenter.fixed_radius is None:
            raise ValueError("the depth under a force is known for a punch with a sharp edge")

        def transform(rate: complex) -> Array:
            per_depth = (
                2 * np.pi * self.contact_radius * self._solution(rate, self._largest(t))[:1] / self.depth
            )
            return np.asarray(force / (rate**2 * per_depth))

        return float(inverse_laplace(transform, t)[0])

    def contact_pressure(self, r: npt.ArrayLike, t: float) -> Array:
        """N at distances ``r`` < a from the axis at the time ``t`` > 0 [E]; the shape of ``r``."""
        a, r = self.contact_radius, np.asarray(r, dtype=float)
        phi = self._at(lambda solution: solution[:TERMS], t)
        even = np.ravel(np.column_stack([phi, np.zeros(TERMS)]))
        polynomial = np.polynomial.Legendre(even, domain=[-a, a])
        slope: Callable[[Array], Array] = polynomial.deriv()  # type: ignore[no-untyped-call]
        return np.asarray(polynomial(a) / np.sqrt(a**2 - r**2) - _abel(slope, r, a))

    def pore_pressure(self, r: npt.ArrayLike, t: float) -> Array:
        """p of the surface at distances ``r`` < a from the axis at the time ``t`` > 0 [E]; the shape of ``r``."""
        r = np.asarray(r, dtype=float)
        if self.under == "drained":
            return np.zeros_like(r)
        if self.outside == "drained":
            b = self._sealed_to
            psi = self._at(lambda solution: solution[TERMS:], t) / b
            coefficients = np.ravel(np.column_stack([np.zeros(TERMS), psi]))
            return _abel(np.polynomial.Legendre(coefficients, domain=[-b, b]), r, b)
        largest, a = self._largest(t), self.contact_radius
        x, weights, even, _ = _quadrature(largest, 1.0)
        wave = j0(np.multiply.outer(r / a, x)) * (weights * x) / a

        def transform(rate: complex) -> Array:
            gamma, coupling = self._roots(x, rate)
            share = (1 - x / gamma) / (self._constants[2] - coupling * x / gamma)
            return np.asarray(wave @ (share * (self._solution(rate, largest) @ even)))

        return after_ramp(transform, t, self.ramp)

    def _elastic(self, poisson: float) -> ElasticIndentation:
        return ElasticIndentation(self.indenter, self.shear, poisson)

    @property
    def _sealed_to(self) -> float:
        return self.contact_radius if self.sealed_radius is None else self.sealed_radius

    @property
    def _constants(self) -> tuple[float, float, float]:
        """κ, m and β."""
        shear, biot, storage = self.shear, self.biot, self.storage
        lame = self.aggregate_modulus - 2 * shear
        beta = biot + (lame + shear) * storage / biot
        return 2 * shear * biot / self.aggregate_modulus, beta / shear + storage / biot, beta

    def _largest(self, t: float) -> float:
        """Return up to which ξ a the transforms at the time ``t`` are summed, a power of 2."""
        shortest = min(t, t - self.ramp) if t > self.ramp else t
        front = np.sqrt(NODES / float(self.dimensionless_time(shortest)))
        return float(2 ** np.ceil(np.log2(max(200.0, 16 * front))))

    def _roots(self, x: Array, rate: complex) -> tuple[Complex, Complex]:
        """Return γ a and κ ξ/(γ + ξ) at x = ξ a."""
        gamma = np.sqrt(x**2 + rate * self.contact_radius**2 / self.diffusivity)
        return gamma, self._constants[0] * x / (gamma + x)

    @cached_property
    def _right(self) -> Array:
        """Integrals of (δ − g) P₂ₖ over the contact, of its radius."""
        points, weights = roots_legendre(GAUSS)
        a, right = self.contact_radius, np.zeros(TERMS)
        ends = [0.0, *(c / a for c in self.indenter.corners if c < a), 1.0]
        for low, high in pairwise(ends):
            x = low + (high - low) * (points + 1) / 2
            given = (self.depth - self.indenter.effective_profile(a * x)) * weights * (high - low) / 2
            right += eval_legendre(2 * np.arange(TERMS)[:, None], x) @ given
        return right

    def _solution(self, rate: complex, largest: float) -> Complex:
        """Return the transformed coefficients of N, and of p or the flow, for a sudden depth."""
        (kappa, m, beta), zone = self._constants, self._sealed_to / self.contact_radius
        x, weights, even, odd = _quadrature(largest, zone)
        gamma, coupling = self._roots(x, rate)

        def block(rows: Array, columns: Array, values: Complex | Array, last: float = 0.0) -> Complex:
            """Integrate, with the part that does not decay, ``last``, in closed form."""
            matrix: Complex = np.asarray((rows * (weights * (values - last))) @ columns.T, dtype=complex)
            if last:
                first, width = (0, 1.0) if rows is even else (1, zone)
                matrix = matrix + last / width * np.diag(np.pi / (4 * np.arange(first, 2 * TERMS, 2) + 2))
            return matrix

        last = m / 2 / (beta - kappa / 2)
        right = np.concatenate([self._right / rate, np.zeros(TERMS)])
        if self.under == self.outside:
            through = coupling if self.under == "drained" else coupling * x / gamma
            return np.asarray(
                np.linalg.solve(block(even, even, m / 2 / (beta - through), last), right[:TERMS])
            )
        if self.under == "sealed":  # N, and p below the indenter
            own = beta - coupling
            above = [block(even, even, m / 2 / own, last), block(even, odd, -m / 2 * coupling / own / x)]
            sealed = (gamma + (gamma - x) * coupling / own) / x
            below = [block(odd, even, (x - gamma) / own), block(odd, odd, sealed, 1.0)]
        else:  # N, and the flow below the indenter
            own = beta * gamma - coupling * x
            above = [block(even, even, m / 2 * gamma / own, last), block(even, even, -m / 2 * coupling / own)]
            below = [
                block(even, even, x * (gamma - x) / own),
                block(even, even, x * (beta - coupling) / own, 1.0),
            ]
        return np.asarray(np.linalg.solve(np.block([above, below]), right))

    def _at(self, part: Callable[[Complex], Complex], t: float) -> Array:
        """Return coefficients at the time ``t``."""
        largest = self._largest(t)
        return after_ramp(lambda rate: np.asarray(part(self._solution(rate, largest))), t, self.ramp)


@lru_cache(maxsize=4)
def _quadrature(largest: float, zone: float) -> tuple[Array, Array, Array, Array]:
    """Return points x, weights, and spherical Bessel functions (terms, k) of even order at x, of odd at zone · x."""
    points, weights = roots_legendre(5)
    step = np.pi / 2 / max(zone, 1.0)
    ends = np.concatenate([[0.0], np.geomspace(1e-4, step, 16), np.arange(2, largest / step) * step])
    widths = np.diff(ends)[:, None]
    x = (ends[:-1, None] + widths * (points + 1) / 2).ravel()
    orders, signs = 2 * np.arange(TERMS)[:, None], (-1.0) ** np.arange(TERMS)[:, None]
    even, odd = signs * spherical_jn(orders, x), signs * spherical_jn(orders + 1, zone * x)
    return x, (widths * weights / 2).ravel(), even, odd


def _abel(function: Callable[[Array], Array], r: Array, end: float) -> Array:
    """Return ∫ function(x)/√(x² − r²) dx from r to ``end``, of an odd polynomial, at ``r`` ≤ end."""
    points, weights = roots_legendre(2 * TERMS)
    last = np.sqrt(end**2 - r**2)
    v = last[..., None] * (points + 1) / 2
    x = np.sqrt(r[..., None] ** 2 + v**2)
    return np.asarray(last / 2 * ((function(x) / x) @ weights))


#: (factor, rate, power of τ) of the exponentials in the relaxation curves.
RELAXATION_FITS: dict[str, tuple[tuple[float, float, float], ...]] = {
    "sphere": ((0.491, 0.908, 0.5), (0.509, 1.679, 1.0)),
    "cone": ((0.493, 0.822, 0.5), (0.507, 1.348, 1.0)),
    "punch": ((1.304, 1.0, 0.5), (-0.304, 0.254, 1.0)),
    "punch-2017": ((0.242, 3.13, 1.0), (0.536, 1.71, 0.5), (-0.043, 12.8, 1 / 3), (0.266, 0.892, 0.25)),
}


def relaxation_fit(shape: str, tau: npt.ArrayLike) -> Array:
    """Return the published fit of (F(t) − F(∞))/(F(0) − F(∞)) at τ = c t/a²; the shape of ``tau``.

    The curves were fitted to finite-element solutions by Hu, Zhao, Vlassak & Suo (2010, Appl. Phys. Lett. 96:121904),
    that of the punch anew by Lai & Hu (2017, Soft Matter 13:852–861). a is √(R δ) for a sphere, (2/π) δ tan θ for a
    cone, the radius for a punch. They end exponentially, and so are wrong for late times, where the force approaches
    its last value as τ^(−1/2): see :class:`PoroelasticIndentation`, which has no fitted number.

    Parameters
    ----------
    shape
        "sphere", "cone", "punch" (2010) or "punch-2017".
    tau
        τ ≥ 0.
    """
    tau = np.asarray(tau, dtype=float)
    return np.asarray(
        sum(factor * np.exp(-rate * tau**power) for factor, rate, power in RELAXATION_FITS[shape])
    )
