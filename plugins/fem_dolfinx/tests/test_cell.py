"""What is special about the dolfinx cell solver; tests/consistency holds it against the others."""

import subprocess
import sys
import textwrap

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import block_diag

from porocore.cell.cell import Cell
from porocore.cell.equilibrium.discrete import FactorError
from porocore.cell.equilibrium.responses import respond
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.meshing.mesh import MeshSettings
from porocore.errors import ConfigurationError
from porocore.states import MacroState, Status
from porocore_fem_dolfinx import cell_mesh as condensation
from porocore_fem_dolfinx import cell_mesh as solid_space
from porocore_fem_dolfinx import compat, linalg
from porocore_fem_dolfinx.cell_solver import DolfinxCellSolver

COARSE = MeshSettings(size=0.2, fluid_size=0.14)
STATE = MacroState.single(np.diag([0.01, -0.06, 0.0]), 0.05)
DIRECT = ("mumps", "cholmod")


@pytest.fixture(scope="module")
def mumps():
    backend = DolfinxCellSolver(solver="mumps")
    return backend.solve(backend.prepare(Cell(mesh=COARSE)), STATE).response


@pytest.mark.parametrize("solver", ["auto", "cholmod", "gamg"])
def test_linear_solvers_give_the_same_cell(mumps, solver):
    backend = DolfinxCellSolver(solver=solver)
    response = backend.solve(backend.prepare(Cell(mesh=COARSE)), STATE).response
    np.testing.assert_allclose(response.stress, mumps.stress, atol=1e-10)
    np.testing.assert_allclose(response.tangent.mean_grad_grad_u, mumps.tangent.mean_grad_grad_u, atol=1e-9)


def test_petsc_options_of_the_user_go_first(mumps):
    """A preconditioner of one's own, with an iteration around it."""
    backend = DolfinxCellSolver(petsc={"ksp_type": "cg", "pc_type": "bjacobi", "ksp_max_it": 5000})
    prepared = backend.prepare(Cell(mesh=COARSE))
    response = backend.solve(prepared, STATE, tangent=False).response
    np.testing.assert_allclose(response.stress, mumps.stress, atol=1e-10)
    assert response.extrema.negative_pivots[0] == -1


@pytest.mark.parametrize("solver", DIRECT)
def test_an_indefinite_tangent_is_reported(solver):
    """Under p = −3 the undeformed solid's tangent has λ + pJ < 0, whatever the state is that holds it there."""
    cell = Cell(mesh=COARSE)
    problem = DolfinxCellSolver(solver=solver).solid(cell, cell.make_mesh("solid", "eighth"))
    problem.reset()
    still = problem.iterate_at(np.zeros((3, 3)), 0.0)
    assert respond(problem, still, tangent=False).status[0] == Status.converged
    held = problem.iterate_at(still.H, -3.0)
    response = respond(problem, held, tangent=False)
    assert response.status[0] == Status.unstable
    assert response.extrema.negative_pivots[0] > 0
    assert np.isfinite(response.stress).all()


@pytest.mark.parametrize("solver", [*DIRECT, "gamg"])
def test_a_shear_mode_of_the_eighth_makes_a_state_unstable(solver):
    """At r = 0.4 the thin struts lose their stability in a shear mode that the diagonal classes do not see."""
    backend = DolfinxCellSolver(solver=solver)
    cell = Cell(geometry=OrthogonalChannels(radius=0.4), mesh=COARSE)
    state = MacroState.single(np.diag([0.0, -0.26, 0.0]))
    response = backend.solve(backend.prepare(cell), state).response
    assert response.status[0] == Status.unstable
    assert np.isfinite(response.stress).all()
    shear = response.tangent.mean_grad_grad_u[0, 0, 1, 0, 1]
    if solver == "mumps":
        assert shear == pytest.approx(0.2143, abs=2e-4)
    else:  # these cannot solve an indefinite system: no number rather than a wrong one
        assert np.isnan(shear)


@pytest.mark.parametrize("solver", DIRECT)
def test_inertia(solver):
    rng = np.random.default_rng(0)
    A = sparse.random(400, 400, 0.02, random_state=1)
    shift = np.where(np.arange(400) % 100 == 7, -40.0, 40.0)
    A = sparse.csr_matrix(A + A.T + sparse.diags(shift))
    factor = linalg.SymmetricSolver(solver, {}, 400)
    factor.use(condensation.to_petsc(A))
    assert factor.negative == (4 if solver == "mumps" else 1)
    definite = sparse.csr_matrix(A + sparse.diags(100.0 * (shift < 0)))
    factor.use(condensation.to_petsc(definite))
    assert factor.negative == 0
    rhs = rng.normal(size=400)
    np.testing.assert_allclose(definite @ factor.solve(rhs), rhs, atol=1e-10)


