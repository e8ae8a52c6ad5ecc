"""Linear solvers of the macro problem and of the cell: what is checked before a native library sees it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from porocore.cell.equilibrium.discrete import FactorError
from porocore.macro.boundary.conditions import boundary_data
from porocore.macro.integration.discretisation import StepFailed
from porocore.macro.linear_systems import LinearWork
from porocore.macro.problem import Boundary, MacroProblem, body_mesh
from porocore.testing.macro_checks.runs import NONLINEAR
from porocore.testing.synthetic.response import GradientLaw, confined_column
from porocore_fem_skfem import macro_linear, pardiso
from porocore_fem_skfem.factor import OutOfMemoryError, SingularError
from porocore_fem_skfem.linalg import SuperLUFactor, refine
from porocore_fem_skfem.macro import SkfemMacroSolver
from porocore_fem_skfem.macro_assembly import SkfemDiscretisation
from porocore_fem_skfem.macro_small import SmallSystem

#: Row pointers and columns of a symmetric pattern, and of its upper triangle.
WHOLE = ([0, 2, 5, 7], [0, 1, 0, 1, 2, 1, 2])
UPPER = ([0, 2, 4, 5], [0, 1, 1, 2, 2])
GENERAL = {
    "unsorted": (([0, 2, 5, 7], [1, 0, 0, 1, 2, 1, 2]), "row 0, column 0 does not come after"),
    "twice": (([0, 2, 5, 7], [0, 1, 0, 1, 1, 1, 2]), "row 1, column 1 does not come after"),
    "outside": (([0, 2, 5, 7], [0, 1, 0, 1, 3, 1, 2]), "row 1, column 3 lies outside the 3 columns"),
    "negative": (([0, 2, 5, 7], [-1, 1, 0, 1, 2, 1, 2]), "row 0, column -1 lies outside"),
    "pointers": (([0, 2, 5, 9], [0, 1, 0, 1, 2, 1, 2]), "row pointers: expected to ascend from 0 to the 7"),
    "falling": (([0, 5, 2, 7], [0, 1, 0, 1, 2, 1, 2]), "row pointers: expected to ascend"),
    "no rows": (([0], []), "CSR: 0 rows"),
    "no mirror image": (([0, 2, 4, 6], [0, 1, 1, 2, 0, 2]), "row 0, column 1 has no mirror image"),
    "lopsided": (([0, 2, 4, 6], [0, 1, 0, 1, 1, 2]), "row 1 has not as many entries"),
    "no diagonal": (([0, 1, 3, 4], [1, 0, 2, 1]), "row 0 has no entry on the diagonal"),
}
TRIANGLE = {
    "below": (WHOLE, "row 1, column 0 lies below the diagonal"),
    "no diagonal": (([0, 2, 3, 4], [0, 1, 2, 2]), "row 1 has no entry on the diagonal"),
    "empty row": (([0, 2, 2, 3], [0, 1, 2]), "row 1 has no entry on the diagonal"),
    "outside": (([0, 2, 4, 5], [0, 1, 1, 2, 7]), "row 2, column 7 lies outside"),
    "too short": (([0, 2, 4, 5], [0, 1, 1, 2]), "row pointers"),
}


def arrays(pattern):
    return tuple(np.array(part, dtype=np.int32) for part in pattern)


def upper_factors():
    return {
        "pardiso": lambda pattern: pardiso.PardisoFactor(*arrays(pattern)),
        "superlu": lambda pattern: SuperLUFactor(*arrays(pattern)),
    }


@pytest.mark.parametrize("fault", GENERAL)
def test_a_wrong_pattern_is_refused_before_pardiso_sees_it(fault):
    pattern, message = GENERAL[fault]
    with pytest.raises(ValueError, match=message):
        pardiso.GeneralFactor(*arrays(pattern), single=False)


@pytest.mark.parametrize("kind", ["pardiso", "superlu"])
@pytest.mark.parametrize("fault", TRIANGLE)
def test_a_wrong_triangle_is_refused_by_every_solver(kind, fault):
    pattern, message = TRIANGLE[fault]
    with pytest.raises(ValueError, match=message):
        upper_factors()[kind](pattern)


@pytest.mark.parametrize("kind", ["pardiso", "superlu"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_what_is_not_finite_is_refused(kind, bad):
    """1e300 is finite, but not in the single precision of PARDISO's factor."""
    factor = upper_factors()[kind](UPPER)
    data = np.array([4.0, 1.0, 4.0, 1.0, 4.0])
    if not (kind == "superlu" and bad == 1e300):
        with pytest.raises(FactorError, match="the matrix is not finite"):
            factor.factor(np.where(np.arange(5) == 2, bad, data))
        factor.factor(data)
        with pytest.raises(FactorError, match="the right-hand side is not finite"):
            factor.solve(np.array([1.0, bad, 0.0]))
    factor.factor(data)
    for wrong in (np.ones(4), np.ones((4, 2)), np.ones((3, 2, 2))):
        with pytest.raises(ValueError, match="right-hand side: expected an array of shape"):
            factor.solve(wrong)
    with pytest.raises(ValueError, match="matrix: expected an array of shape"):
        factor.factor(np.ones(4))
    A = np.array([[4, 1, 0], [1, 4, 1], [0, 1, 4.0]])
    np.testing.assert_allclose(A @ factor.solve(np.arange(3.0)), np.arange(3.0), atol=1e-6)


