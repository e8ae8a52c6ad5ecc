"""The progress display, on a terminal and elsewhere."""

import io
import re

import pytest

from porocore.core.console import INTERVAL, Console, duration, roughly


class Clock:
    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_work_without_steps_counts_none():
    stream = io.StringIO()
    with Console(stream, lambda: 0.0).task("training", "epochs") as task:
        task.done_at_once("loss 1.00e-03")
    assert stream.getvalue().strip() == "training: loss 1.00e-03; took 0.0 s"


def test_plain_lines_come_now_and_then_and_tell_failures_and_rest():
    stream, clock = io.StringIO(), Clock()
    with Console(stream, clock).task("sampling", "states") as task:
        for done in range(0, 101):
            clock.now = done * 2.0
            task.update(done, 100, failed=done // 50)
    lines = stream.getvalue().splitlines()
    assert lines[0] == "sampling: 8 of 100 states, 3 min left"
    assert lines[-1] == "sampling: 100 of 100 states, 2 failed; took 3 min 20 s"
    assert len(lines) - 1 == 200 // 16
    assert INTERVAL == 15


def test_what_a_resumed_run_found_done_does_not_count_for_the_pace():
    stream, clock = io.StringIO(), Clock()
    with Console(stream, clock).task("sampling", "states") as task:
        for done in range(900, 911):
            clock.now = (done - 900) * 2.0
            task.update(done, 1000, detail="slow ones")
        assert task.left == pytest.approx(180)
    assert stream.getvalue().splitlines()[0] == "sampling: 908 of 1000 states, slow ones, 3 min left"


def test_a_time_that_nobody_waits_for_is_not_told():
    """A run whose steps shrank without end had 2.2e+05 h left."""
    clock = Clock()
    with Console(io.StringIO(), clock).task("solving", "steps") as task:
        for done in range(1, 20):
            clock.now = 4.0 * done
            task.update(done, 1e9)
            assert task.left is None


def test_nothing_is_estimated_before_it_means_something():
    clock = Clock()
    with Console(io.StringIO(), clock).task("solving", "steps") as task:
        # Steps that become four times as long each time foretell nothing.
        for done in range(1, 8):
            clock.now = 4.0**done
            task.update(done, 20)
            assert task.left is None
        for done in range(8, 15):
            clock.now += 4.0**7
            task.update(done, 20)
        assert task.left == pytest.approx(6 * 4.0**7)


def test_a_slow_start_and_a_burst_of_several_workers_do_not_mislead():
    clock = Clock()
    with Console(io.StringIO(), clock).task("sampling", "states") as task:
        for pair in range(1, 11):
            for nth in range(2):
                # Two workers make ready for 50 s and then solve two states at once in 10 s.
                clock.now = 40.0 + 10.0 * pair + 0.1 * nth
                task.update(2 * pair - 1 + nth, 60)
                if task.left is not None:
                    assert task.left == pytest.approx((60 - 2 * pair) * 5.0, rel=0.5)
        assert task.left == pytest.approx(200, rel=0.15)


def test_the_time_left_follows_the_work_that_is_told():
    clock = Clock()
    with Console(io.StringIO(), clock).task("body", "s", "t = ") as task:
        for step in range(1, 11):
            clock.now = float(step)
            task.update(0.01 * step, 100, work=(step, 30 - step))
        assert task.left == pytest.approx(20)
        assert task.text(80) == "t = 0.1 of 100 s, 20 s left"


@pytest.mark.parametrize("stream", [io.StringIO, Terminal])
def test_lines_fit_into_80_columns(stream, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    written, clock = stream(), Clock()
    with Console(written, clock).task("direct-mean-gradient, load -0.125", "s", "t = ") as task:
        for step in range(1, 200):
            clock.now += 20.0
            task.update(1234.56 * step, 1234567, failed=3, detail="settlement 0.123456 mm and more beside")
            assert len(task.text(45)) <= 45
    lines = written.getvalue().replace("\r", "\n").splitlines()
    assert len(lines) >= 5
    plain = [re.sub("\x1b[^A-Za-z]*[A-Za-z]", "", line) for line in lines]
    assert max(map(len, plain)) <= 80


def test_the_last_line_says_how_long_the_task_took():
    stream, clock = io.StringIO(), Clock()
    with Console(stream, clock).task("training", "epochs") as task:
        for done in range(1, 101):
            clock.now += 1.0 if done < 50 else 3.0
            task.update(done, 100)
    assert stream.getvalue().splitlines()[-1] == ("training: 100 of 100 epochs; took 3 min 22 s")


def test_a_terminal_gets_a_bar_that_goes_away_and_a_last_line():
    stream = Terminal()
    console = Console(stream, Clock())
    with console.task("training", "epochs") as task:
        task.update(5, 10, detail="loss [red]1e-3")
        console.warn("three states are unstable [sic]")
    written = stream.getvalue()
    assert "warning: three states are unstable [sic]" in written
    assert "training: 5 of 10 epochs, loss [red]1e-3; took 0.0 s" in written.splitlines()[-1]
    console.note("after")
    assert stream.getvalue().endswith("after\n")


def test_the_bar_ends_with_the_block_when_that_fails():
    stream = Terminal()
    console = Console(stream, Clock())
    with pytest.raises(ZeroDivisionError), console.task("solving", "steps"):
        1 / 0  # noqa: B018
    console.note("after")
    assert stream.getvalue().endswith("after\n")


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.04, "0.0 s"), (59.4, "59 s"), (60, "1 min 00 s"), (200.4, "3 min 20 s"), (3899, "1 h 04 min")],
)
def test_durations(seconds, text):
    assert duration(seconds) == text


@pytest.mark.parametrize(
    ("seconds", "text"), [(3.4, "3 s"), (47, "50 s"), (95, "2 min"), (3000, "50 min"), (5500, "1.5 h")]
)
def test_estimates_have_no_digits_that_they_do_not_deserve(seconds, text):
    assert roughly(seconds) == text
