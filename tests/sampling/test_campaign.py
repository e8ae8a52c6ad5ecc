"""Sampling in parallel: the same dataset however many work on it, and a word for whatever goes wrong."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import numpy as np
import pytest

from porocore.errors import ConfigurationError, PluginError, PorocoreError
from porocore.interfaces.sampler import Request, Sampler
from porocore.sampling.campaign import CampaignProgress, run_campaign
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.samplers.density import DensitySweep
from porocore.states import CellResponse, Status
from tests.helpers.campaigns import gone, sample, solves
from tests.helpers.fake_cell import IDENTITY, INPUTS, OPTIONS, Fake, make, mean_gradient, refuse


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The dataset of one worker and no interruption."""
    return sample(tmp_path_factory.mktemp("undisturbed") / "data.h5")[0]


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
    seen: list[CampaignProgress] = []
    dataset, summary = sample(tmp_path / "data.h5", on_progress=seen.append)
    assert seen[1].doing == "at work on the first ones"
    seen = [progress for progress in seen if not progress.doing]
    assert [progress.done for progress in seen] == list(range(len(dataset) + 1))
    # Nothing is known about the time of a state before the first.
    assert seen[0].seconds is None
    assert all(0 < progress.seconds < 60 for progress in seen[1:-1])
    assert all(progress.expected >= progress.done for progress in seen)
    last = seen[-1]
    assert (last.done, last.expected, last.seconds) == (len(dataset), len(dataset), 0)
    statuses = dataset.responses().status
    assert last.failed == (statuses == Status.overlap).sum()
    assert summary.counts == {s: (statuses == s).sum() for s in (Status.converged, Status.overlap)}
    assert (summary.solved, summary.reused) == (len(dataset), 0)
    assert summary.seconds >= dataset.seconds().sum()


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
    seen: list[CampaignProgress] = []
    again, summary = sample(dataset.path, Fake(log=str(log)), on_progress=seen.append)
    assert solves(log) == []
    # The line at the end said that of 6 states none was there.
    assert (seen[-1].done, seen[-1].expected, seen[-1].doing) == (len(dataset), len(dataset), "complete")
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
    assert "in solve" in caught.value.details
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
    with pytest.raises(PluginError, match=r"Stubborn \(.*test_campaign\.py\) asks for no more states, but"):
        sample(tmp_path / "a.h5", sampler=Stubborn([Request("rest", (0.0, 0.0))]))
    with pytest.raises(PluginError, match="to start from 'nowhere', which is not solved"):
        sample(tmp_path / "b.h5", sampler=Stubborn([Request("rest", (0.0, 0.0), "nowhere")]))
