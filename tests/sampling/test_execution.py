"""Who solves the states is no matter to what comes out: this process, processes, dask, any executor."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import porocore.sampling.execution.dask_workers as dask_workers
from porocore.core.inputs import InputSpace
from porocore.errors import ConfigurationError, PluginError, PorocoreError
from porocore.sampling.campaign import run_campaign
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.states import MacroState, Status
from porocore.study.config.config import SamplingSettings
from tests.helpers.campaigns import gone, sample, solves, state_text
from tests.helpers.fake_cell import IDENTITY, INPUTS, Fake, Tree, make, make_noted

SEVEN = InputSpace(
    ("H11", "H22", "H33", "H12", "H13", "H23", "p"),
    (-0.2, -0.3, -0.2, -0.1, -0.1, -0.1, -0.1),
    (0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.2),
)


def solve_tree(folder: Path, count: int, **where: Any) -> tuple[Dataset, set[str], list[str]]:
    """States of seven inputs; the processes that solved them, and those that prepared the cell."""
    log, notes = folder / "log", folder / "notes"
    dataset = Dataset.create(folder / "data.h5", inputs=SEVEN, identity=IDENTITY)
    processes = where.get("executor") in ("processes", "dask")
    fake = Fake(log=str(log), sleep=2 / count if processes else 0.0)  # long enough for both workers to begin
    with CellPool(make_noted, (fake, str(notes)), **where) as pool:
        summary = run_campaign(Tree(SEVEN, count), pool, dataset)
    assert summary.solved == count
    assert len(solves(log)) == count
    return dataset, {process for process, _, _ in solves(log)}, notes.read_text().split()


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], Dataset]:
    """The judge: so many states, solved in this process."""

    @cache
    def solved(count: int) -> Dataset:
        folder = tmp_path_factory.mktemp("serial")
        dataset, processes, prepared = solve_tree(folder, count, executor="serial")
        assert processes == {str(os.getpid())} == set(prepared)
        assert len(prepared) == 1
        assert set(dataset.responses().status) == {Status.converged, Status.overlap}
        return dataset

    return solved


@pytest.mark.parametrize("executor", ["processes", "dask"])
@pytest.mark.parametrize("count", [40, pytest.param(200, marks=pytest.mark.slow)])
def test_two_workers_give_the_same_bits_and_prepare_the_cell_once_each(
    tmp_path: Path, serial: Callable[[int], Dataset], executor: str, count: int
) -> None:
    before = dict(os.environ)
    dataset, processes, prepared = solve_tree(tmp_path, count, workers=2, executor=executor)
    assert dataset.digest() == serial(count).digest()
    assert len(processes) == 2
    assert str(os.getpid()) not in processes
    assert sorted(prepared) == sorted(processes)
    assert {threads for _, threads, _ in solves(tmp_path / "log")} == {"1"}
    assert gone({int(process) for process in processes})
    assert before.items() <= os.environ.items()  # dask leaves marks of its own


def test_an_executor_that_is_handed_in(tmp_path: Path, serial: Callable[[int], Dataset]) -> None:
    with ThreadPoolExecutor(3) as executor:
        dataset, _, prepared = solve_tree(tmp_path, 40, workers=3, executor=executor)
        assert executor.submit(len, "abc").result() == 3  # not shut down
    assert dataset.digest() == serial(40).digest()
    assert 1 <= len(prepared) <= 3  # at most once a thread


@pytest.mark.slow
def test_dask_workers_that_die_are_replaced(tmp_path: Path) -> None:
    path, log = tmp_path / "data.h5", tmp_path / "log"
    dataset, _ = sample(path, Fake(die_at=0.1, log=str(log)), workers=2, executor="dask")
    at_death = np.isclose(dataset.x()[:, 0], 0.1)
    np.testing.assert_array_equal(dataset.responses().status == Status.lost, at_death)
    begun = [state for _, _, state in solves(log)]
    for key, dead in zip(dataset.keys, at_death, strict=True):
        assert begun.count(state_text(dataset, key)) == 1 + dead
    assert gone({int(pid) for pid, _, _ in solves(log)})


def test_nobody_at_the_address(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which is no matter as long as there is nothing to solve."""
    monkeypatch.setattr(dask_workers, "SCHEDULER_TIMEOUT", 0.5)
    with CellPool(make, (Fake(),), scheduler="tcp://127.0.0.1:1") as pool:
        assert pool.pending == 0
        with pytest.raises(
            PorocoreError, match=r"no dask scheduler answers at tcp://127\.0\.0\.1:1 .*dask scheduler"
        ):
            pool.submit("a", MacroState.zeros(1))


