"""The progress display, on a terminal and elsewhere."""

import io

import pytest

from porocore.core.console import INTERVAL, Console, duration


class Clock:
    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_plain_lines_come_now_and_then_and_tell_rate_failures_and_rest():
    stream, clock = io.StringIO(), Clock()
    with Console(stream, clock).task("sampling", "states") as task:
        for done in range(0, 101):
            clock.now = done * 2.0
            task.update(done, 100, failed=done // 50)
    lines = stream.getvalue().splitlines()
    assert lines[0] == "sampling: 8 of 100 states, 0.5/s, about 3 min 04 s left"
    assert lines[-1] == "sampling: 100 of 100 states, 2 failed; took 3 min 20 s"
    assert len(lines) - 1 == 200 // 16
    assert INTERVAL == 15


def test_what_a_resumed_run_found_done_does_not_count_for_the_rate():
    stream, clock = io.StringIO(), Clock()
    with Console(stream, clock).task("sampling", "states") as task:
        task.update(900, 1000)
        clock.now = 20.0
        task.update(910, 1000, detail="slow ones")
    assert stream.getvalue().splitlines()[0] == (
        "sampling: 910 of 1000 states, slow ones, 0.5/s, about 3 min 00 s left"
    )


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
