"""The iteration for large bodies, on small ones, against factors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from porocore.errors import ConfigurationError, SolveError
from porocore.macro.integration.discretisation import StepFailed
from porocore.macro.problem import MacroProblem
from porocore.testing.synthetic.response import GradientLaw, linear_law, mean_gradient_law
from porocore_fem_skfem import macro_linear, macro_preconditioner
from porocore_fem_skfem import macro_linear as macro_iterative
from porocore_fem_skfem.factor import check_symmetric
from porocore_fem_skfem.macro import SkfemMacroSolver
from porocore_fem_skfem.macro_linear import flexible_gmres

NONLINEAR = mean_gradient_law()
WEDGE = {"kind": "wedge", "radius": 1, "height": 0.7, "elements": (3, 3, 2), "angle": 60}
PLANES = {"oblique": {"normal": 0}, "z-": {"normal": 0}, "y-": {"normal": 0}}
ROLLERS = {"x-": {"normal": 0}, "z-": {"normal": 0}}
CUBE = {"size": (1, 1, 1), "elements": (4, 4, 4)}
HELD = {"y-": {"displacement": (0, 0, 0)}}
PROBLEMS = {
    "traction": {
        "body": CUBE,
        "boundary": {**ROLLERS, **HELD, "y+": {"traction": (0, -0.05, 0), "pressure": 0}},
    },
    "follower": {"body": CUBE, "boundary": {**HELD, "y+": {"follower": 0.05, "pressure": 0}}},
    "oblique": {"body": WEDGE, "boundary": {**PLANES, "y+": {"traction": (0, -0.05, 0), "pressure": 0}}},
    "plate": {"body": WEDGE, "boundary": {**PLANES, "y+": {"plate": -0.03}, "side": {"pressure": 0}}},
    "moved": {
        "body": CUBE,
        "boundary": {**ROLLERS, **HELD, "y+": {"displacement": (None, -0.02, None)}, "x+": {"pressure": 0}},
    },
}
TIME = {"end": 0.4, "step": 0.1, "ramp_increments": 2, "ramp_step": 0.1, "profiles": ()}


def problem(name, **settings):
    return MacroProblem.model_validate({**PROBLEMS[name], "time": TIME, **settings})


def systems(name, dt, by=("iterative", "direct")):
    """Discretisations with each solver, a tangent at a deformed state, and a right-hand side."""
    bodies = [SkfemMacroSolver(solver=solver).prepare(problem(name)) for solver in by]
    d, rng = bodies[0], np.random.default_rng(0)
    coarse = d.from_mesh(
        np.concatenate([(0.05 * d.mesh.points**2).ravel(), np.full(len(d.mesh.p_nodes), 0.01)])
    )
    states, grad_p = d.states(coarse)
    tangent = NONLINEAR.respond(states, grad_p, NONLINEAR.initial(len(states))).tangent
    system = d.coupled(tangent, dt, coarse, d.loads(1.0)).system
    return bodies, system, rng.standard_normal(d.mesh.size), rng.standard_normal(len(d.prescribed))


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_system_is_solved_as_by_a_factor(name):
    (iterative, direct), system, right, jump = systems(name, 0.1)
    found = iterative.solve(system, right, jump, accuracy=1e-10)
    expected = direct.solve(system, right, jump)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * abs(expected).max())
    work, notes = iterative.linear.take()
    assert (work.systems, work.set_ups, notes) == (1, 1, ())
    assert 3 < work.iterations <= 40


@pytest.mark.parametrize("dt", [1e-6, 1e-2, 1e2])
def test_iterations_do_not_depend_on_the_time_step(dt):
    (d,), system, right, jump = systems("traction", dt, by=("iterative",))
    d.solve(system, right, jump, accuracy=1e-8)
    assert d.linear.take()[0].iterations <= 25


@pytest.mark.parametrize(
    ("body", "most"),
    [
        (CUBE, 25),
        ({"size": (0.1, 7.5, 0.1), "elements": (1, 40, 1)}, 25),
        ({"size": (1, 0.1, 1), "elements": (4, 4, 4)}, 40),
        ({"kind": "wedge", "radius": 1, "height": 1, "elements": (6, 6, 1), "angle": 15}, 40),
    ],
    ids=["cube", "column", "flat", "wedge"],
)
@pytest.mark.parametrize("dt", [1e-6, 1e-2, 1e2])
def test_iterations_stand_contrast_and_stretched_elements(body, most, dt):
    """Conductivities that differ by 10⁴ at random, elements of 1:10, a wedge of 15°."""
    planes = PLANES if "kind" in body else ROLLERS
    boundary = {**planes, **HELD, "y+": {"traction": (0, -1, 0), "pressure": 0}}
    data = {"body": body, "boundary": boundary, "time": TIME}
    d = SkfemMacroSolver(solver="iterative").prepare(MacroProblem.model_validate(data))
    rng = np.random.default_rng(0)
    states, grad_p = d.states(np.zeros(d.mesh.size))
    tangent = NONLINEAR.respond(states, grad_p, NONLINEAR.initial(len(states))).tangent
    contrast = 10 ** rng.uniform(-2, 2, len(d.mesh.cells)).repeat(d.n_points // len(d.mesh.cells))
    tangent = replace(tangent, flux_grad_p=tangent.flux_grad_p * contrast[:, None, None])
    right = rng.standard_normal(d.mesh.size)
    d.solve(d.system(tangent, dt), right, np.zeros(len(d.prescribed)), accuracy=1e-8)
    work, notes = d.linear.take()
    assert not notes
    assert work.iterations <= most


def test_multigrid_on_the_linear_level_does_as_well_as_a_factor(monkeypatch):
    monkeypatch.setattr(macro_preconditioner, "FACTORED", 0)
    monkeypatch.setattr(macro_preconditioner, "COARSEST", 20)
    (d,), system, right, jump = systems("traction", 0.1, by=("iterative",))
    d.solve(system, right, jump, accuracy=1e-8)
    assert d.linear.take()[0].iterations <= 25


@pytest.mark.parametrize(
    "law",
    [NONLINEAR, linear_law(), GradientLaw(NONLINEAR)],
    ids=["nonlinear", "linear", "gradient"],
)
@pytest.mark.parametrize("name", ["traction", "moved", "plate"])
def test_a_march_ends_as_with_factors(name, law):
    by = {}
    for solver in ("iterative", "direct"):
        body = SkfemMacroSolver(solver=solver)
        by[solver] = body.solve(body.prepare(problem(name)), law)
    for field in ("u", "p"):
        mine, other = (getattr(by[solver].profiles[-1], field) for solver in ("iterative", "direct"))
        np.testing.assert_allclose(mine, other, rtol=0, atol=1e-8 * abs(other).max())
    work = by["iterative"].work
    if law.constant_tangent:
        np.testing.assert_array_equal(by["iterative"].history.iterations[1:], 1)
    assert work["set_ups"].sum() <= 2 < work["systems"].sum()
    assert (work["iterations"][1:] > 0).all()
    assert "preconditioned iteration (macro.options.solver = iterative)" in by["iterative"].linear_solver
    assert (by["direct"].work["iterations"] == 0).all()
    assert (by["direct"].work["seconds"][1:] > 0).all()


def test_a_killed_run_continues_to_the_same_solution(tmp_path):
    """To the tolerance of Newton's method: a preconditioner that was kept is made anew."""
    solver = SkfemMacroSolver(solver="iterative", checkpoint_seconds=0)
    prepared, file = solver.prepare(problem("traction")), tmp_path / "macro.h5"
    whole = solver.solve(prepared, NONLINEAR)

    def killed(report):
        if report.time > 0.15:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solver.solve(prepared, NONLINEAR, checkpoint=file, on_step=killed)
    resumed = solver.solve(prepared, NONLINEAR, checkpoint=file)
    np.testing.assert_array_equal(resumed.history.time, whole.history.time)
    np.testing.assert_array_equal(resumed.history.iterations, whole.history.iterations)
    largest = abs(whole.profiles[-1].u).max()
    np.testing.assert_allclose(resumed.profiles[-1].u, whole.profiles[-1].u, rtol=0, atol=1e-8 * largest)
    assert len(resumed.work["systems"]) == len(whole.history.time)
    # What was solved before on the same body does not matter.
    again = solver.solve(prepared, NONLINEAR)
    np.testing.assert_array_equal(again.profiles[-1].u, whole.profiles[-1].u)


