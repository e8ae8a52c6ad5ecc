"""Large cells: multigrid against factors, on meshes that are small enough for both."""

import numpy as np
import pytest
from scipy import sparse

from porocore.cell.cell import Cell
from porocore.cell.contact.wall_contact import make_contact_model
from porocore.cell.equilibrium.discrete import LoadStepFailed
from porocore.cell.equilibrium.responses import follow, respond
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.level_sets.tpms import TriplyPeriodic
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.cell.meshing.mesh import MeshSettings
from porocore.cell.stability.modes import lowest_of_class
from porocore.states import MacroState, Status
from porocore_fem_skfem import iterative, linalg, multigrid, stokes
from porocore_fem_skfem.cell_solver import SkfemCellSolver
from porocore_fem_skfem.linalg import conjugate_gradients
from porocore_fem_skfem.multigrid import Multigrid, Nodes, aggregated
from porocore_fem_skfem.node_grid import PaddedPattern, node_grid
from porocore_fem_skfem.products import Product, block_of, in_blocks
from porocore_fem_skfem.solid import SkfemSolid
from porocore_fem_skfem.stokes import SkfemStokes

COARSE = MeshSettings(size=0.2, fluid_size=0.14)
GYROID = TriplyPeriodic(kind="tpms", surface="gyroid", level=0)
SHEARED = MacroState.single([[0.01, 0.03, 0], [0, -0.06, 0], [0, 0, 0]], 0.05)


def solid_of(cell, domain="whole", solver="amg", contact=False):
    mesh = cell.make_mesh("solid", domain)
    model = make_contact_model(mesh, cell.contact, cell.solid.on(mesh)) if contact else None
    return SkfemSolid(mesh, NeoHookean(), degree=mesh.quadrature_degree, solver=solver, contact=model)


@pytest.fixture
def levels(monkeypatch):
    """Let small cells have several levels."""
    monkeypatch.setattr(multigrid, "COARSEST", 100)


def all_values(response):
    found = {name: getattr(response, name) for name in ("mean_grad", "potential", "stress", "fluid_volume")}
    return found | {name: value for name, value in vars(response.tangent).items() if value is not None}


def agree(one, other, tolerance=1e-9):
    assert one.status == other.status
    assert one.extrema.negative_pivots == other.extrema.negative_pivots
    for name, value in all_values(other).items():
        np.testing.assert_allclose(all_values(one)[name], value, atol=tolerance, err_msg=name)


@pytest.mark.parametrize("element", ["quadratic-curved", "linear"])
@pytest.mark.parametrize("geometry", [OrthogonalChannels(), GYROID], ids=["channels", "gyroid"])
def test_multigrid_gives_the_response_of_a_factor(levels, geometry, element):
    """Averages and all ten derivatives on the whole cell, under shear and pressure, and the unstable modes."""
    cell = Cell(geometry=geometry, mesh=COARSE.model_copy(update={"element": element}))
    found = []
    for name in ("amg", "pardiso"):
        solver = SkfemCellSolver(solver=name)
        found.append(solver.solve(solver.prepare(cell), SHEARED).response)
    agree(*found)


@pytest.mark.parametrize("domain", ["eighth", pytest.param("whole", marks=pytest.mark.slow)])
def test_multigrid_gives_the_response_of_a_factor_in_contact(levels, domain):
    """Contact couples unknowns that share no element."""
    found = []
    for name in ("amg", "pardiso"):
        solid = solid_of(Cell(mesh=COARSE), domain, name, contact=True)
        path = follow(
            solid, solid.iterate_at(np.zeros((3, 3)), 0.0), -0.26 * np.diag([0.0, 1.0, 0.0]), 0.0, 1e-11
        )
        assert path.status == Status.converged
        found.append(respond(solid, path.equilibrium, tangent=True))
    assert found[0].status == Status.contact
    agree(*found)


@pytest.mark.parametrize("domain", ["eighth", "whole"])
def test_a_cycle_is_symmetric_and_as_good_on_a_finer_mesh(levels, domain):
    for size in (0.2, 0.14):
        solid = solid_of(Cell(mesh=MeshSettings(size=size)), domain)
        constraints = solid.constraints()
        component, node = np.divmod(constraints.free, solid.n_nodes)
        grid = node_grid(solid.mesh, 3 * node + component, 3)
        pattern = PaddedPattern(constraints.indptr, constraints.indices, grid)
        entries = constraints.restrict(solid.iterate_at(np.zeros((3, 3)), 0.0).tangent)
        matrix, cycles = pattern.matrix(entries), Multigrid(pattern, grid, np.float64)
        cycles.set_up(matrix)
        assert len(cycles.sizes) >= 3
        assert cycles.sizes[0] == pattern.size
        x, y = np.random.default_rng(1).normal(size=(2, pattern.size))
        assert x @ cycles.cycle(y) == pytest.approx(y @ cycles.cycle(x), rel=1e-10)
        assert x @ cycles.cycle(x) > 0
        solved = conjugate_gradients(
            matrix.dot, pattern.padded(x[pattern.places]), cycles.cycle, tolerance=1e-10
        )
        assert solved.converged
        assert solved.iterations <= 45


