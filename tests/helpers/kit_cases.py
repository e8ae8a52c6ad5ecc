"""The wrong implementations in ``wrong/``, each a right one with one thing spoilt, and the checks that catch them.

What a class there says:

``caught_by``
    The check that it breaks; empty for a right one, which obeys all.
``raises``
    The error in which the check ends, where that is none of its own assertions.
``slow``
    That the check takes a second or more.

``python -m tests.helpers.kit_cases`` writes ``docs/reference/caught.md``, a table of the checks with what each catches.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import porocore.testing
from porocore.testing.suite import Suite, checks_of

WRONG = Path(__file__).parents[1] / "testing" / "wrong"
TABLE = Path(__file__).parents[2] / "docs" / "reference" / "caught.md"
#: The suite of the classes in each file.
SUITES: dict[str, type[Suite]] = {
    "samplers": porocore.testing.SamplerSuite,
    "commands": porocore.testing.CommandSuite,
    "cells": porocore.testing.CellSolverSuite,
    "cell_slopes": porocore.testing.CellSolverSuite,
    "meshed": porocore.testing.MeshedCellSuite,
    "relaxing_cells": porocore.testing.MeshedCellSuite,
    "contact": porocore.testing.CellContactSuite,
    "surrogates": porocore.testing.PotentialSuite,
    "surrogate_files": porocore.testing.PotentialSuite,
    "surrogate_training": porocore.testing.PotentialSuite,
    "surrogate_parameters": porocore.testing.PotentialSuite,
    "macro_law": porocore.testing.MacroLawSuite,
    "macro_states": porocore.testing.MacroSolverSuite,
    "macro_plates": porocore.testing.MacroSolverSuite,
    "macro_contact": porocore.testing.MacroSolverSuite,
    "macro_bodies": porocore.testing.MacroSolverSuite,
    "macro_flat_bodies": porocore.testing.MacroSolverSuite,
    "macro_histories": porocore.testing.MacroSolverSuite,
    "macro_runs": porocore.testing.MacroSolverSuite,
    "macro_memory": porocore.testing.MacroSolverSuite,
    "macro_columns": porocore.testing.MacroSolverSuite,
    "macro_sensitivities": porocore.testing.MacroSolverSuite,
}


@dataclass(frozen=True)
class Case:
    """A class of ``wrong/``."""

    file: str
    name: str
    summary: str
    caught_by: str
    raises: str = ""
    slow: bool = False

    def __str__(self) -> str:
        return f"{self.file}.{self.name}"

    def node(self, check: str = "") -> str:
        """As pytest names it, or one of its checks."""
        return f"{WRONG / self.file}.py::{self.name}" + (f"::{check}" if check else "")

    @property
    def words(self) -> str:
        """What it does, after its name and its first line."""
        name = re.sub(r"(?<=.)([A-Z])", r" \1", self.name.removeprefix("Test")).lower()
        return f"{name} ({self.summary.rstrip('.')})" if self.summary else name


def cases(file: str) -> Iterator[Case]:
    """Read, not imported: backends are slow to import."""
    for node in ast.parse((WRONG / f"{file}.py").read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ClassDef) and node.name.startswith("Test"):
            said = {
                statement.targets[0].id: statement.value.value
                for statement in node.body
                if isinstance(statement, ast.Assign) and isinstance(statement.value, ast.Constant)
            }
            known = {key: said[key] for key in ("caught_by", "raises", "slow") if key in said}
            summary = (ast.get_docstring(node) or "").partition("\n")[0]
            yield Case(file, node.name, summary, **known)


CASES = [case for file in SUITES for case in cases(file)]
RIGHT = [case for case in CASES if not case.caught_by]
WRONGS = [case for case in CASES if case.caught_by]


def suites() -> list[type[Suite]]:
    """All that the kit has."""
    found = [getattr(porocore.testing, name) for name in porocore.testing.__all__]
    return [suite for suite in found if isinstance(suite, type) and issubclass(suite, Suite)]


def wrong_ones(suite: type[Suite], check: str) -> list[Case]:
    """Those that a check of a suite catches.

    Checks that several suites share are one check; those of one name in different suites are not.
    """
    return [
        case
        for case in WRONGS
        if case.caught_by == check and getattr(SUITES[case.file], check) is getattr(suite, check)
    ]


def table() -> str:
    """Every check, once, with what it catches."""
    lines = [
        "# What the checks of the conformance kit catch",
        "",
        "Every check of the [conformance kit](testing.md) is tested on implementations that break it, each made of a",
        "right one by spoiling one thing. A check that suites share is listed once.",
        "`python -m tests.helpers.kit_cases` writes this page.",
    ]
    listed: set[object] = set()
    for suite in sorted(suites(), key=lambda suite: (len(suite.__mro__), suite.__name__)):
        own = [check for check in checks_of(suite) if getattr(suite, check) not in listed]
        lines += ["", f"## {suite.__name__}", "", "| check | catches |", "|---|---|"]
        for check in own:
            listed.add(getattr(suite, check))
            words = check.removeprefix("test_").replace("_", " ")
            lines.append(f"| {words} | {'; '.join(case.words for case in wrong_ones(suite, check))} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    TABLE.write_text(table(), encoding="utf-8")
