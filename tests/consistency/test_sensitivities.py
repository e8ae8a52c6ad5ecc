"""Sensitivities of a macro run against central differences: each kind of unknown, both closures, both backends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.interfaces.sensitivities import (
    BoundaryChange,
    CellParameterChange,
    InitialPressureChange,
    LoadChange,
    ModulusChange,
    ViscosityChange,
)
from porocore.macro.laws import ClosedLaw, make_closure
from porocore.macro.problem import MacroProblem
from porocore.plugins.registry import registry
from porocore.testing.synthetic.porous_law import PorousFamilyLaw

#: Difference from central differences, as a share of the largest derivative of a series.
ACCURACY = 1e-6
#: Relative steps of the differences.
STEP = 1e-4
TIME = {"end": 3.0, "step": 1.0, "ramp_increments": 2, "ramp_step": 0.2, "profiles": ()}
SIDES = {face: {"displacement": (0, None, 0)} for face in ("x-", "x+", "z-", "z+")}
NAMES = ("radius", "poisson_ratio", "modulus", "viscosity")
SERIES = ("probes", "reactions", "inflow")
CHANGES = {
    "radius": CellParameterChange("radius"),
    "poisson_ratio": CellParameterChange("poisson_ratio"),
    "modulus": ModulusChange(),
    "viscosity": ViscosityChange(),
    "load": LoadChange(),
    "traction": BoundaryChange("y+", "traction", 1),
    "pressure": BoundaryChange("y+", "pressure"),
    "initial": InitialPressureChange(),
}


@pytest.fixture(params=["skfem", pytest.param("dolfinx", marks=pytest.mark.slow)])
def make_solver(request):
    pytest.importorskip(request.param)
    return registry().get("macro solver", request.param)


def problem(
    *,
    radius: float = 0.0,
    poisson_ratio: float = 0.0,
    modulus: float = 1.0,
    viscosity: float = 0.01,
    load: float = 1.0,
    traction: float = -0.05,
    pressure: float = 0.002,
    initial: float = 0.001,
    **settings: Any,
) -> MacroProblem:
    """A column of three elements, in units of the modulus: loads over it, and times as the viscosity over it."""
    top = {"traction": (0, traction / modulus, 0), "pressure": pressure / modulus}
    fields = {
        "radius": f"{0.2 + radius!r} + 0.01*y",
        "poisson_ratio": 0.33 + poisson_ratio,
        "viscosity": viscosity / modulus,
    }
    data = {
        "body": {"kind": "box", "elements": (1, 3, 1), "size": (0.5, 1.5, 0.5)},
        "boundary": {**SIDES, "y-": {"displacement": (0, 0, 0)}, "y+": top},
        "time": TIME,
        "newton": {"tolerance": 1e-13},
        "probes": {"inside": (0.2, 0.6, 0.3)},
        "fields": fields,
        "initial": {"pressure": initial / modulus},
        "load": load,
    }
    return MacroProblem.model_validate(data | settings)


BASE = {"radius": 0.0, "poisson_ratio": 0.0, "modulus": 1.0, "viscosity": 0.01, "load": 1.0}
BASE |= {"traction": -0.05, "pressure": 0.002, "initial": 0.001}
#: Unknowns by whose logarithm the derivative is.
RELATIVE = ("modulus", "viscosity")


def law(closure="potential", conductivity="piola"):
    cell = PorousFamilyLaw("radius", "poisson_ratio", "viscosity", deformed=conductivity == "deformed")
    return ClosedLaw(cell, make_closure(closure, 0.6, NeoHookean(), np.eye(3), law=conductivity))


def solve(make_solver, problem, law):
    solver = make_solver()
    return solver.solve(solver.prepare(problem), law)


def series(solution, modulus=1.0):
    """Name to values, in units that do not depend on the modulus."""
    h = solution.history
    found = {"settlement": h.settlement, "pressure_max": h.pressure_max * modulus, "drained": h.drained}
    for name, values in solution.probes.items():
        found[f"probes/{name}"] = values * [1, 1, 1, modulus]
    found |= {f"reactions/{name}": values * modulus for name, values in solution.reactions.items()}
    return found | {f"inflow/{name}": values for name, values in solution.inflow.items()}


def derivatives(found):
    values = {name: getattr(found, name) for name in ("settlement", "pressure_max", "drained")}
    return values | {f"{kind}/{name}": each for kind in SERIES for name, each in getattr(found, kind).items()}


def differences(make_solver, given, **along):
    """Central differences of all series along a direction, in which unknowns change by these numbers."""
    ends = []
    for sign in (1, -1):
        at = {name: BASE[name] + sign * STEP * by for name, by in along.items()}
        ends.append(series(solve(make_solver, problem(**at), given), at.get("modulus", 1.0)))
    return {key: (ends[0][key] - ends[1][key]) / (2 * STEP) for key in ends[0]}


def compare(found, expected, sizes):
    assert found.keys() == expected.keys()
    for key, wanted in expected.items():
        # What an unknown does not change, such as the force that bears the load, is round-off of the differences.
        scale = max(np.abs(wanted).max(), 0.1 * np.abs(sizes[key]).max())
        assert np.abs(found[key] - wanted).max() <= ACCURACY * scale, key


def along(name):
    """Change of an unknown by as much as it is itself, for the derivatives by logarithms by 1."""
    return BASE[name] or 0.2


@pytest.mark.parametrize("closure", ["potential", "mean-gradient"])
def test_derivatives_by_each_unknown_are_limits_of_differences(make_solver, closure):
    solver, given = make_solver(), law(closure)
    prepared = solver.prepare(problem())
    solution, found = solver.solve_with_sensitivities(prepared, given, [*CHANGES.values()])
    plain = solve(make_solver, problem(), given)
    np.testing.assert_allclose(solution.history.settlement, plain.history.settlement, rtol=1e-12)
    for j, name in enumerate(CHANGES):
        by = along(name)
        share = 1.0 if name in RELATIVE else by
        mine = {key: share * values[..., j] for key, values in derivatives(found).items()}
        compare(mine, differences(make_solver, given, **{name: by}), series(plain))
