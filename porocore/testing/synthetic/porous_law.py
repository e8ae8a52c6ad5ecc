"""Law of the made-up family of porous cells, in closed form (PorousFamilyLaw)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from porocore.interfaces.law import CellLaw, UndeformedCells
from porocore.states import Array, CellResponse, CellSlopes, MacroState, Status
from porocore.testing.synthetic.porous_family import (
    DEFAULTS,
    IDENTITY,
    complex_steps,
    inputs_of,
    porosity,
    respond,
    undeformed_conductivity,
    values_at,
    with_defaults,
)


class PorousFamilyLaw(CellLaw):
    """Law of the family in closed form, with the parameters that are named; the others have their usual values.

    Parameters
    ----------
    parameters
        Names.
    deformed
        Predict the conductivity of the deformed pore, too.
    """

    identity = IDENTITY

    def __init__(self, *parameters: str, deformed: bool = False) -> None:
        self.parameters, self.deformed = parameters, deformed

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return the responses with their derivatives."""
        names = self.parameters
        if not tangent:
            return self._without_derivatives(states)
        found = respond(self._named(states), names)
        gradients, K = found.tangent, found.conductivity if self.deformed else None
        if self.deformed and gradients is not None:
            z = inputs_of(self._named(states))
            by = complex_steps(z, lambda at: {"K": values_at(at, names)["conductivity"]})["K"]
            by_H = by[..., :9].reshape(-1, 3, 3, 3, 3)
            gradients = replace(gradients, conductivity_grad_u=by_H, conductivity_p=by[..., 9])
        return replace(found, conductivity=K, slopes=None, tangent=gradients)

    def _without_derivatives(self, states: MacroState) -> CellResponse:
        values: dict[str, Any] = values_at(inputs_of(self._named(states)), self.parameters)
        if not self.deformed:
            del values["conductivity"]
        converged = np.full(len(states), int(Status.converged), dtype=np.int64)
        return CellResponse(status=converged, **{name: value.real for name, value in values.items()})

    def slopes(self, states: MacroState) -> CellSlopes:
        """Return the derivatives by the parameters."""
        found = respond(self._named(states), self.parameters).slopes
        assert found is not None
        if self.deformed:
            return found
        n, z = len(states), inputs_of(self._named(states))
        K = complex_steps(
            z, lambda at: {"K": undeformed_conductivity(with_defaults(at, self.parameters), n)}
        )["K"]
        return replace(found, conductivity=K[:, None, None, 10:] * np.eye(3)[..., None])

    @staticmethod
    def _named(states: MacroState) -> MacroState:
        """Return the states with parameters, none of which there may be."""
        return states if states.parameters is not None else states.with_parameters(np.zeros(0))

    def undeformed(self, parameters: Array) -> UndeformedCells:
        """Return φ_f, and K before the solid swells."""
        at: dict[str, Any] = {**DEFAULTS, **dict(zip(self.parameters, parameters.T, strict=True))}
        r, n = at["radius"], len(parameters)
        K = undeformed_conductivity(at, n)
        return UndeformedCells(np.broadcast_to(np.asarray(porosity(r)), n), K[:, None, None] * np.eye(3))