@pytest.mark.parametrize("solver", [*DIRECT, "gamg"])
def test_a_singular_matrix_is_an_error_of_its_own(solver):
    A = sparse.csr_matrix(block_diag(np.eye(4), [[1.0, -1.0], [-1.0, 1.0]]))
    factor = linalg.SymmetricSolver(solver, {}, 6)

    def solve():
        factor.use(condensation.to_petsc(A))
        if factor.negative > 0:  # round-off has made it indefinite, which is as true
            raise FactorError("indefinite")
        factor.solve(np.arange(6.0))

    with pytest.raises(FactorError):
        solve()


def test_a_cell_that_cannot_be_factorised_is_a_status(monkeypatch):
    """Nothing holds the whole cell against translations, and the options refuse to pivot."""
    monkeypatch.setattr(
        solid_space, "held_displacements", lambda mesh, odd: np.zeros((len(mesh.points), 3), bool)
    )
    monkeypatch.setattr(linalg.SymmetricSolver, "use", _breaks_down)
    backend = DolfinxCellSolver()
    response = backend.solve(backend.prepare(Cell(mesh=COARSE, symmetry="none")), STATE).response
    assert response.status[0] == Status.not_converged
    assert np.isnan(response.stress).all()


def _breaks_down(self, matrix, accuracy=0.0):
    raise FactorError("MUMPS ended with error -10")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"quadrature": 2}, "unknown key 'quadrature'"),
        ({"quadrature_degree": 0}, "quadrature_degree: expected an integer from 1 to 12, got 0"),
        ({"solver": "pardiso"}, "solver: expected auto, mumps, cholmod or gamg, got 'pardiso'"),
        ({"petsc": ["ksp_type"]}, "petsc: expected PETSc options such as"),
    ],
)
def test_options_are_checked_at_once(options, message):
    with pytest.raises(ConfigurationError, match=message):
        DolfinxCellSolver(**options)


@pytest.mark.parametrize(
    ("petsc", "message"),
    [
        ({"ksp_tipe": "cg"}, "PETSc makes no use of ksp_tipe"),
        ({"pc_type": "hyper"}, "Unable to find requested PC type hyper"),
        ({"ksp_type": "cg", "ksp_rtol": "small"}, "Input string small has no numeric value"),
        ({"pc_factor_mat_solver_type": "pardiso"}, "solver type pardiso"),
        ({"ksp_type": [1]}, r"expected PETSc options such as 'ksp_type: cg', got 'ksp_type': \[1\]"),
    ],
)
def test_petsc_options_that_do_not_exist(petsc, message):
    backend = DolfinxCellSolver(petsc=petsc)
    with pytest.raises(ConfigurationError, match=message) as caught:
        backend.solve(backend.prepare(Cell(mesh=COARSE)), STATE)
    assert str(caught.value).startswith("fem.options.petsc: ")
    assert "\n" not in str(caught.value)


def test_nothing_is_compiled_after_the_first_state(monkeypatch):
    backend = DolfinxCellSolver()
    prepared = backend.prepare(Cell(mesh=COARSE))
    backend.solve(prepared, STATE)
    monkeypatch.setattr(compat.dolfinx.jit, "ffcx_jit", None)
    states = MacroState(np.stack([np.diag([0.02, -0.03, 0.01]), np.diag([0, -0.05, 0])]), np.array([0.1, 0]))
    assert (backend.solve(prepared, states).response.status == Status.converged).all()


@pytest.mark.parametrize(
    "code",
    [
        "import porocore, porocore.plugins.registry; porocore.plugins.registry.plugins_table(); import h5py",
        "import porocore_fem_dolfinx.cell_solver; import h5py",
        "import h5py; import porocore_fem_dolfinx.cell_solver",
        "from porocore.plugins.registry import registry; registry().get('macro solver', 'dolfinx'); import h5py",
    ],
)
def test_h5py_works_in_any_order(tmp_path, code):
    script = code + textwrap.dedent(
        """
        import sys
        with h5py.File(sys.argv[1], "w") as file:
            file["a"] = [1.0, 2.0]
            file.attrs["text"] = "µ"
        """
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "a.h5")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""


def test_many_solvers_fit_into_petscs_database():
    """It holds 512 options, and a solver brings several; what was told once is not told again."""
    for _ in range(300):
        linalg.SymmetricSolver("gamg", {"ksp_rtol": 1e-9}, 10)


def test_petsc_lists_no_option_of_ours_at_its_end():
    script = textwrap.dedent(
        """
        from porocore_fem_dolfinx import linalg, petsc_options

        petsc_options.PETSc.Options().setValue("options_left", True)
        petsc_options.PETSc.Options().setValue("of_the_user", 1)
        linalg.SymmetricSolver("gamg", {"ksp_rtol": 1e-9}, 10)
        """
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "of_the_user" in done.stdout + done.stderr
    assert "porocore_" not in done.stdout + done.stderr
