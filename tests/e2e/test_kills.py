"""Killed at any moment and resumed, a run ends with the same numbers, and no finished solve is repeated."""

from __future__ import annotations

import shlex
import signal

import h5py
import pytest

from porocore.sampling.datasets.dataset import Dataset
from tests.e2e.study import (
    EAGER_SOLVING,
    EAGER_TRAINING,
    ONE_LOAD,
    PAUSING_SOLVING,
    PLAIN,
    QUICK,
    assert_same_results,
    assert_tidy,
    contents,
    figures,
    fingerprint,
    message,
    parts,
    porocore,
    seconds,
    succeeded,
    write_study,
)
from tests.helpers.platform_parts import POSIX

pytestmark = POSIX


@pytest.fixture
def two_workers(tmp_path):
    """The study with worker processes, whose number belongs to no identity, and one load."""
    return write_study(tmp_path / "study.yaml", {"sampling.workers": 2, **ONE_LOAD})


@pytest.fixture
def one_worker(tmp_path):
    """The same without worker processes."""
    return write_study(tmp_path / "one.yaml", ONE_LOAD)


def epochs(run):
    """Those in the table of losses, in the order of writing, after epoch 0."""
    return [0, *(int(row.split(",")[0]) for row in (run / "training.csv").read_text().splitlines()[1:])]


def checkpoint_time(run, name):
    with h5py.File(run / "checkpoints" / f"{name}.h5", "r") as file:
        return float(file.attrs["time"])


def test_a_run_killed_in_every_stage_ends_with_the_same_numbers(
    finished, two_workers, one_worker, tmp_path, launch
):
    run = tmp_path / "run"
    moments = [
        (PLAIN, lambda: parts(run, "samples.h5") >= 10),
        (PLAIN, lambda: parts(run, "test.h5") >= 3),
        (EAGER_TRAINING, lambda: max(epochs(run)) >= 200),
        (EAGER_SOLVING, lambda: checkpoint_time(run, "mean-gradient_load-0.04") > 30),
        (EAGER_SOLVING, lambda: checkpoint_time(run, "mean-gradient_load-0.04") > 150),
    ]
    solved, written = {}, {}
    for i, (program, moment) in enumerate(moments):
        command = ["run", one_worker, "--out", run, "--resume"] if i else ["run", two_workers, "--out", run]
        running = launch(*command, program=program)
        running.until(moment)
        assert running.stop(signal.SIGKILL) == -signal.SIGKILL
        running.assert_gone()
        assert not (run / "report.html").exists()
        now = seconds(run)
        assert solved.items() <= now.items(), f"states were solved again or lost after kill {i}"
        assert len(now) > len(solved) or i >= 2
        solved = now
        for path in (run / "surrogate.h5", *(run / "solutions").glob("*.h5")):
            if path.exists():
                assert written.setdefault(path, path.stat().st_mtime_ns) == path.stat().st_mtime_ns
    assert [path.name for path in written] == ["surrogate.h5"]
    assert succeeded(porocore("run", one_worker, "--out", run, "--resume")) == str(run / "report.html")
    assert solved.items() <= seconds(run).items()
    assert all(path.stat().st_mtime_ns == time for path, time in written.items())
    assert epochs(run) == sorted(epochs(run)), "the training began anew instead of from its checkpoint"
    assert_same_results(run, finished)
    found, expected = figures(run), figures(finished)
    assert found == expected | {"macro": expected["macro"][:1]}
    assert_tidy(run)


