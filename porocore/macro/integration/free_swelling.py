"""Free swelling of a body with fixed charges (FreeSwelling), with which a run may begin.

The body stands in its bath with nothing prescribed but its supports, until the effective pressure of its fluid is zero
everywhere. That state is come to from a bath of much salt, which thins out over steps so long that nothing is left of
the pressure of their flow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from porocore.core.fields import provided
from porocore.core.units import units_now
from porocore.errors import ConfigurationError, SolveError
from porocore.interfaces.law import (
    Interval,
    LawMemory,
    LawWrapper,
    MacroLaw,
    MacroResponse,
    MemoryChanges,
    PointChanges,
    ResponseChanges,
)
from porocore.macro.composition.regions import BodyFields
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.laws.charges import BATH, DENSITY
from porocore.macro.problem import InitialState, MacroProblem, TimePlan
from porocore.states import Array, MacroState

#: Steps in which the bath thins out from that of so much more salt than charges, and steps in the bath as it is.
THINNING, SALT, SETTLING = 8, 10.0, 4
#: Length of a step, in times of diffusion across the whole body.
LONG = 1e4


def starts_swollen(problem: MacroProblem) -> bool:
    """Tell whether a run of the problem begins with free swelling."""
    return problem.charges is not None and problem.charges.initial == "free-swelling"


def prepared_alone(prepare: Callable[[MacroProblem], Any], problem: MacroProblem, time: TimePlan) -> Any:
    """Return what a solver's ``prepare`` makes of the body on its supports alone, as it swells freely.

    Raises
    ------
    ConfigurationError
        The supports do not hold the body, or it takes up fluid nowhere.
    """
    if all(face.pressure is None for face in problem.boundary.values()):
        raise ConfigurationError(
            "macro.charges.initial: free swelling takes up fluid, but no surface has a pressure; give one "
            "'pressure: 0', or begin 'as charged'"
        )
    free = problem.model_copy(
        update={
            "boundary": {name: face.supports_alone() for name, face in problem.boundary.items()},
            "body_force": (0.0, 0.0, 0.0),
            "contact": {},
            "initial": InitialState(),
            "probes": {},
            "time": time,
        }
    )
    try:
        return prepare(free)
    except ConfigurationError as error:
        raise ConfigurationError(
            f"macro.charges.initial: without what moves it, the body is not held while it swells freely: {error}; "
            "hold it, or begin 'as charged'"
        ) from None


class StandingLaw(LawWrapper):
    """A law whose points have stood for long, in a bath that thins out with the time of the steps.

    Parameters
    ----------
    law
        With charges.
    salt
        Concentration of the bath to begin with, as a multiple.
    until
        Time at which the bath is as it is given.
    """

    def __init__(self, law: MacroLaw, salt: float, until: float) -> None:
        super().__init__(law)
        self._column, self._salt, self._until = law.parameters.index(BATH), salt, until

    def _more(self, step: Interval | None) -> float:
        """Return the concentration at the end of a step as a multiple."""
        left = 1.0 if step is None else max(0.0, 1 - step.end / self._until)
        return float(self._salt**left)

    def _in_bath(self, states: MacroState, step: Interval | None) -> MacroState:
        theta = provided(states.parameters).copy()
        theta[:, self._column] *= self._more(step)
        return replace(states, parameters=theta)

    def respond_to_each(
        self,
        states: MacroState,
        gradients: Sequence[Array],
        memory: LawMemory,
        *,
        step: Interval | None = None,
        tangent: bool = True,
    ) -> list[MacroResponse]:
        """Return the responses of points that have stood for long."""
        found = self.law.respond_to_each(self._in_bath(states, step), gradients, memory, tangent=tangent)
        return [replace(each, memory=replace(each.memory, states=states)) for each in found]

    def respond_to_changes(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        changes: PointChanges,
        before: MemoryChanges,
        *,
        step: Interval | None = None,
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return response and derivatives of points that have stood for long."""
        theta = changes.parameters
        if theta is not None:
            theta = theta.copy()
            theta[:, self._column] *= self._more(step)
        response, found = self.law.respond_to_changes(
            self._in_bath(states, step), grad_p, memory, replace(changes, parameters=theta), before
        )
        return replace(response, memory=replace(response.memory, states=states)), found