def test_there_is_nothing_to_solve_with_before_a_factorisation():
    with pytest.raises(FactorError, match="there is no factor"):
        pardiso.GeneralFactor(*arrays(WHOLE), single=False).solve(np.ones(3))


@pytest.mark.parametrize(
    ("code", "kind", "text"),
    [
        (-2, OutOfMemoryError, "error -2: there is not enough memory for the factor"),
        (-3, FactorError, "error -3: no ordering of the unknowns was found"),
        (-4, SingularError, "error -4: a pivot vanished"),
        (-99, FactorError, "error -99: an internal error"),
    ],
)
def test_error_codes_of_pardiso_say_what_they_mean(monkeypatch, code, kind, text):
    class Broken:
        @staticmethod
        def pardiso(*arguments):
            arguments[-1]._obj.value = code

    factor = pardiso.GeneralFactor(*arrays(WHOLE), single=False)
    with monkeypatch.context() as patch:
        patch.setattr(pardiso, "library", Broken)
        with pytest.raises(kind, match=text) as caught:
            factor.factor(np.ones(7))
    assert ("supports" in str(caught.value)) is False
    assert type(caught.value) is kind


@pytest.mark.parametrize(
    ("error", "held"), [(SingularError("x"), True), (OutOfMemoryError("x"), False), (FactorError("x"), False)]
)
def test_only_of_a_singular_matrix_the_supports_are_blamed(monkeypatch, error, held):
    def broken(matrix):
        raise error

    monkeypatch.setattr(macro_linear, "superlu", broken)
    with pytest.raises(StepFailed) as caught:
        macro_linear.SparseLinearSolver(LinearWork()).solve(
            sparse.identity(3, format="csr"), np.ones(3), again=False
        )
    assert (macro_linear.NOT_HELD in str(caught.value)) == held


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_tangent_that_is_not_finite_fails_the_step(bad):
    matrix = sparse.identity(3, format="csr")
    matrix.data[1] = bad
    for A, b in ((matrix, np.ones(3)), (sparse.identity(3, format="csr"), np.array([1, bad, 0]))):
        with pytest.raises(StepFailed, match="the tangent or the residual is not finite"):
            macro_linear.SparseLinearSolver(LinearWork()).solve(A, b, again=False)


WEDGE = {"kind": "wedge", "radius": 1, "height": 0.7, "elements": (2, 2, 1), "angle": 60}
PLANES = {"oblique": {"normal": 0}, "z-": {"normal": 0}, "y-": {"normal": 0}}
PROBLEMS = {
    "follower": {
        "body": {"size": (1, 1, 1), "elements": (2, 2, 2)},
        "boundary": {"y-": {"displacement": (0, 0, 0)}, "y+": {"follower": 0.05, "pressure": 0}},
    },
    "oblique": {"body": WEDGE, "boundary": {**PLANES, "y+": {"traction": (0, -0.05, 0), "pressure": 0}}},
    "both": {"body": WEDGE, "boundary": {**PLANES, "y+": {"pressure": 0}, "side": {"follower": 0.05}}},
    "plate": {"body": WEDGE, "boundary": {**PLANES, "y+": {"plate": -0.03}, "side": {"pressure": 0}}},
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_tangent_has_the_pattern_that_pardiso_takes_and_both_solvers_agree(monkeypatch, name):
    """By PARDISO, as bodies of more than 3,000 unknowns are, and by SuperLU; in frames it is Q A Qᵀ."""
    d = SkfemMacroSolver().prepare(MacroProblem.model_validate(PROBLEMS[name]))
    rng = np.random.default_rng(0)
    x = 0.02 * rng.standard_normal(d.mesh.size)
    states, grad_p = d.states(x)
    tangent = NONLINEAR.respond(states, grad_p, NONLINEAR.initial(len(states))).tangent
    loads = d.loads(1.0)
    system = d.coupled(tangent, 0.3, x, loads).system
    matrix = d.equation_matrix(system)
    pardiso.GeneralFactor(matrix.indptr, matrix.indices, single=True)  # checks the pattern
    right, jump = rng.standard_normal(d.mesh.size), np.zeros(len(d.prescribed))
    by_superlu = d.solve(system, right, jump)
    monkeypatch.setattr(macro_linear, "SMALL", 0)
    np.testing.assert_allclose(
        d.solve(system, right, jump), by_superlu, rtol=0, atol=1e-7 * abs(by_superlu).max()
    )
    if d.rotation is not None:
        plain = SkfemMacroSolver().prepare(d.problem)
        plain.rotation = plain._frames = None
        surface = d.surface_tangent(x, loads, 0.3)
        cartesian = plain.system(tangent, 0.3, None if surface is None else surface.matrix)
        turned, straight = (sparse.bmat(d.matrices(parts)).toarray() for parts in (system, cartesian))
        Q = d.rotation.toarray()
        np.testing.assert_allclose(Q.T @ turned @ Q, straight, atol=1e-12)
        if name != "plate":  # whose equation is a sum of rows
            rows = d.free[:, None]
            np.testing.assert_array_equal(matrix.toarray(), turned[rows, rows.T])


def test_refinement_ends_where_round_off_does():
    """A nearly singular matrix with a solution of 1e9 for a right-hand side of 1: no residual of 1e-11 can be left."""
    vectors, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(40, 40)))
    values = np.geomspace(1e-9, 1e1, 40)
    matrix = sparse.csr_matrix((vectors * values) @ vectors.T)
    rhs = vectors[:, :2] + vectors[:, 5:7]

    def precise(r):
        return (vectors / values) @ (vectors.T @ r)

    solved = refine(matrix, rhs, precise, tolerance=1e-11)
    residual = np.linalg.norm(rhs - matrix @ solved.x, axis=0) / np.linalg.norm(rhs, axis=0)
    assert solved.converged
    assert (residual > 1e-11).any()  # it was not reached
    # A factor of another matrix leads nowhere, and that is not taken for round-off.
    other = np.linalg.inv((matrix + 1e-3 * sparse.eye(40)).toarray())
    assert not refine(matrix, rhs, lambda r: other @ r, tolerance=1e-11).converged


