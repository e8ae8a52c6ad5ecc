"""A factorised tangent is a value, also with a backend whose factors displace each other."""

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.cell.stability.modes import lowest_eigenvalues, negative_pivots
from porocore.interfaces.records import flatten_response
from porocore.states import MacroState, Status
from tests.cell.dense_solid import DenseCellSolver, DenseSolid, StaleFactor

CELL = Cell(mesh=MeshSettings(size=0.4, fluid_size=0.4, element="linear"), contact={"kind": "none"})
H = np.diag([0.02, -0.05, 0.0])


@pytest.fixture
def solid():
    return DenseCellSolver().prepare(CELL).eighth


def factor_error(solid, disturb):
    """Return the relative error of a factor at one iterate, applied after ``disturb(other iterate)``."""
    iterate, other = solid.iterate_at(H, 0.0), solid.iterate_at(np.diag([0.2, 0.2, 0.2]), 0.1)
    factor = solid.factor(iterate, "xy", -1.0)
    rhs = np.random.default_rng(0).normal(size=len(solid.masses("xy")))
    expected = np.linalg.solve(solid.shifted(iterate, "xy", -1.0), rhs)
    disturb(other)
    return np.linalg.norm(factor.solve(rhs) - expected) / np.linalg.norm(expected)


CALLS = {
    "nothing": lambda solid: lambda other: None,
    "another iterate": lambda solid: lambda other: solid.factor(other, "xy", -1.0),
    "another shift": lambda solid: lambda other: solid.factor(solid.iterate_at(H, 0.0), "xy", -3.0),
    "pivots": lambda solid: lambda other: solid.negative_pivots(other, "xy"),
    "another start": lambda solid: lambda other: solid.reset(),
    "release": lambda solid: lambda other: solid.release("xy"),
}


@pytest.mark.parametrize("call", CALLS)
def test_a_displaced_factor_is_computed_again(solid, call):
    assert factor_error(solid, CALLS[call](solid)) < 1e-12


@pytest.mark.parametrize("call", ["another iterate", "another shift", "pivots"])
def test_a_stale_factor_would_be_seen(monkeypatch, solid, call):
    monkeypatch.setattr(DenseSolid, "kind_of_factor", StaleFactor)
    assert factor_error(solid, CALLS[call](solid)) > 1e-2


def test_no_study_of_a_cell_applies_a_factor_after_another_was_made():
    """Responses, derivatives, pivots and eigenvalues of every class take one pass through the one slot."""
    solver = DenseCellSolver()
    prepared = solver.prepare(CELL)
    solution = solver.solve(prepared, MacroState.single(H, 0.05), fields=True)
    field, solid = solution.fields[0], prepared.eighth
    iterate = solid.iterate_at(field.grad_u, field.p, field.u)
    assert set(negative_pivots(solid, iterate).values()) == {0}
    assert all(value > 0 for value in lowest_eigenvalues(solid, iterate, ["000", "110"]).values())
    assert solid.displaced == 0


def test_a_made_up_backend_agrees_with_one_that_is_installed():
    skfem = pytest.importorskip("porocore_fem_skfem.cell_solver")
    found, expected = (
        solver.solve_one(solver.prepare(CELL), H, 0.05)
        for solver in (DenseCellSolver(), skfem.SkfemCellSolver())
    )
    assert Status(int(found.status[0])) is Status.converged
    found, expected = flatten_response(found), flatten_response(expected)
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        np.testing.assert_allclose(found[name], value, atol=1e-8, err_msg=name)