@dataclass(frozen=True, eq=False)
class FreeSwelling:
    """Run at the end of which a body is swollen.

    Attributes
    ----------
    d, body, law
        Discretisation of the body on its supports alone, its fields at the beginning, and its law.
    """

    d: Discretisation
    body: BodyFields
    law: MacroLaw

    @classmethod
    def prepared(
        cls,
        prepare: Callable[[MacroProblem], Any],
        d: Discretisation,
        body: BodyFields,
        law: MacroLaw,
    ) -> FreeSwelling:
        """Return the run of a solver by its ``prepare``.

        Raises
        ------
        ConfigurationError
            The supports do not hold the body, or it takes up fluid nowhere.
        """
        fields = body.held(0.0)
        length = LONG * _diffusion_time(d, fields, law)
        theta = provided(fields.at(0.0).parameters)
        density, bath = (theta[:, law.parameters.index(name)] for name in (DENSITY, BATH))
        salt = SALT * d.communicator.max(float(np.nanmax(density / bath, initial=0.0)))
        # A power of two, so that a small change of the charges does not change the way.
        salt = 2.0 ** max(1, math.ceil(math.log2(max(salt, 1.0))))
        end = (THINNING + SETTLING) * length
        time = TimePlan(
            end=end,
            step=length,
            ramp_increments=1,
            ramp_step=length,
            smallest_step=1e-4 * length,
            profiles=(),
        )
        alone = prepared_alone(prepare, d.problem, time)
        return cls(alone, fields, StandingLaw(law, salt, THINNING * length))

    def local(self, d: Discretisation, x: Array) -> Array:
        """Return the displacements of local unknowns ``x`` of the swelling as unknowns of ``d``; pressures are 0."""
        return np.where(d.is_force, d.from_mesh(self.d.to_mesh(x)), 0.0)

    def weights(self, d: Discretisation, weights: Array) -> Array:
        """Return the weights of the local unknowns of the swelling from those of :meth:`local`."""
        seen = d.cartesian(np.where(d.is_force, weights, 0.0))
        return seen if self.d.rotation is None else np.asarray(self.d.rotation @ seen)


def require_apart(d: Discretisation) -> None:
    """Refuse indenters that begin inside the swollen body.

    Raises
    ------
    SolveError
        There is one.
    """
    for state in d.contact_states(d.to_mesh(provided(d.origin)), d.loads_at(0.0)):
        if not state.contact.by_force and state.penetration > 0:
            deep = units_now().text(state.penetration, "displacement", 3)
            raise SolveError(
                f"macro.contact.{state.contact.name}: the indenter begins {deep} deep inside the swollen body; move "
                "its place back, against its direction"
            )


def _diffusion_time(d: Discretisation, body: BodyFields, law: MacroLaw) -> float:
    """Return the square of the size of the body over its least conductivity and stiffness at rest."""
    states = body.at(0.0).given_to(MacroState.zeros(d.n_points))
    least = np.full(2, np.inf)
    if len(states):
        t = provided(law.respond(states, np.zeros((len(states), 3)), law.initial_at(states)).tangent)
        K = -np.einsum("nii->ni", t.flux_grad_p)
        C = np.einsum("nijij->nij", t.stress_grad_u)
        least = np.array([float(values[values > 0].min(initial=np.inf)) for values in (K, C)])
    K_least, C_least = (-d.communicator.max(-float(each)) for each in least)
    size = float(np.linalg.norm(np.ptp(d.mesh.points, axis=0)))
    found = size**2 / (K_least * C_least)
    return found if np.isfinite(found) and found > 0 else 1.0