class Blocks(SkfemDiscretisation):
    largest_small = 0


@pytest.mark.parametrize("law", [NONLINEAR, GradientLaw(NONLINEAR)], ids=["plain", "gradient"])
@pytest.mark.parametrize("name", ["column", "bent", "drained", "pushed", "plate"])
def test_a_small_body_has_the_system_of_a_large_one(name, law):
    """Integrated into the equations at once and solved by a band, against blocks of nodes and SuperLU."""
    column = {"elements": 6} if name == "column" else {"elements": (2, 3, 1)}
    drained = {face: {"displacement": (0, None, 0), "pressure": 0} for face in ("x-", "x+")}
    boundary = {
        "drained": drained,
        "pushed": {"y+": {"displacement": (None, -0.1, None)}},
        "plate": {"y+": {"plate": -0.1}},
    }
    problem = confined_column(**column, size=(0.7, 1.1, 0.9))
    problem = problem.model_copy(
        update={
            "boundary": problem.boundary
            | {face: Boundary(**values) for face, values in boundary.get(name, {}).items()}
        }
    )
    mesh = body_mesh(problem)
    if name == "bent":
        x, y, z = mesh.points.T
        mesh = replace(
            mesh, points=np.stack([x, y + 0.1 * y**2 + 0.1 * x * y, z * (1 + 0.1 * y * x)], axis=1)
        )
    small, large = (
        kind(problem, mesh, boundary_data(mesh, problem)) for kind in (SkfemDiscretisation, Blocks)
    )
    assert small.shapes.alike == (name != "bent")
    rng = np.random.default_rng(0)
    x, right = np.zeros(mesh.size), rng.standard_normal(mesh.size)
    x[small.free] = 0.01 * rng.standard_normal(len(small.free))
    states, grad_p = small.states(x)
    tangent = law.respond(states, grad_p, law.initial(len(states))).tangent
    systems = small.system(tangent, 0.3), large.system(tangent, 0.3)
    assert isinstance(systems[0], SmallSystem)
    assert not isinstance(systems[1], SmallSystem)
    both = [d.equation_matrix(system).toarray() for d, system in zip((small, large), systems, strict=True)]
    np.testing.assert_allclose(both[0], both[1], rtol=0, atol=1e-13 * abs(both[1]).max())
    jump = -0.1 * small.loads(1.0).values
    for move in (jump, rng.standard_normal(len(jump))):  # the second moves what is held
        found, wanted = (
            d.solve(system, right, move) for d, system in zip((small, large), systems, strict=True)
        )
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9 * abs(wanted).max())
    if name == "plate":  # whose magnitudes may stand in any of its rows
        return
    sizes = [
        d.magnitudes(system, x)[small.free[small.leading]]
        for d, system in zip((small, large), systems, strict=True)
    ]
    np.testing.assert_allclose(sizes[0], sizes[1], rtol=1e-12)
