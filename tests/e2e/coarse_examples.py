"""The examples in a coarse form, and how to run one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from porocore.interfaces.solution import MacroSolution
from tests.e2e.study import porocore, succeeded, write_study

EXAMPLES = Path(__file__).parents[2] / "examples"
#: Few states of a coarse cell, and a polynomial, which is the same on every machine.
COARSE: dict[str, Any] = {
    "cell.mesh": {"size": 0.4, "fluid_size": 0.2},
    "surrogate": {"backend": "polynomial"},
    "sampling.workers": 1,
    "sampling.test": {"count": 1, "seed": 0},
}


def written(path: Path, name: str, changes: dict[str, Any]) -> Path:
    """The example by the file's name with these changes, in a file of its own."""
    return write_study(
        path, changes, base=yaml.safe_load((EXAMPLES / f"{name}.yaml").read_text(encoding="utf-8"))
    )


def run(folder: Path, name: str, changes: dict[str, Any]) -> dict[str, MacroSolution]:
    """Solutions of the example."""
    config = written(folder / "example.yaml", name, changes)
    succeeded(porocore("run", config, "--out", folder / "run", timeout=900))
    assert list((folder / "run" / "fields").glob("*.pvd"))
    return solutions(folder / "run")


def solutions(folder: Path) -> dict[str, MacroSolution]:
    """Those in a run folder by their names."""
    return {path.stem: MacroSolution.load_file(path) for path in (folder / "solutions").glob("*.h5")}
