"""Sampling in parallel, with interruptions: the same dataset whatever happens on the way."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from porocore.dataset import Dataset
from porocore.errors import ConfigurationError, DataError, PluginError, PorocoreError
from porocore.execution import CellPool
from porocore.inputs import InputSpace
from porocore.interfaces.sampler import Request, Sampler
from porocore.sampling.campaign import CampaignSummary, Progress, run_campaign
from porocore.sampling.density import DensitySweep
from porocore.sampling.random_states import RandomStates, random_requests
from porocore.states import CellResponse, Status

sys.path.insert(0, str(Path(__file__).parent))
from fake_cell import IDENTITY, INPUTS, OPTIONS, Fake, make, mean_gradient, refuse

SCRIPT = str(Path(__file__).with_name("fake_cell.py"))


def sample(
    path: Path,
    fake: Fake | None = None,
    *,
    workers: int = 1,
    sampler: Sampler | None = None,
    on_progress: Callable[[Progress], None] | None = None,
) -> tuple[Dataset, CampaignSummary]:
    dataset = Dataset.create_or_open(path, inputs=INPUTS, identity=IDENTITY)
    with CellPool(make, (fake or Fake(),), workers=workers) as pool:
        sampler = sampler or DensitySweep(INPUTS, **OPTIONS)
        return dataset, run_campaign(sampler, pool, dataset, on_progress=on_progress)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The dataset of one worker and no interruption."""
    return sample(tmp_path_factory.mktemp("undisturbed") / "data.h5")[0]


def solves(log: Path) -> list[tuple[str, str, str]]:
    """(process, threads, state) of each solve that began."""
    if not log.exists():
        return []
    return [tuple(line.split(maxsplit=2)) for line in log.read_text().splitlines()]  # type: ignore[misc]


def state_text(dataset: Dataset, key: str) -> str:
    return " ".join(f"{value:+.10f}" for value in dataset.inputs_of(key))


def gone(pids: set[int], within: float = 10.0) -> bool:
    """Whether all these processes end in time (a zombie of another parent has ended too)."""

    def alive(pid: int) -> bool:
        try:
            return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
        except OSError:
            return False

    end = time.monotonic() + within
    while any(map(alive, pids)) and time.monotonic() < end:
        time.sleep(0.02)
    return not any(map(alive, pids))


def session_gone(session: int, within: float = 10.0) -> bool:
    """Whether every process of this session ends in time, also one that was starting and has logged nothing yet."""

    def members() -> set[int]:
        found = set()
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                of = stat.read_text().rsplit(")", 1)[1].split()[3]
            except OSError:
                continue
            if int(of) == session:
                found.add(int(stat.parent.name))
        return found

    end = time.monotonic() + within
    return gone(members(), within) and gone(members(), max(0.0, end - time.monotonic()))


def test_the_dataset_holds_the_closed_form_and_the_failures(undisturbed: Dataset) -> None:
    x, responses = undisturbed.x(), undisturbed.responses()
    expected_to_fail = x[:, 1] + x[:, 0] < Fake().edge
    assert 5 < expected_to_fail.sum() < len(x) - 20
    np.testing.assert_array_equal(responses.status == Status.overlap, expected_to_fail)
    for (p, H22), g, fails in zip(x, responses.mean_grad, expected_to_fail, strict=True):
        np.testing.assert_array_equal(g, np.full((3, 3), np.nan) if fails else mean_gradient(H22, p))
    assert (undisturbed.seconds() > 0).all()
    assert undisturbed.starts().count(None) == 1
    assert not undisturbed.path.with_name("data.h5.parts").exists()


def test_progress_and_summary_count_every_state(tmp_path: Path) -> None:
    seen: list[Progress] = []
    dataset, summary = sample(tmp_path / "data.h5", on_progress=seen.append)
    assert [progress.done for progress in seen] == list(range(len(dataset) + 1))
    assert seen[0].remaining is None
    assert all(progress.expected >= progress.done for progress in seen)
    last = seen[-1]
    assert (last.done, last.expected, last.remaining) == (len(dataset), len(dataset), 0)
    statuses = dataset.responses().status
    assert last.failed == (statuses == Status.overlap).sum()
    assert summary.counts == {s: (statuses == s).sum() for s in (Status.converged, Status.overlap)}
    assert (summary.solved, summary.reused) == (len(dataset), 0)
    assert summary.seconds >= dataset.seconds().sum()
    assert last.rate >= len(dataset) / summary.seconds * 0.9


