"""Law as a function of (H, p) alone, with derivatives, for solvers that users write (Law, LawResponse)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from porocore.core.fields.batch import Batch
from porocore.core.inputs.given_states import given_states
from porocore.core.units.results import ResultUnits
from porocore.errors import ConfigurationError
from porocore.interfaces.law import LawMemory, MacroLaw, MacroTangent
from porocore.states import Array


@dataclass(frozen=True, eq=False)
class LawTangent(Batch):
    """Exact derivatives of a :class:`LawResponse` with respect to (H, p); response indices first.

    Attributes
    ----------
    stress_grad_u : (n, 3, 3, 3, 3)
        ∂P_E,ij / ∂H_kl [E].
    stress_p : (n, 3, 3)
        ∂P_E,ij / ∂p [-].
    fluid_volume_grad_u : (n, 3, 3)
        ∂φ / ∂H_kl [-].
    fluid_volume_p : (n,)
        ∂φ / ∂p [1/E].
    conductivity_grad_u : (n, 3, 3, 3, 3)
        ∂K_ref,ij / ∂H_kl.
    conductivity_p : (n, 3, 3)
        ∂K_ref,ij / ∂p.
    """

    stress_grad_u: Array
    stress_p: Array
    fluid_volume_grad_u: Array
    fluid_volume_p: Array
    conductivity_grad_u: Array
    conductivity_p: Array


@dataclass(frozen=True, eq=False)
class LawResponse(Batch):
    """Response of a :class:`Law` at n states, dimensionless; NaN where there is none.

    Attributes
    ----------
    stress : (n, 3, 3)
        P_E, total first Piola–Kirchhoff stress, tension positive [E].
    fluid_volume : (n,)
        φ, current fluid volume per reference volume [-].
    conductivity : (n, 3, 3)
        K_ref, with which q = −K_ref ∇_X p is the flux through reference area; K in the linear law.
    deformation : (n, 3, 3)
        F̄ = I + H + <∇u¹>_s/φ_s (I + H in the linear law).
    outside_training_range : (n,) bool
        The state is flagged: the surrogate is not to be trusted there.
    memory
        State of the law, from which a further response counts the fluid.
    tangent
        Derivatives; None if they were not asked for.
    """

    stress: Array
    fluid_volume: Array
    conductivity: Array
    deformation: Array
    outside_training_range: npt.NDArray[np.bool_]
    memory: LawMemory
    tangent: LawTangent | None = None

    def __len__(self) -> int:
        return len(self.fluid_volume)


class Law:
    """Stress, fluid volume and conductivity of the porous body as functions of (H, p), for n states at once.

    The macro solver evaluates the same law at its quadrature points. ``porocore.Study.law`` returns it.

    Parameters
    ----------
    law
        Macroscopic law.
    porosity
        φ_f, fluid volume of the undeformed cell, for a law that counts only changes of it.
    units
        Units of the study, which responses do not have: ``law.units.factor("stress")`` takes their stress to its unit.

    Examples
    --------
    >>> from porocore import Law
    >>> from porocore.testing.synthetic.response import linear_law
    >>> law = Law(linear_law(), porosity=0.41)
    >>> pressed = [np.diag([0.0, -0.01, 0.0]), np.diag([0.0, -0.02, 0.0])]
    >>> found = law.response(pressed, p=[0.002, 0.0])
    >>> found.stress[:, 1, 1].round(5), found.fluid_volume.round(5), found.conductivity[0].diagonal()
    (array([-0.00603, -0.0096 ]), array([0.40276, 0.3938 ]), array([1.94, 1.94, 1.94]))
    >>> found.tangent.stress_grad_u.shape, found.outside_training_range
    ((2, 3, 3, 3, 3), array([False, False]))
    """

    def __init__(self, law: MacroLaw, porosity: float, units: ResultUnits | None = None) -> None:
        self._law, self.porosity, self.units = law, porosity, units or ResultUnits()

    def __repr__(self) -> str:
        return f"<law '{self.name}'>"

    @property
    def name(self) -> str:
        """Name of the law as in a report, such as ``linear``."""
        return self._law.name

    def response(
        self,
        grad_u: npt.ArrayLike,
        p: npt.ArrayLike = 0.0,
        *,
        before: LawResponse | None = None,
        tangent: bool = True,
    ) -> LawResponse:
        """Return the response to one state or to n of them.

        Parameters
        ----------
        grad_u : (3, 3) or (n, 3, 3)
            H_ij = ∂u_i/∂X_j.
        p : number or (n,)
            Pore pressure, positive in compression [E].
        before
            Response of the same n points at the last time; by default they were at rest. It makes a difference with
            the closure ``mean-gradient`` only, whose fluid volume is summed over the steps, as in the macro solver.
        tangent
            Compute the derivatives, too.

        Raises
        ------
        ConfigurationError
            The shapes do not belong together, or a number is not finite.
        """
        states = given_states(grad_u, p)
        n = len(states)
        if before is not None and len(before) != n:
            raise ConfigurationError(
                f"before: expected the response at the same {n} states, got one at {len(before)}"
            )
        memory = self._law.initial(n) if before is None else before.memory
        known = before.fluid_volume if before is not None else memory.fluid_volume
        # The flux under a unit gradient along an axis is a column of −K_ref, and so are its derivatives.
        units = [np.broadcast_to(axis, (n, 3)) for axis in np.eye(3)] if tangent else [np.zeros((n, 3))]
        found = self._law.respond_to_each(states, units, memory, tangent=tangent)
        first = found[0]
        tangents = [response.tangent for response in found if response.tangent is not None]
        return LawResponse(
            stress=first.stress,
            fluid_volume=(self.porosity if known is None else known) + first.storage,
            conductivity=first.transformed_conductivity * first.volume_ratio[:, None, None],
            deformation=first.deformation,
            outside_training_range=first.outside_training_range,
            memory=first.memory,
            tangent=_tangent(tangents) if tangents else None,
        )

    def reasons(self, grad_u: npt.ArrayLike, p: npt.ArrayLike = 0.0) -> list[str]:
        """Return for each of n flagged states which component drives it out; empty where it is not known."""
        return self._law.reasons(given_states(grad_u, p))


def _tangent(columns: list[MacroTangent]) -> LawTangent:
    """Return the derivatives from those under a unit gradient of the pressure along each axis."""
    first = columns[0]
    return LawTangent(
        stress_grad_u=first.stress_grad_u,
        stress_p=first.stress_p,
        fluid_volume_grad_u=first.storage_grad_u,
        fluid_volume_p=first.storage_p,
        conductivity_grad_u=-np.stack([column.flux_grad_u for column in columns], axis=2),
        conductivity_p=-np.stack([column.flux_p for column in columns], axis=2),
    )
