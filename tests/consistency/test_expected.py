"""What is tested here is what ought to be there."""

from __future__ import annotations

import subprocess
import sys
from itertools import combinations
from pathlib import Path

import pytest

from porocore.plugins.kinds import FIRST_PARTY

HERE = Path(__file__).parent


def test_every_backend_that_the_project_publishes_loads(load):
    for name, (_, kinds) in FIRST_PARTY.items():
        for kind in kinds:
            load(kind, name)


@pytest.mark.parametrize(("ci", "outcome"), [("1", "failed"), ("", "skipped")])
def test_a_backend_that_does_not_load_fails_where_all_should_be(ci, outcome, tmp_path):
    """A plugin whose class cannot be imported, beside the others, in a run of its own."""
    info = tmp_path / "porocore_lame-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: porocore-lame\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[porocore]\nlame = porocore_lame\n")
    (tmp_path / "porocore_lame.py").write_text(
        "from porocore import Offer, hookimpl\n"
        "@hookimpl\n"
        "def porocore_macro_solvers():\n"
        "    return [Offer('lame', lambda: __import__('no_such_module'), '')]\n"
    )
    code = f"""
import os, sys
sys.path.insert(0, {str(tmp_path)!r})
os.environ["CI"] = {ci!r}
os.environ.pop("POROCORE_WITHOUT", None)
import pytest
chosen = ["-k", "test_histories and lame and column"]
sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", {str(HERE / "test_bodies.py")!r}, *chosen]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    count = 2 * len([pair for pair in combinations(["dolfinx", "lame", "skfem"], 2) if "lame" in pair])
    assert f"{count} {outcome}" in done.stdout, done.stdout
    assert done.returncode == (1 if ci else 0)
