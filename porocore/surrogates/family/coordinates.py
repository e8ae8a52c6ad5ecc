"""Coordinates θ̂ in which the responses of a family are smooth, bounds of its isotropic solid, exact parameters.

In units of Young's modulus of the solid and with the porosity φ and bulk and shear modulus K_s, G_s of the solid
the upper bounds are (Hashin & Shtrikman 1963)

    K_HS = 4 G_s K_s (1 − φ)/(4 G_s + 3 φ K_s),   G_HS = G_s (1 − φ)(9 K_s + 8 G_s)/(9 K_s + 8 G_s + 6 φ (K_s + 2 G_s)).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from porocore.core.inputs.input_space import InputSpace
from porocore.states import Array, IntArray

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
        Kind of each, as of :class:`porocore.interfaces.rest_data.RestData`.
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
