"""Both finite-element backends on the workers of every executor."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from porocore.core.parallel.memory import THREAD_VARIABLES

SCRIPT = """
import json, sys
from pathlib import Path
from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.datasets.check import check_file
from porocore.sampling.execution import CellPool
from porocore.core.inputs import InputSpace
from porocore.sampling.campaign import run_campaign
from porocore.study.run.composition import prepare_cell
from tests.helpers.fake_cell import Tree

if __name__ == "__main__":
    backend, folder = sys.argv[1:]
    names = ("H11", "H22", "H33", "H12", "H13", "H23", "p")
    inputs = InputSpace(names, (-0.03,) * 7, (0.03,) * 7)
    cell = Cell(mesh=MeshSettings(size=0.25, fluid_size=0.25))
    digests = {}
    for executor, workers in (("serial", 1), ("processes", 2), ("dask", 2)):
        dataset = Dataset.create(Path(folder) / f"{executor}.h5", inputs=inputs, identity="x")
        with CellPool(prepare_cell, (backend, {}, cell), workers=workers, executor=executor) as pool:
            summary = run_campaign(Tree(inputs, 6), pool, dataset)
        wrong = [finding.name for finding in check_file(dataset.path) if not finding.holds]
        digests[executor] = dataset.digest(), {s.name: n for s, n in summary.counts.items()}, wrong
    print(json.dumps(digests))
"""


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["skfem", "dolfinx"])
def test_the_same_bits_of_a_real_cell(tmp_path: Path, backend: str) -> None:
    if find_spec(f"porocore_fem_{backend}") is None or (
        backend == "dolfinx" and find_spec("dolfinx") is None
    ):
        pytest.skip(f"{backend} is not installed")
    script = tmp_path / "sample.py"
    script.write_text(SCRIPT)
    environment = (
        os.environ
        | dict.fromkeys(THREAD_VARIABLES, "1")
        | {"PYTHONPATH": str(Path(__file__).parents[1] / "helpers")}
    )
    done = subprocess.run(
        [sys.executable, str(script), backend, str(tmp_path)],
        env=environment,
        capture_output=True,
        text=True,
        timeout=580,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["serial"][1:] == [{"converged": 6}, []]
    assert found["processes"] == found["dask"] == found["serial"]
