"""The conformance kit: versions, expected failures, what it says to authors; its checks: test_kit_checks.py."""

from __future__ import annotations

import ast
import subprocess
import sys

import pytest

from porocore.plugins.table import complaint
from porocore.testing import (
    KIT_VERSION,
    CellContactSuite,
    CellSolverSuite,
    CommandSuite,
    MacroLawSuite,
    MacroSolverSuite,
    MeshedCellSuite,
    PotentialSuite,
    SamplerSuite,
    Suite,
    SurrogateSuite,
)
from tests.helpers.kit_runs import run_pytest


def test_versions_of_the_kit():
    major = int(KIT_VERSION.partition(".")[0])
    assert complaint(str(major)) == complaint(KIT_VERSION) == ""
    assert f'write kit_version = "{major}"' in complaint("")
    assert "sharper checks; see which of them fail" in complaint(str(major - 1))
    assert "pip install --upgrade porocore" in complaint(str(major + 1))
    assert "pip install --upgrade porocore" in complaint(f"{major}.99")
    assert "expected a text such as" in complaint("latest")


def test_expected_failures_are_strict_and_their_names_are_checked(tmp_path):
    (tmp_path / "test_checks.py").write_text(
        """
from porocore.testing import Suite
import pytest

class Checks(Suite):
    kit_version = "5"
    def test_holds(self): pass
    def test_breaks(self): assert 1 == 2
    @pytest.mark.parametrize("n", [1, 2])
    def test_cases(self, n): assert n == 1

class TestKnown(Checks):
    expected_failures = {"test_breaks": "numbers differ", "test_cases[2]": "two is not one"}

class TestStale(Checks):
    expected_failures = {"test_holds": "mended long ago", "test_breaks": "numbers differ"}
"""
    )
    found = run_pytest(tmp_path, tmp_path, [str(tmp_path / "test_checks.py")])
    known, stale = (
        {
            check: [outcome for outcome, _ in cases]
            for (name, check), cases in found.items()
            if name.endswith(n)
        }
        for n in ("Known", "Stale")
    )
    assert known["test_breaks"] == ["skipped"]
    assert sorted(known["test_cases"]) == ["passed", "skipped"]
    assert known["test_holds"] == ["passed"]
    assert stale["test_holds"] == ["failure"]
    assert stale["test_cases"] == ["passed", "failure"]
    with pytest.raises(TypeError, match=r"there is no check 'test_hold'; did you mean 'test_holds'\?"):

        class Typo(Suite):
            expected_failures = {"test_hold": "a reason"}  # noqa: RUF012

            def test_holds(self):
                """A check."""

    with pytest.raises(TypeError, match="expected a reason, got ''"):

        class Silent(SurrogateSuite):
            expected_failures = {"test_shapes": ""}  # noqa: RUF012


@pytest.mark.parametrize(
    ("suite", "arguments", "interface"),
    [
        (CellSolverSuite, "make_solver(cls)", "CellSolver"),
        (MeshedCellSuite, "make_solver(cls)", "CellSolver"),
        (CellContactSuite, "make_solver(cls)", "CellSolver"),
        (MacroLawSuite, "make_law(cls)", "MacroLaw"),
        (MacroSolverSuite, "make_solver(cls, **options)", "MacroSolver"),
        (SurrogateSuite, "make_surrogate(cls)", "Surrogate"),
        (PotentialSuite, "make_surrogate(cls)", "Surrogate"),
        (SamplerSuite, "make_sampler(cls, inputs, **options)", "Sampler"),
        (CommandSuite, "make_command(cls)", "Command"),
    ],
)
def test_a_suite_without_its_function_says_what_to_write(suite, arguments, interface):
    class TestMine(suite):
        kit_version = KIT_VERSION

    function = arguments.partition("(")[0]
    with pytest.raises(NotImplementedError) as error:
        getattr(TestMine, function)(*[None] * arguments.count("inputs"))
    words, _, code = str(error.value).partition("\n\n")
    assert words.startswith("TestMine does not say what is tested; write in it a function that returns a")
    assert words.endswith(":")
    assert f"porocore.{interface}" in words
    assert f"    @classmethod\n    def {arguments}:\n" in code
    # What is shown can be pasted into the class.
    (mine,) = ast.parse(f"class TestMine:\n{code}").body
    (definition,) = mine.body
    assert definition.name == function


def test_a_suite_without_its_function_is_told_so_once_for_each_check(tmp_path):
    (tmp_path / "test_mine.py").write_text(
        f"from porocore.testing import SamplerSuite\nclass TestMine(SamplerSuite):\n    kit_version = '{KIT_VERSION}'\n"
    )
    found = run_pytest(tmp_path, tmp_path, [str(tmp_path / "test_mine.py")])
    assert found.pop(("test_mine.TestMine", "test_version_of_the_kit")) == [("passed", "")]
    messages = {
        message for cases in found.values() for outcome, message in cases if outcome in ("error", "failure")
    }
    assert len(found) > 10
    assert all("TestMine does not say what is tested" in message for message in messages), messages


def test_without_pytest_the_kit_says_what_to_install():
    code = """
import sys
from importlib import util
find, util.find_spec = util.find_spec, lambda name, *a: None if name == "pytest" else find(name, *a)
import porocore.testing
print(porocore.testing.KIT_VERSION)
try:
    porocore.testing.SamplerSuite
except ModuleNotFoundError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        KIT_VERSION,
        "porocore.testing.SamplerSuite needs pytest, which is not installed here; install it: pip install pytest",
    ]
