"""What is particular to this backend: the pressure's two forms, linear solvers, convergence, statuses."""

import numpy as np
import pytest

from porocore import MacroState, Status
from porocore.cell.cell import Cell
from porocore.cell.contact.wall_contact import ContactSettings
from porocore.cell.equilibrium.responses import respond
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.cell.meshing.mesh import MeshSettings
from porocore.errors import ConfigurationError
from porocore_fem_skfem import constraints
from porocore_fem_skfem.cell_solver import SkfemCellSolver
from porocore_fem_skfem.linalg import (
    Iteration,
    SuperLUFactor,
    SymmetricPattern,
    block_conjugate_gradients,
    conjugate_gradients,
)
from porocore_fem_skfem.pardiso import PardisoFactor, library
from porocore_fem_skfem.solid import SkfemSolid

COARSE = MeshSettings(size=0.2, fluid_size=0.14)
NO_CONTACT = ContactSettings(kind="none")


def compressed(h, p=0.0):
    return MacroState.single(np.diag([0.0, -h, 0.0]), p)


@pytest.mark.parametrize("domain", ["eighth", "whole"])
def test_pressure_on_the_wall_and_in_the_volume_give_the_same_residual(domain):
    """∫_Γ cof(F) N·v dS, by Nanson's formula on the deformed facets, against ∫ cof F:∇v dV."""
    mesh = Cell(mesh=COARSE).make_mesh("solid", domain)
    problem = SkfemSolid(mesh, NeoHookean(), degree=3, solver="auto")
    rng = np.random.default_rng(5)
    H = np.diag([0.03, -0.06, 0.02]) if domain == "eighth" else rng.normal(size=(3, 3)) * 0.05
    free = problem.constraints().free
    u = np.zeros(3 * problem.n_nodes)
    u[free] = rng.normal(size=len(free)) * 2e-3
    u = u.reshape(3, -1)
    at = problem.iterate_at(H, 1.0, u[:, problem.nodes].T)
    volume = problem.assemble(at.cof).ravel()[free]

    x = (mesh.points @ (np.eye(3) + H).T) + u[:, problem.nodes].T
    wall = mesh.wall
    # Gauss rule of degree 4 on the triangle: the integrand is a polynomial of that degree.
    a, b, wa, wb = 0.445948490915965, 0.091576213509771, 0.223381589678011 / 2, 0.109951743655322 / 2
    points = np.array([(a, a), (1 - 2 * a, a), (a, 1 - 2 * a), (b, b), (1 - 2 * b, b), (b, 1 - 2 * b)])
    s, t = points.T
    r = 1 - s - t
    N = np.stack([r * (2 * r - 1), s * (2 * s - 1), t * (2 * t - 1), 4 * r * s, 4 * s * t, 4 * t * r], axis=1)
    zero = 0 * s
    dN_s = np.stack([1 - 4 * r, 4 * s - 1, zero, 4 * (r - s), 4 * t, -4 * t], axis=1)
    dN_t = np.stack([1 - 4 * r, zero, 4 * t - 1, -4 * s, 4 * s, 4 * (r - t)], axis=1)
    weights = np.array([wa] * 3 + [wb] * 3)
    normal = np.cross(
        np.einsum("qa,kai->kqi", dN_s, x[wall]), np.einsum("qa,kai->kqi", dN_t, x[wall])
    )  # cof(F) N dS, outward
    nodal = np.einsum("kqi,qa,q->kai", normal, N, weights)
    surface = np.zeros((3, problem.n_nodes))
    for i in range(3):
        np.add.at(surface[i], problem.nodes[wall], nodal[:, :, i])
    surface = surface.ravel()[free]
    assert np.abs(surface).max() > 1e-4
    np.testing.assert_allclose(surface, volume, atol=1e-12)


