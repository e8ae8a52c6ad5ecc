"""``porocore sweep`` as a process: killed or interrupted between two values it goes on, to the same table."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

pytestmark = pytest.mark.slow

SIDE = {"displacement": [0, None, 0]}
STUDY = {
    "cell": {
        "geometry": {"kind": "orthogonal-channels", "radius": 0.25},
        "mesh": {"size": 0.5, "fluid_size": 0.5, "element": "linear"},
    },
    "sampling": {
        "sampler": "sobol",
        "inputs": {"H22": {"range": [-0.1, 0.02]}, "p": {"range": [-0.02, 0.05]}},
        "options": {"count": 8, "states_per_member": 4},
        "test": {"count": 2},
        "workers": 1,
    },
    "surrogate": {"backend": "polynomial"},
    "closure": "potential",
    "macro": {
        "body": {"kind": "box", "size": [0.1, 7.5, 0.1], "elements": [1, 10, 1]},
        "boundary": {
            **dict.fromkeys(("x-", "x+", "z-", "z+"), SIDE),
            "y-": {"displacement": [0, 0, 0]},
            "y+": {"traction": [0, 1, 0], "pressure": 0},
        },
        "loads": [-0.04],
        "time": {"end": 60, "step": 0.25, "ramp_increments": 2, "ramp_step": 0.25},
    },
}
OVER = ("--over", "radius=0.22:0.26:3")


def command(*words: object) -> list[str]:
    return [sys.executable, "-c", "from porocore.cli import program; program()", *map(str, words)]


def called(*words: object) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(command(*words), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sweep") / "study.yaml"
    path.write_text(yaml.safe_dump(STUDY, sort_keys=False))
    return path


@pytest.fixture(scope="module")
def table(study: Path) -> bytes:
    """Table of a sweep that nothing interrupted."""
    out = study.parent / "whole"
    called("sweep", study, *OVER, "--out", out, "--no-store")
    return (out / "sweep.csv").read_bytes()


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_ended_between_values_it_goes_on(
    study: Path, table: bytes, tmp_path: Path, how: signal.Signals
) -> None:
    out = tmp_path / "run"
    words = ("sweep", study, *OVER, "--out", out, "--no-store")
    process = subprocess.Popen(command(*words), start_new_session=True, stderr=subprocess.PIPE, text=True)
    while process.poll() is None and not list(out.glob("sweep/*/solutions/*.h5")):
        time.sleep(0.01)
    os.killpg(process.pid, how)
    _, said = process.communicate()
    solved = list(out.glob("sweep/*/solutions/*.h5"))
    assert 1 <= len(solved) < 6
    if how == signal.SIGINT:
        assert process.returncode == 130
        assert f"continue with: porocore sweep {study} --over radius=0.22:0.26:3 --out {out} --no-store --resume" in said
    before = {path: path.stat().st_mtime_ns for path in (*solved, out / "samples.h5", out / "surrogate.h5")}
    done = called(*words, "--resume")
    assert "the cells are learned already" in done.stderr
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert (out / "sweep.csv").read_bytes() == table
