"""Docstrings: their first words, their length, and the examples in those of the main classes, which are run."""

import ast
import doctest
import re
from pathlib import Path

import numpy as np
import pytest

import porocore

ROOT = Path(__file__).parents[2]
#: No docstring begins with one of these: it says what a function does or what a thing is.
NOT_FIRST = {
    "Of", "What", "Whether", "How", "Which", "By", "With", "Where", "At", "As",
    "To", "For", "In", "That", "Who", "When", "Why",
}  # fmt: skip
#: Every module of the core and of the plugins.
FILES = sorted([*(ROOT / "porocore").rglob("*.py"), *(ROOT / "plugins").glob("*/porocore_*/**/*.py")])


def docstrings(path):
    """(line, first line) of every docstring of a file, public or private."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            if text is not None:
                yield getattr(node, "lineno", 1), text.partition("\n")[0]


def faults(path):
    for line, text in docstrings(path):
        words = text.split()
        if len(words) < 3:
            yield f"{path.relative_to(ROOT)}:{line}: fewer than three words: {text}"
        elif words[0].strip(",:;") in NOT_FIRST:
            yield f"{path.relative_to(ROOT)}:{line}: begins with {words[0]}: {text}"


def test_docstrings_say_what_a_thing_is_or_does():
    assert [fault for path in FILES for fault in faults(path)] == []


def test_a_bad_docstring_is_found(tmp_path, monkeypatch):
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    (tmp_path / "bad.py").write_text(
        '"""Good words here."""\ndef f():\n    """Of a thing."""\nclass A:\n    def _b(self):\n        """One."""\n'
    )
    assert list(faults(tmp_path / "bad.py")) == [
        "bad.py:2: begins with Of: Of a thing.",
        "bad.py:5: fewer than three words: One.",
    ]


#: Main classes; each has an example.
MAIN = (
    "CellProblem", "CellResponse", "InputSpace", "Law", "MacroLaw", "MacroState", "NeoHookean", "SampledRange",
    "Status", "Study", "TrainingSet",
)  # fmt: skip


@pytest.mark.parametrize("name", MAIN)
def test_the_example_of_a_main_class_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = getattr(porocore, name).__doc__
    assert re.search(r"^ *Examples\n *--------$", text, re.MULTILINE), f"{name} has no section Examples"
    example = doctest.DocTestParser().get_doctest(text, {"np": np}, name, None, None)
    assert example.examples
    report: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    runner.run(example, out=report.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(report)