@pytest.mark.parametrize(
    ("radius", "M_2222", "M_2211", "Q_11", "K_11"),
    [(0.25, -0.2297, -0.0754, -0.1141, 1.943), (0.2, -0.2217, -0.0804, -0.1148, 0.757)],
)
def test_published_values_of_the_cell(radius, M_2222, M_2211, Q_11, K_11):
    """Dehghani & Zilian print 1.943, −0.23, −0.076, −0.113; more digits from an independent code."""
    solver = SkfemCellSolver()
    cell = Cell(geometry=OrthogonalChannels(radius=radius))
    prepared = solver.prepare(cell)
    rest = solver.solve_one(prepared, np.zeros((3, 3)))
    M, Q = rest.tangent.mean_grad_grad_u[0], rest.tangent.mean_grad_p[0]
    assert M[1, 1, 1, 1] == pytest.approx(M_2222, rel=1e-2)
    assert M[1, 1, 0, 0] == pytest.approx(M_2211, rel=1e-2)
    assert Q[0, 0] == pytest.approx(Q_11, rel=1e-2)
    assert solver.conductivity(prepared)[0, 0] == pytest.approx(K_11, rel=1e-2)
    assert rest.fluid_volume[0] == pytest.approx(cell.geometry.porosity, rel=5e-3)


def test_drained_stress_against_an_independent_code():
    solver = SkfemCellSolver()
    prepared = solver.prepare(Cell())
    for h, P_22 in ((0.05, -0.02338), (0.10, -0.0493), (0.20, -0.109)):
        stress = solver.solve(prepared, compressed(h), tangent=False).response.stress
        assert stress[0, 1, 1] == pytest.approx(P_22, rel=5e-3)


def test_refinement_converges():
    """Curved quadratic and linear elements tend to the same value."""
    solver = SkfemCellSolver()

    def M_2222(size, element):
        prepared = solver.prepare(Cell(mesh=MeshSettings(size=size, element=element)))
        return solver.solve_one(prepared, np.zeros((3, 3))).tangent.mean_grad_grad_u[0, 1, 1, 1, 1]

    fine = M_2222(0.08, "quadratic-curved")
    curved = abs(M_2222(0.2, "quadratic-curved") - fine)
    linear = [abs(M_2222(size, "linear") - fine) for size in (0.14, 0.07)]
    assert curved < 0.005 * abs(fine)
    assert linear[1] < 0.5 * linear[0]
    assert curved < linear[1]


@pytest.mark.parametrize("p", [0.0, pytest.param(0.2, marks=pytest.mark.slow)])
def test_statuses_under_strong_compression(p):
    """Without contact none behind the first overlap is converged; every state has a status, and two meshes agree."""
    solver = SkfemCellSolver()
    heights = np.array([0.0, 0.04, 0.08, 0.12, 0.16, 0.2, 0.24, 0.32, 0.4])
    states = MacroState(np.array([np.diag([0, -h, 0]) for h in heights]), np.full(len(heights), p))
    meshes = []
    for size in (0.2, 0.15):
        prepared = solver.prepare(Cell(mesh=MeshSettings(size=size), contact=NO_CONTACT))
        meshes.append(solver.solve(prepared, states, tangent=False).response)
    for response in meshes:
        good = response.status == Status.converged
        first_bad = int(np.argmin(good))
        assert good[:first_bad].all()
        assert not good[first_bad:].any()
        assert (response.status[first_bad:] == Status.overlap).all()
        assert (response.extrema.min_gap[good] > 0).all()
        assert np.isnan(response.stress[~good]).all()
        assert -heights[first_bad] >= -0.15 - 0.33 * p - 0.12
    both = (meshes[0].status == Status.converged) & (meshes[1].status == Status.converged)
    assert both.sum() >= 5
    np.testing.assert_allclose(
        meshes[0].stress[both, 1, 1], meshes[1].stress[both, 1, 1], rtol=1e-2, atol=1e-12
    )


@pytest.mark.slow
def test_whole_cell_notices_overlap_too():
    solver = SkfemCellSolver()
    prepared = solver.prepare(Cell(mesh=COARSE, symmetry="none", contact=NO_CONTACT))
    good = solver.solve(prepared, compressed(0.15), tangent=False).response
    bad = solver.solve(prepared, compressed(0.28), tangent=False).response
    assert good.status[0] == Status.converged
    assert bad.status[0] == Status.overlap


