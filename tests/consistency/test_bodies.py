"""Macro solvers against each other: the same law must give the same history and the same fields."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from porocore.commands.crosscheck.bodies import history_difference, node_orders
from porocore.macro.problem import MacroProblem
from porocore.testing.synthetic.response import confined_column, linear_law, mean_gradient_law

TOLERANCE = 1e-8
PLAN = {"end": 4.0, "step": 0.5, "ramp_increments": 4, "ramp_step": 0.05, "profiles": (0.2, 1.0)}
EXACT = {"time": PLAN, "newton": {"tolerance": 1e-11}}
SIDES = {face: {"displacement": (0, None, 0)} for face in ("x-", "x+", "z-", "z+")}
BOX = {"size": (0.8, 1.2, 1.0), **EXACT}
PROBLEMS = {
    "column": confined_column(6, -0.15, size=(0.1, 1.5, 0.1), **EXACT),
    # Three-dimensional: free sides, loaded askew, drained on two faces.
    "block": confined_column(
        (2, 2, 2),
        -0.03,
        boundary={
            "y-": {"displacement": (0, 0, 0)},
            "y+": {"traction": (0.3, 1.0, -0.2), "pressure": 0.0},
            "x+": {"pressure": 0.0},
        },
        **BOX,
    ),
    # Driven by a flux into the bottom and a displacement of the top.
    "pumped": confined_column(
        (1, 3, 2),
        0.05,
        boundary={
            **SIDES,
            "y-": {"displacement": (0, 0, 0), "flux": -0.4},
            "y+": {"displacement": (None, -1.0, None), "pressure": 0.5},
        },
        **BOX,
    ),
}
FLAT = {
    "tube": {"kind": "axisymmetric", "radius": 1.2, "inner_radius": 0.4, "height": 1.0, "elements": (3, 2)},
    "plate": {
        "kind": "plane-strain",
        "size": (0.8, 1.0),
        "depth": 0.3,
        "elements": (3, 2),
        "grading": (2, 1),
    },
}
PROBLEMS |= {
    name: MacroProblem.model_validate(
        {
            "body": body,
            "boundary": {
                "y-": {"displacement": (0, 0, None)},
                "y+": {"traction": (0.3, 1.0, 0), "pressure": 0.0},
                "side" if name == "tube" else "x+": {"follower": -0.5, "pressure": 0.0},
            },
            "load": -0.03,
            **EXACT,
        }
    )
    for name, body in FLAT.items()
}
LAWS = {"linear": linear_law, "mean-gradient": mean_gradient_law}
#: Scale of each nodal field and element mean, where it is small everywhere.
FLOOR = 1e-6


@pytest.fixture(scope="module")
def solved(load):
    """``solved(backend, problem, law)``, solved once."""

    @cache
    def make(backend, problem, law):
        solver = load("macro solver", backend)
        return solver.solve(solver.prepare(PROBLEMS[problem]), LAWS[law]())

    return make


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("problem", PROBLEMS)
def test_histories_agree(macro_solver_pair, problem, law, solved):
    a, b = (solved(backend, problem, law).history for backend in macro_solver_pair)
    np.testing.assert_array_equal(a.time, b.time)
    np.testing.assert_array_equal(a.ramp, b.ramp)
    for name in ("settlement", "pressure_max", "drained", "drained_paper"):
        x, y = getattr(a, name), getattr(b, name)
        assert history_difference(x, y).max() < TOLERANCE, name
        assert np.isfinite(x).all()
    assert np.abs(a.drained).max() > 1e-6, "nothing happens in this problem"


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("problem", PROBLEMS)
def test_fields_agree(macro_solver_pair, problem, law, solved):
    a, b = (solved(backend, problem, law) for backend in macro_solver_pair)
    nodes = node_orders(a.points, b.points)
    elements = node_orders(a.points[a.cells].mean(axis=1), b.points[b.cells].mean(axis=1))
    assert nodes is not None
    assert elements is not None
    assert [p.time for p in a.profiles] == [p.time for p in b.profiles] == [0.0, 0.2, 1.0, 4.0]
    for p, q in zip(a.profiles, b.profiles, strict=True):
        theirs = q.arrays()
        for name, mine in p.arrays().items():
            if name == "time":
                continue
            orders = nodes if name in ("u", "p") else elements
            x, y = mine[orders[0]], theirs[name][orders[1]]
            scale = max(np.abs(x).max(), FLOOR)
            np.testing.assert_allclose(x, y, rtol=0, atol=TOLERANCE * scale, err_msg=f"{name} {p.time}")


def test_cells_hold_the_same_nodes_in_the_same_order(macro_solver_pair, solved):
    """VTK's order, so that what reads one solution reads the other."""
    a, b = (solved(backend, "block", "linear") for backend in macro_solver_pair)
    first, second = node_orders(a.points[a.cells].mean(axis=1), b.points[b.cells].mean(axis=1))
    np.testing.assert_allclose(a.points[a.cells[first]], b.points[b.cells[second]], rtol=0, atol=1e-12)
