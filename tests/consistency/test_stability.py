"""Modes of period one and two by every pair of cell solvers: the same numbers, in contact and without."""

import numpy as np
import pytest

from porocore import MacroState
from porocore.cell.cell import Cell
from porocore.cell.equilibrium.solver import EquilibriumCellSolver
from porocore.cell.meshing.mesh import MeshSettings
from porocore.cell.stability.modes import lowest_of_class, negative_pivots
from porocore.states import Status

CELL = Cell(mesh=MeshSettings(size=0.25, fluid_size=0.25, element="quadratic-curved"))
STATES = {"open": (-0.22, Status.converged), "contact": (-0.27, Status.contact)}


def examined(solver, strain):
    if not isinstance(solver, EquilibriumCellSolver):
        pytest.skip(f"{type(solver).__name__} gives no access to its tangent")
    prepared = solver.prepare(CELL)
    solution = solver.solve(prepared, MacroState.single(np.diag([0.0, strain, 0.0])), fields=True)
    (field,) = solution.fields
    solid = prepared.eighth
    here = solid.iterate_at(field.grad_u, field.p, field.u)
    # The held component, the shift, the inverse and the field of a class; the last has the translation along y.
    modes = [lowest_of_class(solid, here, parity) for parity in ("|xy", "xyz|z", "y")]
    return solution.response, negative_pivots(solid, here, ["000", "110", "111"]), modes


@pytest.mark.parametrize("state", STATES)
def test_pivots_and_eigenvalues(cell_solver_pair, load, state):
    strain, status = STATES[state]
    one, other = (examined(load("cell solver", name), strain) for name in cell_solver_pair)
    assert one[0].status[0] == other[0].status[0] == status
    assert one[1] == other[1]
    assert one[1]["110"] > 0
    for a, b in zip(one[2], other[2], strict=True):
        assert a.value == pytest.approx(b.value, rel=1e-5)
        np.testing.assert_allclose(a.u, b.u, atol=2e-3)
    assert one[2][0].value < 0 < one[2][2].value
