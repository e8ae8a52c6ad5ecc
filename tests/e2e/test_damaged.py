"""Files of a run that were cut short, exchanged or made by somebody else: refused by name, and left alone."""

from __future__ import annotations

import os
import shutil

import h5py
import pytest

from porocore.sampling.datasets.dataset import Dataset
from porocore.study.config.loading import load_config
from tests.e2e.study import LOADS, contents, fingerprint, message, porocore, succeeded

SOLUTION = "solutions/linear_load-0.04.h5"
#: Each file with the step that reads it first.
READERS = {
    "samples.h5": "sample",
    "test.h5": "sample",
    "surrogate.h5": "solve",
    SOLUTION: "solve",
    "cell.json": "solve",
    "run.json": "train",
    "timings.json": "report",
    "training.csv": "report",
}


def refuse(run, step, name):
    """The message of ``step``, which must name the file and what to do, and change nothing."""
    before = fingerprint(run)
    refused = message(porocore(step, run))
    assert fingerprint(run) == before
    assert str(run / name) in refused
    assert len(refused.splitlines()) == 1
    assert any(advice in refused for advice in ("move it", "--out", "again", "sample"))
    return refused


@pytest.mark.parametrize("name", READERS)
def test_a_truncated_file(a_copy, name):
    run = a_copy("report.html", "metrics.json")
    os.truncate(run / name, (run / name).stat().st_size // 2)
    if name == "training.csv":  # cut between two numbers of a row
        (run / name).write_text("epoch,loss,validation_loss\n100,1e-3,2e-3\n200,1e-\n")
    refuse(run, READERS[name], name)


@pytest.mark.parametrize("name", ["samples.h5", "surrogate.h5", SOLUTION])
def test_a_text_in_place_of_the_file(a_copy, name):
    run = a_copy()
    (run / name).write_text("Dear diary,\n")
    refuse(run, READERS[name], name)


@pytest.mark.parametrize("name", ["samples.h5", "surrogate.h5", SOLUTION])
def test_a_foreign_hdf5_file(a_copy, name):
    run = a_copy()
    with h5py.File(run / name, "w") as file:
        file["temperature"] = [1.0, 2.0]
    refuse(run, READERS[name], name)


def test_states_and_surrogate_of_another_cell(a_copy, finished, other_cell):
    run = a_copy("samples.h5")
    shutil.copy(other_cell / "samples.h5", run)
    refused = refuse(run, "sample", "samples.h5")
    assert "holds solved states of another cell or other settings" in refused
    shutil.copy(finished / "samples.h5", run)
    shutil.copy(other_cell / "surrogate.h5", run)
    for step in ("train", "solve", "report"):
        refused = refuse(run, step, "surrogate.h5")
        assert "trained for another cell" in refused
        assert f"move it elsewhere and run porocore train {run}" in refused
    shutil.copy(other_cell / "cell.json", run)
    assert "belongs to another cell" in refuse(run, "solve", "cell.json")


def test_a_solution_of_another_law_or_load(a_copy):
    run = a_copy()
    shutil.copy(run / f"solutions/linear_load{LOADS[1]!r}.h5", run / SOLUTION)
    assert "holds the solution of law 'linear' under load -0.0001" in refuse(run, "solve", SOLUTION)
    shutil.copy(run / f"solutions/mean-gradient_load{LOADS[0]!r}.h5", run / SOLUTION)
    assert "holds the solution of law 'mean-gradient' under load -0.04" in refuse(run, "report", SOLUTION)


def test_held_out_states_that_are_missing(a_copy):
    """A report on fewer held-out states than configured would look better than it is."""
    run = a_copy()
    config = load_config(run / "config.yaml")
    (run / "test.h5").unlink()
    assert "sample first" in refuse(run, "report", "test.h5")
    inputs = config.sampling.input_space()
    Dataset.create(run / "test.h5", inputs=inputs, identity=config.stages.test)
    refused = refuse(run, "report", "test.h5")
    assert refused.endswith(f"sampling was interrupted and is not finished; run porocore sample {run}")


def test_a_configuration_edited_after_the_run_began(a_copy):
    run = a_copy()
    text = (run / "config.yaml").read_text().replace("poisson_ratio: 0.35", "poisson_ratio: 0.3")
    (run / "config.yaml").write_text(text)
    assert "was changed after the run began" in refuse(run, "solve", "config.yaml")


def test_following_the_advice_mends_the_run(a_copy, finished):
    run = a_copy()
    os.truncate(run / SOLUTION, 1000)
    assert f"move it to {(run / SOLUTION).name}.damaged, then solve again" in refuse(run, "solve", SOLUTION)
    (run / SOLUTION).unlink()
    succeeded(porocore("solve", run))
    assert contents(run / SOLUTION) == contents(finished / SOLUTION)


def test_half_written_files_of_killed_processes_are_removed(a_copy):
    run = a_copy()
    left = [run / "solutions" / ".linear_load-0.04.h5.4711.part", run / ".samples.h5.4711.part"]
    own = run / ".notes.part"
    for path in (*left, own):
        path.write_text("half")
    succeeded(porocore("train", run))
    assert own.exists()
    assert not any(path.exists() for path in left)
