"""Finished runs that the tests share; whoever damages one takes a copy."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from porocore.macro.reference import CellReference
from porocore.sampling.datasets.dataset import Dataset
from porocore.study.config.loading import load_config
from porocore.study.run.folder import RunFolder
from porocore.surrogates.portable import NumpySurrogate
from tests.e2e.study import Running, porocore, succeeded, write_study


@pytest.fixture(scope="session")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The configuration."""
    return write_study(tmp_path_factory.mktemp("study") / "study.yaml")


@pytest.fixture(scope="session")
def finished(study: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one undisturbed 'porocore run'. Not to be changed."""
    out = tmp_path_factory.mktemp("finished") / "run"
    done = porocore("run", study, "--fem", "skfem", "--surrogate", "torch", "--out", out)
    assert succeeded(done) == str(out / "report.html")
    return out


@pytest.fixture(scope="session")
def other_cell(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run with another Poisson ratio, with files of that cell's identity. Not to be changed."""
    folder = tmp_path_factory.mktemp("other")
    config = load_config(write_study(folder / "other.yaml", {"cell.material.poisson_ratio": 0.3}))
    run = RunFolder.claim(folder / "run", config)
    Dataset.create(run.dataset, inputs=config.sampling.input_space(), identity=config.stages.sampling)
    own = load_config(finished / "config.yaml")
    replace(CellReference.load(finished / "cell.json", own.stages.cell), identity=config.stages.cell).save(
        run.reference
    )
    surrogate = NumpySurrogate.load(finished / "surrogate.h5")
    surrogate.identity, surrogate.backend = config.stages.cell, "torch"
    surrogate.save(run.path / "surrogate.h5")
    return run.path


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


@pytest.fixture
def launch(tmp_path):
    """Start the command in the background; whatever a failed test leaves of it is killed."""
    started = []

    def start(*words, **how):
        started.append(Running(tmp_path / "streams", *words, **how))
        return started[-1]

    yield start
    for running in started:
        running.kill_all()
