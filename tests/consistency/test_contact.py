"""Cell solvers against each other where the pore wall touches itself."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.commands.crosscheck.bodies import AVERAGES, DERIVATIVES, compare_responses
from porocore.states import MacroState, Status

#: In contact on the coarse mesh.
STATES = {
    "uniaxial": MacroState.single(np.diag([0.0, -0.25, 0.0])),
    "under pressure": MacroState.single(np.diag([0.0, -0.33, 0.0]), 0.1),
    "triaxial": MacroState.single(np.diag([0.02, -0.28, -0.03])),
}


@pytest.fixture(scope="module")
def solved(load):
    """``solved(backend, state)`` is the response, of one prepared cell."""

    @cache
    def prepared(backend):
        solver = load("cell solver", backend)
        return solver, solver.prepare(Cell(mesh=MeshSettings(size=0.35, fluid_size=0.25)))

    def solve(backend, state):
        solver, ready = prepared(backend)
        return solver.solve(ready, STATES[state]).response

    return solve


@pytest.mark.parametrize(
    "state",
    [name if name == "under pressure" else pytest.param(name, marks=pytest.mark.slow) for name in STATES],
)
def test_averages_and_derivatives_agree_in_contact(cell_solver_pair, solved, state):
    one, other = cell_solver_pair
    a, b = (solved(backend, state) for backend in cell_solver_pair)
    assert a.status[0] == Status.contact
    assert a.extrema.contact_share[0] > 0
    assert b.extrema.contact_share[0] == pytest.approx(a.extrema.contact_share[0], rel=1e-9)
    lines = compare_responses(state, one, a, other, b)
    assert {line.quantity for line in lines} == {"status", *AVERAGES.values(), *DERIVATIVES.values()}
    assert not [line.describe() for line in lines if not line.passed]


def test_the_kind_of_wall_changes_the_answer_only_beyond_the_crease(cell_solver, load):
    """Before anything touches contact is not there at all; behind it the state has no other answer."""
    solver = load("cell solver", cell_solver)
    free, held = (
        solver.prepare(Cell(mesh=MeshSettings(size=0.35, fluid_size=0.25), contact={"kind": kind}))
        for kind in ("none", "frictionless")
    )
    H = np.zeros((2, 3, 3))
    H[:, 1, 1] = -0.15, -0.28
    states = MacroState(H, np.zeros(2))
    without, with_contact = (solver.solve(cell, states).response for cell in (free, held))
    assert list(without.status) == [Status.converged, Status.overlap]
    assert list(with_contact.status) == [Status.converged, Status.contact]
    np.testing.assert_array_equal(with_contact.stress[0], without.stress[0])
    np.testing.assert_array_equal(with_contact.tangent.stress_grad_u[0], without.tangent.stress_grad_u[0])
    assert with_contact.extrema.contact_share[0] == 0.0


def test_walls_that_touch_agree_under_shear(cell_solver_pair, load):
    """The whole cell, where walls couple unknowns that share no element."""
    one, other = cell_solver_pair
    H = np.diag([0.0, -0.36, 0.0])
    H[0, 1] = 0.02
    mesh = MeshSettings(size=0.35, fluid_size=0.25, element="linear")
    found = []
    for backend in cell_solver_pair:
        solver = load("cell solver", backend)
        found.append(solver.solve(solver.prepare(Cell(mesh=mesh)), MacroState.single(H)).response)
    assert found[0].status[0] == Status.contact
    lines = compare_responses("sheared", one, found[0], other, found[1])
    assert len(lines) == 1 + len(AVERAGES) + len(DERIVATIVES)
    assert not [line.describe() for line in lines if not line.passed]
