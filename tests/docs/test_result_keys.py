"""Every column of the tables and every key of metrics.json stands in docs/results.md; ``stress_spread`` was nowhere."""

import ast
import re
from dataclasses import fields
from pathlib import Path

import porocore
from porocore.interfaces.solution import PROBE, History
from porocore.macro.laws.closure import ClosureError
from porocore.report.context import AdaptiveSurrogateCost, DirectCost
from porocore.report.words.results import SHARES
from porocore.study.sweep.results import OF_ALL, OF_CELL, OF_FORCES, OF_SETTLEMENT

PACKAGE = Path(porocore.__file__).parent
PAGE = (PACKAGE.parent / "docs" / "results.md").read_text(encoding="utf-8")
#: Functions that write keys or columns, by file.
WRITERS = {
    "study/run/reporting.py": (
        "figures_of_merit",
        "_cell",
        "_sampling",
        "_surrogate",
        "_errors",
        "report",
    ),
    "report/metrics.py": (
        "solution_metrics",
        "case_metrics",
    ),
    "report/context.py": (
        "reactions",
        "relaxation",
        "history_difference",
        "law_differences",
    ),
    "report/dimensional.py": ("dimensional_metrics",),
    "report/words/memory.py": (
        "_branch",
        "_evolution",
        "figures",
    ),
    "report/words/results.py": (
        "_at",
        "_wall",
    ),
    "study/tuning.py": ("write_tables",),
    "commands/sensitivity/results.py": ("write_table",),
    "cell/stability/map.py": ("write_tables",),
    "sampling/datasets/check.py": ("table",),
}


def named(node):
    """Strings that are keys of dictionaries, entries of lists, or under which something is assigned."""
    for each in ast.walk(node):
        if isinstance(each, ast.Dict):
            found = each.keys
        elif isinstance(each, ast.List):
            found = each.elts
        elif isinstance(each, ast.Assign):
            found = [target.slice for target in each.targets if isinstance(target, ast.Subscript)]
        else:
            continue
        yield from (
            key.value for key in found if isinstance(key, ast.Constant) and isinstance(key.value, str)
        )


def written():
    for path, names in WRITERS.items():
        tree = ast.parse((PACKAGE / path).read_text(encoding="utf-8"))
        functions = {f.name: f for f in ast.walk(tree) if isinstance(f, ast.FunctionDef)}
        for name in names:
            yield from named(functions[name])


def test_every_column_and_every_key_is_explained():
    known = set(re.findall(r"`(?:NAME: )?([^`]+)`", PAGE))
    columns = [field.name for field in fields(History)] + [name for name, _ in PROBE]
    costs = [field.name for each in (DirectCost, AdaptiveSurrogateCost) for field in fields(each)]
    keys = [*columns, *costs, *ClosureError(0, 0, 0, 0).for_json(), *SHARES, *written()]
    keys += [*OF_CELL, *OF_SETTLEMENT, *OF_ALL, *OF_FORCES]
    assert {"stress_spread", "wall_in_contact", "reactions", "relaxed_95_percent", "depth", "min_gap"} <= set(
        keys
    )
    assert sorted(set(keys) - known) == []
