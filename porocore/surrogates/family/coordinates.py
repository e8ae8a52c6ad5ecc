"""Coordinates θ̂ in which a family is smooth; what an isotropic solid ties to the cell's stiffness.

In units of Young's modulus of the solid and with the porosity φ and bulk and shear modulus K_s, G_s of the solid
the upper bounds are (Hashin & Shtrikman 1963)

    K_HS = 4 G_s K_s (1 − φ)/(4 G_s + 3 φ K_s),   G_HS = G_s (1 − φ)(9 K_s + 8 G_s)/(9 K_s + 8 G_s + 6 φ (K_s + 2 G_s)).

With H = −p/(3 K_s) I and p in the pores, solid and fluid bear the same pressure and nothing fluctuates. That gives
Biot's coupling and modulus. The mean strain of the solid follows from its mean stress.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

from porocore.core.inputs import InputSpace
from porocore.states import Array, IntArray
from porocore.surrogates.stretch import PLACES

#: Kinds of parameters whose effect needs no samples.
EXACT = ("modulus", "swelling", "viscosity")
#: Step of the complex-step derivatives, which are exact to round-off.
STEP = 1e-30


@dataclass(frozen=True)
class ParameterMap:
    """Parameters θ of a family: their kinds, and coordinates of those that are learned.

    Attributes
    ----------
    inputs
        Inputs, whose last m are the parameters.
    kinds
        Kind of each, as of :class:`porocore.interfaces.records.RestData`.
    young, poisson
        Young's modulus and Poisson's ratio of the solid: numbers or names of parameters; None where it is not
        isotropic, or not the same everywhere.
    stretch
        Swelling stretch of the whole solid, of all members; beside it may stand one that is a parameter.
    """

    inputs: InputSpace
    kinds: tuple[str, ...]
    young: float | str | None = None
    poisson: float | str | None = None
    stretch: float = 1.0

    @cached_property
    def learned(self) -> IntArray:
        """Numbers of the parameters that are learned, (l,)."""
        return np.array([k for k, kind in enumerate(self.kinds) if kind not in EXACT], dtype=np.int64)

    @property
    def isotropic(self) -> bool:
        """True where the solid is isotropic and the same everywhere."""
        return self.poisson is not None

    def poisson_ratio(self, theta: Array) -> tuple[Array, Array]:
        """Return ν (n,) of the solid at θ (n, m), and its derivatives by the learned parameters (n, l)."""
        slopes = np.zeros((len(theta), len(self.learned)))
        if isinstance(self.poisson, str):
            k = self.inputs.parameters.index(self.poisson)
            slopes[:, list(self.learned).index(k)] = 1.0
            return theta[:, k], slopes
        return np.full(len(theta), 0.0 if self.poisson is None else self.poisson), slopes

    def shape(self, theta: Array) -> tuple[Array, Array]:
        """Return coordinates (n, l) of the learned parameters that need no porosity, scaled to [−1, 1].

        Logarithms for lengths; also their derivatives (n, l), each by its own parameter.
        """
        low, high = self.inputs.parameter_ranges[self.learned].T
        x, slope = theta[:, self.learned].copy(), np.ones((len(theta), len(self.learned)))
        for c, k in enumerate(self.learned):
            if self.kinds[k] == "length" and low[c] > 0:
                # Beyond the range anything may be asked for.
                inner = np.maximum(x[:, c], 1e-3 * low[c])
                slope[:, c] = np.where(inner == x[:, c], 1 / inner, 0.0)
                x[:, c], low[c], high[c] = np.log(inner), np.log(low[c]), np.log(high[c])
        return (2 * x - low - high) / (high - low), slope * 2 / (high - low)

    def smooth(self, theta: Array, porosity: Array, porosity_slopes: Array) -> tuple[Array, Array]:
        """Return θ̂ (n, l) and its derivatives (n, l, l) by the learned parameters.

        Parameters
        ----------
        theta : (n, m)
            θ.
        porosity : (n,), porosity_slopes : (n, l)
            φ_f and its derivatives.
        """
        x, slope = self.shape(theta)
        J = np.zeros((*x.shape, x.shape[1]))
        J[:, range(x.shape[1]), range(x.shape[1])] = slope
        for c, k in enumerate(self.learned):
            if self.kinds[k] == "poisson_ratio":
                # Beside others of several solids the pores' compliance is a guess of the right size all the same.
                value, by_porosity, by_poisson = log_zeta(porosity, theta[:, k])
                x[:, c] = value
                J[:, c] = by_porosity[:, None] * porosity_slopes
                J[:, c, c] += by_poisson
        return x, J

    @cached_property
    def unscaled(self) -> bool:
        """True where neither the modulus nor the stretch of the whole solid is other than 1."""
        young = self.young if isinstance(self.young, float | int) else 1.0
        return young == self.stretch == 1.0 and not {"modulus", "swelling"} & set(self.kinds)

    def factors(self, theta: Array) -> tuple[Array, Array, Array]:
        """Return E (n,), the swelling stretch λ (n,) and the viscosity (n,), each 1 where it is no parameter."""
        found = []
        for kind in EXACT:
            at = [k for k, other in enumerate(self.kinds) if other == kind]
            found.append(theta[:, at].prod(axis=1))
        if isinstance(self.young, float | int):
            found[0] = found[0] * self.young
        return found[0], found[1] * self.stretch, found[2]


@dataclass(frozen=True, eq=False)
class Scaling:
    """Factors by which states and responses of n points become those of w.

    Attributes
    ----------
    factor : (n,)
        E λ³.
    variables : (7, n), shift : (7, n)
        Derivatives of the variables of w by y, 1 but for 1/E of p; what is taken off them, ln λ of the normal ones.
    stretch : (n,)
        λ.
    viscosity : (n,)
        Viscosity of the fluid.
    trivial
        True where E and λ are 1 whatever the parameters are.
    """

    factor: Array
    variables: Array
    shift: Array
    stretch: Array
    viscosity: Array
    trivial: bool = False

    @classmethod
    def from_parameters(cls, parameters: ParameterMap, theta: Array) -> Scaling:
        """Return the factors at θ (n, m)."""
        E, stretch, viscosity = parameters.factors(theta)
        by, shift = np.ones((7, len(theta))), np.zeros((7, len(theta)))
        by[6], shift[:3] = 1 / E, np.log(stretch)
        return cls(E * stretch**3, by, shift, stretch, viscosity, parameters.unscaled)

    @classmethod
    @cache
    def one(cls) -> Scaling:
        """Return the factors of a cell without parameters, one for all points."""
        one = np.ones(1)
        return cls(one, np.ones((7, 1)), np.zeros((7, 1)), one, one, trivial=True)

    def inner(self, y: Array) -> Array:
        """Return the variables of w (7, n) from y (7, n)."""
        if self.trivial:
            return y
        found: Array = self.variables * y - self.shift
        return found


@dataclass(frozen=True, eq=False)
class Bounds:
    """Quantities of n solids with pores; each with its derivatives by φ and ν.

    Attributes
    ----------
    bulk : (n,)
        K_s.
    shear : (n,)
        G_s.
    drained : (n,)
        K_HS.
    wave : (n,)
        M_HS = K_HS + 4/3 G_HS.
    """

    bulk: Array
    shear: Array
    drained: Array
    wave: Array


def bounds(porosity: Array, poisson: Array) -> tuple[Bounds, Bounds, Bounds]:
    """Return the bounds for φ (n,) and ν (n,), and their derivatives by φ and by ν."""
    values = _bounds(porosity, poisson)
    by_porosity = _bounds(porosity + 1j * STEP, poisson + 0j)
    by_poisson = _bounds(porosity + 0j, poisson + 1j * STEP)
    slopes = [Bounds(*(x.imag / STEP for x in found)) for found in (by_porosity, by_poisson)]
    return Bounds(*values), slopes[0], slopes[1]


def _bounds(phi: Any, nu: Any) -> tuple[Any, ...]:
    K, G = 1 / (3 * (1 - 2 * nu)), 1 / (2 * (1 + nu))
    drained = 4 * G * K * (1 - phi) / (4 * G + 3 * phi * K)
    sheared = G * (1 - phi) * (9 * K + 8 * G) / (9 * K + 8 * G + 6 * phi * (K + 2 * G))
    return K + 0 * phi, G + 0 * phi, drained, drained + 4 / 3 * sheared


def log_zeta(porosity: Array, poisson: Array) -> tuple[Array, Array, Array]:
    """Return ln ζ (n,), and its derivatives by φ and ν, ζ = 1/[6 (1 − 2ν)/(1 + ν) + 3 φ].

    As ν approaches 1/2 the solid's compressibility vanishes beside that of its pores, and the response of the cell
    saturates in ν; in ln ζ it is smooth.
    """
    inverse = 6 * (1 - 2 * poisson) / (1 + poisson) + 3 * porosity
    found: Array = -np.log(inverse)
    return found, -3 / inverse, 18 / (1 + poisson) ** 2 / inverse


#: Mandel's factors of the six components of a stress that counts a shear in both places.
MANDEL = np.array([1.0, 1.0, 1.0, *[1 / np.sqrt(2)] * 3])
#: Volumetric and deviatoric projector in Mandel's components.
VOLUMETRIC = np.outer([1, 1, 1, 0, 0, 0], [1, 1, 1, 0, 0, 0]) / 3
DEVIATORIC = np.eye(6) - VOLUMETRIC


def normaliser(values: Bounds, slopes: Bounds) -> tuple[Array, Array]:
    """Return N^½ (n, 6, 6) of the bounds, and its derivatives (n, l, 6, 6)."""
    a, b = np.sqrt(3 * values.drained), np.sqrt(values.wave)
    root = a[:, None, None] * VOLUMETRIC + b[:, None, None] * DEVIATORIC
    by_a, by_b = (1.5 * slopes.drained / a).T[..., None, None], (0.5 * slopes.wave / b).T[..., None, None]
    return root, by_a * VOLUMETRIC + by_b * DEVIATORIC


def tied(
    C: Array, C_slopes: Array, phi: Array, phi_slopes: Array, solid: tuple[Bounds, Bounds] | None
) -> tuple[Array, Array, Array, Array]:
    """Return A (7, 7, n) and ∂⟨∇u¹⟩/∂y (9, 7, n), each with its derivatives, as far as the stiffness ties them."""
    n, l = len(phi), len(phi_slopes)
    A, A_slopes = np.zeros((7, 7, n)), np.zeros((7, 7, l, n))
    factor = np.outer(MANDEL, MANDEL)
    A[:6, :6], A_slopes[:6, :6] = C / factor[:, :, None], C_slopes / factor[:, :, None, None]
    m, m_slopes = np.zeros((9, 7, n)), np.zeros((9, 7, l, n))
    if solid is None:
        return A, A_slopes, m, m_slopes
    values, slopes = solid
    bulk, shear = values.bulk, values.shear
    # With H = −p/(3 K_s) I and p in the pores, solid and fluid bear the same pressure, and nothing fluctuates.
    sums = A[:6, :3].sum(axis=1)
    A[6, :6] = sums / (3 * bulk)
    A[6, :3] -= 1.0
    A_slopes[6, :6] = A_slopes[:6, :3].sum(axis=1) / (3 * bulk) - sums[:, None] * slopes.bulk / (3 * bulk**2)
    A[:6, 6], A_slopes[:6, 6] = A[6, :6], A_slopes[6, :6]
    normal = A[6, :3].sum(axis=0)
    A[6, 6] = normal / (3 * bulk) + phi / bulk
    A_slopes[6, 6] = (A_slopes[6, :3].sum(axis=0) + 3 * phi_slopes) / (3 * bulk)
    A_slopes[6, 6] -= (normal + 3 * phi) / (3 * bulk**2) * slopes.bulk
    for a in range(6):
        strain, strain_slopes = _strain(A[:6, a], A_slopes[:6, a], bulk, shear, slopes)
        i, j = PLACES[a]
        m[:, a], m_slopes[:, a] = strain, strain_slopes
        for place in {3 * i + j, 3 * j + i}:
            m[place, a] -= 1 - phi
            m_slopes[place, a] += phi_slopes
    trace = m[:, :3].sum(axis=1)
    m[:, 6] = trace / (3 * bulk)
    m_slopes[:, 6] = m_slopes[:, :3].sum(axis=1) / (3 * bulk)
    m_slopes[:, 6] -= trace[:, None] * slopes.bulk / (3 * bulk**2)
    return A, A_slopes, m, m_slopes


def _strain(
    stress: Array, stress_slopes: Array, bulk: Array, shear: Array, slopes: Bounds
) -> tuple[Array, Array]:
    """Return the strain (9, n) of the solid for six stresses, shears counted twice, and its derivatives (9, l, n)."""
    deviator = 1 / (2 * shear)
    volume = 1 / (9 * bulk) - 1 / (6 * shear)
    by_deviator = -slopes.shear / (2 * shear**2)
    by_volume = -slopes.bulk / (9 * bulk**2) + slopes.shear / (6 * shear**2)
    trace, trace_slopes = stress[:3].sum(axis=0), stress_slopes[:3].sum(axis=0)
    strain, strain_slopes = np.zeros((9, len(bulk))), np.zeros((9, *stress_slopes.shape[1:]))
    for b, (i, j) in enumerate(PLACES):
        half = 1.0 if i == j else 0.5
        for place in {3 * i + j, 3 * j + i}:
            strain[place] = half * stress[b] * deviator
            strain_slopes[place] = half * (stress_slopes[b] * deviator + stress[b] * by_deviator)
            if i == j:
                strain[place] += trace * volume
                strain_slopes[place] += trace_slopes * volume + trace * by_volume
    return strain, strain_slopes