def test_groups_move_like_rigid_bodies_across_the_faces_of_the_cell():
    """Two nodes at x = ±0.45 of a periodic cell are neighbours; a rotation about the face between them is exact."""
    points = np.array([[0.45, 0.0, 0.0], [-0.45, 0.1, 0.0], [0.45, 0.0, 0.1], [-0.45, 0.1, 0.2]])
    motions = np.zeros((4, 3, 6))
    motions[:, range(3), range(3)] = 1.0
    matrix = sparse.csr_matrix(np.ones((12, 12)))
    prolong, groups, active = aggregated(matrix, Nodes(points, motions, np.ones(3)))
    assert prolong.shape == (12, 6)
    assert active.all()
    np.testing.assert_allclose((prolong.T @ prolong).toarray(), np.eye(6), atol=1e-12)
    near = points - np.round(points - points[0])
    turned = np.add(np.cross([0.3, -0.2, 0.5], near - [0.5, 0.0, 0.0]), [1.0, 2.0, 3.0])
    u = turned.ravel()
    np.testing.assert_allclose(prolong @ (prolong.T @ u), u, atol=1e-12)
    np.testing.assert_allclose(groups.points[0] - near.mean(axis=0), 0.0, atol=1e-12)


@pytest.mark.parametrize("parity", ["", "xy", "x"])
def test_definite_and_indefinite_are_told_apart_without_a_factor(levels, parity):
    """K − σM has a negative eigenvalue if and only if σ is above the lowest one, found by inverse iteration."""
    cell = Cell(mesh=COARSE)
    solid, direct = solid_of(cell, "eighth"), solid_of(cell, "eighth", "pardiso")
    still = direct.iterate_at(np.zeros((3, 3)), 0.0)
    direct.reset()
    lowest = lowest_of_class(direct, still, parity).value
    rest = solid.iterate_at(np.zeros((3, 3)), 0.0)
    if parity != "x":  # without a rigid translation, which is held at one node only
        assert solid.negative_pivots(rest, parity, 0.99 * lowest) == 0
        assert solid.negative_pivots(rest, parity, 1.01 * lowest) == 1
    assert lowest_of_class(solid, rest, parity).value == pytest.approx(lowest, rel=1e-6)


def test_where_multigrid_fails_a_factor_takes_over(levels, monkeypatch):
    """At r = 0.4 the struts are unstable; the response is the factor's, with its count of modes and its derivatives."""
    cell = Cell(geometry=OrthogonalChannels(radius=0.4), mesh=COARSE)
    H = -0.26 * np.diag([0.0, 1.0, 0.0])
    factors = SkfemCellSolver().solve_one(SkfemCellSolver().prepare(cell), H)
    monkeypatch.setattr(linalg, "DIRECT_LIMIT", 0)
    solver = SkfemCellSolver()
    prepared = solver.prepare(cell)
    agree(solver.solve_one(prepared, H), factors, 1e-8)
    monkeypatch.setattr(iterative, "LIMIT", 2)
    agree(solver.solve_one(prepared, H), factors, 1e-8)


def test_an_iteration_that_stagnates_is_a_status(levels, monkeypatch):
    monkeypatch.setattr(iterative, "LIMIT", 2)
    solver = SkfemCellSolver(solver="amg")
    failed = solver.solve_one(solver.prepare(Cell(mesh=COARSE)), -0.05 * np.eye(3))
    assert failed.status == Status.not_converged
    assert np.isnan(failed.stress).all()
    solid = solid_of(Cell(mesh=COARSE))
    iterate = solid.iterate_at(-0.05 * np.eye(3), 0.0)
    with pytest.raises(LoadStepFailed):
        solid.solve(iterate, -iterate.residual, 1e-8)


@pytest.mark.parametrize(
    ("geometry", "domain"),
    [(OrthogonalChannels(), "eighth"), (OrthogonalChannels(), "whole"), (GYROID, "whole")],
    ids=["eighth of channels", "channels", "gyroid"],
)
def test_stokes_flow_by_iteration_is_that_by_factors(levels, geometry, domain):
    cell = Cell(geometry=geometry, mesh=COARSE)
    mesh = cell.make_mesh("fluid", domain)
    by_factor, by_iteration = (SkfemStokes(mesh, name).flow() for name in ("pardiso", "amg"))
    if domain == "eighth":  # whose flows along different axes have nothing in common
        by_factor, by_iteration = np.diag(by_factor), np.diag(by_iteration)
    np.testing.assert_allclose(by_iteration, by_factor, rtol=0, atol=1e-9 * by_factor.max())


def test_the_conductivity_is_more_exact_than_velocity_and_pressure(monkeypatch):
    """Its error is about the square of theirs, on the diagonal, which alone has a meaning on the eighth."""
    mesh = Cell(mesh=COARSE).make_mesh("fluid", "eighth")
    exact = np.diag(SkfemStokes(mesh, "pardiso").flow())
    monkeypatch.setattr(stokes, "TOLERANCE", 1e-4)
    error = np.abs(np.diag(SkfemStokes(mesh, "amg").flow()) / exact - 1).max()
    assert 1e-13 < error < 1e-6


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("columns", [None, 0, 1, 2, 3, 11])
@pytest.mark.parametrize("block", [(1, 1), (3, 3), (6, 6), (3, 6)])
def test_products_are_those_of_scipy(dtype, columns, block):
    rng = np.random.default_rng(0)
    matrix = in_blocks(sparse.random(42, 30, 0.2, format="csr", random_state=0).astype(dtype), *block)
    assert block_of(matrix) == block
    x = rng.normal(size=30 if columns is None else (30, columns)).astype(dtype)
    found = Product(matrix) @ x
    assert found.dtype == dtype
    np.testing.assert_allclose(
        found, matrix.toarray() @ x, rtol=1e-4 if dtype == np.float32 else 1e-12, atol=1e-6
    )
