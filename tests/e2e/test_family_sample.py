"""``porocore sample`` of a family: killed and resumed, finished, damaged; what learns none says so."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

from porocore.sampling.datasets.dataset import Dataset
from porocore.states import Status

SIDE = {"displacement": [0, None, 0]}
STUDY = {
    "cell": {"material": {"poisson_ratio": {"range": [0.2, 0.4]}}, "mesh": {"size": 0.45}},
    "sampling": {
        "sampler": "sobol",
        "parameters": "ranges",
        "inputs": {"H22": {"range": [-0.1, 0.02]}, "p": {"range": [-0.05, 0.05]}},
        "options": {"count": 6, "states_per_member": 3},
        "test": {"count": 2},
        "workers": 1,
    },
    "surrogate": {"backend": "polynomial"},
    "closure": "potential",
    "macro": {
        "body": {"kind": "box", "size": [0.1, 7.5, 0.1], "elements": [1, 2, 1]},
        "boundary": {
            **dict.fromkeys(("x-", "x+", "z-", "z+"), SIDE),
            "y-": {"displacement": [0, 0, 0]},
            "y+": {"pressure": 0},
        },
        "loads": [-0.04],
        "fields": {"poisson_ratio": 0.3},
    },
}
#: A surrogate that learns no parameters.
LEARNS_ONE_CELL = {"backend": "torch", "model": "mlp"}
FILES = ("undeformed.h5", "samples.h5", "test.h5")


def command(*words: object) -> list[str]:
    return [sys.executable, "-c", "from porocore.cli.entry import main; main()", *map(str, words)]


def called(*words: object, status: int = 0) -> str:
    done = subprocess.run(command(*words), capture_output=True, text=True, check=False)
    assert done.returncode == status, done.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("family") / "study.yaml"
    path.write_text(yaml.safe_dump(STUDY, sort_keys=False))
    return path


@pytest.fixture(scope="module")
def run(study: Path) -> Path:
    """A finished sampling."""
    called("sample", study, "--out", study.parent / "run", "--no-store")
    return study.parent / "run"


@pytest.mark.slow
def test_a_family_is_sampled_over_its_members(run: Path) -> None:
    undeformed, samples, test = (Dataset.open(run / name) for name in FILES)
    assert (len(undeformed), len(samples), len(test)) == (10, 6, 2)
    assert (undeformed.responses().status == Status.converged).all()
    assert len(np.unique(samples.states().parameters)) == 2
    # K is that of Stokes flow through the same pore for every Poisson's ratio, and the drained solid stiffens with it.
    found, nu = undeformed.responses(), undeformed.x()[:, 0]
    np.testing.assert_allclose(found.conductivity, found.conductivity[:1].repeat(10, axis=0), rtol=1e-12)
    stiffness = found.tangent.stress_grad_u[np.argsort(nu), 1, 1, 1, 1]
    assert (np.diff(stiffness) > 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("file", ["undeformed.h5", "samples.h5"])
def test_killed_and_resumed_it_has_the_same_bits(study: Path, run: Path, tmp_path: Path, file: str) -> None:
    out = tmp_path / "run"
    parts = out / f"{file}.parts"
    process = subprocess.Popen(command("sample", study, "--out", out, "--no-store"), start_new_session=True)
    while process.poll() is None and len(list(parts.glob("*.h5"))) < 3:
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert 3 <= len(Dataset.open(out / file)) < len(Dataset.open(run / file))
    called("sample", out, "--no-store")
    for name in FILES:
        assert Dataset.open(out / name).digest() == Dataset.open(run / name).digest()


@pytest.mark.slow
def test_a_finished_sampling_solves_nothing_and_a_damaged_file_is_refused(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    shutil.copytree(run, out)
    before = {name: (out / name).stat().st_mtime_ns for name in FILES}
    said = called("sample", out, "--no-store")
    assert said.count("complete") == 3
    assert {name: (out / name).stat().st_mtime_ns for name in FILES} == before
    path = out / "undeformed.h5"
    path.write_bytes(path.read_bytes()[:-1000])
    said = called("sample", out, "--no-store", status=2)
    assert f"{path}: " in said
    assert "move it to undeformed.h5.damaged, then sample again" in said


@pytest.mark.slow
def test_check_counts_the_members_and_what_learns_none_is_refused_before_it_begins(study: Path) -> None:
    said = called("check", study)
    assert "10 undeformed members; states of 2 members, held-out states of 2 members" in said
    out, other = study.parent / "refused", study.parent / "one-cell.yaml"
    other.write_text(yaml.safe_dump({**STUDY, "surrogate": LEARNS_ONE_CELL}, sort_keys=False))
    said = called("run", other, "--out", out, status=2)
    assert "learns no cells with parameters, but cell.material.poisson_ratio is a range" in said
    assert not out.exists()