def test_a_factor_takes_over_where_the_iteration_stagnates(monkeypatch):
    notes = []
    monkeypatch.setattr(macro_iterative, "LIMIT", 2)
    solver = SkfemMacroSolver(solver="iterative")
    solution = solver.solve(
        solver.prepare(problem("traction")), NONLINEAR, on_step=lambda report: notes.extend(report.notes)
    )
    direct = SkfemMacroSolver(solver="direct")
    expected = direct.solve(direct.prepare(problem("traction")), NONLINEAR)
    u = expected.profiles[-1].u
    np.testing.assert_allclose(solution.profiles[-1].u, u, rtol=0, atol=1e-8 * abs(u).max())
    assert "of the residual after 2 steps; a direct factorisation takes about" in notes[0]
    assert notes[0].endswith("is used instead")
    # After so many systems it is not tried again.
    assert len(notes) == macro_linear.MOST_FAILURES < solution.work["systems"].sum()


def test_without_memory_for_a_factor_stagnation_is_an_error_that_says_what_to_try(monkeypatch):
    monkeypatch.setattr(macro_iterative, "LIMIT", 2)
    monkeypatch.setattr(macro_linear, "available_bytes", lambda: 1.0)
    solver = SkfemMacroSolver(solver="iterative")
    stiff = problem("traction", time={**TIME, "smallest_step": 0.06})
    with pytest.raises(
        SolveError, match=r"after 2 steps; a direct factorisation takes about .* are free. Use elements"
    ):
        solver.solve(solver.prepare(stiff), NONLINEAR)


