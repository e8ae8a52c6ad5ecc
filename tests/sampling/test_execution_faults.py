"""A sampling run that is shot at: workers and the main process die at random moments, schedulers go, users give up."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import pytest

from porocore.errors import PluginError, PorocoreError
from porocore.sampling.campaign import CampaignProgress, run_campaign
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.execution.dask_workers import DaskBackend
from porocore.sampling.execution.tasks import Ready
from tests.helpers.campaigns import SCRIPT, gone, sample, session_gone, solves, state_text
from tests.helpers.fake_cell import IDENTITY, INPUTS, Fake, Tree, make

pytestmark = pytest.mark.slow

STATES, KILLS, WORKERS = 300, 20, 2


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The dataset of one worker and no fault."""
    return sample(tmp_path_factory.mktemp("undisturbed") / "data.h5", sampler=Tree(INPUTS, STATES))[0]


class Shooting:
    """One run that is resumed until it is done, and what its log says meanwhile."""

    def __init__(self, folder: Path, executor: str, seed: int) -> None:
        self.path, self.log = folder / "data.h5", folder / "log"
        self.executor, self.random = executor, random.Random(seed)
        self.process: subprocess.Popen[bytes] | None = None
        self.hit: set[str] = set()
        self.kills: list[str] = []
        #: States that were kept, and how many solves had begun, at each kill.
        self.kept: list[tuple[set[str], int]] = []

    def start(self) -> None:
        words = [str(self.path), str(self.log), str(WORKERS), "0.05", self.executor, str(STATES)]
        self.process = subprocess.Popen([sys.executable, SCRIPT, *words], start_new_session=True)
        self.hit = set()

    def kill_once(self) -> bool:
        """At a random moment, the main process or a worker; False: the run ended before."""
        assert self.process is not None
        target = len(solves(self.log)) + self.random.randint(1, 6)
        while len(solves(self.log)) < target:
            if self.process.poll() is not None:
                return False
            time.sleep(0.002)
        time.sleep(self.random.uniform(0, 0.04))
        if self.random.random() < 0.35:
            self.process.kill()
            assert self.process.wait() == -signal.SIGKILL
            assert session_gone(self.process.pid)
            self.kills.append("main")
        elif not self.kill_worker():
            return True
        # A solve that had begun before it was noted here may be under way still; a kept one never begins again.
        begun = len(solves(self.log))
        kept = Dataset.open(self.path)
        self.kept.append(({state_text(kept, key) for key in kept.keys}, max(begun, len(solves(self.log)))))
        return True

    def kill_worker(self) -> bool:
        latest = {int(pid): state for pid, _, state in solves(self.log)}
        alive = [pid for pid, state in latest.items() if state not in self.hit and not gone({pid}, within=0)]
        if not alive:
            return False
        victim = self.random.choice(alive)
        # A state whose worker dies twice would be recorded as lost, as it should.
        self.hit.add(latest[victim])
        with suppress(ProcessLookupError):
            os.kill(victim, signal.SIGKILL)
        self.kills.append("worker")
        return True


@pytest.fixture
def shoot(tmp_path: Path) -> Iterator[type[Shooting]]:
    made: list[Shooting] = []

    def begin(executor: str, seed: int) -> Shooting:
        made.append(Shooting(tmp_path, executor, seed))
        made[-1].start()
        return made[-1]

    yield begin  # type: ignore[misc]
    for shooting in made:
        if shooting.process is not None and shooting.process.poll() is None:
            shooting.process.kill()
            shooting.process.wait()


@pytest.mark.parametrize("executor", ["processes", "dask"])
def test_killed_at_twenty_random_moments(shoot, undisturbed: Dataset, executor: str) -> None:
    run = shoot(executor, 7)
    while len(run.kills) < KILLS:
        assert run.kill_once(), f"done after {len(run.kills)} kills"
        if run.process.poll() is not None:
            run.start()
    assert {"main", "worker"} == set(run.kills)
    assert run.process.wait(timeout=120) == 0
    dataset = Dataset.open(run.path)
    assert dataset.digest() == undisturbed.digest()
    begun = [state for _, _, state in solves(run.log)]
    for kept, position in run.kept:
        assert kept.isdisjoint(begun[position:])
    # Only what was under way, or lay solved on its way to the disk, is solved again.
    assert len(begun) - STATES <= (WORKERS + 1) * run.kills.count("main") + run.kills.count("worker")