@pytest.mark.slow
def test_workers_end_when_only_the_main_process_is_killed(
    finished, two_workers, one_worker, tmp_path, launch
):
    """Nobody writes afterwards; sampling goes on where it was, with another number of workers if need be."""
    run = tmp_path / "run"

    running = launch("sample", two_workers, "--out", run)
    running.until(lambda: len(running.processes()) >= 3)
    refused = message(porocore("sample", run))
    assert refused.startswith(f"another porocore (process {running.process.pid}) is working in {run}; ")
    assert running.stop(signal.SIGKILL, only_main=True) == -signal.SIGKILL
    running.assert_gone()
    first = seconds(run)

    running = launch("sample", run)
    running.until(lambda: parts(run, "samples.h5") >= len(first) + 5)
    assert running.stop(signal.SIGKILL, only_main=True) == -signal.SIGKILL
    running.assert_gone()
    solved = seconds(run)
    assert first.items() <= solved.items()
    assert 5 <= len(solved) < len(Dataset.open(finished / "samples.h5"))
    before = fingerprint(run)
    refused = message(porocore("train", run))
    assert refused.endswith(f"sampling was interrupted and is not finished; run porocore sample {run}")
    assert fingerprint(run) == before

    succeeded(porocore("sample", one_worker, "--out", run, "--resume"))
    assert solved.items() <= seconds(run).items()
    for name in ("samples.h5", "test.h5"):
        assert Dataset.open(run / name).digest() == Dataset.open(finished / name).digest()
    assert_no_parts(run)


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_ctrl_c_while_sampling_keeps_what_ran_and_says_how_to_go_on(tmp_path, launch, workers):
    inputs = {"p": {"range": [0.0, 0.02], "step": 0.005}, "H22": {"range": [-0.02, 0.0], "step": 0.004}}
    changes = QUICK | {"sampling.inputs": inputs}
    config = write_study(tmp_path / "study.yaml", changes | {"sampling.workers": workers})
    finished, run = tmp_path / "finished", tmp_path / "a run"
    succeeded(porocore("sample", write_study(tmp_path / "one.yaml", changes), "--out", finished))
    running = launch("sample", config, "--out", run)
    running.until(lambda: parts(run, "samples.h5") >= 3)
    assert running.stop(signal.SIGINT) == 130
    running.assert_gone()
    assert running.out.read_text() == ""
    error = running.err.read_text()
    assert "Traceback" not in error
    advice = error.splitlines()[-1].removeprefix("interrupted; continue with: ")
    assert shlex.split(advice) == ["porocore", "sample", str(run)]
    solved = seconds(run)
    assert 3 <= len(solved) < len(Dataset.open(finished / "samples.h5"))
    succeeded(porocore(*shlex.split(advice)[1:]))
    assert solved.items() <= seconds(run).items()
    assert Dataset.open(run / "samples.h5").digest() == Dataset.open(finished / "samples.h5").digest()
    assert_no_parts(run)


def test_ctrl_c_while_a_run_samples(tmp_path, launch):
    run = tmp_path / "a run"
    inputs = {"p": {"range": [0.0, 0.02], "step": 0.005}, "H22": {"range": [-0.02, 0.0], "step": 0.004}}
    config = write_study(tmp_path / "study.yaml", QUICK | {"sampling.inputs": inputs, "sampling.workers": 1})
    running = launch("run", config, "--out", run)
    running.until(lambda: parts(run, "samples.h5") >= 2)
    assert running.stop(signal.SIGINT) == 130
    error = running.err.read_text()
    assert "unexpected" not in error
    advice = error.splitlines()[-1].removeprefix("interrupted; continue with: ")
    assert shlex.split(advice)[:2] == ["porocore", "run"]
    assert "--resume" in advice


@pytest.mark.parametrize("stage", [pytest.param("train", marks=pytest.mark.slow), "solve"])
def test_ctrl_c_later_on(finished, a_copy, launch, stage):
    made = {"train": ["surrogate.h5", "training.csv"], "solve": ["solutions"]}[stage]
    run = a_copy(*made)
    program, moment = {
        "train": (EAGER_TRAINING, lambda: max(epochs(run)) > 0),
        "solve": (PAUSING_SOLVING, lambda: checkpoint_time(run, "mean-gradient_load-0.04") > 0),
    }[stage]
    running = launch(stage, run, program=program)
    running.until(moment)
    assert running.stop(signal.SIGINT) == 130
    error = running.err.read_text()
    assert error.splitlines()[-1] == f"interrupted; continue with: porocore {stage} {run}"
    assert "Traceback" not in error
    succeeded(porocore(stage, run))
    for name in ("surrogate.h5", "solutions/mean-gradient_load-0.04.h5", "solutions/linear_load-0.0001.h5"):
        assert contents(run / name) == contents(finished / name)
    assert_tidy(run)


def assert_no_parts(run):
    assert not [path for path in run.rglob("*") if path.name.endswith((".part", ".parts"))]
