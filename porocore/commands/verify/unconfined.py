"""Case of unconfined compression of a cylinder, on a quarter and on a wedge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from porocore.commands.verify.case import Check, VerificationCase, observed_order
from porocore.commands.verify.small_strain import isotropic_coefficients
from porocore.interfaces.macro import MacroSolver
from porocore.macro.analytic import UnconfinedCompression
from porocore.macro.body.mesh import Facets
from porocore.macro.laws.linear import LinearPoroelasticity
from porocore.macro.problem import MacroProblem, body_mesh

#: Of the largest value of each quantity over time.
ALLOWED = 0.01
#: The fluid and the solid are incompressible there; 1/M_B = 0 exactly is no law of a cell.
STORAGE = 1e-9
HEIGHT = 0.5


def quarter(solver: MacroSolver, long: bool) -> Sequence[Check]:
    """A quarter between its two symmetry planes."""
    body = {"kind": "quarter-cylinder", "elements": (7, 1, 1)}
    return _checks(solver, long, body, ("x-", "z-"))


def wedge(solver: MacroSolver, long: bool) -> Sequence[Check]:
    """A twelfth, one plane of which is oblique."""
    body = {"kind": "wedge", "elements": (7, 1, 1), "angle": 30}
    return _checks(solver, long, body, ("oblique", "z-"))


def _checks(solver: MacroSolver, long: bool, body: dict[str, Any], planes: tuple[str, str]) -> list[Check]:
    exact = UnconfinedCompression(1.0, -0.01, lame=0.3, shear=0.4, conductivity=1.0, ramp=0.05)
    # The error of a step goes with its square and that of the history with the step.
    tolerances = (5e-4, 1.25e-4) if long else (5e-4,)
    found = [_errors(solver, exact, body, planes, tolerance) for tolerance in tolerances]
    checks = []
    for i, quantity in enumerate(("force on the plates", "radius", "pressure on the axis")):
        steps, errors = np.sqrt(tolerances).tolist(), [errors[i] for errors in found]
        order = observed_order(steps, errors, exact=0.0) if long else None
        checks.append(Check(f"{quantity}, of its largest", errors[-1], ALLOWED, order=order))
    return checks


def _errors(
    solver: MacroSolver,
    exact: UnconfinedCompression,
    body: dict[str, Any],
    planes: tuple[str, str],
    tolerance: float,
) -> tuple[float, float, float]:
    """Largest error over the history of each quantity, as a share of its largest value."""
    boundary: dict[str, Any] = {name: {"normal": 0} for name in (*planes, "y-")}
    boundary["y+"] = {"displacement": (None, exact.strain * HEIGHT, None)}
    boundary["side"] = {"pressure": 0}
    time = {"end": 1.0, "step": 0.1, "ramp_increments": 10, "ramp_step": exact.ramp / 10, "profiles": ()}
    problem = MacroProblem.model_validate(
        {
            "body": {"radius": exact.radius, "height": HEIGHT, **body},
            "boundary": boundary,
            "probes": {"rim": (exact.radius, 0.0, 0.0), "axis": (0.0, 0.0, 0.0)},
            "time": time | {"tolerance": tolerance},
        }
    )
    coefficients = isotropic_coefficients(exact.lame, exact.shear, 1.0, STORAGE, exact.conductivity)
    solution = solver.solve(solver.prepare(problem), LinearPoroelasticity(coefficients))
    mesh = body_mesh(problem)
    area = float(Facets(mesh, mesh.surfaces["y+"]).areas.sum())
    later = solution.history.time > 0
    t = solution.history.time[later]
    ours = (
        solution.reactions["y+"][later, 1] / area,
        solution.probes["rim"][later, 0],
        solution.probes["axis"][later, 3],
    )
    theirs = (
        np.array([exact.stress(float(time)) for time in t]),
        np.array([float(exact.lateral(exact.radius, float(time))) for time in t]),
        np.array([float(exact.pressure(0.0, float(time))) for time in t]),
    )
    first, second, third = (
        float(np.abs(a - b).max() / np.abs(b).max()) for a, b in zip(ours, theirs, strict=True)
    )
    return first, second, third


CASE = VerificationCase(
    "unconfined",
    "Unconfined compression of a poroelastic cylinder",
    "Armstrong, Lai & Mow 1984, J. Biomech. Eng. 106, 165–173",
    "macro solver",
    {"quarter": quarter, "wedge": wedge},
)
