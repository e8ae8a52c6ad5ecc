"""Finished runs that the tests share; whoever damages one takes a copy."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from study import porocore, succeeded, write_study


@pytest.fixture(scope="session")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The configuration."""
    return write_study(tmp_path_factory.mktemp("study") / "study.yaml")


@pytest.fixture(scope="session")
def finished(study: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one undisturbed 'porocore run'. Not to be changed."""
    out = tmp_path_factory.mktemp("finished") / "run"
    done = porocore("run", study, "--fem", "skfem", "--surrogate", "torch", "--out", out, drawn=True)
    assert succeeded(done) == str(out / "report.html")
    return out


@pytest.fixture(scope="session")
def other_cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run with another Poisson ratio, sampled and trained as little as possible. Not to be changed."""
    folder = tmp_path_factory.mktemp("other")
    changes = {
        "cell.material.poisson_ratio": 0.3,
        "sampling.inputs.p": {"range": [-0.02, 0.02], "step": 0.02},
        "sampling.inputs.H22": {"range": [-0.02, 0.02], "step": 0.02},
        "sampling.test.count": 1,
        "surrogate.options.epochs": 10,
    }
    config = write_study(folder / "other.yaml", changes)
    succeeded(porocore("sample", config, "--out", folder / "run"))
    succeeded(porocore("train", folder / "run"))
    return folder / "run"


@pytest.fixture
def a_copy(finished: Path, tmp_path: Path) -> Callable[..., Path]:
    """A copy of the finished run without the files and folders that are named."""

    def copy(*without: str) -> Path:
        folder = tmp_path / "copy"
        shutil.copytree(finished, folder)
        for name in without:
            path = folder / name
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        return folder

    return copy
