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
from porocore.core.tensors import cofactor, cofactor_tangent, determinant
from porocore.errors import ConfigurationError, MemberError
from porocore.interfaces.cell import CellField, CellSolution, CellSolver
from porocore.interfaces.records import failed_response
from porocore.states import Array, CellResponse, CellSlopes, MacroState, Status
from porocore.testing.synthetic.porous_family import hessian_slopes
from porocore.testing.synthetic.potential_cell import SOLID_FRACTION
from porocore.testing.synthetic.potential_cell import respond as respond_at_base

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
        K: Array = _conductivity(np.array(prepared.values[:1]))[0][0]
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
    assert states.parameters is not None
    phi, E = states.parameters.T
    F = np.eye(3) + states.grad_u
    p = states.p / E
    unit = _unit_modulus(MacroState(states.grad_u, p), phi)
    tangent = unit.tangent
    assert tangent is not None
    assert unit.potential is not None
    assert unit.stress is not None
    assert unit.fluid_volume is not None
    material, J, cof = NeoHookean(), determinant(F), cofactor(F)
    e2, e4 = E[:, None, None], E[:, None, None, None, None]
    p2 = p[:, None, None]
    K, K_phi = _conductivity(phi)
    slopes = CellSlopes(
        potential=np.stack(
            [-E * (material.energy_density(F) + J * p), unit.potential + p * unit.fluid_volume], axis=-1
        ),
        stress=np.stack(
            [-e2 * (material.stress(F) + p2 * cof), unit.stress - p2 * tangent.stress_p], axis=-1
        ),
        fluid_volume=np.stack([J, -p / E * tangent.fluid_volume_p], axis=-1),
        porosity=np.stack([np.ones_like(p), np.zeros_like(p)], axis=-1),
        mean_grad=np.stack([np.zeros_like(cof), -p2 / e2 * tangent.mean_grad_p], axis=-1),
        conductivity=np.stack([K_phi, np.zeros_like(K)], axis=-1),
    )
    assert tangent.stress_grad_u is not None
    assert tangent.fluid_volume_p is not None
    assert tangent.mean_grad_p is not None
    return replace(
        unit,
        potential=E * unit.potential,
        stress=e2 * unit.stress,
        tangent=replace(
            tangent,
            stress_grad_u=e4 * tangent.stress_grad_u,
            fluid_volume_p=tangent.fluid_volume_p / E,
            mean_grad_p=tangent.mean_grad_p / e2,
        ),
        slopes=slopes,
    )


def _unit_modulus(states: MacroState, phi: Array) -> CellResponse:
    """Return the responses for a modulus of 1 and porosities (n,)."""
    base = respond_at_base(states)
    tangent = base.tangent
    assert tangent is not None
    F, p = np.eye(3) + states.grad_u, states.p
    material, J, cof = NeoHookean(), determinant(F), cofactor(F)
    more = phi - (1 - SOLID_FRACTION)
    m2, p2 = more[:, None, None], p[:, None, None]
    m4, p4 = m2[..., None, None], p2[..., None, None]
    assert base.potential is not None
    assert base.stress is not None
    assert base.fluid_volume is not None
    assert tangent.stress_grad_u is not None
    assert tangent.stress_p is not None
    stress_p = tangent.stress_p - m2 * cof
    return replace(
        base,
        potential=base.potential - more * (material.energy_density(F) + p * J),
        stress=base.stress - m2 * (material.stress(F) + p2 * cof),
        fluid_volume=base.fluid_volume + more * J,
        tangent=replace(
            tangent,
            stress_grad_u=tangent.stress_grad_u - m4 * (material.tangent(F) + p4 * cofactor_tangent(F)),
            stress_p=stress_p,
            fluid_volume_grad_u=-stress_p,
        ),
    )


def _conductivity(phi: Array) -> tuple[Array, Array]:
    """Return K and its slope by the porosity for porosities (n,), (n, 3, 3) each."""
    value = phi**3 / (1 - phi) ** 2
    slope = phi**2 * (3 - phi) / (1 - phi) ** 3
    return value[:, None, None] * np.eye(3), slope[:, None, None] * np.eye(3)
