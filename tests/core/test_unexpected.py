"""An exception that nobody expected: one line, a status of its own, and a file that holds the whole of it."""

from __future__ import annotations

import operator
import os
import subprocess
import sys
import threading
import uuid
from pathlib import Path

import numpy as np
import pytest

from porocore.cli import main
from porocore.core import unexpected
from porocore.errors import DataError, PorocoreError, UnexpectedError
from porocore.sampling.execution.pool import CellPool
from porocore.states import MacroState
from porocore.study.config.loading import benchmark_path
from porocore.study.run import pipeline


@pytest.fixture
def state_folder(tmp_path, monkeypatch):
    """Where files go that belong to no run."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "porocore"


@pytest.fixture
def command(monkeypatch, capsys, state_folder):
    """Run the command line in this process: status, standard output, standard error."""

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["porocore", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        captured = capsys.readouterr()
        return ended.value.code, captured.out, captured.err

    return run


def raising(error):
    def fail(*args, **others):
        raise error

    return fail


def the_file(err, folder):
    """The one file in ``folder``, which the one line names."""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    (path,) = folder.glob("porocore-error-*.txt")
    assert f"the whole of it is in {path}" in err
    return path


@pytest.mark.parametrize(
    "error",
    [
        ZeroDivisionError("a bug"),
        KeyError("H22"),
        RecursionError("maximum recursion depth exceeded"),
        AssertionError(),
        EOFError("a stream ended"),
        FileNotFoundError(2, "No such file or directory", "a template"),
        UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"),
        ExceptionGroup("several", [ValueError("one"), ValueError("two")]),
    ],
    ids=lambda error: type(error).__name__,
)
def test_a_bug_is_one_line_and_a_file(command, monkeypatch, state_folder, error):
    monkeypatch.setattr(pipeline, "solve_cell", raising(error))
    status, out, err = command("cell", benchmark_path())
    assert (status, out) == (70, "")
    assert f"unexpected {type(error).__name__}" in err or f"unexpected: {type(error).__name__}" in err
    path = the_file(err, state_folder)
    text = path.read_text(encoding="utf-8")
    assert "Traceback (most recent call last)" in text
    assert type(error).__name__ in text
    assert f"command: porocore cell {benchmark_path()}" in text
    assert "versions: porocore " in text
    assert "platform: " in text
    assert path.stat().st_mode & 0o777 == 0o600


def test_the_file_of_a_run_is_in_its_folder(command, monkeypatch, tmp_path, state_folder):
    monkeypatch.setattr(pipeline, "run", raising(ZeroDivisionError("a bug")))
    status, _, err = command("run", benchmark_path(), "--out", tmp_path / "run")
    assert status == 70
    the_file(err, tmp_path / "run")
    assert not state_folder.exists()


def test_memory_that_runs_out_comes_with_advice(command, monkeypatch, state_folder):
    monkeypatch.setattr(pipeline, "solve_cell", raising(MemoryError("Unable to allocate 7 TiB")))
    status, _, err = command("cell", benchmark_path())
    assert status == 70
    assert "memory ran out: Unable to allocate 7 TiB; take a coarser mesh" in err
    the_file(err, state_folder)


def test_a_long_message_is_cut_in_the_line_and_whole_in_the_file(command, monkeypatch, state_folder):
    monkeypatch.setattr(pipeline, "solve_cell", raising(ValueError("x\n" * 100_000)))
    _, _, err = command("cell", benchmark_path())
    assert len(err) < 800
    assert the_file(err, state_folder).stat().st_size > 100_000


def test_no_file_is_written_through_a_link_or_over_another(monkeypatch, tmp_path):
    """The next place is taken instead."""
    monkeypatch.setattr(unexpected.time, "strftime", lambda *_: "now")
    monkeypatch.setattr(unexpected, "uuid4", lambda: uuid.UUID(int=0))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    run, mine = tmp_path / "run", tmp_path / "mine"
    run.mkdir()
    mine.write_text("mine")
    (run / f"porocore-error-now-{os.getpid()}-0000.txt").symlink_to(mine)
    error = ValueError("a bug")
    unexpected.note_folder(error, run)
    assert str(tmp_path / "state") in unexpected.describe(error)
    assert mine.read_text() == "mine"


def test_where_nothing_can_be_written_the_line_says_so(command, monkeypatch, state_folder):
    monkeypatch.setattr(pipeline, "solve_cell", raising(ValueError("a bug")))
    monkeypatch.setattr(os, "open", raising(OSError(28, "No space left on device")))
    status, _, err = command("cell", benchmark_path())
    assert status == 70
    assert "no file could be written that holds the whole of it (No space left on device)" in err


@pytest.mark.parametrize(
    ("number", "advice"), [(36, "choose a shorter name"), (40, "symbolic link"), (24, "ulimit -n")]
)
def test_what_the_system_refuses_is_no_bug(command, monkeypatch, number, advice):
    monkeypatch.setattr(pipeline, "solve_cell", raising(OSError(number, os.strerror(number), "a path")))
    status, _, err = command("cell", benchmark_path())
    assert status == 2
    assert err.startswith(f"error: a path: {os.strerror(number)}; ")
    assert advice in err


def test_an_expected_error_of_many_long_lines_is_shortened(command, monkeypatch):
    text = "\n".join("y" * 5000 for _ in range(500))
    monkeypatch.setattr(pipeline, "solve_cell", raising(DataError(text)))
    status, _, err = command("cell", benchmark_path())
    assert status == 2
    assert len(err) < 25_000
    assert err.startswith("error: 500 faults\n")
    assert err.rstrip().endswith("and 470 more")


def test_a_bug_in_a_thread_is_one_line(command, monkeypatch, state_folder):
    def solve_cell(*args, **how):
        thread = threading.Thread(target=raising(ZeroDivisionError("a bug")))
        thread.start()
        thread.join()
        raise PorocoreError("so nothing came of it")

    monkeypatch.setattr(pipeline, "solve_cell", solve_cell)
    monkeypatch.setattr(threading, "excepthook", threading.excepthook)
    status, _, err = command("cell", benchmark_path())
    assert status == 2
    first, second = err.splitlines()
    assert "unexpected ZeroDivisionError: a bug" in first
    assert second == "error: so nothing came of it"


@pytest.mark.parametrize("workers", [1, 2])
def test_a_bug_in_a_worker_keeps_its_traceback_for_the_file(workers, state_folder):
    """In this process, and in processes of their own."""
    executor = "serial" if workers == 1 else "processes"
    with CellPool(operator.truediv, (1, 0), workers=workers, executor=executor) as pool:
        pool.submit("one", MacroState(np.zeros((1, 3, 3)), np.zeros(1)))
        with pytest.raises(UnexpectedError, match="ZeroDivisionError while it prepared the cell") as raised:
            pool.wait()
    line = unexpected.describe(raised.value)
    assert line.startswith("unexpected: the cell solver raised ZeroDivisionError")
    (path,) = state_folder.glob("*.txt")
    assert "where it was first raised" in path.read_text()
    assert "ZeroDivisionError: division by zero" in path.read_text()


def test_streams_that_are_closed_or_full_end_without_a_traceback(tmp_path):
    """Standard error closed, standard output on a full disk."""
    program = "from porocore.cli import main; main()"
    done = subprocess.run(
        f"{sys.executable} -c '{program}' units > /dev/full; echo $?; "
        f"{sys.executable} -c '{program}' units --force x 2>&-; echo $?",
        shell=True, capture_output=True, text=True, check=False, env={**os.environ, "XDG_STATE_HOME": str(tmp_path)},
    )  # fmt: skip
    first, second = done.stdout.split()
    assert (first, second) == ("2", "2")
    assert done.stderr.startswith("error: standard output: No space left on device; send it")
    assert "Traceback" not in done.stderr
    assert not list(Path(tmp_path).iterdir())


@pytest.mark.parametrize("words", ["units", "--version", "data summary"])
def test_a_closed_standard_output_loses_no_result_in_silence(tmp_path, words):
    program = "from porocore.cli import program; program()"
    done = subprocess.run(
        f"{sys.executable} -c '{program}' {words} >&-",
        shell=True, capture_output=True, text=True, check=False, env={**os.environ, "XDG_STATE_HOME": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 2
    told = done.stderr
    if words == "data summary":  # which prints no result
        assert "the commands are info" in told
    else:
        assert told == "error: standard output: closed; send it somewhere else\n"
