"""Rates of parameters that evolve: formulas in the state of a point, with exact derivatives; named rates.

With F₀ = I + H and J = det F₀, the effective Cauchy stress is σ' = P_E F₀ᵀ/J + p I, tension positive.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.cell.materials.invariants import Kinematics
from porocore.core.dual_numbers import value_and_slopes
from porocore.core.echo import joined
from porocore.core.fields import Batch
from porocore.core.formulas import CONSTANTS, FUNCTIONS, Expression
from porocore.errors import ConfigurationError
from porocore.states import Array


@dataclass(frozen=True, eq=False)
class RatePoints(Batch):
    """n points in the state in which their rates are taken, that at the end of a step.

    Attributes
    ----------
    time : (n,)
        t, a multiple of the time scale.
    grad_u : (n, 3, 3)
        H.
    p : (n,)
        Pore pressure, positive in compression [E].
    parameters : (n, m)
        Parameters θ of the cell.
    fluid_volume : (n,)
        φ, fluid volume per reference volume.
    stress : (n, 3, 3)
        P_E, total first Piola–Kirchhoff stress, tension positive [E].
    flux : (n, 3)
        q, through reference area.
    position : (n, 3)
        X, a multiple of the length scale; None where it is not known.
    potential : (n,)
        W, with P_E = ∂W/∂H and φ = −∂W/∂p [E]; None where it is not known.
    """

    time: Array
    grad_u: Array
    p: Array
    parameters: Array
    fluid_volume: Array
    stress: Array
    flux: Array
    position: Array | None = None
    potential: Array | None = None


@dataclass(frozen=True, eq=False)
class RateSlopes(Batch):
    """Rate r at n points, and its derivatives by each quantity at fixed others.

    Attributes
    ----------
    value : (n,)
        r, per time scale; NaN or infinite where the formula has no value.
    grad_u : (n, 3, 3)
        ∂r/∂H.
    p : (n,)
        ∂r/∂p.
    parameters : (n, m)
        ∂r/∂θ.
    constants : (n, c)
        By the constants of the formula.
    fluid_volume : (n,)
        ∂r/∂φ.
    stress : (n, 3, 3)
        ∂r/∂P_E.
    flux : (n, 3)
        ∂r/∂q.
    potential : (n,)
        ∂r/∂W.
    """

    value: Array
    grad_u: Array
    p: Array
    parameters: Array
    constants: Array
    fluid_volume: Array
    stress: Array
    flux: Array
    potential: Array

    @classmethod
    def zeros(cls, n: int, m: int, c: int) -> RateSlopes:
        """Return rates of zero at n points, for m parameters and c constants."""
        return cls(
            value=np.zeros(n),
            grad_u=np.zeros((n, 3, 3)),
            p=np.zeros(n),
            parameters=np.zeros((n, m)),
            constants=np.zeros((n, c)),
            fluid_volume=np.zeros(n),
            stress=np.zeros((n, 3, 3)),
            flux=np.zeros((n, 3)),
            potential=np.zeros(n),
        )


#: Derivatives of a quantity by fields of :class:`RateSlopes`; one that is missing is zero.
Slopes = dict[str, Array]


class _State:
    """Quantities of points, each with its derivatives; each is computed when a formula names it."""

    def __init__(self, at: RatePoints) -> None:
        self.at, self.F = at, np.eye(3) + at.grad_u
        self.kinematics = Kinematics(np.moveaxis(self.F, 0, -1))

    @cached_property
    def J(self) -> Array:
        return self.kinematics.J

    @cached_property
    def cofactor(self) -> Array:
        return np.moveaxis(self.kinematics.cofactor, -1, 0)

    def place(self, axis: int) -> tuple[Array, Slopes]:
        if self.at.position is None:
            raise ConfigurationError(
                "a rate names the place x, y or z, but the points have none; a formula of the place needs a body"
            )
        return self.at.position[:, axis], {}

    def volume_ratio(self) -> tuple[Array, Slopes]:
        return self.J, {"grad_u": self.cofactor}

    def first_invariant(self) -> tuple[Array, Slopes]:
        return np.einsum("nij,nij->n", self.F, self.F), {"grad_u": 2 * self.F}

    def stretch(self, rank: int) -> tuple[Array, Slopes]:
        """Return the principal stretch with this rank, the largest first; ∂λ_a/∂F = (F N_a) ⊗ N_a/λ_a."""
        squares, _, _ = self.kinematics.principal
        at, n = np.argsort(-squares, axis=0, kind="stable")[rank], np.arange(squares.shape[1])
        stretch = np.sqrt(squares[at, n])
        return stretch, {"grad_u": self.kinematics.dyads[at, at, :, :, n] / stretch[:, None, None]}

    @cached_property
    def cauchy(self) -> Array:
        """Total Cauchy stress P_E F₀ᵀ/J."""
        return np.asarray(self.at.stress @ self.F.swapaxes(1, 2) / self.J[:, None, None])

    def _by_stress(self, direction: Array, value: Array) -> Slopes:
        """Return the derivatives of ``value`` = N : σ where σ moves, given the tensor N (n, 3, 3)."""
        J = self.J[:, None, None]
        inverse = self.cofactor / J
        return {
            "stress": direction @ self.F / J,
            "grad_u": direction.swapaxes(1, 2) @ self.at.stress / J - value[:, None, None] * inverse,
        }

    def mean_stress(self) -> tuple[Array, Slopes]:
        mean = np.trace(self.cauchy, axis1=1, axis2=2) / 3
        third = np.broadcast_to(np.eye(3) / 3, self.F.shape)
        return mean + self.at.p, {**self._by_stress(third, mean), "p": np.ones_like(mean)}

    def von_mises(self) -> tuple[Array, Slopes]:
        """Return √(3/2 s:s), s the deviator of the symmetric part; its derivative where it is zero is 0."""
        sigma = (self.cauchy + self.cauchy.swapaxes(1, 2)) / 2
        s = sigma - np.trace(sigma, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        size = np.sqrt(1.5 * np.einsum("nij,nij->n", s, s))
        return size, self._by_stress(1.5 * s / _nonzero(size)[:, None, None], size)

    def flux(self) -> tuple[Array, Slopes]:
        size = np.sqrt(np.einsum("ni,ni->n", self.at.flux, self.at.flux))
        return size, {"flux": self.at.flux / _nonzero(size)[:, None]}

    def energy(self) -> tuple[Array, Slopes]:
        """Return W + p φ, which is <Ψ>_s."""
        at = self.at
        if at.potential is None:
            raise ConfigurationError(
                "a rate names the energy, but the law of the cells has none; choose closure: potential and a surrogate "
                "of the potential"
            )
        energy = at.potential + at.p * at.fluid_volume
        return energy, {"potential": np.ones_like(energy), "p": at.fluid_volume, "fluid_volume": at.p}


def _nonzero(size: Array) -> Array:
    """Return a size, 1 where it is zero."""
    return np.where(size == 0, 1.0, size)


@dataclass(frozen=True)
class RateQuantity:
    """A quantity that a formula of a rate may name; ``found`` gives its values (n,) and its derivatives."""

    meaning: str
    found: Callable[[_State], tuple[Array, Slopes]]


#: What a formula of a rate may name beside the cell's parameters and its own constants.
QUANTITIES: dict[str, RateQuantity] = {
    "t": RateQuantity("time at the end of the step", lambda s: (s.at.time, {})),
    "x": RateQuantity("place along the first axis in the undeformed body", lambda s: s.place(0)),
    "y": RateQuantity("place along the second axis in the undeformed body", lambda s: s.place(1)),
    "z": RateQuantity("place along the third axis in the undeformed body", lambda s: s.place(2)),
    "J": RateQuantity("volume ratio det F₀", lambda s: s.volume_ratio()),
    "I1": RateQuantity("first invariant tr F₀ᵀF₀", lambda s: s.first_invariant()),
    "stretch_1": RateQuantity("largest principal stretch", lambda s: s.stretch(0)),
    "stretch_2": RateQuantity("middle principal stretch", lambda s: s.stretch(1)),
    "stretch_3": RateQuantity("smallest principal stretch", lambda s: s.stretch(2)),
    "p": RateQuantity("pore pressure", lambda s: (s.at.p, {"p": np.ones_like(s.at.p)})),
    "phi": RateQuantity(
        "stored fluid φ per reference volume",
        lambda s: (s.at.fluid_volume, {"fluid_volume": np.ones_like(s.at.fluid_volume)}),
    ),
    "flux": RateQuantity("size of the flux through reference area", lambda s: s.flux()),
    "energy": RateQuantity("strain energy of the solid per reference volume", lambda s: s.energy()),
    "mean_stress": RateQuantity("mean effective Cauchy stress, tension positive", lambda s: s.mean_stress()),
    "von_mises": RateQuantity("equivalent stress of von Mises of the Cauchy stress", lambda s: s.von_mises()),
}


def name_in_formula(parameter: str) -> str:
    """Return the name of a parameter of the cell in formulas: ``radii_x`` for ``radii.x``."""
    return re.sub(r"\W", "_", parameter)


class Rate:
    """Rate of a parameter of the cell per time scale, as a formula, with exact derivatives.

    Principal stretches descend. Where two are equal, each has the derivative along one of the principal axes that the
    eigenvalues come with; it is finite, and right for formulas that treat these stretches alike.

    Parameters
    ----------
    formula
        In :data:`QUANTITIES`, parameters of the cell and constants; a dot in the name of a parameter is written as an
        underscore.
    parameters
        Names of the cell's m parameters.
    constants
        Names of the c constants.

    Raises
    ------
    ConfigurationError
        The text is no formula, holds another name, or a name has two meanings.

    Examples
    --------
    >>> Rate("-k*radius", ["radius"], ["k"]).names
    ['k', 'radius']
    """

    def __init__(self, formula: str, parameters: Sequence[str], constants: Sequence[str] = ()) -> None:
        self.formula, self.parameters, self.constants = formula, tuple(parameters), tuple(constants)
        self._parameters = [name_in_formula(name) for name in parameters]
        for name in self.constants:
            if not name.isidentifier():
                raise ConfigurationError(
                    f"{name!r}: expected the name of a constant, of letters, digits and _; rename it"
                )
        taken = [*QUANTITIES, *CONSTANTS, *FUNCTIONS]
        for name in (*self._parameters, *self.constants):
            if name in taken:
                raise ConfigurationError(
                    f"'{name}' has two meanings in the rate '{formula}'; choose another name for the constant than "
                    f"those of quantities, functions and parameters: {joined(taken)}"
                )
            taken.append(name)
        try:
            self._expression = Expression.parse(
                formula, (*QUANTITIES, *self._parameters, *self.constants), tuple(FUNCTIONS)
            )
        except ValueError as error:
            raise ConfigurationError(str(error)) from None

    @property
    def names(self) -> list[str]:
        """Names that the formula holds, sorted."""
        return sorted(self._expression.names)

    @property
    def follows_state(self) -> bool:
        """True of a rate that depends on more than time, place, parameters and constants."""
        return bool(self._expression.names & (set(QUANTITIES) - {"t", "x", "y", "z"}))

    def alone(self, time: float, parameters: Array, constants: Array, position: Array) -> Array:
        """Return a rate (n,) that does not follow the state, of parameters (n, m), constants (c,) and X (n, 3)."""
        values = dict(zip(self._parameters, parameters.T, strict=True))
        values |= dict(zip(self.constants, constants, strict=True)) | dict(
            zip("xyz", position.T, strict=True)
        )
        return np.broadcast_to(self._expression(t=time, **values), len(parameters)).astype(float)

    def at(self, points: RatePoints, constants: Array) -> RateSlopes:
        """Return the rate at n points with its derivatives; ``constants`` are (n, c).

        Raises
        ------
        ConfigurationError
            The formula names the place, and the points have none.
        """
        n, state = len(points.p), _State(points)
        slopes = RateSlopes.zeros(n, len(self.parameters), len(self.constants))
        values: dict[str, Array] = dict(zip(self._parameters, points.parameters.T, strict=True))
        values |= dict(zip(self.constants, constants.T, strict=True))
        by: dict[str, Slopes] = {}
        with np.errstate(all="ignore"):
            for name in self._expression.names & set(QUANTITIES):
                values[name], by[name] = QUANTITIES[name].found(state)
        value, direct = value_and_slopes(self._expression, values)
        slopes.value[:] = value
        for name, slope in direct.items():
            if name in self._parameters:
                slopes.parameters[:, self._parameters.index(name)] = slope
            elif name in self.constants:
                slopes.constants[:, self.constants.index(name)] = slope
            for quantity, inner in by.get(name, {}).items():
                total = getattr(slopes, quantity)
                # A slope that is infinite where the quantity does not move, such as that of sqrt(flux), adds nothing.
                with np.errstate(all="ignore"):
                    total += np.where(inner == 0, 0.0, slope.reshape(n, *(1,) * (inner.ndim - 1)) * inner)
        return slopes


@dataclass(frozen=True)
class RateConstant:
    """A constant of a named rate: what it means, and its unit in scales of the study."""

    meaning: str
    unit: str


@dataclass(frozen=True)
class NamedRate:
    """A rate with a name: the formula, in which ``OWN`` is the parameter that evolves, and its constants."""

    formula: str
    constants: Mapping[str, RateConstant]

    def of(self, parameter: str, parameters: Sequence[str]) -> Rate:
        """Return the rate of one of the cell's ``parameters``.

        Raises
        ------
        ConfigurationError
            A parameter has the name of a constant.
        """
        return Rate(
            self.formula.replace("OWN", name_in_formula(parameter)), parameters, tuple(self.constants)
        )


_OWN = "that of the parameter"
#: Rates by name. A stress in a formula is a multiple of the modulus E of the scales.
NAMED_RATES: dict[str, NamedRate] = {
    "clogging": NamedRate(
        "-deposition*flux*(OWN - clogged)",
        {
            "deposition": RateConstant(
                "share of the open pore that a unit of fluid through unit area fills", "1/length"
            ),
            "clogged": RateConstant("value at which nothing more is deposited", _OWN),
        },
    ),
    "growth": NamedRate(
        "growth_rate*(mean_stress - homeostatic_stress)",
        {
            "growth_rate": RateConstant("rate under a stress that is too large by E", "1/time"),
            "homeostatic_stress": RateConstant(
                "mean effective stress at which nothing grows, tension positive", "stress"
            ),
        },
    ),
    "degradation": NamedRate(
        "-degradation_rate*OWN", {"degradation_rate": RateConstant("share that is lost per time", "1/time")}
    ),
    "creep": NamedRate(
        "creep_rate*(final_value - OWN)",
        {
            "creep_rate": RateConstant("share of the remaining way that is gone per time", "1/time"),
            "final_value": RateConstant("value that is approached", _OWN),
        },
    ),
}
