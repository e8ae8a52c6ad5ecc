"""One writer at a time, and any number of readers."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import porocore.sampling.datasets.dataset as dataset_module
import porocore.sampling.datasets.dataset as parts_module
from porocore.errors import DataError, RunFolderError
from porocore.interfaces.records import SolvedState
from porocore.sampling.datasets.dataset import Dataset, parts_folder
from porocore.states import Status
from tests.helpers.campaigns import SCRIPT, sample, solves
from tests.helpers.fake_cell import IDENTITY, INPUTS, mean_gradient, response


def record(key: str, p: float = 0.0) -> SolvedState:
    x = (p, -0.1)
    answer = response(mean_gradient(-0.1, p), 0.1, Status.converged)
    return SolvedState(key, x, INPUTS.scatter(x), answer, 0.5)


def create(path: Path) -> Dataset:
    return Dataset.create(path, inputs=INPUTS, identity=IDENTITY)


def test_a_second_writer_is_refused_and_the_first_goes_on(tmp_path: Path) -> None:
    """Two processes at one file; the lock of a killed one is free."""
    path, log = tmp_path / "data.h5", tmp_path / "log"
    process = subprocess.Popen([sys.executable, SCRIPT, str(path), str(log), "1", "0.05"])
    try:
        while len(solves(log)) < 3 and process.poll() is None:
            time.sleep(0.01)
        with pytest.raises(
            RunFolderError, match=rf"data\.h5: another process \({process.pid}\) is writing it"
        ):
            sample(path)
        with pytest.raises(RunFolderError, match=r"another process"):
            Dataset.open(path).append(record("mine"))
        assert len(Dataset.open(path)) >= 2  # reading is allowed
        assert process.poll() is None
    finally:
        process.kill()
        process.wait()
    _, summary = sample(path)
    assert summary.reused >= 2
    assert sorted(os.listdir(tmp_path)) == ["data.h5", "log"]


def test_what_another_writer_added_is_read_before_writing(tmp_path: Path) -> None:
    first = create(tmp_path / "data.h5")
    second = Dataset.open(first.path)
    first.append(record("a"))
    assert "a" not in second
    with pytest.raises(ValueError, match="'a' is in the dataset already"):
        second.append(record("a"))
    second.append(record("b"))
    first.consolidate()
    assert first.keys == ["a", "b"]
    second.append(record("c"))
    assert Dataset.open(first.path).keys == ["a", "b", "c"]


def test_a_dataset_is_created_once(tmp_path: Path) -> None:
    path = tmp_path / "data.h5"
    with dataset_module.sole_writer(path), pytest.raises(RunFolderError, match="another process"):
        create(path)
    assert not path.exists()
    create(path)
    with pytest.raises(RunFolderError, match="exists"):
        create(path)
    assert os.listdir(tmp_path) == ["data.h5"]


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RunFolderError, match=r"cannot write .*file/data\.h5"):
        create(tmp_path / "file" / "data.h5")


def test_reading_while_parts_are_merged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file is read before the merge and its parts after it: read again."""
    writer = create(tmp_path / "data.h5")
    for k in range(3):
        writer.append(record(f"{k}", p=0.01 * k))
    read, merged = parts_module.read_block, []

    def read_and_merge(path: Path, advice: str, *, sound: bool) -> object:
        found = read(path, advice, sound=sound)
        if not merged:
            merged.append(True)
            with monkeypatch.context() as undone:
                undone.setattr(parts_module, "read_block", read)
                writer.consolidate()
        return found

    monkeypatch.setattr(parts_module, "read_block", read_and_merge)
    reader = Dataset.open(writer.path)
    assert merged
    assert reader.keys == ["0", "1", "2"]
    np.testing.assert_array_equal(reader.x(), writer.x())


def test_a_damaged_part_is_no_reason_to_read_again(tmp_path: Path) -> None:
    writer = create(tmp_path / "data.h5")
    writer.append(record("a"))
    (part,) = parts_folder(writer.path).glob("*.h5")
    part.write_bytes(b"nothing")
    with pytest.raises(DataError, match=r"move it to .*\.damaged, then resume"):
        Dataset.open(writer.path)
