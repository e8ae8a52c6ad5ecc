"""The macro solver on dolfinx: the conformance suite, PETSc's options and failures, and scikit-fem's histories."""

from __future__ import annotations

from dataclasses import fields
from importlib.util import find_spec

import numpy as np
import pytest

if not find_spec("dolfinx"):
    pytest.skip("dolfinx is not installed", allow_module_level=True)

from porocore.errors import ConfigurationError, SolveError
from porocore.interfaces.solution import History
from porocore.macro.problem import NewtonSettings
from porocore.plugins import registry
from porocore.testing.synthetic.response import GradientLaw, confined_column, linear_law, mean_gradient_law
from porocore_fem_dolfinx.conformance import TestDolfinxMacroSolver
from porocore_fem_dolfinx.macro import DolfinxMacroSolver

__all__ = ["TestDolfinxMacroSolver"]

SHORT = {"end": 6.0, "step": 0.5, "ramp_increments": 4, "ramp_step": 0.05, "profiles": (1.0,)}
SIDES = {face: {"displacement": (0, None, 0)} for face in ("x-", "x+", "z-", "z+")}
HELD = {"displacement": (0, 0, 0)}
#: The field split of docs/configuration.md.
FIELD_SPLIT = {
    "ksp_type": "fgmres",
    "pc_type": "fieldsplit",
    "pc_fieldsplit_type": "schur",
    "pc_fieldsplit_schur_fact_type": "full",
    "pc_fieldsplit_schur_precondition": "selfp",
    "fieldsplit_u_ksp_type": "preonly",
    "fieldsplit_u_pc_type": "lu",
    "fieldsplit_u_pc_factor_mat_solver_type": "mumps",
    "fieldsplit_p_ksp_type": "gmres",
    "fieldsplit_p_ksp_rtol": 1e-10,
    "fieldsplit_p_pc_type": "lu",
    "fieldsplit_p_pc_factor_mat_solver_type": "mumps",
}
PROBLEMS = {
    "column": confined_column(30, load=-0.1, time=SHORT),
    "every kind of boundary": confined_column(
        (2, 3, 2),
        load=-0.05,
        size=(1, 2, 1.5),
        time=SHORT,
        boundary={
            "x-": {"displacement": (0, None, None), "pressure": 0},
            "y-": {"displacement": (None, 0, None)},
            "z-": {"displacement": (None, None, 0)},
            "x+": {"traction": (0.02, -0.05, 0.03), "pressure": 0.3},
            "y+": {"traction": (0, 1, 0)},
            "z+": {"flux": 0.2},
        },
    ),
    "flux": confined_column(
        (2, 4, 1),
        load=0.05,
        boundary={**SIDES, "y-": {**HELD, "flux": -0.5}, "y+": {"pressure": 0}},
        time=SHORT,
    ),
    "displaced": confined_column(
        (1, 6, 2),
        load=-0.8,
        boundary={**SIDES, "y-": HELD, "y+": {"displacement": (None, 1, None), "pressure": 0}},
        time=SHORT,
    ),
    "load jump": confined_column(
        6, load=-0.15, time=SHORT | {"step": 1.0, "ramp_increments": 1, "ramp_step": 1e-3}
    ),
}


def solve(problem, law, **options):
    solver = DolfinxMacroSolver(**options)
    return solver.solve(solver.prepare(problem), law)


def other_solver():
    """scikit-fem's, through the registry: a plugin imports no other."""
    if not find_spec("skfem"):
        pytest.skip("scikit-fem is not installed")
    return registry.registry().get("macro solver", "skfem")()


@pytest.mark.parametrize(
    "law",
    [linear_law(), mean_gradient_law(), GradientLaw(mean_gradient_law())],
    ids=["linear", "nonlinear", "gradient"],
)
@pytest.mark.parametrize("name", PROBLEMS)
def test_histories_and_fields_are_those_of_scikit_fem(name, law):
    """At round-off; a solver that keeps its factor takes more iterations, and shorter ones."""
    other, converged = other_solver(), NewtonSettings(tolerance=1e-15)
    problem = PROBLEMS[name].model_copy(update={"newton": converged})
    expected = other.solve(other.prepare(problem), law)
    found = solve(problem, law)
    assert expected.history.pressure_max.max() > 0
    for field in fields(History):
        if field.name == "iterations":
            continue
        mine, theirs = (getattr(solution.history, field.name) for solution in (found, expected))
        # A uniform stress has a spread of round-off only: of forces 20 units, over an area of 0.01.
        scale = abs(theirs).max() if field.name != "stress_spread" else 1e-2
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-10 * scale, err_msg=field.name)
    for mine, theirs in zip(found.profiles, expected.profiles, strict=True):
        own = mine.arrays()
        for name, value in theirs.arrays().items():
            atol = 1e-10 * max(np.abs(value).max(), 1e-3)
            np.testing.assert_allclose(own[name], value, rtol=0, atol=atol, err_msg=name)
    np.testing.assert_array_equal(found.points, expected.points)
    np.testing.assert_array_equal(found.cells, expected.cells)


