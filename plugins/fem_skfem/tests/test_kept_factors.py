"""What the solver keeps between states: factors by definiteness, widened patterns, derivatives of images."""

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.equilibrium import responses
from porocore.cell.symmetry import axis_order
from porocore.interfaces.records import flatten_response
from porocore.states import Status
from porocore_fem_skfem import constraints as widening
from porocore_fem_skfem import pardiso
from porocore_fem_skfem.cell_solver import SkfemCellSolver

COARSE = {"size": 0.25, "element": "quadratic-curved"}
TOUCHING, FREE = np.diag([0.0, -0.36, 0.0]), np.diag([0.0, -0.1, 0.0])


def flat(response):
    return flatten_response(response)


def test_a_definite_matrix_has_a_cholesky_factor_and_any_other_its_inertia():
    n = 40
    rng = np.random.default_rng(1)
    indptr = np.array([0, *np.cumsum(np.arange(n, 0, -1))], dtype=np.int32)
    indices = np.concatenate([np.arange(i, n) for i in range(n)]).astype(np.int32)
    factor = pardiso.PardisoFactor(indptr, indices, single=False)
    half = rng.normal(size=(n, n))
    definite = half @ half.T + np.eye(n)
    for negative in (0, 3, 1, 0):
        matrix = definite - 1e3 * np.diag(np.arange(n) < negative) * np.linalg.norm(definite)
        entries = matrix[np.triu_indices(n)]
        assert factor.factor_definite(entries) is (negative == 0)
        factor.factor(entries)
        assert factor.negative == negative == (np.linalg.eigvalsh(matrix) < 0).sum()
        rhs = rng.normal(size=(n, 2))
        np.testing.assert_allclose(matrix @ factor.solve(rhs), rhs, atol=1e-7)


@pytest.fixture(scope="module")
def solver():
    return SkfemCellSolver()


def test_results_do_not_depend_on_the_widened_patterns_that_are_kept(solver, monkeypatch):
    used = solver.prepare(Cell(mesh=COARSE))
    states = [TOUCHING, np.diag([-0.33, 0.0, 0.0]), np.diag([0.0, -0.34, -0.3]), TOUCHING]
    kept = [solver.solve_one(used, H, 0.03) for H in states]
    assert used.eighth._widenings._kept
    assert kept[0].status[0] == Status.contact
    monkeypatch.setattr(widening, "MOST_KEPT", 0)
    for H, response in zip(states, kept, strict=True):
        fresh = solver.solve_one(solver.prepare(Cell(mesh=COARSE)), H, 0.03)
        for name, values in flat(response).items():
            np.testing.assert_array_equal(values, flat(fresh)[name], err_msg=name)


def test_derivatives_of_images_are_those_of_their_own_factors(solver, monkeypatch):
    prepared = solver.prepare(Cell(mesh=COARSE))
    for H, p in ((FREE, 0.05), (np.diag([-0.1, -0.1, 0.02]), 0.0), (np.zeros((3, 3)), 0.1)):
        exchanged = solver.solve_one(prepared, H, p)
        with monkeypatch.context() as patch:
            patch.setattr(responses, "images", lambda parity, swaps: {parity})
            each = solver.solve_one(prepared, H, p)
        for name, values in flat(each).items():
            scale = np.abs(values).max()
            np.testing.assert_allclose(flat(exchanged)[name], values, atol=1e-9 * scale, err_msg=name)


def test_the_order_of_axes_maps_one_class_onto_the_other():
    assert axis_order("xy", "yz", ["xz"]) == (2, 1, 0)
    assert axis_order("xy", "xz", ["yz"]) == (0, 2, 1)
    assert axis_order("x", "z", ["xy", "yz"])[2] == 0
    with pytest.raises(ValueError, match="'xz' is no image of 'xy' under exchanges of xz"):
        axis_order("xy", "xz", ["xz"])
