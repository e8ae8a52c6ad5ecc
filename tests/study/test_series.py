"""Series of runs: what is finished is not solved again, whatever ended it; failures, order, memory, progress."""

import io
import os
import signal
import subprocess
import sys
import time
from multiprocessing import active_children

import numpy as np
import pytest

from porocore.core.console import Console
from porocore.core.parallel.calls import ProcessEnded
from porocore.errors import DataError, PorocoreError, RunFolderError, SolveError, UnexpectedError
from porocore.study.series import CaseProgress, _Progress, claim_record, require_own
from tests.helpers.platform_parts import KILL, POSIX
from tests.helpers.series_cases import Squares, cases

WORKERS = pytest.mark.parametrize("workers", [1, 2])


def silent():
    return Console(io.StringIO())


@WORKERS
def test_finished_cases_are_not_solved_again(tmp_path, workers):
    series = Squares(tmp_path)
    assert series.run(cases([2, 3]), silent(), workers) == [4, 9]
    console = silent()
    assert series.run(cases([5, 3, 2, 7]), console, workers) == [25, 9, 4, 49]
    assert sorted(number for _, _, number in series.lines("begins")) == [2, 3, 5, 7]
    assert "squares: 2 of 4 numbers are there already\n" in console.stream.getvalue()
    assert "squares: 4 of 4 numbers; took" in console.stream.getvalue()
    assert series.run(cases([5, 3]), silent(), workers) == [25, 9]
    assert len(series.lines("begins")) == 4
    assert not active_children()


def test_results_do_not_depend_on_the_order_in_which_cases_end(tmp_path):
    series = Squares(tmp_path)
    assert series.run(cases([2, 3, 5, 7], [1.0]), silent(), 2) == [4, 9, 25, 49]
    assert series.kept[-1] == "2"
    processes = {process for process, *_ in series.lines("begins")}
    assert len(processes) == 2
    assert os.getpid() not in processes
    assert [process for process, _ in series.lines("made")] == list(
        dict.fromkeys(p for p, _ in series.lines("made"))
    )
    assert len(series.lines("made")) == 2


@WORKERS
def test_a_case_that_fails_is_recorded_and_the_others_go_on(tmp_path, workers):
    series, console = Squares(tmp_path), silent()
    np.testing.assert_array_equal(series.run(cases([2, 13, 3]), console, workers), [4, np.nan, 9])
    assert "3 of 3 numbers, 1 failed; took" in console.stream.getvalue()
    series.run(cases([13]), silent(), workers)
    assert len(series.lines("begins")) == 3


@WORKERS
def test_an_error_that_is_not_taken_ends_the_series_and_what_is_finished_stays(tmp_path, workers):
    series = Squares(tmp_path, takes=())
    with pytest.raises(SolveError, match=r"^13 has no square$"):
        series.run(cases([2, 13, 3], [0.0, 0.5, 30.0]), silent(), workers)
    assert series.kept == ["2"]
    assert not active_children()
    expected = ZeroDivisionError if workers == 1 else UnexpectedError
    with pytest.raises(expected, match="by nothing"):
        series.run(cases([17, 23]), silent(), workers)


def test_a_process_that_ends_costs_its_case_alone_which_is_tried_twice(tmp_path):
    series = Squares(tmp_path, takes=(ProcessEnded,))
    found = series.run(cases([19, 2, 3, 5], [0.1, 0.5]), silent(), 2)
    np.testing.assert_array_equal(found, [np.nan, 4, 9, 25])
    assert [number for _, _, number in series.lines("begins")].count(19) == 2
    assert len(series.lines("made")) >= 3
    assert not active_children()
    (tmp_path / "19").unlink()
    with pytest.raises(
        PorocoreError, match="a process ended without a message while it solved the number 19"
    ):
        Squares(tmp_path, takes=()).run(cases([19, 29]), silent(), 2)


def test_a_process_that_ends_while_it_has_nothing_to_do_is_replaced(tmp_path):
    class Killing(Squares):
        def save(self, case, result):
            super().save(case, result)
            if case.key == "3":
                (process,) = (process for process, _, number in self.lines("ends") if number == 3)
                os.kill(process, signal.SIGKILL)
                time.sleep(0.3)

    series = Killing(tmp_path)
    assert series.run(cases([2, 3, 5], [1.0]), silent(), 2) == [4, 9, 25]
    assert len(series.lines("begins")) == 3


