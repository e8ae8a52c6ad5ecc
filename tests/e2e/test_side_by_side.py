"""Stages and macro solves side by side: files and words as of one after the other, also when they are cut short."""

import io
import json
import os
import signal
import sys

import pytest

from porocore.core.console import Console
from porocore.core.parallel import calls
from porocore.errors import PorocoreError
from porocore.study.config.loading import load_config
from porocore.study.notes import forecast
from porocore.study.run.folder import RunFolder
from porocore.study.run.solving import solve
from tests.e2e.study import (
    LOADS,
    ONE_LOAD,
    Running,
    assert_same_results,
    assert_tidy,
    contents,
    porocore,
    succeeded,
    write_study,
)
from tests.helpers.platform_parts import KILL, POSIX

#: Every solve is worth a process.
SIDE_BY_SIDE = (
    sys.executable,
    "-c",
    "from porocore.study.notes import forecast; forecast.WORTHWHILE = 0\nfrom porocore.cli import main; main()",
)
CASES = [(load, law) for load in LOADS for law in ("mean-gradient", "linear")]


@pytest.fixture
def half_done(a_copy, monkeypatch):
    """A run that lacks its solutions, and its configuration with two workers that save every step."""
    monkeypatch.setattr(forecast, "WORTHWHILE", 0)
    folder = RunFolder.open(a_copy("solutions", "timings.json"))
    config = folder.config
    sampling = config.sampling.model_copy(update={"workers": 2})
    macro = config.macro.model_copy(update={"options": {"checkpoint_seconds": 0.0}})
    return folder, config.model_copy(update={"sampling": sampling, "macro": macro})


class Interrupting(io.StringIO):
    """A stream that is interrupted when a text comes."""

    def __init__(self, at):
        super().__init__()
        self.at = at

    def write(self, text):
        if self.at in text:
            raise KeyboardInterrupt
        return super().write(text)


def assert_the_same(folder, finished):
    for load, law in CASES:
        path = folder.solution(law, load)
        assert contents(path) == contents(finished / "solutions" / path.name), path.name
    assert_tidy(folder.path)


def without_times(text):
    return [line.partition("; took")[0] for line in text.splitlines()]


def test_files_and_words_are_those_of_one_after_the_other(half_done, finished):
    folder, config = half_done
    texts = {}
    for workers in (2, 1):
        for path in folder.solutions():
            path.unlink(missing_ok=True)
        stream = io.StringIO()
        sampling = config.sampling.model_copy(update={"workers": workers})
        with folder:
            names = solve(
                folder.with_config(config.model_copy(update={"sampling": sampling})), console=Console(stream)
            )
        assert names == ["mean-gradient", "linear"]
        assert_the_same(folder, finished)
        texts[workers] = without_times(stream.getvalue())
    assert texts[2] == ["solving: 4 solutions, 2 at a time", *texts[1]]
    assert len(texts[1]) >= 5
    times = json.loads(folder.timings.read_text())
    assert [(each["runs"], each["seconds"] > 0) for each in times.values()] == [(2, True)] * 4
    assert list(times) == [f"macro, {law}, load {load:g}" for load, law in CASES]


def test_what_is_there_stays_and_is_told_in_order(half_done, finished):
    folder, config = half_done
    kept = folder.solution("mean-gradient", LOADS[1])
    kept.parent.mkdir()
    kept.write_bytes((finished / "solutions" / kept.name).read_bytes())
    before, stream = kept.stat().st_mtime_ns, io.StringIO()
    with folder:
        solve(folder.with_config(config), console=Console(stream))
    lines = stream.getvalue().splitlines()
    assert lines[0] == "solving: 3 solutions, 2 at a time"
    assert lines[-2] == f"solving: {kept.name} is there already"
    assert kept.stat().st_mtime_ns == before
    assert_the_same(folder, finished)


def test_an_interruption_keeps_checkpoints_and_times(half_done, finished):
    folder, config = half_done
    with pytest.raises(KeyboardInterrupt), folder:
        solve(folder.with_config(config), console=Console(Interrupting("t = 240 of 240")))
    done = [path.name for path in folder.solutions() if path.exists()]
    assert folder.solution("mean-gradient", LOADS[0]).name in done
    times = json.loads(folder.timings.read_text())
    assert len(times) >= 2, "what ran beside it counts"
    assert not list(folder.path.rglob("*.part"))
    sampling = config.sampling.model_copy(update={"workers": 1})
    with folder:
        solve(
            folder.with_config(config.model_copy(update={"sampling": sampling})),
            console=Console(io.StringIO()),
        )
    assert_the_same(folder, finished)


