"""Case of the small-strain limit: nonlinear histories tend to linear ones with the load."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.commands.verify.case import Check, VerificationCase, observed_order
from porocore.interfaces.law import CellLaw, MacroLaw, fingerprint
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.solution import History
from porocore.macro.laws.closure import MeanGradientClosure, PotentialClosure
from porocore.macro.laws.linear import LinearCellLaw, LinearCoefficients, LinearPoroelasticity
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.states import Array, CellResponse, MacroState
from porocore.testing.synthetic import potential_cell
from porocore.testing.synthetic.response import CONDUCTIVITY, SOLID_FRACTION, confined_column, cubic_reference

#: The largest moves the top by a tenth of the height.
LOADS = (0.04, 0.02, 0.01, 0.005)
QUANTITIES = {
    "settlement": "settlement",
    "pressure_max": "largest pressure",
    "drained": "drained volume",
}
#: Difference between nonlinear and linear at the smallest load, and distance of the order from 1.
ALLOWED, ALLOWED_ORDER = 0.03, 0.1


class _PotentialCell(CellLaw):
    """The made-up cell with a potential, in closed form."""

    identity = fingerprint(potential_cell.IDENTITY)

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return all responses."""
        return potential_cell.respond(states)


def mean_gradient() -> tuple[MacroLaw, LinearCoefficients]:
    """The closure on <∇u¹>_s = M:H + Q p, and its linear limit."""
    reference = cubic_reference()
    closure = MeanGradientClosure(SOLID_FRACTION, NeoHookean(), CONDUCTIVITY)
    linear = LinearCoefficients.from_reference(reference, SOLID_FRACTION, NeoHookean(), CONDUCTIVITY)
    return ClosedLaw(LinearCellLaw(reference), closure), linear


def potential() -> tuple[MacroLaw, LinearCoefficients]:
    """The closure on a cell with a potential W that is no polynomial, and its linear limit."""
    closure = PotentialClosure(potential_cell.SOLID_FRACTION, NeoHookean(), CONDUCTIVITY)
    tangent = potential_cell.respond(MacroState.zeros(1)).tangent
    assert tangent is not None
    parts: dict[str, Any] = {}
    for name in ("stress_grad_u", "stress_p", "fluid_volume_p", "mean_grad_grad_u", "mean_grad_p"):
        value = getattr(tangent, name)
        assert value is not None
        parts[name] = value[0]
    linear = LinearCoefficients(
        stiffness=parts["stress_grad_u"],
        biot=-parts["stress_p"],
        biot_of_stress=-parts["stress_p"],
        storage=float(parts["fluid_volume_p"]),
        conductivity=CONDUCTIVITY,
        mean_grad_grad_u=parts["mean_grad_grad_u"],
        mean_grad_p=parts["mean_grad_p"],
    )
    return ClosedLaw(_PotentialCell(), closure), linear


def limit(
    make: Callable[[], tuple[MacroLaw, LinearCoefficients]], solver: MacroSolver, long: bool
) -> Sequence[Check]:
    """Histories of a column under smaller and smaller loads."""
    law, coefficients = make()
    linear = LinearPoroelasticity(coefficients)
    loads = (*LOADS, LOADS[-1] / 2, LOADS[-1] / 4) if long else LOADS
    rows = [_difference(solver, law, linear, load, long) for load in loads]
    differences = {name: [row[name] for row in rows] for name in QUANTITIES}
    checks = []
    for name, values in differences.items():
        order = observed_order(loads[-3:], values[-3:], exact=0.0)
        quantity = f"{QUANTITIES[name]}, nonlinear against linear, load {loads[-1]:g}"
        checks.append(Check(quantity, values[-1], ALLOWED, order=order))
        checks.append(Check(f"{QUANTITIES[name]}, order in the load less 1", abs(order - 1), ALLOWED_ORDER))
    return checks


def _difference(
    solver: MacroSolver, law: MacroLaw, linear: MacroLaw, load: float, long: bool
) -> dict[str, float]:
    """Largest over the history, relative to the largest value."""
    plan = {"end": 20.0, "step": 1.0, "ramp_increments": 2, "ramp_step": 0.25, "profiles": ()}
    problem = confined_column(20 if long else 8, load=-load, time=plan, newton={"tolerance": 1e-11})
    prepared = solver.prepare(problem)
    one, other = solver.solve(prepared, law).history, solver.solve(prepared, linear).history
    return {name: _relative(name, one, other) for name in QUANTITIES}


def _relative(name: str, one: History, other: History) -> float:
    a, b = getattr(one, name), getattr(other, name)
    return float(np.abs(a - b).max() / np.abs(b).max())


CASE = VerificationCase(
    "small-strain",
    "Small-strain limit",
    "Biot 1941, with the coefficients of the same cell",
    "macro solver",
    {"mean-gradient": partial(limit, mean_gradient), "potential": partial(limit, potential)},
)


def isotropic_coefficients(
    lame: float, shear: float, biot: float, storage: float, conductivity: float
) -> LinearCoefficients:
    """Coefficients from λ and μ of the drained frame, α, 1/M_B and k/μ_f, in units that fit together."""
    one = np.eye(3)
    stiffness = lame * np.einsum("ij,kl->ijkl", one, one)
    stiffness += shear * (np.einsum("ik,jl->ijkl", one, one) + np.einsum("il,jk->ijkl", one, one))
    return LinearCoefficients(
        stiffness=stiffness,
        biot=biot * one,
        biot_of_stress=biot * one,
        storage=storage,
        conductivity=conductivity * one,
        mean_grad_grad_u=np.zeros((3, 3, 3, 3)),
        mean_grad_p=np.zeros((3, 3)),
    )


def relative_l2(found: Array, exact: Array) -> float:
    """Discrete norm of the difference over that of the exact field, for values in cells of equal volume."""
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))