def test_entries_that_vanish_stay_in_the_pattern_of_a_factor():
    lopsided = sparse.csr_matrix(np.array([[2.0, 1, 0], [0, 3, 0], [0, 5, 0]]))
    found = macro_preconditioner._with_symmetric_pattern(lopsided)
    np.testing.assert_array_equal(found.toarray(), lopsided.toarray())
    check_symmetric(found.indptr, found.indices)


def test_a_tangent_without_a_preconditioner_is_left_to_the_factor(monkeypatch):
    """Whose group of nodes is singular; the factor says that there is no solution."""
    (d,), system, right, jump = systems("traction", 0.1, by=("iterative",))
    system.uu[:] = 0.0
    with pytest.raises(StepFailed, match="singular"):
        d.solve(system, right, jump)
    (note,) = d.linear.take()[1]
    assert "left inf of the residual after 0 steps" in note


def test_a_body_that_can_turn_is_an_error():
    boundary = {
        "y-": {"displacement": (0, None, None), "pressure": 0},
        "x-": {"displacement": (None, 0, None)},
        "z-": {"displacement": (None, None, 0)},
        "x+": {"traction": (0, 1, 0)},
    }
    turning = MacroProblem.model_validate(
        {"body": CUBE, "boundary": boundary, "load": 1e-3, "time": {**TIME, "smallest_step": 0.06}}
    )
    solver = SkfemMacroSolver(solver="iterative")
    with pytest.raises(SolveError):
        solver.solve(solver.prepare(turning), NONLINEAR)


def test_the_solver_is_chosen_by_size_and_by_the_user(monkeypatch):
    def choice(solver):
        return SkfemMacroSolver(solver=solver).prepare(problem("traction")).linear.choice

    assert "direct factor (up to 20,000)" in choice("auto")
    monkeypatch.setattr(macro_linear, "ABOVE", 10)
    assert "preconditioned iteration (more than 10)" in choice("auto")
    assert "direct factor (macro.options.solver = direct)" in choice("direct")
    monkeypatch.setattr(macro_linear.pardiso, "library", lambda: None)
    assert "up to 5,000, without MKL" in choice("auto")
    with pytest.raises(
        ConfigurationError, match=r"macro\.options\.solver: expected auto, direct or iterative, got 'fast'"
    ):
        SkfemMacroSolver(solver="fast")


def test_gmres_restarts_and_ends_at_round_off(monkeypatch):
    from porocore_fem_skfem import macro_linear as krylov

    rng = np.random.default_rng(1)
    A = np.eye(60) + 0.02 * rng.standard_normal((60, 60))
    b = rng.standard_normal(60)
    expected = np.linalg.solve(A, b)
    for restart in (80, 4):
        monkeypatch.setattr(krylov, "RESTART", restart)
        found = flexible_gmres(lambda x: A @ x, b, lambda r: r, accuracy=1e-10, limit=200)
        assert found.reached(1e-10)
        np.testing.assert_allclose(found.x, expected, atol=1e-9)
    tight = flexible_gmres(lambda x: A @ x, b, lambda r: r, accuracy=1e-30, limit=200)
    assert not tight.reached(1e-30)
    assert tight.reduction < 1e-13
    singular = A.copy()
    singular[0] = 0
    assert not flexible_gmres(lambda x: singular @ x, b, lambda r: r, accuracy=1e-10, limit=200).reached(
        1e-10
    )
    broken = flexible_gmres(lambda x: x * np.nan, b, lambda r: r, accuracy=1e-10, limit=200)
    assert not broken.reached(1e-10)
    none = flexible_gmres(lambda x: A @ x, 0 * b, lambda r: r, accuracy=1e-10, limit=200)
    assert replace(none, x=0) == replace(none, x=0, iterations=0, reduction=0.0)