@pytest.mark.parametrize("times", [1, 2])
def test_ctrl_c_with_dask(tmp_path: Path, times: int) -> None:
    """Once: what runs is finished and kept. Twice: at once. Both go on to the same dataset."""
    path, log = tmp_path / "data.h5", tmp_path / "log"
    sleep = "0.5" if times == 1 else "60"
    process = subprocess.Popen(
        [sys.executable, SCRIPT, str(path), str(log), "2", sleep, "dask"],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    wanted = 6 if times == 1 else 1
    while len(solves(log)) < wanted and process.poll() is None:
        time.sleep(0.005)
    began = time.monotonic()
    for _ in range(times):
        time.sleep(0.3)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers too
    try:
        _, trouble = process.communicate(timeout=40)
    finally:
        process.kill()
    assert process.returncode == -signal.SIGINT
    assert trouble.strip().endswith("KeyboardInterrupt")
    assert time.monotonic() - began < 30
    assert session_gone(process.pid)
    kept = Dataset.open(path)
    if times == 1:
        assert sorted(state for _, _, state in solves(log)) == sorted(state_text(kept, k) for k in kept.keys)
        assert len(kept) >= 6
    dataset, summary = sample(path)
    assert summary.reused == len(kept)
    assert dataset.digest() == sample(tmp_path / "other.h5")[0].digest()


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, dict[str, subprocess.Popen[bytes]]]]:
    """A scheduler and two workers of the user's."""
    file = tmp_path / "scheduler.json"
    folder = str(Path(__file__).parents[1] / "helpers")
    environment = os.environ | {"PYTHONPATH": folder}
    common = {"env": environment, "stderr": subprocess.DEVNULL, "start_new_session": True}
    module = [sys.executable, "-m"]
    scheduler = [*module, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    worker = [*module, "distributed.cli.dask_worker", "--nworkers", "2", "--nthreads", "1", "--no-dashboard"]
    started = {
        "scheduler": subprocess.Popen([*scheduler, "--no-dashboard", "--scheduler-file", str(file)], **common)
    }
    try:
        while not file.exists() or not file.read_text().strip():
            assert started["scheduler"].poll() is None
            time.sleep(0.05)
        words = ["--scheduler-file", str(file), "--local-directory", str(tmp_path)]
        started["workers"] = subprocess.Popen([*worker, *words], **common)
        yield json.loads(file.read_text())["address"], started
    finally:
        for process in started.values():
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def test_a_cluster_of_the_users(tmp_path: Path, cluster) -> None:
    """It serves two runs one after the other; a scheduler that goes away ends the run with a word."""
    address, started = cluster
    judge = sample(tmp_path / "judge.h5")[0]
    first, _ = sample(tmp_path / "first.h5", scheduler=address)
    assert first.digest() == judge.digest()
    log = tmp_path / "log"

    def watch(progress: CampaignProgress) -> None:
        if progress.done == 8:
            started["scheduler"].kill()

    dataset = Dataset.create(tmp_path / "second.h5", inputs=INPUTS, identity=IDENTITY)
    with (
        pytest.raises(PorocoreError, match=rf"the dask scheduler at {address} has gone .* resume"),
        CellPool(make, (Fake(sleep=0.1, log=str(log)),), scheduler=address) as pool,
    ):
        run_campaign(Tree(INPUTS, 30), pool, dataset, on_progress=watch)
    assert 8 <= len(dataset) < 30
    before = {key: dataset.seconds()[i] for i, key in enumerate(dataset.keys)}
    resumed, _ = sample(dataset.path, sampler=Tree(INPUTS, 30))
    after = dict(zip(resumed.keys, resumed.seconds(), strict=True))
    assert before.items() <= after.items()


def test_workers_that_join_late(tmp_path: Path, cluster) -> None:
    """The run says that it waits, and is done when they are there."""
    address, started = cluster
    os.killpg(started["workers"].pid, signal.SIGSTOP)
    told: list[str] = []

    def tell(text: str) -> None:
        told.append(text)
        os.killpg(started["workers"].pid, signal.SIGCONT)

    dataset = Dataset.create(tmp_path / "data.h5", inputs=INPUTS, identity=IDENTITY)
    with CellPool(make, (Fake(),), scheduler=address, on_warning=tell) as pool:
        run_campaign(Tree(INPUTS, 10), pool, dataset)
    assert len(dataset) == 10
    assert told == [f"the dask scheduler at {address} has no workers; waiting for the first one to join"]


def test_what_is_asked_of_a_worker(cluster) -> None:
    """The same porocore, and one thread."""
    address, _ = cluster
    workers = DaskBackend(address, 1)
    try:
        fit = Ready(1, "node", version("porocore"), ("1", "1", "1", None))
        assert workers.check(fit) == []
        (warning,) = workers.check(replace(fit, threads=(None,) * 4))
        assert "OMP_NUM_THREADS=1" in warning
        with pytest.raises(PluginError, match=r"on node have porocore 0\.0\.1, this process has"):
            workers.check(replace(fit, version="0.0.1"))
    finally:
        workers.close()
