"""Made-up cells in closed form, with parameters (ParametricCell) or without: responses, training set.

Nothing of it comes from a finite element solve. <∇u¹>_s has the size and the bend of that of the paper's cell;
stress and fluid volume derive from one potential.

W(H, p; r, e) = e W₁(H, p/e) − (φ_f(r) − φ_f) p J, where W₁ and φ_f are those of :mod:`.potential_cell`: e scales the
modulus, r changes the pores.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.inputs import InputSpace
from porocore.core.tensors import cofactor, determinant
from porocore.interfaces.law import CellLaw, UndeformedCells
from porocore.interfaces.surrogate import TrainingSet
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.states import Array, CellResponse, MacroState
from porocore.testing.synthetic import potential_cell
from porocore.testing.synthetic.response import cubic_reference, respond_by

#: Confined compression: the range of the two inputs that a synthetic training set samples.
INPUTS = InputSpace(("H22", "p"), (-0.20, -0.02), (0.04, 0.24))
IDENTITY = "synthetic-cell-1"
SOLID_FRACTION = 0.5877
#: How <∇u¹> bends: G = (M:H + Q p)/(1 + A tr H + B p) + C H·H + D p H.
A, B, C, D = 0.8, -0.5, -0.06, 0.4
#: Curvature of the potential in p.
STORAGE = 0.25


def respond(states: MacroState) -> CellResponse:
    """Return all responses of n states with their derivatives.

    W = φ_s Ψ(F) − φ_f p J − ½ S p².
    """
    return respond_by(values, states)


def values(z: Any) -> dict[str, Any]:
    """Return W, P_E, φ and <∇u¹> at z (n, 10), which is H row by row and p."""
    H, p, linear = z[:, :9].reshape(-1, 3, 3), z[:, 9], cubic_reference().tangent
    M, Q = vars(linear)["mean_grad_grad_u"][0], vars(linear)["mean_grad_p"][0]
    p1 = p[:, None, None]
    r = 1 / (1 + A * np.trace(H, axis1=1, axis2=2) + B * p)
    L = np.einsum("ijkl,nkl->nij", M, H) + Q * p1
    material, F = NeoHookean(), np.eye(3) + H
    solid, fluid = SOLID_FRACTION, 1 - SOLID_FRACTION
    J, fluid_p = determinant(F), fluid * p
    return {
        "mean_grad": L * r[:, None, None] + C * H @ H + D * p1 * H,
        "potential": solid * material.energy_density(F) - fluid_p * J - STORAGE / 2 * p**2,
        "stress": solid * material.stress(F) - fluid_p[:, None, None] * cofactor(F),
        "fluid_volume": fluid * J + STORAGE * p,
    }


def synthetic_training_set(n: int = 240, seed: int = 0) -> TrainingSet:
    """``n`` ≥ 4 states: the corners of :data:`INPUTS`, the rest uniform at random by ``seed``."""
    low, high = np.array(INPUTS.lower), np.array(INPUTS.upper)
    corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    unit = np.concatenate([corners, np.random.default_rng(seed).random((n - len(corners), 2))])
    states = INPUTS.scatter(low + (high - low) * unit)
    provenance = {"origin": "synthetic cell", "states": f"{n}, seed {seed}"}
    return TrainingSet(states, respond(states), INPUTS, respond(MacroState.zeros(1)), IDENTITY, provenance)


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
        return replace(respond_by(self._values, states, tangent=tangent), slopes=None)

    @staticmethod
    def _values(z: Any) -> dict[str, Any]:
        """Return W, P_E, φ and <∇u¹> at z (n, 12), which is H row by row, p, r and e."""
        p, r, e = z[:, 9:].T
        found = potential_cell.values(np.concatenate([z[:, :9], (p / e)[:, None]], axis=1))
        F, more = np.eye(3) + z[:, :9].reshape(-1, 3, 3), porosity(r) - (1 - potential_cell.SOLID_FRACTION)
        J, more_p = determinant(F), more * p
        return {
            "mean_grad": found["mean_grad"],
            "potential": e * found["potential"] - more_p * J,
            "stress": e[:, None, None] * found["stress"] - more_p[:, None, None] * cofactor(F),
            "fluid_volume": found["fluid_volume"] + more * J,
        }

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