def test_a_solve_that_fails_says_so_as_in_this_process(half_done, monkeypatch):
    folder, config = half_done
    newton = config.macro.newton.model_copy(update={"iterations": 1})
    time = config.macro.time.model_copy(update={"smallest_step": 5.0})
    macro = config.macro.model_copy(update={"newton": newton, "time": time})
    said = []
    for workers in (1, 2):
        sampling = config.sampling.model_copy(update={"workers": workers})
        with pytest.raises(PorocoreError) as error, folder:
            solve(
                folder.with_config(config.model_copy(update={"sampling": sampling, "macro": macro})),
                console=Console(io.StringIO()),
            )
        said.append((type(error.value), str(error.value)))
    assert said[0] == said[1]


def test_a_process_that_dies_ends_the_run_with_its_checkpoint(half_done, finished, monkeypatch):
    folder, config = half_done
    shown = calls.Call.reports

    def kills(self):
        for i, told in enumerate(shown(self)):
            if i == 20:
                for process in self._processes._processes:
                    os.kill(process.pid, signal.SIGKILL)
            yield told

    with monkeypatch.context() as patched:
        patched.setattr(calls.Call, "reports", kills)
        with (
            pytest.raises(PorocoreError, match="while it solved 'mean-gradient' under"),
            folder,
        ):
            solve(folder.with_config(config), console=Console(io.StringIO()))
    with folder:
        solve(folder.with_config(config), console=Console(io.StringIO()))
    assert_the_same(folder, finished)


def test_killed_with_its_processes_at_work_it_goes_on(half_done, finished, tmp_path):
    folder, _ = half_done
    text = (folder.path / "config.yaml").read_text()
    text = text.replace("workers: 1", "workers: 2")
    (folder.path / "config.yaml").write_text(text)
    assert load_config(folder.path / "config.yaml").sampling.workers == 2
    running = Running(tmp_path / "streams", "solve", folder.path, program=SIDE_BY_SIDE)
    try:
        running.until(lambda: len(list((folder.path / "solutions").glob("*.h5"))) >= 1)
        assert running.stop(signal.SIGKILL, only_main=True) == -signal.SIGKILL
        running.assert_gone()
    finally:
        running.kill_all()
    with folder:
        solve(folder, console=Console(io.StringIO()))
    assert_the_same(folder, finished)


@pytest.fixture
def two_workers(tmp_path):
    """The study with worker processes and one load."""
    return write_study(tmp_path / "two.yaml", ONE_LOAD | {"sampling.workers": 2})


def test_a_run_whose_stages_overlap_has_the_files_and_words_of_another(two_workers, finished, tmp_path):
    run = tmp_path / "run"
    running = Running(tmp_path / "streams", "run", two_workers, "--out", run, program=SIDE_BY_SIDE)
    try:
        assert running.process.wait(timeout=300) == 0, running.err.read_text()
    finally:
        running.kill_all()
    assert_same_results(run, finished)
    assert_tidy(run)
    begins = dict.fromkeys(line.partition(":")[0] for line in running.err.read_text().splitlines())
    shown = ["cell", "sampling", "held-out states", "training", "solving", "mean-gradient, load -0.04"]
    assert [title for title in begins if title in shown] == shown
    stages = json.loads((run / "metrics.json").read_text())["stages"]
    assert list(stages)[:4] == ["cell", "sampling", "held-out states", "training"]
    assert min(stages.values()) > 0


@POSIX
@pytest.mark.parametrize("stopped", [signal.SIGINT, pytest.param(KILL, marks=pytest.mark.slow)])
def test_stopped_while_training_runs_beside_the_held_out_states(two_workers, finished, tmp_path, stopped):
    run = tmp_path / "run"
    running = Running(tmp_path / "streams", "run", two_workers, "--out", run, program=SIDE_BY_SIDE)
    try:
        running.until(lambda: (run / "training.csv").exists())
        status = running.stop(stopped, only_main=True)
        running.assert_gone()
    finally:
        running.kill_all()
    assert status == {signal.SIGINT: 130, signal.SIGKILL: -signal.SIGKILL}[stopped]
    if stopped == signal.SIGINT:
        assert {"held-out states", "training"} <= json.loads((run / "timings.json").read_text()).keys()
        assert "Traceback" not in running.err.read_text()
    one = write_study(tmp_path / "one.yaml", ONE_LOAD)
    assert succeeded(porocore("run", one, "--out", run, "--resume")) == str(run / "report.html")
    assert_same_results(run, finished)
    assert_tidy(run)