#: Ends by a signal after the first case was recorded, or goes on.
SCRIPT = """
import io, sys
from tests.helpers.series_cases import Squares, cases
from porocore.core.console import Console
Squares(sys.argv[1]).run(cases([2, 3, 5, 7], [0.0, 0.6, 0.6, 0.6]), Console(io.StringIO()), int(sys.argv[2]))
"""


@POSIX
@pytest.mark.parametrize("how", [KILL, signal.SIGINT])
@WORKERS
def test_a_series_that_is_killed_between_cases_goes_on(tmp_path, workers, how):
    paths = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, tmp_path, str(workers)], env=paths, stderr=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 60
    while not (tmp_path / "2").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(how)
    assert process.wait(timeout=30) != 0
    series = Squares(tmp_path)
    _ends({process for process, *_ in series.lines("begins")})
    kept = [number for number in (2, 3, 5, 7) if (tmp_path / str(number)).exists()]
    assert 2 in kept
    assert len(kept) < 4
    before = len(series.lines("begins"))
    assert series.run(cases([2, 3, 5, 7]), silent(), workers) == [4, 9, 25, 49]
    assert len(series.lines("begins")) - before == 4 - len(kept)


def _ends(processes):
    """Every process has ended, or does so soon."""
    deadline = time.monotonic() + 10
    for process in processes:
        with pytest.raises(ProcessLookupError):  # noqa: PT012 - it may take a moment
            while time.monotonic() < deadline:
                os.kill(process, 0)
                time.sleep(0.05)


def test_no_more_cases_run_at_a_time_than_the_memory_allows(tmp_path):
    series = Squares(tmp_path)
    series.run([*cases([2, 3], [0.2, 0.2]), *cases([5, 7, 11], [0.2] * 3, side_by_side=1)], silent(), 2)
    spans = {n: [t, None] for _, t, n in series.lines("begins")}
    for _, at, number in series.lines("ends"):
        spans[number][1] = at
    for number in (5, 7, 11):
        begin = spans.pop(number)[0]
        assert not any(first < begin < last for first, last in spans.values())


@WORKERS
def test_what_the_store_holds_is_recorded_and_told(tmp_path, workers):
    """Of whole cases, and of what a case says that it took."""
    series, console = Squares(tmp_path, known={"3": (9.0, 30.0)}), silent()
    assert series.run(cases([1, 2, 3]), console, workers) == [1, 4, 9]
    assert sorted(number for _, _, number in series.lines("begins")) == [1, 2]
    said = console.stream.getvalue()
    assert "squares: 2 numbers came from the store, which saved about 1 min 30 s" in said
    assert (tmp_path / "3").read_text() == "9.0"


class Shown:
    """Task that notes what it is told."""

    unit = "numbers"

    def __init__(self):
        self.told = []

    def update(self, done, total, *, failed, detail, work):
        self.told.append((done, total, failed, detail, work))


def test_the_progress_is_that_of_all_cases_by_their_sizes_and_work():
    first, second = cases([2], size=4, work=3.0) + cases([3], size=2)
    shown = Shown()
    progress = _Progress(shown, [first, second])
    progress.take(first, CaseProgress("half way", 0.5))
    progress.take(second, CaseProgress("a tenth", 0.1))
    progress.ended(first, True, "2 is lost")
    assert shown.told == [
        (2, 6, 0, "the number 2: half way", (1.5, 2.5)),
        (2, 6, 0, "the number 3: a tenth", (1.6, 2.4)),
        (4, 6, 1, "2 is lost", (3.1, pytest.approx(0.9))),
    ]


def test_a_record_is_not_gone_on_with_by_accident(tmp_path):
    record = tmp_path / "new" / "record.json"
    claim_record(record, "map", resume=False)
    assert record.parent.is_dir()
    record.write_text("{}")
    with pytest.raises(
        RunFolderError, match=r"new already holds a map; add --resume to continue it, or choose"
    ):
        claim_record(record, "map", resume=False)
    claim_record(record, "map", resume=True)
    require_own(record, "a", "a", "the map of another cell")
    with pytest.raises(
        DataError, match="holds the map of another cell; choose another --out, or move it elsewhere"
    ):
        require_own(record, "a", "b", "the map of another cell")
