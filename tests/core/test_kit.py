"""The conformance kit: every law catches the wrong implementation that it is meant for, and passes the right one."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from porocore.testing import (
    KIT_VERSION,
    CellSolverSuite,
    PotentialSuite,
    SamplerSuite,
    Suite,
    SurrogateSuite,
)
from porocore.testing.suite import laws_of
from porocore.testing.version import complaint

WRONG = Path(__file__).parent / "wrong"
SUITES = {"samplers": SamplerSuite, "cells": CellSolverSuite, "surrogates": PotentialSuite}


def classes(file: str) -> dict[str, str]:
    """Name of each suite in a file → the law that is to catch it; empty for those that obey all."""
    found = {}
    for node in ast.parse((WRONG / f"{file}.py").read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ClassDef) and node.name.startswith("Test"):
            (law,) = [
                statement.value.value
                for statement in node.body
                if isinstance(statement, ast.Assign) and statement.targets[0].id == "caught_by"
            ]
            found[node.name] = law
    return found


CASES = [(file, name, law) for file in SUITES for name, law in classes(file).items()]


def run_pytest(folder: Path, root: Path, *words: str) -> dict[tuple[str, str], list[str]]:
    """Outcomes of each (class, law) of one run: passed, failed, error or skipped; also an xfail is skipped."""
    report = folder / "report.xml"
    done = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", os.devnull),
            *("--rootdir", str(root), f"--junitxml={report}", "--import-mode=importlib", *words),
        ],
        env={**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert report.exists(), done.stdout + done.stderr
    found: dict[tuple[str, str], list[str]] = {}
    for case in ElementTree.parse(report).iter("testcase"):
        place = case.attrib["classname"].rsplit(".", 2)[-2:]
        key = f"{place[0]}.{place[1]}", case.attrib["name"].partition("[")[0]
        found.setdefault(key, []).append(case[0].tag if len(case) else "passed")
    return found


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    """Of the wrong ones the law that is meant for them, of the right ones all."""
    nodes = [f"{WRONG / file}.py::{name}" + (f"::{law}" if law else "") for file, name, law in CASES]
    return run_pytest(tmp_path_factory.mktemp("kit"), WRONG, *nodes)


@pytest.mark.parametrize(("file", "name", "law"), [case for case in CASES if case[2]])
def test_a_wrong_implementation_is_caught_by_the_law_meant_for_it(outcomes, file, name, law):
    assert "failure" in outcomes[f"{file}.{name}", law], outcomes[f"{file}.{name}", law]


@pytest.mark.parametrize(("file", "name"), [case[:2] for case in CASES if not case[2]])
def test_a_right_implementation_passes_all(outcomes, file, name):
    found = {law: results for (suite, law), results in outcomes.items() if suite == f"{file}.{name}"}
    assert set(found) == set(laws_of(SUITES[file]))
    assert {result for results in found.values() for result in results} <= {"passed", "skipped"}


@pytest.mark.parametrize("file", SUITES)
def test_no_law_is_without_a_wrong_implementation(file):
    caught = set(classes(file).values()) | set(classes("samplers").values()) & {"test_version_of_the_kit"}
    assert set(laws_of(SUITES[file])) <= caught


@pytest.mark.slow
def test_wrong_macro_solvers_are_caught(tmp_path):
    """Those that change what the core does not do for every backend; the rest of the laws hold by the core's loop."""
    cases = classes("macros")
    found = run_pytest(
        tmp_path, WRONG, *(f"{WRONG / 'macros'}.py::{name}::{law}" for name, law in cases.items())
    )
    for name, law in cases.items():
        assert "failure" in found[f"macros.{name}", law], (name, law)


# ---- versions and expected failures ---------------------------------------------------------------


def test_versions_of_the_kit():
    major = int(KIT_VERSION.partition(".")[0])
    assert complaint(str(major)) == complaint(KIT_VERSION) == ""
    assert f'write kit_version = "{major}"' in complaint("")
    assert "sharper laws; see which of them fail" in complaint(str(major - 1))
    assert "pip install --upgrade porocore" in complaint(str(major + 1))
    assert "pip install --upgrade porocore" in complaint(f"{major}.99")
    assert "expected a text such as" in complaint("latest")


def test_expected_failures_are_strict_and_their_names_are_checked(tmp_path):
    (tmp_path / "test_laws.py").write_text(
        """
from porocore.testing import Suite
import pytest

class Laws(Suite):
    kit_version = "1"
    def test_holds(self): pass
    def test_breaks(self): assert 1 == 2
    @pytest.mark.parametrize("n", [1, 2])
    def test_cases(self, n): assert n == 1

class TestKnown(Laws):
    expected_failures = {"test_breaks": "numbers differ", "test_cases[2]": "two is not one"}

class TestStale(Laws):
    expected_failures = {"test_holds": "mended long ago", "test_breaks": "numbers differ"}
"""
    )
    found = run_pytest(tmp_path, tmp_path, str(tmp_path / "test_laws.py"))
    known, stale = (
        {law: v for (name, law), v in found.items() if name.endswith(n)} for n in ("Known", "Stale")
    )
    assert known["test_breaks"] == ["skipped"]
    assert sorted(known["test_cases"]) == ["passed", "skipped"]
    assert known["test_holds"] == ["passed"]
    assert stale["test_holds"] == ["failure"]
    assert stale["test_cases"] == ["passed", "failure"]
    with pytest.raises(TypeError, match=r"there is no law 'test_hold'; did you mean 'test_holds'\?"):

        class Typo(Suite):
            expected_failures = {"test_hold": "a reason"}  # noqa: RUF012

            def test_holds(self):
                """A law."""

    with pytest.raises(TypeError, match="expected a reason, got ''"):

        class Silent(SurrogateSuite):
            expected_failures = {"test_shapes": ""}  # noqa: RUF012


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