def test_without_dask(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        CellPool(make, (Fake(),), executor="dask") as pool,
        pytest.raises(PluginError, match=r"needs dask\.distributed.*pip install distributed"),
    ):
        pool.submit("a", MacroState.zeros(1))


@contextmanager
def refused(message: str) -> Iterator[None]:
    with pytest.raises(ConfigurationError, match=message):
        yield


def test_what_does_not_go_together() -> None:
    with refused("'processes' has no scheduler"):
        CellPool(make, (Fake(),), executor="processes", scheduler="tcp://a:1")
    with refused("'serial' cannot end a solve"):
        CellPool(make, (Fake(),), executor="serial", state_seconds=1.0)
    with ThreadPoolExecutor(1) as executor, refused("cannot be ended from here"):
        CellPool(make, (Fake(),), executor=executor, state_seconds=1.0)
    with refused("unknown executor 'slurm'; the executors are auto, serial, processes, dask"):
        CellPool(make, (Fake(),), executor="slurm")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="'serial' cannot end a solve"):
        SamplingSettings(inputs={"p": {"range": (0, 1)}}, executor="serial", state_seconds=2)


def test_one_worker_with_a_time_limit_is_a_process(tmp_path: Path) -> None:
    log = tmp_path / "log"
    sample(tmp_path / "data.h5", Fake(log=str(log)), sampler=Tree(INPUTS, 2), state_seconds=60)
    (process,) = {process for process, _, _ in solves(log)}
    assert process != str(os.getpid())


def test_who_solves_belongs_to_no_identity() -> None:
    from porocore.study.config.loading import benchmark_path, load_config

    config = load_config(benchmark_path())
    for change in (("processes", None), ("dask", None), (None, "tcp://a:1")):
        other = config.with_executor(*change)
        assert other.identity == config.identity
        assert other.sampling.pool_options()["executor"] == (change[0] or "dask")
    with refused("'serial' has no scheduler"):
        config.with_executor("serial", "tcp://a:1")


def test_waiting_for_nothing_is_a_mistake() -> None:
    with CellPool(make, (Fake(),)) as pool, pytest.raises(ValueError, match="no state was submitted"):
        pool.wait()


def test_wait_unless_gives_up_when_it_is_told(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as executor, CellPool(make, (Fake(sleep=0.5),), executor=executor) as pool:
        pool.submit("a", MacroState.zeros(1))
        assert pool.wait_unless(lambda: True) is None
        assert pool.pending == 1
        assert pool.wait().key == "a"


def test_the_options_of_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from typer.testing import CliRunner

    from porocore.cli.common import Interrupted
    from porocore.cli.entry import app
    from porocore.study.config.loading import benchmark_path
    from porocore.study.notes import checks as preflight
    from porocore.study.run import pipeline

    out = tmp_path / "run"
    words = ["sample", str(benchmark_path()), "--out", str(out)]
    with refused("'serial' has no scheduler"):
        raise CliRunner().invoke(app, [*words, "--executor", "serial", "--scheduler", "tcp://a:1"]).exception
    assert not out.exists()
    asked: list[Any] = []
    reached: list[str] = []

    def interrupted(folder: Any, **how: Any) -> None:
        sampling = folder.config.sampling
        asked.append((sampling.executor, sampling.scheduler, how["retry_lost"]))
        raise KeyboardInterrupt

    monkeypatch.setattr(pipeline, "solve_reference", lambda *given, **how: None)
    monkeypatch.setattr(pipeline, "sample", interrupted)
    monkeypatch.setattr(preflight, "check_reachable", reached.append)
    for more in ([*words], ["sample", str(out)]):
        more = [*more, "--scheduler", "tcp://a:1", "--retry-lost"]
        result = CliRunner().invoke(app, more)
        assert isinstance(result.exception, Interrupted)
        assert f"porocore sample {out} --scheduler tcp://a:1" in str(result.exception)
    assert asked == [("dask", "tcp://a:1", True)] * 2
    assert reached == ["tcp://a:1"]  # a run folder that is there asks when it solves
