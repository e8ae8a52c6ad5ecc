"""A factor is a value: it stays that of its iterate when others are made after it."""

import numpy as np
import pytest
from scipy.sparse.linalg import splu

from porocore.cell.cell import Cell
from porocore.cell.equilibrium.solver import EquilibriumCellSolver
from porocore.cell.meshing.mesh import MeshSettings

CELL = Cell(mesh=MeshSettings(size=0.25, fluid_size=0.25, element="linear"))


@pytest.fixture
def solid(load, cell_solver):
    solver = load("cell solver", cell_solver)
    if not isinstance(solver, EquilibriumCellSolver):
        pytest.skip(f"{cell_solver} gives no access to its tangent")
    return solver.prepare(CELL).eighth


@pytest.mark.parametrize("parity", ["", "xy"])
@pytest.mark.parametrize("shift", [0.0, -1.0])
def test_what_is_factored_later_does_not_change_a_factor(solid, parity, shift):
    """x with (K − shift·M) x = b against SuperLU, before and after factors of another iterate and shift."""
    here = solid.iterate_at(np.diag([0.0, -0.05, 0.0]), 0.0)
    other = solid.iterate_at(np.diag([0.3, 0.3, 0.3]), 0.1)
    factor = solid.factor(here, parity, shift)
    K = solid.tangent(here, parity).tocsc()
    K.setdiag(K.diagonal() - shift * solid.masses(parity))
    rhs = np.random.default_rng(0).normal(size=K.shape[0])
    expected = splu(K).solve(rhs)

    def error():
        return np.linalg.norm(factor.solve(rhs) - expected) / np.linalg.norm(expected)

    assert error() < 1e-4  # a factor may be of single precision
    assert solid.negative_pivots(other, parity, -3.0) == factor.negative == 0
    assert error() < 1e-4
    solid.tangent(other, parity)
    solid.reset()
    assert error() < 1e-4


def test_sensitivities_are_those_of_the_factor_that_is_given(solid):
    here = solid.iterate_at(np.diag([0.0, -0.05, 0.0]), 0.0)
    factor = solid.factor(here, "")
    expected = solid.sensitivities(factor, (0, 9))
    solid.negative_pivots(solid.iterate_at(np.diag([0.3, 0.3, 0.3]), 0.1), "")
    again = solid.sensitivities(factor, (0, 9))
    np.testing.assert_allclose(again.grad, expected.grad, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(again.second, expected.second, rtol=1e-9, atol=1e-12)