def test_two_workers_give_the_same_bits_on_one_thread_each(tmp_path: Path, undisturbed: Dataset) -> None:
    before = dict(os.environ)
    log = tmp_path / "log"
    dataset, summary = sample(tmp_path / "data.h5", Fake(log=str(log), sleep=0.01), workers=2)
    assert dataset.digest() == undisturbed.digest()
    assert summary.solved == len(undisturbed)
    processes = {process for process, _, _ in solves(log)}
    assert len(processes) == 2
    assert str(os.getpid()) not in processes
    assert {threads for _, threads, _ in solves(log)} == {"1"}
    assert gone({int(process) for process in processes})
    assert dict(os.environ) == before


def test_a_finished_campaign_is_not_solved_again(tmp_path: Path) -> None:
    dataset, _ = sample(tmp_path / "data.h5")
    log = tmp_path / "log"
    again, summary = sample(dataset.path, Fake(log=str(log)))
    assert solves(log) == []
    assert (summary.solved, summary.reused) == (0, len(dataset))
    assert again.digest() == dataset.digest()


def test_the_start_matters_in_this_fake(tmp_path: Path, undisturbed: Dataset) -> None:
    """Otherwise the tests on equal bits would not notice a wrong start."""

    class Cold(DensitySweep):
        def ask(self) -> list[Request]:
            return [Request(request.key, request.x) for request in super().ask()]

    dataset, _ = sample(tmp_path / "data.h5", sampler=Cold(INPUTS, **OPTIONS))
    key = undisturbed.keys[5]
    warm, cold = undisturbed.field(key), dataset.field(key)
    assert warm is not None
    assert cold is not None
    assert not np.array_equal(warm.u, cold.u)


@pytest.mark.parametrize(("moment", "workers"), [(0, 1), (1, 2), (2, 2), (3, 2)])
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


@pytest.mark.parametrize("workers", [1, 2])
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


@pytest.mark.parametrize("workers", [1, 2])
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


def test_an_interrupt_is_reported_and_the_handler_is_put_back(tmp_path: Path) -> None:
    before = signal.getsignal(signal.SIGINT)
    seen: list[Progress] = []

    def watch(progress: Progress) -> None:
        seen.append(progress)
        if progress.done == 3:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        sample(tmp_path / "data.h5", on_progress=watch)
    assert seen[-1].stopping
    assert not seen[2].stopping
    assert signal.getsignal(signal.SIGINT) is before
    assert len(Dataset.open(tmp_path / "data.h5")) == 3


def test_beside_the_main_thread_no_signal_is_touched(tmp_path: Path, undisturbed: Dataset) -> None:
    digests = []
    thread = threading.Thread(target=lambda: digests.append(sample(tmp_path / "data.h5")[0].digest()))
    thread.start()
    thread.join()
    assert digests == [undisturbed.digest()]


@pytest.mark.parametrize("workers", [1, 2])
def test_an_exception_in_a_solve_comes_back_with_its_message(tmp_path: Path, workers: int) -> None:
    with pytest.raises(
        PorocoreError, match=r"ArithmeticError at state 'p=\+0.1000000000 .*: a pivot vanished"
    ) as caught:
        sample(tmp_path / "data.h5", Fake(raise_at=0.1), workers=workers)
    assert "in solve" in caught.value.__notes__[0]
    # The other first steps were asked for together with it.
    assert len(Dataset.open(tmp_path / "data.h5")) >= workers


def test_an_error_for_the_user_keeps_its_class(tmp_path: Path) -> None:
    def unusable() -> None:
        raise ConfigurationError("fem.options: unknown key 'oder'")

    dataset = Dataset.create(tmp_path / "data.h5", inputs=INPUTS, identity=IDENTITY)
    with (
        CellPool(unusable) as pool,
        pytest.raises(ConfigurationError, match=r"^fem\.options: unknown key 'oder'$"),
    ):
        run_campaign(DensitySweep(INPUTS, **OPTIONS), pool, dataset)


def test_a_cell_that_cannot_be_prepared_in_a_worker_says_why(tmp_path: Path) -> None:
    dataset = Dataset.create(tmp_path / "data.h5", inputs=INPUTS, identity=IDENTITY)
    with CellPool(refuse, workers=2) as pool, pytest.raises(PorocoreError, match="no mesh of such a cell"):
        run_campaign(DensitySweep(INPUTS, **OPTIONS), pool, dataset)


def test_a_worker_that_dies_is_named_by_its_state_and_costs_nothing_else(
    tmp_path: Path, undisturbed: Dataset
) -> None:
    path, log = tmp_path / "data.h5", tmp_path / "log"
    with pytest.raises(PorocoreError, match=r"worker process died while solving .*'p=\+0.2000000000 "):
        sample(path, Fake(die_at=0.2, log=str(log)), workers=2)
    assert gone({int(pid) for pid, _, _ in solves(log)})
    kept = len(Dataset.open(path))
    assert kept >= 2
    dataset, summary = sample(path)
    assert summary.reused == kept
    assert dataset.digest() == undisturbed.digest()


