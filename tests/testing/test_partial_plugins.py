"""Plugins that do less than others and say so pass: what they lack is skipped; studies that need it are refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from porocore.cell.cell import Cell
from porocore.errors import ConfigurationError
from porocore.macro.problem import MacroProblem
from porocore.states import MacroState
from porocore.study.notes.abilities import lacking, require_conductivity, require_learner, require_parts
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing.suite import checks_of
from porocore.testing.synthetic.response import confined_column
from tests.helpers.kit_runs import Outcomes, run_pytest
from tests.helpers.partial import cells, column, kernel
from tests.helpers.partial.cells import SolidCellSolver
from tests.helpers.partial.column import ColumnMacroSolver
from tests.helpers.partial.kernel import KernelSurrogate

FOLDER = Path(__file__).parents[1] / "helpers" / "partial"
#: Suite → file, a check that must have been tested, and checks that must be skipped, with a word of the reason.
PARTIAL = {
    column.TestColumn: (
        "column",
        "test_steady_state_is_the_drained_uniaxial_one",
        {
            "test_uniform_drained_strain_is_reproduced": "no confined column",
            "test_a_killed_run_continues_to_the_identical_solution": "checkpoints = False",
            "test_newtons_iteration_converges_quadratically": "meshes = 'own'",
            "test_on_a_column_a_plate_is_a_traction": "plate",
            "test_steps_by_error_meet_the_tolerance": "tolerance",
        },
    ),
    kernel.TestKernels: (
        "kernel",
        "test_reference_state_is_exact",
        {"test_a_truncated_checkpoint_is_refused": "begins anew"},
    ),
    cells.TestSolid: (
        "cells",
        "test_each_variable_alone_changes_the_answer",
        {
            "test_conductivity": "conductivities = ()",
            "test_conductivity_has_the_known_value": "conductivities = ()",
            "test_fields_are_returned_where_they_are_declared": "returns_fields = False",
        },
    ),
}


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> Outcomes:
    nodes = [f"{FOLDER / file}.py::{suite.__name__}" for suite, (file, *_) in PARTIAL.items()]
    return run_pytest(tmp_path_factory.mktemp("partial"), FOLDER, nodes)


@pytest.mark.parametrize("suite", PARTIAL, ids=lambda suite: suite.__name__)
def test_what_it_offers_passes_and_the_rest_is_skipped_and_said(outcomes, suite):
    file, tested, skipped = PARTIAL[suite]
    found = {
        check: results for (name, check), results in outcomes.items() if name == f"{file}.{suite.__name__}"
    }
    assert set(found) == set(checks_of(suite))
    failed = {
        check: [text for outcome, text in results if outcome not in ("passed", "skipped")]
        for check, results in found.items()
    }
    assert not {check: texts for check, texts in failed.items() if texts}
    assert {outcome for outcome, _ in found[tested]} == {"passed"}
    for check, reason in skipped.items():
        assert all(outcome == "skipped" and reason in text for outcome, text in found[check]), found[check]


def box(**settings) -> MacroProblem:
    """A block that is free at its sides."""
    faces = {name: {"normal": 0} for name in ("x-", "y-", "z-")} | {"y+": {"traction": (0, -1, 0)}}
    return MacroProblem.model_validate({"body": {"size": (1, 1, 1)}, "boundary": faces} | settings)


def test_a_column_is_told_from_other_boxes():
    assert confined_column(4).is_column
    assert not box().is_column
    sides = {name: {"normal": 0} for name in ("x-", "x+", "y-", "z-", "z+")}
    assert box(boundary=sides | {"y+": {"traction": (0, -1, 0), "pressure": 0}}).is_column
    for face, more in (
        ("x+", {"pressure": 0}),
        ("y+", {"traction": (1, 0, 0)}),
        ("y+", {"displacement": (0.1, 0, 0)}),
    ):
        assert not box(boundary=sides | {face: sides.get(face, {}) | more}).is_column
    assert not box(boundary=sides, initial={"gradient": ((0.1, 0, 0), (0, 0, 0), (0, 0, 0))}).is_column


def test_what_a_study_needs_and_the_solver_does_not_offer_is_refused():
    assert lacking(ColumnMacroSolver, confined_column(4)) == ""
    require_parts(ColumnMacroSolver, "fv", confined_column(4))
    for problem, words in (
        (
            box(),
            "this problem needs a box that is no confined column, which the macro solver 'fv' does not offer",
        ),
        (box(body={"kind": "cylinder", "radius": 1, "height": 1}, boundary={}), "needs the body 'cylinder'"),
        (confined_column(4, probes={"middle": (0, 1, 0)}), "needs probes"),
        (confined_column(4, body_force=(0, -1, 0)), "needs body_force"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            require_parts(ColumnMacroSolver, "fv", problem)


def test_a_family_needs_a_surrogate_that_learns_parameters():
    family = Cell(geometry={"radius": {"range": [0.2, 0.25]}})
    with pytest.raises(
        ConfigurationError, match=r"'kernels' learns no cells with parameters, but cell\.geometry\.radius"
    ):
        require_learner(KernelSurrogate(), "kernels", family)
    require_learner(KernelSurrogate(), "kernels", Cell())
    require_learner(PolynomialSurrogate(), "polynomial", family)
    with pytest.raises(ConfigurationError, match="gives no derivatives by parameters of the cell"):
        KernelSurrogate().slopes(MacroState.zeros(1))


def test_a_study_needs_the_conductivity_that_it_names():
    with pytest.raises(ConfigurationError, match="'solid' computes no conductivity, without which no body"):
        require_conductivity(SolidCellSolver, "solid", "piola")
    with pytest.raises(NotImplementedError, match="SolidCellSolver computes no conductivity"):
        SolidCellSolver().conductivity(None)
