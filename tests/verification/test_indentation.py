"""Indentation of a half space in its meridian against Sneddon's, Hertz's and Biot's half spaces."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.commands.verify.linear_cases import isotropic_law
from porocore.macro.indentation import PoroelasticIndentation, Punch
from porocore.macro.problem import MacroProblem
from porocore.plugins.registry import registry
from tests.helpers.half_space import edge_at, half_space

NU, SHEAR = 0.3, 1.0
LAME = 2 * SHEAR * NU / (1 - 2 * NU)
#: c = 1: times are τ a².
CONDUCTIVITY = 1 / (LAME + 2 * SHEAR)
LAW = isotropic_law(LAME, SHEAR, 1.0, 1e-9, CONDUCTIVITY)
DEPTH = 1e-4

#: One step that is next to none: nothing flows.
SUDDEN = 1e-6


def drained(far):
    """Steps that are so long that all pressure vanishes from a body of this size."""
    step = 100 * far**2
    return {"end": 2 * step, "step": step, "ramp_increments": 1, "ramp_step": step, "profiles": ()}


def relaxing(end):
    return {
        "end": end,
        "step": end / 5,
        "ramp_increments": 1,
        "ramp_step": SUDDEN,
        "profiles": (),
        "tolerance": 2e-3,
    }


@pytest.fixture(params=["skfem", pytest.param("dolfinx", marks=pytest.mark.slow)])
def solver(request):
    pytest.importorskip(request.param)
    return registry().get("macro solver", request.param)()


def solve(solver, body, boundary, time, **more):
    given = {"body": body, "boundary": {"side": {"normal": 0}, "y-": {"normal": 0}} | boundary, "time": time}
    problem = MacroProblem.model_validate(given | more)
    return solver.solve(solver.prepare(problem), LAW)


# ---- a flat punch whose contact is given ---------------------------------------------------------


def pressed(solver, first, ratio, far, time, under="sealed", outside="drained"):
    """Return times and forces of a sharp punch of radius 1, as a prescribed displacement of a patch."""
    body = half_space(edge_at(1.0, first, ratio), far, first, ratio)
    free = {"drained": {"pressure": 0}, "sealed": {}}
    boundary = {"y+": free[outside], "punch": {"displacement": (None, -DEPTH, None)} | free[under]}
    found = solve(solver, body, boundary, time, surfaces={"punch": {"of": "y+", "x": (0, 1)}})
    return found.history.time[1:], -found.reactions["punch"][1:, 1]


def test_a_flat_patch_approaches_sneddon(solver):
    """The error falls with the elements at the edge, as their size: u is a root there. The rest is the far boundary."""
    exact = 4 * SHEAR / (1 - NU) * DEPTH
    errors = [
        pressed(solver, first, 1.6, 3000.0, drained(3000), under="drained")[1][-1] / exact - 1
        for first in (0.2, 0.1, 0.05, 1e-3)
    ]
    assert 0 < errors[-1] < 2e-3
    above = np.array(errors[:-1]) - errors[-1]
    assert above[-1] < 4e-3
    assert np.all(above[:-1] / above[1:] > 1.7)


@pytest.mark.slow
@pytest.mark.parametrize("outside", ["drained", "sealed"])
@pytest.mark.parametrize("under", ["sealed", "drained"])
def test_a_flat_patch_relaxes_as_biot_s_half_space(solver, under, outside):
    """Forces as shares of the last one, which takes the far boundary and the sharp edge away."""
    exact = PoroelasticIndentation(Punch(1.0), DEPTH, SHEAR, NU, CONDUCTIVITY, under=under, outside=outside)
    mesh = (0.03, 1.6, 300.0)
    times, forces = pressed(solver, *mesh, relaxing(10.0), under, outside)
    last = pressed(solver, *mesh, drained(300), under, outside)[1][-1]
    if under == "sealed":
        assert forces[0] / last == pytest.approx(2 * (1 - NU), rel=2e-3)
    for tau in (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 8.0):
        share = np.interp(np.sqrt(tau), np.sqrt(times), forces) / last
        assert share == pytest.approx(exact.force(tau) / exact.relaxed_force, rel=5e-3)
