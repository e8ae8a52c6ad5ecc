"""Large bodies: the preconditioned iteration against MUMPS' factor, its counts, and what happens where it fails."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

if not find_spec("dolfinx"):
    pytest.skip("dolfinx is not installed", allow_module_level=True)

from porocore.errors import ConfigurationError, SolveError
from porocore.macro.problem import MacroProblem
from porocore.testing.macro_checks.runs import SHORT
from porocore.testing.synthetic.response import GradientLaw, confined_column, linear_law, mean_gradient_law
from porocore_fem_dolfinx import macro_assembly, macro_linear
from porocore_fem_dolfinx.macro import DolfinxMacroSolver

HELD = {"displacement": (0, 0, 0)}
TWO_STEPS = {"end": 0.1, "step": 0.05, "ramp_increments": 1, "ramp_step": 0.05, "profiles": ()}
BLOCK = confined_column(
    (3, 3, 3),
    load=-0.03,
    size=(1, 1, 1),
    time=TWO_STEPS,
    boundary={"y-": HELD, "x-": {"normal": 0}, "y+": {"traction": (0.1, 1, 0), "pressure": 0}},
)
FRAMES = MacroProblem.model_validate(
    {
        "body": {"kind": "wedge", "radius": 1, "height": 0.7, "elements": (3, 3, 2), "angle": 60},
        "boundary": {
            "oblique": {"normal": 0},
            "z-": {"normal": 0},
            "y-": {"displacement": (None, 0, None)},
            "y+": {"plate": -0.03},
            "side": {"pressure": 0, "follower": 0.01},
        },
        "time": SHORT,
    }
)
PROBLEMS = {"block": BLOCK, "frames, a plate and a follower": FRAMES}


def solve(problem, law, **options):
    solver, reports = DolfinxMacroSolver(**options), []
    solution = solver.solve(solver.prepare(problem), law, on_step=reports.append)
    return solution, reports


@pytest.mark.parametrize(
    "law",
    [linear_law(), mean_gradient_law(), GradientLaw(mean_gradient_law())],
    ids=["linear", "nonlinear", "gradient"],
)
@pytest.mark.parametrize("name", PROBLEMS)
def test_the_iteration_agrees_with_the_factor(name, law):
    expected, _ = solve(PROBLEMS[name], law, solver="direct")
    found, reports = solve(PROBLEMS[name], law, solver="iterative")
    mine, theirs = found.profiles[-1], expected.profiles[-1]
    np.testing.assert_allclose(mine.u, theirs.u, rtol=0, atol=1e-8 * abs(theirs.u).max())
    np.testing.assert_allclose(mine.p, theirs.p, rtol=0, atol=1e-8 * expected.history.pressure_max.max())
    assert "a preconditioned iteration" in found.linear_solver
    assert all(report.work.iterations > 0 and not report.notes for report in reports)
    # One hierarchy serves the march.
    assert sum(report.work.set_ups for report in reports) <= 2


@pytest.mark.parametrize("contrast", [0, 4], ids=["uniform", "contrast 1e4"])
def test_iterations_do_not_grow_over_eight_decades_of_time_steps(contrast):
    problem = confined_column(
        (6, 6, 6),
        size=(1, 1, 1),
        boundary={"y-": HELD, "x-": {"normal": 0}, "y+": {"traction": (0, 1, 0), "pressure": 0}},
    )
    d = DolfinxMacroSolver(solver="iterative").prepare(problem)
    law, x = mean_gradient_law(), np.zeros(len(d.unknowns))
    states, grad_p = d.states(x)
    response = law.respond(states, grad_p, law.initial(d.n_points))
    factor = np.where(np.random.default_rng(0).integers(0, 2, d.n_points), 10.0**contrast, 1.0)
    tangent = replace(response.tangent, flux_grad_p=factor[:, None, None] * response.tangent.flux_grad_p)
    right, counts = d.loads(1.0).external, []
    for dt in (1e-6, 1e-4, 1e-2, 1.0, 100.0):
        system = d.system(tangent, dt)
        d.linear.take()
        d.solve(system, right, np.zeros(len(d.prescribed)), accuracy=1e-8)
        counts.append(d.linear.take()[0].iterations)
    assert max(counts) <= 25
    assert max(counts) <= 2 * min(counts)


def test_a_factor_takes_over_where_the_iteration_does_not_converge():
    expected, _ = solve(BLOCK, mean_gradient_law(), solver="direct")
    found, reports = solve(BLOCK, mean_gradient_law(), solver="iterative", petsc={"ksp_max_it": 2})
    np.testing.assert_allclose(found.profiles[-1].u, expected.profiles[-1].u, rtol=0, atol=1e-10)
    assert not any(report.notes for report in reports[1:])


def test_a_stronger_smoother_comes_before_the_factor(monkeypatch):
    """A pace that no iteration keeps, then a limit that only the weaker one misses."""
    monkeypatch.setattr(macro_linear, "SLOW", 0.1)
    expected, _ = solve(BLOCK, mean_gradient_law(), solver="direct")
    found, reports = solve(BLOCK, mean_gradient_law(), solver="iterative")
    np.testing.assert_allclose(found.profiles[-1].u, expected.profiles[-1].u, rtol=0, atol=1e-9)
    assert reports[0].notes == ("the smoother of the iteration is made stronger: elements may be stretched",)
    assert all(report.work.iterations > 0 for report in reports)


def test_without_memory_for_a_factor_the_message_says_what_to_try(monkeypatch):
    monkeypatch.setattr(macro_linear, "available_bytes", lambda: 1e3)
    monkeypatch.setattr(macro_linear.MultigridSolver, "solve", lambda *_: (-3, 80))
    with pytest.raises(SolveError) as caught:
        solve(BLOCK, mean_gradient_law(), solver="iterative")
    message = str(caught.value)
    assert "does not converge in 80 steps, and a direct factor would take about" in message
    assert "macro.options.petsc" in message
    assert len(message.splitlines()) == 1


def test_an_iteration_that_is_wrong_is_noticed(monkeypatch):
    """PETSc says that it converged and the solution is none."""
    true = macro_linear.MultigridSolver.solve

    def lying(self, matrix, b, x, accuracy):
        outcome = true(self, matrix, b, x, accuracy)
        x.scale(np.nan)
        return outcome

    expected, _ = solve(BLOCK, mean_gradient_law(), solver="direct")
    monkeypatch.setattr(macro_linear.MultigridSolver, "solve", lying)
    found, reports = solve(BLOCK, mean_gradient_law(), solver="iterative")
    np.testing.assert_allclose(found.profiles[-1].u, expected.profiles[-1].u, rtol=0, atol=1e-10)
    assert "a direct factor takes over" in " ".join(reports[0].notes)


def test_a_body_that_is_not_held_ends_in_one_message():
    boundary = {
        "y-": {"displacement": (0, None, None), "pressure": 0},
        "x-": {"displacement": (None, 0, None)},
        "z-": {"displacement": (None, None, 0)},
        "x+": {"traction": (0, 1, 0)},
    }
    problem = confined_column(2, load=1e-3, size=(1, 1, 1), boundary=boundary, time=SHORT)
    with pytest.raises(SolveError, match=r"the macroscale step from t = 0 failed .* held against rigid"):
        solve(problem, linear_law(), solver="iterative")


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"solver": "wavelets"}, "macro.options.solver: expected auto, direct or iterative, got 'wavelets'"),
        (
            {"solver": "iterative", "petsc": {"fieldsplit_v_pc_type": "lu"}},
            "makes no use of fieldsplit_v_pc_type",
        ),
        (
            {"solver": "iterative", "petsc": {"fieldsplit_u_pc_type": "nonsense"}},
            "refuses .*fieldsplit_u_pc_type",
        ),
    ],
)
def test_options_that_cannot_be_used_are_refused(options, expected):
    with pytest.raises(ConfigurationError, match=rf"(?s){expected}"):
        DolfinxMacroSolver(**options).prepare(BLOCK)


def test_options_of_the_iteration_can_be_chosen():
    chosen = {"fieldsplit_u_mg_levels_ksp_max_it": 3}
    expected, plain = solve(BLOCK, mean_gradient_law(), solver="iterative")
    found, reports = solve(BLOCK, mean_gradient_law(), solver="iterative", petsc=chosen)
    np.testing.assert_allclose(found.profiles[-1].u, expected.profiles[-1].u, rtol=0, atol=1e-9)
    assert reports[0].work.iterations <= plain[0].work.iterations


@pytest.mark.parametrize(("threshold", "chosen"), [(10**6, "a direct factor"), (10, "a preconditioned")])
def test_the_size_decides(monkeypatch, threshold, chosen):
    monkeypatch.setattr(macro_assembly, "THRESHOLD", threshold)
    assert chosen in DolfinxMacroSolver().prepare(BLOCK).linear.choice
    options = DolfinxMacroSolver(petsc={"ksp_type": "gmres"}).prepare(BLOCK)
    assert options.linear.choice.endswith("solved for by the options macro.options.petsc")
