"""Loads that only rotate the deformed cell are not solved for; the answer is that of the other loads' solver."""

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.equilibrium.discrete import load_basis
from porocore.cell.equilibrium.responses import follow
from porocore.cell.equilibrium.solver import TOLERANCE
from porocore.cell.symmetry import CLASSES
from porocore_fem_skfem import constraints, iterative
from porocore_fem_skfem.cell_solver import SkfemCellSolver

GENERAL = np.array([[-0.05, 0.08, 0.02], [-0.03, 0.04, 0.05], [0.01, -0.06, -0.02]])
FIBRES = {
    "kind": "holzapfel-gasser-ogden",
    "shear_modulus": 1.0,
    "bulk_modulus": 2.0,
    "k1": 1.0,
    "k2": 1.0,
    "directions": [[1.0, 0.3, -0.2]],
}
MESHES = {
    "linear": {"size": 0.25, "element": "linear"},
    "curved": {"size": 0.3, "element": "quadratic-curved"},
}


@pytest.mark.parametrize("parity", ["xy", "xz", "yz"])
def test_a_class_of_shears_has_one_rotation(parity):
    H = np.diag([-0.3, 0.2, 0.1])
    basis = load_basis(H, CLASSES[parity])
    assert basis.spins.shape == (1, 3, 3)
    turn = np.zeros(9)
    turn[list(CLASSES[parity])] = basis.loads[:, -1]
    np.testing.assert_allclose(turn.reshape(3, 3), basis.spins[0] @ (np.eye(3) + H))


@pytest.mark.parametrize("columns", [CLASSES[""], (0, 9), (1,)])
def test_loads_without_rotations(columns):
    basis = load_basis(np.diag([-0.3, 0.2, 0.1]), columns)
    assert len(basis.spins) == 0
    assert abs(np.linalg.det(basis.loads)) > 0.1


def test_three_of_all_loads_are_rotations_even_of_a_cell_on_its_head():
    upside_down = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) - np.eye(3)
    for H in (GENERAL, upside_down):
        basis = load_basis(H, range(10))
        assert len(basis.spins) == 3
        assert np.linalg.cond(basis.loads) < 10
    assert len(load_basis(GENERAL, (0, 9)).spins) == 0


@pytest.mark.parametrize(("solver", "solved"), [("pardiso", {7}), ("amg", {8})])
@pytest.mark.parametrize(("mesh", "material"), [("linear", FIBRES), ("curved", {})])
def test_derivatives_are_those_of_each_load_alone(monkeypatch, solver, solved, mesh, material):
    cell = Cell(mesh=MESHES[mesh], material=material)
    solid = SkfemCellSolver(solver=solver).prepare(cell).whole
    start = solid.iterate_at(np.zeros((3, 3)), 0.0)
    iterate = follow(solid, start, GENERAL, 0.05, TOLERANCE).equilibrium
    factor = solid.factor(iterate, "")
    widths = count_columns(monkeypatch)
    found = solid.sensitivities(factor, range(10))
    assert widths == solved
    alone = [solid.sensitivities(factor, (k,)) for k in range(10)]
    np.testing.assert_allclose(found.grad, np.concatenate([one.grad for one in alone]), atol=1e-9)
    np.testing.assert_allclose(np.diag(found.second), [one.second[0, 0] for one in alone], atol=1e-9)
    np.testing.assert_allclose(found.second, found.second.T, atol=1e-12)


@pytest.mark.parametrize("parity", ["xy", "yz"])
def test_shears_of_the_eighth(monkeypatch, parity):
    solid = SkfemCellSolver().prepare(Cell(mesh=MESHES["curved"])).eighth
    H = np.diag([0.0, -0.12, 0.05])
    iterate = follow(solid, solid.iterate_at(np.zeros((3, 3)), 0.0), H, 0.05, TOLERANCE).equilibrium
    factor = solid.factor(iterate, parity)
    widths = count_columns(monkeypatch)
    found = solid.sensitivities(factor, CLASSES[parity])
    assert widths == {1}
    for k, column in enumerate(CLASSES[parity]):
        alone = solid.sensitivities(factor, (column,))
        np.testing.assert_allclose(found.grad[k], alone.grad[0], atol=1e-9)
        assert found.second[k, k] == pytest.approx(alone.second[0, 0], abs=1e-9)


def test_away_from_equilibrium_every_load_is_solved_for(monkeypatch):
    solid = SkfemCellSolver().prepare(Cell(mesh=MESHES["linear"])).whole
    iterate = solid.iterate_at(GENERAL, 0.0)
    factor = solid.factor(iterate, "")
    widths = count_columns(monkeypatch)
    found = solid.sensitivities(factor, range(10))
    assert widths == {10}
    alone = solid.sensitivities(factor, (3,))
    np.testing.assert_allclose(found.grad[3], alone.grad[0], atol=1e-9)


def count_columns(monkeypatch):
    """Return the numbers of columns that are solved for together, as they are found from now on."""
    widths = set()

    def counted(solve):
        def solving(first, rhs, *others, **options):
            widths.add(rhs.shape[1])
            return solve(first, rhs, *others, **options)

        return solving

    monkeypatch.setattr(constraints, "refine", counted(constraints.refine))
    solve = counted(iterative.block_conjugate_gradients)
    monkeypatch.setattr(iterative, "block_conjugate_gradients", solve)
    return widths