@pytest.mark.parametrize(("law", "most"), [(linear_law(), 4), (mean_gradient_law(), None)])
def test_a_factor_serves_while_the_tangent_is_the_same(law, most):
    """All steps of one length of a linear law, two ends of stretches among them; else one step."""
    solution = solve(PROBLEMS["column"], law)
    systems, factors = (int(solution.work[name].sum()) for name in ("systems", "set_ups"))
    steps = len(solution.history.time) - 1
    assert systems == solution.history.iterations.sum()
    assert factors <= (most or 1.5 * steps)
    assert factors < systems


def test_a_field_split_gives_the_same_history():
    expected = solve(PROBLEMS["column"], mean_gradient_law()).history
    found = solve(PROBLEMS["column"], mean_gradient_law(), petsc=FIELD_SPLIT).history
    np.testing.assert_array_less(found.iterations, expected.iterations + 1)  # whose factor serves twice
    np.testing.assert_allclose(found.settlement, expected.settlement, rtol=1e-9)
    np.testing.assert_allclose(found.pressure_max, expected.pressure_max, rtol=1e-9)


@pytest.mark.parametrize(
    ("petsc", "expected"),
    [
        ({"ksp_typ": "cg"}, "makes no use of ksp_typ here: misspelt"),
        ({"ksp_type": "cgg"}, "refuses ksp_type: cgg: .*KSP type cgg"),
        ({"pc_type": "luu"}, "refuses pc_type: luu"),
        ({"pc_factor_mat_solver_type": "mumpss"}, "refuses pc_factor_mat_solver_type: mumpss"),
        ({"fieldsplit_u_pc_type": "lu"}, "makes no use of fieldsplit_u_pc_type"),
        ({**FIELD_SPLIT, "fieldsplit_u_pc_type": "nonsense"}, "refuses .*fieldsplit_u_pc_type: nonsense"),
        ({"ksp_type": "richardson", "pc_type": "none"}, "fails on an elastic body: .*stopped for reason -"),
        ({"pc_type": "cholesky"}, "fails on an elastic body: .*not symmetric"),
        ({"ksp_type": ["cg"]}, "expected PETSc options"),
        ("cg", "expected PETSc options such as"),
    ],
)
def test_options_that_petsc_cannot_use_are_refused_before_anything_is_solved(petsc, expected):
    with pytest.raises(ConfigurationError, match=rf"(?s)^macro\.options\.petsc: .*{expected}") as caught:
        DolfinxMacroSolver(petsc=petsc).prepare(PROBLEMS["flux"])
    assert len(str(caught.value).splitlines()) == 1


def test_unknown_options_are_refused():
    with pytest.raises(ConfigurationError, match="unknown key 'wavelets'; dolfinx takes solver, petsc"):
        DolfinxMacroSolver(wavelets=True)


@pytest.mark.parametrize("petsc", [None, FIELD_SPLIT], ids=["direct", "field split"])
def test_a_singular_matrix_ends_in_one_message(petsc):
    """Held against translations at one edge each, free to turn."""
    boundary = {
        "y-": {"displacement": (0, None, None), "pressure": 0},
        "x-": {"displacement": (None, 0, None)},
        "z-": {"displacement": (None, None, 0)},
        "x+": {"traction": (0, 1, 0)},
    }
    problem = confined_column(2, load=1e-3, size=(1, 1, 1), boundary=boundary, time=SHORT)
    with pytest.raises(SolveError, match=r"the macroscale step from t = 0 failed .* held against rigid"):
        solve(problem, linear_law(), petsc=petsc)


def test_forms_are_compiled_once(monkeypatch):
    """A second problem takes them from the cache, and steps compile nothing."""
    import porocore_fem_dolfinx.compat as compat

    solver = DolfinxMacroSolver()
    prepared = solver.prepare(PROBLEMS["flux"])

    def refuse(*arguments):
        raise AssertionError("compiles")

    monkeypatch.setattr(compat, "_compile", refuse)
    solver.solve(prepared, linear_law())
