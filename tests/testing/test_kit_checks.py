"""The conformance kit: every check of every suite catches the wrong implementation that is meant for it."""

from __future__ import annotations

import ast
import re
from importlib.util import find_spec
from pathlib import Path

import pytest

import porocore.testing
from porocore.testing.suite import checks_of
from tests.helpers.kit_cases import (
    CASES,
    RIGHT,
    SUITES,
    TABLE,
    WRONG,
    WRONGS,
    Case,
    cases,
    suites,
    table,
    wrong_ones,
)
from tests.helpers.kit_runs import Outcomes, run_pytest

#: Files whose right implementation is cheap, so that it is held to all checks here; the others are those of a backend,
#: which is held to all of them by its own tests.
WHOLE = ("samplers", "cells", "cell_slopes", "surrogates", "surrogate_training", "macro_law")
#: Files that need no backend.
FREE = (*WHOLE, "commands", "surrogate_files", "surrogate_parameters", "macro_columns")
#: What a violation says: check, state, expected, got.
TEXT = re.compile(r"(?:[\w.]+: )?check '(?P<check>[^']+)', .+: expected (?P<expected>.+); got .+", re.DOTALL)
#: What is expected where the implementation raises an error of its own.
NOTHING_RAISED = "that nothing is raised"


def run(folder: Path, slow: bool) -> Outcomes:
    """The wrong ones by the check that is meant for them. If slow, also the right ones by the checks of their file."""
    there = [case for case in CASES if case.file in FREE or find_spec("porocore_fem_skfem")]
    nodes = [case.node(case.caught_by) for case in there if case.caught_by and case.slow == slow]
    for case in there:
        if not case.caught_by and slow and case.file not in WHOLE:
            nodes += sorted({case.node(other.caught_by) for other in cases(case.file) if other.caught_by})
        elif not case.caught_by and not slow and case.file in WHOLE:
            nodes.append(case.node())
    return run_pytest(folder, WRONG, nodes)


@pytest.fixture(scope="module")
def fast(tmp_path_factory: pytest.TempPathFactory) -> Outcomes:
    return run(tmp_path_factory.mktemp("kit"), slow=False)


@pytest.fixture(scope="module")
def slow(tmp_path_factory: pytest.TempPathFactory) -> Outcomes:
    return run(tmp_path_factory.mktemp("kit"), slow=True)


def assert_caught(case: Case, outcomes: Outcomes) -> None:
    """By the check, whose text says what is wrong; a slip in the wrong implementation itself does not count."""
    if case.file not in FREE:
        pytest.importorskip("porocore_fem_skfem")
    found = outcomes[str(case), case.caught_by]
    caught = [message for outcome, message in found if outcome == "failure"]
    assert caught, found
    for message in caught:
        said = TEXT.match(message)
        assert said, message
        assert said["check"].partition("[")[0] == case.caught_by.removeprefix("test_").replace("_", " ")
        # Of the cases of one check some may end by an error of the implementation's own, if that is the fault.
        assert said["expected"] != NOTHING_RAISED or case.raises, message
    assert not case.raises or any(f"; got {case.raises}: " in message for message in caught)


@pytest.mark.parametrize("case", [case for case in WRONGS if not case.slow], ids=str)
def test_a_wrong_implementation_is_caught_by_the_check_meant_for_it(fast, case):
    assert_caught(case, fast)


@pytest.mark.slow
@pytest.mark.parametrize("case", [case for case in WRONGS if case.slow], ids=str)
def test_a_wrong_implementation_is_caught_by_the_slow_check_meant_for_it(slow, case):
    assert_caught(case, slow)


@pytest.mark.parametrize("case", [case for case in RIGHT if case.file in WHOLE], ids=str)
def test_a_right_implementation_passes_all(fast, case):
    found = {check: results for (name, check), results in fast.items() if name == str(case)}
    assert set(found) == set(checks_of(SUITES[case.file]))
    assert {outcome for results in found.values() for outcome, _ in results} <= {"passed", "skipped"}


@pytest.mark.slow
@pytest.mark.parametrize("case", [case for case in RIGHT if case.file not in WHOLE], ids=str)
def test_a_right_implementation_passes_the_checks_that_catch_the_wrong_ones(slow, case):
    """So that a wrong one differs from it by what is spoilt alone."""
    pytest.importorskip("porocore_fem_skfem")
    found = {check: results for (name, check), results in slow.items() if name == str(case)}
    assert set(found) == {other.caught_by for other in cases(case.file) if other.caught_by}
    assert {outcome for results in found.values() for outcome, _ in results} == {"passed"}


@pytest.mark.parametrize("suite", suites(), ids=lambda suite: suite.__name__)
def test_no_check_is_without_a_wrong_implementation(suite):
    assert [check for check in checks_of(suite) if not wrong_ones(suite, check)] == []


def test_every_wrong_implementation_names_a_check():
    assert [str(case) for case in WRONGS if case.caught_by not in checks_of(SUITES[case.file])] == []


def test_the_table_of_checks_is_up_to_date():
    assert TABLE.read_text(encoding="utf-8") == table(), "run: python tests/helpers/kit_cases.py"


@pytest.mark.parametrize("suite", sorted(set(SUITES.values()), key=str), ids=lambda suite: suite.__name__)
def test_every_suite_has_a_check_that_is_shown_at_once_to_catch_a_wrong_one(suite):
    fast = {case.caught_by for case in WRONGS if SUITES[case.file] is suite and not case.slow}
    inherited = {check for base in suite.__bases__ if base in SUITES.values() for check in checks_of(base)}
    assert fast - inherited


def test_what_is_spoilt_is_told_apart_from_a_slip():
    """An implementation that does not run at all proves nothing about a check."""
    case = Case("cells", "TestX", "", "test_rest")
    said = "porocore.testing.expect.Violation: check 'rest', at rest: expected"
    slip = f"{said} {NOTHING_RAISED}; got NameError: name 'npp' is not defined"
    for message in (slip, "TypeError: alter() takes 2 arguments", "assert 1 == 2", f"{said} 0"):
        with pytest.raises(AssertionError):
            assert_caught(case, {("cells.TestX", "test_rest"): [("failure", message)]})
    good = f"{said} stress = 0 within 1.0e-13; got 1e-06"
    assert_caught(case, {("cells.TestX", "test_rest"): [("passed", ""), ("failure", good)]})
    with pytest.raises(AssertionError):
        assert_caught(case, {("cells.TestX", "test_rest"): [("error", good)]})


def test_no_check_ends_in_a_bare_assertion():
    """What fails in a suite says check, state, expected and got; assert, numpy and pytest's raises do not."""
    bare = []
    for path in sorted(Path(porocore.testing.__file__).parent.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            words = ast.unparse(node.func) if isinstance(node, ast.Call) else ""
            asserts = isinstance(node, ast.Assert) and "is not None" not in ast.unparse(node.test)
            if asserts or words.startswith(("np.testing.", "pytest.raises", "pytest.fail")):
                bare.append(f"{path.name}:{node.lineno}")
    assert bare == []
