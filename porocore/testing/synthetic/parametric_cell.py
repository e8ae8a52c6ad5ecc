"""Made-up cell with two parameters in closed form (ParametricCell), for laws of bodies of many cells.

W(H, p; r, e) = e W₁(H, p/e) − (φ_f(r) − φ_f) p J, where W₁ and φ_f are those of :mod:`.potential_cell`: e scales the
modulus, r changes the pores.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.core.tensors.cofactors import cofactor, cofactor_tangent, determinant
from porocore.interfaces.law import CellLaw, UndeformedCells
from porocore.macro.laws import ClosedLaw, make_closure
from porocore.states import Array, CellResponse, CellTangent, MacroState
from porocore.testing.synthetic import potential_cell

#: K of the cell with r = 1, another one along each axis.
CONDUCTIVITY: Array = 500.0 * np.diag([1.0, 1.5, 2.0])


class ParametricCell(CellLaw):
    """Cell with the parameters ``radius`` (of three channels) and ``stiffness``."""

    identity = "parametric-cell-1"
    parameters = ("radius", "stiffness")

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return the responses with their derivatives.

        Raises
        ------
        ValueError
            The states have no parameters.
        """
        if states.parameters is None:
            raise ValueError("expected states with parameters")
        r, e = states.parameters.T
        e2, e4 = e[:, None, None], e[:, None, None, None, None]
        first = potential_cell.respond(MacroState(states.grad_u, states.p / e))
        assert first.potential is not None
        assert first.stress is not None
        assert first.fluid_volume is not None
        F = np.eye(3) + states.grad_u
        J, cof = determinant(F), cofactor(F)
        more = porosity(r) - (1 - potential_cell.SOLID_FRACTION)
        p = more * states.p
        return CellResponse(
            mean_grad=first.mean_grad,
            status=first.status,
            potential=e * first.potential - p * J,
            stress=e2 * first.stress - p[:, None, None] * cof,
            fluid_volume=first.fluid_volume + more * J,
            tangent=_tangent(first.tangent, e, e4, more, p, F) if tangent else None,
        )

    def undeformed(self, parameters: Array) -> UndeformedCells:
        """Return φ_f(r) and K r⁴."""
        r = parameters[:, 0]
        return UndeformedCells(porosity(r), CONDUCTIVITY * (r**4)[:, None, None])


class BoundCell(CellLaw):
    """The same cell with its parameters bound to constants (m,)."""

    def __init__(self, constants: Array) -> None:
        self.constants, self.identity = np.asarray(constants, float), f"bound {constants}"

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return the responses with their derivatives."""
        theta = np.broadcast_to(self.constants, (len(states), len(self.constants)))
        return ParametricCell().predict(replace(states, parameters=theta), tangent=tangent)


def parametric_law(cell: CellLaw | None = None, radius: float = 0.2, closure: str = "potential") -> ClosedLaw:
    """Return the closed law of ``cell``, by default of the one with parameters; ``radius`` gives the constants."""
    solid = 1 - float(porosity(np.array(radius)))
    constants = make_closure(closure, solid, NeoHookean(), CONDUCTIVITY * radius**4)
    return ClosedLaw(ParametricCell() if cell is None else cell, constants)


def porosity(r: Array) -> Array:
    """Return φ_f = 3π r² − 8√2 r³ of three crossing channels with the radii r (n,)."""
    return np.asarray(3 * np.pi * r**2 - 8 * np.sqrt(2) * r**3)


def _tangent(first: CellTangent | None, e: Array, e4: Array, more: Array, p: Array, F: Array) -> CellTangent:
    assert first is not None
    assert first.mean_grad_p is not None
    assert first.stress_grad_u is not None
    assert first.stress_p is not None
    assert first.fluid_volume_p is not None
    stress_p = first.stress_p - more[:, None, None] * cofactor(F)
    return CellTangent(
        mean_grad_grad_u=first.mean_grad_grad_u,
        mean_grad_p=first.mean_grad_p / e[:, None, None],
        stress_grad_u=e4 * first.stress_grad_u - p[:, None, None, None, None] * cofactor_tangent(F),
        stress_p=stress_p,
        fluid_volume_grad_u=-stress_p,
        fluid_volume_p=first.fluid_volume_p / e,
    )
