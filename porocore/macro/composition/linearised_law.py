"""Linear poroelasticity of a body of many cells: a law linearised at rest, point by point (LinearisedLaw)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from porocore.core.fields import Batch
from porocore.errors import ConfigurationError
from porocore.interfaces.cell import ElementCells
from porocore.interfaces.law import (
    LawMemory,
    MacroLaw,
    MacroResponse,
    MacroTangent,
    MemoryChanges,
    PointChanges,
    ResponseChanges,
    fingerprint,
)
from porocore.macro.composition.axes import TurnedLaw
from porocore.macro.laws.linear import LinearCoefficients
from porocore.states import Array, BodyPlace, MacroState


@dataclass(frozen=True, eq=False)
class RestCoefficients(Batch):
    """Coefficients of linear poroelasticity at n points; see :class:`~porocore.macro.laws.linear.LinearCoefficients`.

    Attributes
    ----------
    points
        States at rest, with parameters and places.
    stress : (n, 3, 3)
        P₀ at rest, other than zero where a swelling is held.
    fluid_volume : (n,)
        φ₀ at rest.
    stiffness : (n, 9, 9)
        C_eff.
    biot : (n, 9)
        α from the storage.
    storage : (n,)
        1/M_B.
    conductivity : (n, 3, 3)
        K.
    """

    points: MacroState
    stress: Array
    fluid_volume: Array
    stiffness: Array
    biot: Array
    storage: Array
    conductivity: Array

    @classmethod
    def of_elements(cls, coefficients: LinearCoefficients | RestCoefficients, n: int) -> RestCoefficients:
        """Return the coefficients of the n elements of a body; those of one cell are the same in all."""
        if isinstance(coefficients, RestCoefficients):
            return coefficients
        c, ones = coefficients, np.ones(n)
        return cls(
            MacroState.zeros(n),
            np.zeros((n, 3, 3)),
            c.fluid_volume * ones,
            np.multiply.outer(ones, c.stiffness.reshape(9, 9)),
            np.multiply.outer(ones, c.biot.reshape(9)),
            c.storage * ones,
            np.multiply.outer(ones, c.conductivity),
        )

    def at(self, i: int) -> LinearCoefficients:
        """Return the coefficients at one point, without M and Q, which are not known (NaN)."""
        return LinearCoefficients(
            self.stiffness[i].reshape(3, 3, 3, 3),
            self.biot[i].reshape(3, 3),
            self.biot[i].reshape(3, 3),
            float(self.storage[i]),
            self.conductivity[i],
            np.full((3, 3, 3, 3), np.nan),
            np.full((3, 3), np.nan),
            self.stress[i],
        )


class LinearisedLaw(MacroLaw):
    """A law linearised at H = 0 and p = 0, at each point with its own parameters and place.

    P = P₀ + C_eff:H − α p, φ = φ₀ + α:H + p/M_B and q = −K ∇p. Where the parameters or the axes change with time, so do
    the coefficients, P₀ and φ₀. The mean gradient <∇u¹>_s is not carried.

    Parameters
    ----------
    law
        Any law; it is asked at rest only.
    name
        For reports.
    """

    constant_tangent = True

    def __init__(self, law: MacroLaw, name: str = "linear") -> None:
        self.law, self.name, self.parameters = law, name, law.parameters
        self.identity = fingerprint("linearised", law.identity)
        self._known: list[RestCoefficients] = []

    def parameters_of(self, region: int) -> tuple[str, ...]:
        """Return those of the law; see :class:`MacroLaw`."""
        return self.law.parameters_of(region)

    def initial(self, n: int) -> LawMemory:
        """Return the memory at rest."""
        return self.initial_at(MacroState.zeros(n))

    def initial_at(self, points: MacroState) -> LawMemory:
        """Return the memory at rest, with the parameters and places of the points."""
        rest = points.at_rest()
        return LawMemory(rest, np.zeros((len(rest), 3, 3)), self.coefficients(rest).fluid_volume)

    def respond(
        self, states: MacroState, grad_p: Array, memory: LawMemory, *, tangent: bool = True
    ) -> MacroResponse:
        """Return the linear response; see :class:`MacroLaw`."""
        n, c = len(states), self.coefficients(states)
        H, p = states.grad_u.reshape(n, 9), states.p
        fluid = c.fluid_volume + np.einsum("ni,ni->n", c.biot, H) + c.storage * p
        stress = (c.stiffness @ H[:, :, None])[..., 0] - p[:, None] * c.biot
        return MacroResponse(
            stress=c.stress + stress.reshape(n, 3, 3),
            storage=fluid - memory.fluid_volume,
            flux=-(c.conductivity @ grad_p[:, :, None])[..., 0],
            memory=LawMemory(states, np.zeros((n, 3, 3)), fluid),
            deformation=np.eye(3) + states.grad_u,
            volume_ratio=np.ones(n),
            transformed_conductivity=c.conductivity,
            doubt=np.zeros(n, np.int64),
            tangent=MacroTangent(
                stress_grad_u=c.stiffness.reshape(n, 3, 3, 3, 3),
                stress_p=-c.biot.reshape(n, 3, 3),
                storage_grad_u=c.biot.reshape(n, 3, 3),
                storage_p=c.storage,
                flux_grad_u=np.zeros((n, 3, 3, 3)),
                flux_p=np.zeros((n, 3)),
                flux_grad_p=-c.conductivity,
            )
            if tangent
            else None,
        )

    def respond_to_changes(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        changes: PointChanges,
        before: MemoryChanges,
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return the response and its derivatives; C_eff and M_B are in proportion to the modulus, and so is P₀.

        Raises
        ------
        ConfigurationError
            A parameter changes: the slopes of the coefficients are not known.
        """
        if changes.parameters is not None and changes.parameters.any():
            raise ConfigurationError(
                f"the law '{self.name}' gives no derivatives by parameters of the cell; choose a law of a closure"
            )
        found, c = self.respond(states, grad_p, memory), self.coefficients(states)
        by, (n, k) = changes.modulus, changes.modulus.shape
        borne = found.stress.reshape(n, 9) + states.p[:, None] * c.biot
        fluid = -(c.storage * states.p)[:, None] * by
        assert before.fluid_volume is not None
        return found, ResponseChanges(
            stress=(borne[..., None] * by[:, None, :]).reshape(n, 3, 3, k),
            storage=fluid - before.fluid_volume,
            flux=-found.flux[..., None] * changes.viscosity[:, None, :],
            fluid_volume=fluid,
        )

    def coefficients(self, states: MacroState) -> RestCoefficients:
        """Return the coefficients at n points, by their parameters and places."""
        for known in self._known:
            if _same_points(known.points, states):
                return known
        rest = states.at_rest()
        n = len(rest)
        before = self.law.initial_at(rest)
        found = self.law.respond(rest, np.zeros((n, 3)), before)
        tangent = found.tangent
        assert tangent is not None
        C = tangent.stress_grad_u
        C = (C + C.swapaxes(1, 2)) / 2
        C = (C + C.swapaxes(3, 4)) / 2
        alpha = (tangent.storage_grad_u + tangent.storage_grad_u.swapaxes(1, 2)) / 2
        coefficients = RestCoefficients(
            rest,
            found.stress,
            before.fluid_volume,
            C.reshape(n, 9, 9),
            alpha.reshape(n, 9),
            np.array(tangent.storage_p),
            -tangent.flux_grad_p,
        )
        self._known = [coefficients, *self._known[:1]]
        return coefficients


def coefficients_of_elements(law: MacroLaw, cells: ElementCells, profile: int = 0) -> RestCoefficients:
    """Return the coefficients of the elements of a body, in its axes, at the time of a profile.

    Parameters
    ----------
    law
        That of the body.
    cells
        Of its elements.
    profile
        Number of the profile.
    """
    n, values, axes = len(cells.region), cells.values_at(profile), cells.axes_at(profile)
    zero = MacroState.zeros(n)
    points = replace(zero, parameters=values, place=BodyPlace(cells.region, axes))
    return LinearisedLaw(law if axes is None else TurnedLaw(law)).coefficients(points)


def _same_points(one: MacroState, other: MacroState) -> bool:
    """Tell whether as many points have the same parameters, regions and axes."""
    parts = (
        [at.parameters, *([] if at.place is None else [at.place.region, at.place.axes])]
        for at in (one, other)
    )
    first, second = parts
    return (
        len(one) == len(other)
        and len(first) == len(second)
        and all(
            a is b or (a is not None and b is not None and np.array_equal(a, b))
            for a, b in zip(first, second, strict=True)
        )
    )
