"""A plug in its meridian from the command line: check, run, report, files for ParaView, and the cell itself."""

from __future__ import annotations

import meshio
import numpy as np
import pytest

from porocore.interfaces.solution import MacroSolution
from tests.e2e.coarse_examples import COARSE, solutions
from tests.e2e.study import porocore, succeeded, write_study

pytestmark = pytest.mark.slow

PLUG = COARSE | {
    "cell.geometry": {"kind": "orthogonal-channels", "radius": 0.25},
    "sampling.inputs": {
        "H11": {"range": [-0.02, 0.05]},
        "H22": {"range": [-0.1, 0.01]},
        "H33": {"range": [-0.02, 0.05]},
        "p": {"range": [-0.01, 0.04]},
    },
    "sampling.sampler": "macro-driven",
    "sampling.options": {"count": 12, "elements": 2},
    "closure": "potential",
    "macro.body": {"kind": "axisymmetric", "radius": 1.0, "height": 1.0, "elements": [2, 1]},
    "macro.boundary": {"y-": {"normal": 0}, "y+": {"plate": -0.05}, "side": {"pressure": 0}},
    "macro.probes": {"rim": [1, 0.5, 0]},
    "macro.loads": [1],
    "macro.time": {"end": 0.4, "step": 0.2, "ramp_increments": 2, "ramp_step": 0.1, "profiles": [0.3]},
}


def test_a_plug_is_run_and_reported(tmp_path):
    config = write_study(tmp_path / "plug.yaml", PLUG)
    said = succeeded(porocore("check", config))
    assert "body: axisymmetric, 1 × 1, volume 3.1416, 2 quadrilateral elements" in said
    folder = tmp_path / "run"
    succeeded(porocore("run", config, "--out", folder, timeout=900))
    assert (folder / "report.html").is_file()
    assert list((folder / "figures").glob("body_*.png"))
    last = sorted((folder / "fields").glob("potential*.vtu"))[-1]
    mesh = meshio.read(last)
    assert [block.type for block in mesh.cells] == ["quad9"]
    assert not mesh.points[:, 2].any()
    found = solutions(folder)["potential_load1.0"]
    assert found.revolved
    assert found.reactions["y-"][-1, 1] == pytest.approx(0.05, rel=1e-6)
    succeeded(porocore("solve", folder, "--law", "direct", timeout=900))
    direct = MacroSolution.load_file(folder / "solutions" / "direct-potential_load1.0.h5")
    np.testing.assert_allclose(
        found.probes["rim"], direct.probes["rim"], atol=0.02 * abs(direct.probes["rim"]).max()
    )
