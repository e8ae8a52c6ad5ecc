"""Sampling that is killed, interrupted or loses a worker: what was finished is kept, and the rest has the same bits."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from porocore.errors import PorocoreError
from porocore.sampling.campaign import CampaignProgress
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution.interrupts import GRACE
from porocore.states import Status
from tests.helpers.campaigns import SCRIPT, gone, sample, session_gone, solves, state_text
from tests.helpers.fake_cell import INPUTS, Fake, Tree


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The dataset of one worker and no interruption."""
    return sample(tmp_path_factory.mktemp("undisturbed") / "data.h5")[0]


@pytest.mark.parametrize(
    ("moment", "workers"),
    [(0, 1), (1, 2), *(pytest.param(moment, 2, marks=pytest.mark.slow) for moment in (2, 3))],
)
def test_killed_and_resumed(tmp_path: Path, undisturbed: Dataset, moment: int, workers: int) -> None:
    """SIGKILL at random moments: nothing finished is solved again, and the dataset has the same bits."""
    path, log = tmp_path / "data.h5", tmp_path / "log"
    rng = random.Random(moment)
    command = [sys.executable, SCRIPT, str(path), str(log), str(workers), "0.01"]
    finished: set[str] = set()
    for _ in range(2):
        target = rng.randint(2, (len(undisturbed) - len(finished)) // 2)
        process = subprocess.Popen(command, start_new_session=True)
        while len(solves(log)) < target and process.poll() is None:
            time.sleep(0.002)
        time.sleep(rng.uniform(0, 0.02))
        process.kill()
        assert process.wait() == -signal.SIGKILL
        assert session_gone(process.pid)
        begun = [state for _, _, state in solves(log)]
        log.unlink()
        kept = Dataset.open(path)
        now = {state_text(kept, key) for key in kept.keys}
        assert finished.isdisjoint(begun)
        assert finished <= now <= finished | set(begun)
        # Only what ran in a worker, or lay solved in the queue to the parent, when it was killed is lost.
        assert len(finished | set(begun)) - len(now) <= workers + 1
        assert len(kept) < len(undisturbed)
        finished = now
    dataset, summary = sample(path, Fake(log=str(log)), workers=workers)
    states = [state_text(dataset, key) for key in dataset.keys]
    assert sorted(state for _, _, state in solves(log)) == sorted(set(states) - finished)
    assert (summary.solved, summary.reused) == (len(undisturbed) - len(finished), len(finished))
    assert dataset.digest() == undisturbed.digest()


# Two workers are interrupted by tests/e2e/test_kills.py, too.
@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_interrupted_with_ctrl_c(tmp_path: Path, undisturbed: Dataset, workers: int) -> None:
    """What runs is finished and kept, and no process is left."""
    path, log = tmp_path / "data.h5", tmp_path / "log"
    command = [sys.executable, SCRIPT, str(path), str(log), str(workers), "0.1"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    while len(solves(log)) < 6 and process.poll() is None:
        time.sleep(0.005)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers too
    _, trouble = process.communicate(timeout=30)
    assert process.returncode == -signal.SIGINT
    assert trouble.count("Traceback") == 1
    assert trouble.strip().endswith("KeyboardInterrupt")
    assert gone({int(pid) for pid, _, _ in solves(log)})
    kept = Dataset.open(path)
    assert sorted(state for _, _, state in solves(log)) == sorted(state_text(kept, k) for k in kept.keys)
    assert 6 <= len(kept) < len(undisturbed)
    dataset, summary = sample(path)
    assert summary.reused == len(kept)
    assert dataset.digest() == undisturbed.digest()


@pytest.mark.parametrize("workers", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_a_second_ctrl_c_does_not_wait(tmp_path: Path, workers: int) -> None:
    path, log = tmp_path / "data.h5", tmp_path / "log"
    command = [sys.executable, SCRIPT, str(path), str(log), str(workers), "60"]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    while not solves(log) and process.poll() is None:
        time.sleep(0.01)
    began = time.monotonic()
    for _ in range(2):
        time.sleep(0.2)
        process.send_signal(signal.SIGINT)
    try:
        assert process.wait(timeout=20) == -signal.SIGINT
    finally:
        process.kill()
    assert time.monotonic() - began < 20
    assert gone({int(pid) for pid, _, _ in solves(log)})


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_one_ctrl_c_gives_up_states_that_take_long(tmp_path: Path, workers: int) -> None:
    path, log = tmp_path / "data.h5", tmp_path / "log"
    command = [sys.executable, SCRIPT, str(path), str(log), str(workers), "60"]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    while not solves(log) and process.poll() is None:
        time.sleep(0.01)
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    try:
        assert process.wait(timeout=30) == -signal.SIGINT
    finally:
        process.kill()
    assert time.monotonic() - began >= GRACE
    assert gone({int(pid) for pid, _, _ in solves(log)})
    assert len(Dataset.open(path)) == 0


def test_an_interrupt_is_reported_and_the_handler_is_put_back(tmp_path: Path) -> None:
    before = signal.getsignal(signal.SIGINT)
    seen: list[CampaignProgress] = []

    def watch(progress: CampaignProgress) -> None:
        seen.append(progress)
        if progress.done == 3:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        sample(tmp_path / "data.h5", on_progress=watch)
    assert seen[-1].stopping
    assert not seen[2].stopping
    assert signal.getsignal(signal.SIGINT) is before
    assert len(Dataset.open(tmp_path / "data.h5")) == 3


#: A leaf of the tree, so that nothing starts from it.
LEAF = 7


def leaf_p() -> float:
    return Tree(INPUTS, LEAF + 1).requests[LEAF].x[0]


@pytest.mark.parametrize("workers", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_a_worker_that_dies_twice_over_a_state_costs_that_state_only(tmp_path: Path, workers: int) -> None:
    path, log = tmp_path / "data.h5", tmp_path / "log"
    fake = Fake(die_at=leaf_p(), log=str(log))
    tree = Tree(INPUTS, LEAF + 1)
    dataset, summary = sample(path, fake, workers=workers, executor="processes", sampler=tree)
    (dead,) = dataset.ended(Status.lost)
    assert dead == tree.requests[LEAF].key
    assert summary.counts[Status.lost] == 1
    lost = dataset.response(dead)
    assert np.isnan(lost.stress).all()
    assert np.isnan(lost.tangent.stress_grad_u).all()
    counts = Counter(state for _, _, state in solves(log))
    assert all(counts[state_text(dataset, key)] == 1 + (key == dead) for key in dataset.keys)
    assert gone({int(pid) for pid, _, _ in solves(log)})
    # It stays so, until it is asked for again.
    assert sample(path, sampler=Tree(INPUTS, LEAF + 1))[1].solved == 0
    dataset = Dataset.open(path)
    dataset.drop([dead])
    assert dead not in Dataset.open(path)
    assert len(Dataset.open(path)) == LEAF
    assert sample(path, sampler=Tree(INPUTS, LEAF + 1))[1].solved == 1
    judge, _ = sample(tmp_path / "judge.h5", sampler=Tree(INPUTS, LEAF + 1))
    assert Dataset.open(path).digest() == judge.digest()


def test_workers_that_die_over_the_first_state_end_the_run(tmp_path: Path) -> None:
    """Then it may not be the state's fault."""
    path, tree = tmp_path / "data.h5", Tree(INPUTS, 4)
    first = tree.requests[0]
    with pytest.raises(PorocoreError, match=rf"two workers died on the state '{first.key}'.* fewer workers"):
        sample(path, Fake(die_at=first.x[0]), workers=2, sampler=tree)
    assert len(Dataset.open(path)) == 0
    assert sample(path, sampler=Tree(INPUTS, 4))[1].solved == 4


@pytest.mark.parametrize("executor", ["auto", pytest.param("dask", marks=pytest.mark.slow)])
def test_a_hung_state_is_ended_twice_and_the_others_go_on(tmp_path: Path, executor: str) -> None:
    path, log = tmp_path / "data.h5", tmp_path / "log"
    tree = Tree(INPUTS, LEAF + 1)
    began = time.monotonic()
    fake = Fake(hang_at=leaf_p(), log=str(log))
    dataset, _ = sample(path, fake, workers=2, executor=executor, state_seconds=0.4, sampler=tree)
    assert time.monotonic() - began < 60
    assert dataset.ended(Status.lost) == [tree.requests[LEAF].key]
    assert dataset.seconds()[dataset.keys.index(tree.requests[LEAF].key)] >= 0.8
    hung = {pid for pid, _, state in solves(log) if state == state_text(dataset, tree.requests[LEAF].key)}
    assert len(hung) == 2
    assert gone({int(pid) for pid, _, _ in solves(log)})