def test_suction_ends_in_a_status():
    """Homogeneous hydrostatic tension of this solid peaks at 0.45 E, so p = −1 has no equilibrium."""
    response = (
        SkfemCellSolver()
        .solve(SkfemCellSolver().prepare(Cell(mesh=COARSE)), MacroState.single(np.zeros((3, 3)), -1.0))
        .response
    )
    assert Status(response.status[0]) in (Status.not_converged, Status.inverted, Status.overlap)
    assert np.isnan(response.potential).all()


@pytest.mark.parametrize("solver", ["superlu", pytest.param("amg", marks=pytest.mark.slow)])
def test_linear_solvers_give_the_same_cell(solver):
    state = MacroState.single(np.diag([0.01, -0.06, 0.0]), 0.05)
    results = []
    for name in ("auto", solver):
        backend = SkfemCellSolver(solver=name)
        results.append(backend.solve(backend.prepare(Cell(mesh=COARSE)), state).response)
    np.testing.assert_allclose(results[1].stress, results[0].stress, atol=1e-9)
    np.testing.assert_allclose(
        results[1].tangent.mean_grad_grad_u, results[0].tangent.mean_grad_grad_u, atol=1e-7
    )


@pytest.mark.parametrize("kind", ["pardiso", "superlu"])
def test_inertia(kind):
    """The factors count negative eigenvalues, which is how an indefinite tangent is noticed."""
    rng = np.random.default_rng(0)
    n = 30
    A = rng.normal(size=(n, n))
    A = A + A.T
    indptr = np.array([0, *np.cumsum(np.arange(n, 0, -1))], dtype=np.int32)
    indices = np.concatenate([np.arange(i, n) for i in range(n)]).astype(np.int32)
    data = A[np.triu_indices(n)]
    if kind == "pardiso":
        assert library() is not None
        factor = PardisoFactor(indptr, indices)
    else:
        A = A @ A + np.diag(np.where(np.arange(n) % 3 == 0, -500.0, 500.0))
        data = A[np.triu_indices(n)]
        factor = SuperLUFactor(indptr, indices)
    np.testing.assert_allclose(SymmetricPattern(indptr, indices).full(data).toarray(), A)
    factor.factor(data)
    assert factor.negative == (np.linalg.eigvalsh(A) < 0).sum()
    rhs = rng.normal(size=(n, 2))
    np.testing.assert_allclose(factor.solve(rhs), np.linalg.solve(A, rhs), rtol=2e-2, atol=1e-4)


def test_conjugate_gradients_notice_negative_curvature():
    A = np.diag([1.0, 2.0, -1.0])
    solved = conjugate_gradients(A.dot, np.ones(3), lambda r: r, tolerance=1e-10)
    assert solved.indefinite
    assert not solved.converged


def test_columns_of_a_group_share_their_space():
    """Six small eigenvalues of 300: eight columns meet them together, and a ninth one goes as if it were alone."""
    rng = np.random.default_rng(0)
    # Smaller ones still would make the number of iterations a matter of round-off.
    values = np.concatenate([np.geomspace(1e-3, 0.1, 6), np.linspace(1, 2, 294)])
    rotation = np.linalg.qr(rng.normal(size=(300, 300)))[0]
    A, rhs = rotation * values @ rotation.T, rng.normal(size=(300, 9))
    group = np.array([0] * 8 + [1])

    def together(columns):
        return block_conjugate_gradients(
            A.dot, rhs[:, columns], np.copy, group=group[columns], tolerance=1e-11
        )

    solved = together(range(8))
    np.testing.assert_allclose(A @ solved.x, rhs[:, :8], atol=1e-9)
    alone = conjugate_gradients(A.dot, rhs[:, :8], np.copy, tolerance=1e-11)
    assert alone.iterations > 1.5 * solved.iterations
    last = conjugate_gradients(A.dot, rhs[:, 8], np.copy, tolerance=1e-11)
    assert abs(together(range(9)).iterations - last.iterations) <= 2
    np.testing.assert_allclose(A @ together(range(9)).x, rhs, atol=1e-9)


