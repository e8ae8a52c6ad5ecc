"""Made-up family of cells with two parameters, in closed form: responses with slopes, members, a solver.

With w of :mod:`porocore.testing.synthetic.potential_cell`, whose porosity is φ₀, and the parameters φ_f (porosity) and
E (modulus)

    W(H, p; φ_f, E) = E [w(H, p/E) − (φ_f − φ₀) (Ψ(F) + J p/E)],   K = φ_f³ I / (1 − φ_f)²

A porosity of 0.5 and more together with a modulus of 1.5 and more has no cell, as if its mesh could not be moved there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.inputs import InputSpace
from porocore.core.tensors import cofactor, determinant
from porocore.errors import ConfigurationError, MemberError
from porocore.interfaces.cell import CellField, CellSolution, CellSolver
from porocore.interfaces.records import failed_response
from porocore.states import Array, CellResponse, MacroState, Status
from porocore.testing.synthetic import potential_cell
from porocore.testing.synthetic.porous_family import hessian_slopes
from porocore.testing.synthetic.response import respond_by

PARAMETERS = {"porosity": (0.3, 0.6), "modulus": (0.5, 2.0)}
#: Strains, pressures and parameters.
INPUTS = InputSpace.from_ranges({"H11": (-0.1, 0.1), "H22": (-0.1, 0.1), "p": (0.0, 0.1)}, PARAMETERS)
#: Porosity and modulus from which on there is no cell.
IMPOSSIBLE = (0.5, 1.5)


@dataclass(frozen=True)
class SyntheticParameter:
    """Parameter of the family."""

    name: str
    lower: float
    upper: float


@dataclass(frozen=True)
class SyntheticFamily:
    """Family of made-up cells, or one member of it.

    Attributes
    ----------
    values
        Parameters of the member; those of the family's base are the middles of the ranges.
    """

    values: tuple[float, ...] = tuple(sum(ends) / 2 for ends in PARAMETERS.values())

    @property
    def parameters(self) -> tuple[SyntheticParameter, ...]:
        """Parameters in their order."""
        return tuple(SyntheticParameter(name, *ends) for name, ends in PARAMETERS.items())

    def at(self, values: npt.ArrayLike) -> SyntheticFamily:
        """Return the member with the parameters (m,).

        Raises
        ------
        MemberError
            There is none.
        """
        found = tuple(map(float, np.asarray(values, dtype=float)))
        if len(found) != len(PARAMETERS):
            raise ConfigurationError(f"expected {len(PARAMETERS)} parameters, got {len(found)}")
        if all(value >= end for value, end in zip(found, IMPOSSIBLE, strict=True)):
            raise MemberError(f"no cell has a porosity of {found[0]:g} and a modulus of {found[1]:g}")
        return SyntheticFamily(found)


class SyntheticFamilySolver(CellSolver[SyntheticFamily]):
    """Solver of the members; states with det F ≤ 0 have none.

    Attributes
    ----------
    prepared
        Members in the order in which they were prepared.
    """

    slopes = True
    returns_fields = True

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.prepared: list[SyntheticFamily] = []

    def prepare(self, cell: Any) -> SyntheticFamily:
        """Return the member."""
        self.prepared.append(cell)
        return cell  # type: ignore[no-any-return]

    def conductivity(self, prepared: SyntheticFamily) -> Array:
        """Return K (3, 3)."""
        K: Array = _conductivity(np.array(prepared.values[:1]))[0]
        return K

    def hessian_slopes_at_rest(self, prepared: SyntheticFamily) -> Array:
        """Return the slopes (10, 10, 2) of the Hessian of W, by differences."""
        slopes = hessian_slopes(respond, MacroState.zeros(1).with_parameters(prepared.values))
        return np.asarray(slopes[0])

    def solve(
        self,
        prepared: SyntheticFamily,
        states: MacroState,
        *,
        start: Sequence[CellField | None] | None = None,
        tangent: bool = True,
        fields: bool = False,
    ) -> CellSolution:
        """Return the exact responses; a field holds the state and the parameters."""
        response = respond(states.with_parameters(prepared.values))
        good = determinant(np.eye(3) + states.grad_u) > 0
        failed = failed_response(Status.inverted, like=response)
        rows = [response[i : i + 1] if good[i] else failed for i in range(len(states))]
        response = CellResponse.concatenate(rows) if rows else response
        nodes = np.array([[*prepared.values, 0.0]])
        found = [
            CellField(states.grad_u[i], float(states.p[i]), "whole", nodes) if good[i] else None
            for i in range(len(states))
        ]
        return CellSolution(
            response if tangent else replace(response, tangent=None), found if fields else None
        )


def respond(states: MacroState) -> CellResponse:
    """Return all responses of n states with their parameters, derivatives and slopes."""
    return respond_by(_values, states, hidden=("porosity", "conductivity"))


def _values(z: Any) -> dict[str, Any]:
    """Return W, P_E, φ, <∇u¹>, φ_f and K at z (n, 12), which is H row by row, p, φ_f and E."""
    phi, E = z[:, 10:].T
    p = z[:, 9] / E
    unit = potential_cell.values(np.concatenate([z[:, :9], p[:, None]], axis=1))
    F, more = np.eye(3) + z[:, :9].reshape(-1, 3, 3), phi - (1 - potential_cell.SOLID_FRACTION)
    material, J, p1 = NeoHookean(), determinant(F), p[:, None, None]
    return {
        "mean_grad": unit["mean_grad"],
        "potential": E * (unit["potential"] - more * (material.energy_density(F) + p * J)),
        "stress": E[:, None, None]
        * (unit["stress"] - more[:, None, None] * (material.stress(F) + p1 * cofactor(F))),
        "fluid_volume": unit["fluid_volume"] + more * J,
        "porosity": phi,
        "conductivity": _conductivity(phi),
    }


def _conductivity(phi: Any) -> Any:
    """Return K (n, 3, 3) for porosities (n,)."""
    return (phi**3 / (1 - phi) ** 2)[:, None, None] * np.eye(3)