def test_a_pool_needs_a_worker() -> None:
    with pytest.raises(ValueError, match="at least one worker, got 0"):
        CellPool(make, (Fake(),), workers=0)


class Stubborn(Sampler):
    """Asks for what it is given and is never done."""

    def __init__(self, requests: list[Request]) -> None:
        self.requests = requests

    def ask(self) -> list[Request]:
        requests, self.requests = self.requests, []
        return requests

    def tell(self, key: str, response: CellResponse) -> None:
        """Nothing to learn."""

    done = False
    expected = 0


def test_a_broken_sampler_is_told(tmp_path: Path) -> None:
    with pytest.raises(PluginError, match="Stubborn asks for no more states, but says that it is not done"):
        sample(tmp_path / "a.h5", sampler=Stubborn([Request("rest", (0.0, 0.0))]))
    with pytest.raises(PluginError, match="to start from 'nowhere', which is not solved"):
        sample(tmp_path / "b.h5", sampler=Stubborn([Request("rest", (0.0, 0.0), "nowhere")]))


def test_random_states_fill_the_box_and_extend_one_another() -> None:
    inputs = InputSpace(("p", "H22"), (-0.1, -0.4), (0.2, 0.1))
    requests = random_requests(inputs, 400, seed=5)
    assert requests[:30] == random_requests(inputs, 30, seed=5)
    assert requests[0].x != random_requests(inputs, 1, seed=6)[0].x
    assert [request.key for request in requests[:2]] == ["test-000", "test-001"]
    assert {request.start for request in requests} == {None}
    x = np.array([request.x for request in requests])
    low, high = np.array(inputs.lower), np.array(inputs.upper)
    assert (x >= low).all()
    assert (x <= high).all()
    scaled = (x - low) / (high - low)
    # Kolmogorov's distance to the uniform distribution, 1 % level.
    for column in np.sort(scaled, axis=0).T:
        assert np.abs(column - (np.arange(400) + 0.5) / 400).max() < 1.63 / np.sqrt(400)
    assert abs(np.corrcoef(scaled.T)[0, 1]) < 0.13


@pytest.mark.parametrize("order", range(5))
def test_random_states_go_on_until_enough_have_values(order: int) -> None:
    """Always the shortest beginning of the draw that holds ``count`` good states."""
    draw = random_requests(INPUTS, 200, seed=1)
    good = [request.x[1] + request.x[0] > -0.1 for request in draw]
    needed = int(np.searchsorted(np.cumsum(good), 20)) + 1
    assert 25 < needed < 100
    sampler = RandomStates(INPUTS, count=20, seed=1)
    rng, waiting, told = random.Random(order), [], set()
    while requests := (sampler.ask() + waiting):
        waiting = requests
        request = waiting.pop(rng.randrange(len(waiting)))
        status = Status.converged if good[int(request.key[5:])] else Status.inverted
        sampler.tell(request.key, CellResponse(np.zeros((1, 3, 3)), np.array([int(status)])))
        told.add(request)
    assert sampler.done
    assert told == set(draw[:needed])
    assert sampler.expected == needed


def test_random_states_give_up_after_so_many_tries() -> None:
    sampler = RandomStates(INPUTS, count=3, seed=1, most_tries=4)
    tried = 0
    while requests := sampler.ask():
        for request in requests:
            sampler.tell(request.key, CellResponse(np.zeros((1, 3, 3)), np.array([int(Status.inverted)])))
            tried += 1
    assert sampler.done
    assert tried == 12


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"count": 0}, "count must be a whole number of at least 1, got 0"),
        ({"seed": 1.5}, "seed must be a whole number of at least 0, got 1.5"),
        ({"most_tries": True}, "most_tries must be"),
        ({"cuont": 3}, "unknown option 'cuont'"),
    ],
)
def test_random_states_name_a_wrong_option(options: dict[str, object], named: str) -> None:
    with pytest.raises(ConfigurationError, match=named):
        RandomStates(INPUTS, **options)


def test_a_test_set_of_another_seed_is_not_mistaken_for_this_one(tmp_path: Path) -> None:
    path = tmp_path / "test.h5"
    dataset, _ = sample(path, sampler=RandomStates(INPUTS, count=5, seed=1))
    assert dataset.responses().valid.sum() == 5
    with pytest.raises(DataError, match=r"test\.h5: holds state 'test-000' at .* is asked for"):
        sample(path, sampler=RandomStates(INPUTS, count=5, seed=2))
    longer, summary = sample(path, sampler=RandomStates(INPUTS, count=8, seed=1))
    assert summary.reused == len(dataset)
    assert longer.responses().valid.sum() == 8
    assert longer.keys[: len(dataset)] == dataset.keys
