"""Studies on one cell share what they have solved; a store that is damaged or half written changes nothing."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import time

import pytest

from porocore.core.files.store import ResultStore
from porocore.sampling.datasets.dataset import Dataset
from tests.e2e.study import ENVIRONMENT, PLAIN, QUICK, contents, porocore, succeeded, write_study

OTHER_BODY = QUICK | {
    "title": "A shorter body",
    "macro.body": {"size": [0.1, 4.0, 0.1], "elements": [1, 3, 1]},
}
del OTHER_BODY["macro.body.elements"]


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """A run that filled a store: its folder, and the store."""
    folder = tmp_path_factory.mktemp("first")
    config = write_study(folder / "study.yaml", QUICK)
    done = porocore("run", config, "--out", folder / "run", "--store", folder / "store")
    assert "came from the store" not in done.stderr
    assert succeeded(done)
    return folder / "run", folder / "store"


def digests(run):
    return [Dataset.open(run / name).digest() for name in ("samples.h5", "test.h5")]


def second(folder, store, changes=OTHER_BODY):
    config = write_study(folder / "other.yaml", changes)
    done = porocore("run", config, "--out", folder / "other", "--store", store)
    assert succeeded(done)
    return folder / "other", done.stderr


def test_a_study_with_another_body_solves_no_cell_and_trains_nothing(first, tmp_path):
    run, store = first
    before = {file.path: file.path.read_bytes() for file in ResultStore(store).files()}
    other, said = second(tmp_path, store)
    count = len(Dataset.open(run / "samples.h5"))
    assert f"sampling: {count} states came from the store, which saved " in said
    assert "held-out states: 2 states came from the store" in said
    assert f"store: {count + 2} of {count + 2} states were taken, 0 were solved" in said
    assert "training: surrogate.h5 came from the store" in said
    assert digests(other) == digests(run)
    assert contents(other / "surrogate.h5") == contents(run / "surrogate.h5")
    assert (other / "cell.json").read_bytes() == (run / "cell.json").read_bytes()
    assert {file.path: file.path.read_bytes() for file in ResultStore(store).files()} == before
    times = [json.loads((folder / "timings.json").read_text()) for folder in (run, other)]
    for stage in ("cell", "sampling", "held-out states", "training"):
        assert times[1][stage]["seconds"] >= 0.5 * times[0][stage]["seconds"], stage
        assert times[1][stage]["runs"] == 1


def test_a_damaged_store_gives_the_same_answer(first, tmp_path):
    run, store = first
    damaged = tmp_path / "store"
    shutil.copytree(store, damaged)
    for k, file in enumerate(sorted(ResultStore(damaged).files(), key=lambda file: file.path)):
        if file.kind != "states" or k % 3 == 0:
            os.truncate(file.path, file.bytes // 2)
        elif k % 3 == 1:  # as a process leaves it that is killed while it writes
            file.path.rename(file.path.with_name(f".{file.path.name}.0.part"))
    other, said = second(tmp_path, damaged)
    assert re.search(r"sampling: \d+ states came from the store", said)
    assert digests(other) == digests(run)
    assert contents(other / "surrogate.h5") == contents(run / "surrogate.h5")
    assert len(ResultStore(damaged).files()) == len(ResultStore(store).files())


@pytest.mark.slow
def test_killed_while_it_writes_the_store(first, tmp_path):
    run, _ = first
    store = tmp_path / "store"
    config = write_study(tmp_path / "killed.yaml", QUICK)
    words = [*PLAIN, "sample", config, "--out", tmp_path / "killed", "--store", store]
    process = subprocess.Popen(list(map(str, words)), env=ENVIRONMENT, stderr=subprocess.DEVNULL)
    while len(ResultStore(store).files()) < 4:
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    other, said = second(tmp_path, store)
    assert re.search(r"sampling: \d+ states came from the store", said)
    assert digests(other) == digests(run)


def test_no_store_is_neither_read_nor_filled(first, tmp_path):
    run, store = first
    before = len(ResultStore(store).files())
    config = write_study(tmp_path / "study.yaml", QUICK)
    done = porocore("sample", config, "--out", tmp_path / "run", "--no-store")
    assert "came from the store" not in done.stderr
    assert digests(tmp_path / "run") == digests(run)
    assert len(ResultStore(store).files()) == before


def test_both_options_exclude_each_other(tmp_path, study):
    done = porocore("run", study, "--out", tmp_path / "run", "--store", tmp_path, "--no-store")
    assert done.returncode == 2
    assert done.stderr == "error: --store and --no-store exclude each other; leave one out\n"
    assert not (tmp_path / "run").exists()


def test_the_store_is_listed_checked_and_cleared(first, tmp_path):
    store = tmp_path / "store"
    shutil.copytree(first[1], store)
    listed = json.loads(succeeded(porocore("store", "list", "--store", store, "--json")))
    assert {row["kind"] for row in listed["kinds"]} == {"states", "cells", "surrogates", "training-curves"}
    os.truncate(ResultStore(store).files()[0].path, 10)
    assert "1 were damaged and removed" in succeeded(porocore("store", "check", "--store", store))
    succeeded(porocore("store", "clear", "--store", store, "--unused", "1"))
    assert ResultStore(store).files()
    succeeded(porocore("store", "clear", "--store", store))
    assert ResultStore(store).files() == []