@pytest.mark.parametrize("least", [1.0, -1.0])
@pytest.mark.parametrize("columns", ["independent", "dependent", "zero"])
def test_a_group_of_any_columns_is_solved_for_or_found_indefinite(columns, least):
    A = np.diag([least, 2.0, 3.0, 4.0, 5.0, 6.0])
    rhs = np.random.default_rng(0).normal(size=(6, 3))
    rhs[:, 1] = {"independent": rhs[:, 1], "dependent": 2 * rhs[:, 0], "zero": 0}[columns]
    solved = block_conjugate_gradients(A.dot, rhs, np.copy, group=np.array([0, 0, 1]), tolerance=1e-10)
    assert (solved.converged, solved.indefinite) == (least > 0, least < 0)
    if solved.converged:
        np.testing.assert_allclose(solved.x, np.linalg.solve(A, rhs), atol=1e-9)


def test_options_are_checked():
    with pytest.raises(ConfigurationError, match="quadrature_degree"):
        SkfemCellSolver(quadrature_degree="four")
    with pytest.raises(ConfigurationError, match="unknown key 'quadrature'"):
        SkfemCellSolver(quadrature=2)
    backend = SkfemCellSolver(solver="cholesky")
    prepared = backend.prepare(Cell(mesh=COARSE))
    with pytest.raises(ConfigurationError, match="auto, pardiso, superlu or amg"):
        backend.solve_one(prepared, np.zeros((3, 3)))


def test_an_indefinite_tangent_is_reported():
    """Under p = −3 the undeformed solid's tangent has λ + pJ < 0, whatever the state is that holds it there."""
    problem = SkfemSolid(
        Cell(mesh=COARSE).make_mesh("solid", "eighth"), NeoHookean(), degree=2, solver="auto"
    )
    still = problem.iterate_at(np.zeros((3, 3)), 0.0)
    problem.reset()
    assert respond(problem, still, tangent=False).status[0] == Status.converged
    held = problem.iterate_at(still.H, -3.0)
    response = respond(problem, held, tangent=False)
    assert response.status[0] == Status.unstable
    assert response.extrema.negative_pivots[0] > 0
    assert np.isfinite(response.stress).all()


@pytest.mark.parametrize("solver", ["auto", "superlu", "amg"])
def test_a_shear_mode_of_the_eighth_makes_a_state_unstable(solver):
    """At r = 0.4 the thin struts lose their stability in a shear mode that the diagonal classes do not see."""
    backend = SkfemCellSolver(solver=solver)
    cell = Cell(geometry=OrthogonalChannels(radius=0.4), mesh=COARSE)
    response = backend.solve(backend.prepare(cell), compressed(0.26)).response
    assert response.status[0] == Status.unstable
    assert response.extrema.negative_pivots[0] >= 1
    assert np.isfinite(response.stress).all()
    shear = response.tangent.mean_grad_grad_u[0, 0, 1, 0, 1]
    if (
        solver == "amg"
    ):  # conjugate gradients cannot solve an indefinite system: no number rather than a wrong one
        assert np.isnan(shear)
    else:
        assert shear == pytest.approx(0.2143, abs=2e-4)


def test_sensitivities_that_do_not_converge_are_a_failed_state(monkeypatch):
    """Values without their derivatives are no response: the row is NaN with its status."""
    monkeypatch.setattr(
        constraints,
        "refine",
        lambda matrix, rhs, solve, **how: Iteration(
            np.zeros_like(rhs), 30, converged=False, indefinite=False
        ),
    )
    solver = SkfemCellSolver()
    prepared = solver.prepare(Cell(mesh=COARSE))
    assert solver.solve(prepared, compressed(0.05), tangent=False).response.status == Status.converged
    failed = solver.solve(prepared, compressed(0.05)).response
    assert failed.status == Status.not_converged
    assert np.isnan(failed.stress).all()
    assert np.isnan(failed.tangent.stress_grad_u).all()
