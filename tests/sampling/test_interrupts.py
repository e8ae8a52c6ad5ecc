"""Ctrl-C: acknowledged whatever the process does, raised in the end, and a second one ends it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from porocore.sampling.execution.interrupts import GRACE, LAST, PATIENCE, SOON, finishing, listening

PROGRAM = """
import hashlib, sys, time
from porocore.cli.common import interruptible
from porocore.cli.ending import ending
from porocore.sampling.execution import interrupts
from porocore.sampling.execution.interrupts import finishing

interrupts.PATIENCE, interrupts.SOON, interrupts.LAST = map(float, sys.argv[2:])

def ready():
    print("ready", flush=True)

def native():  # minutes in one call of a library
    ready()
    hashlib.pbkdf2_hmac("sha256", b"", b"", 2_000_000_000)

def python():
    ready()
    while True:
        time.sleep(0.01)

def notices():
    with finishing("what runs") as noted:
        ready()
        while not noted.is_set():
            time.sleep(0.01)
        sys.stdin.readline()  # the test says when it is finished
        raise KeyboardInterrupt

def ignores():
    with finishing("what runs"):
        python()

with ending(), interruptible("porocore go on"):
    globals()[sys.argv[1]]()
"""
#: For a machine with much else to do [s].
LONG = 30.0
#: Times of the program: those of the command line, and such as a test can wait for.
TRUE, BRIEF = (PATIENCE, SOON, LAST), (0.5, 0.1, 0.2)


class Program:
    """It is at work when this is made."""

    def __init__(self, what: str, times: tuple[float, ...] = BRIEF) -> None:
        command = [sys.executable, "-c", PROGRAM, what, *map(str, times)]
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"
        time.sleep(0.1)

    def interrupt(self, number: int = signal.SIGINT) -> None:
        self.process.send_signal(number)

    def line(self) -> str:
        assert self.process.stderr is not None
        return self.process.stderr.readline().strip()

    def end(self) -> tuple[int, str]:
        """Return status and last line."""
        try:
            _, error = self.process.communicate(timeout=LONG)
        finally:
            self.process.kill()
        assert "Traceback" not in error
        return self.process.returncode, error.splitlines()[-1] if error else ""


END = (130, "interrupted; continue with: porocore go on")


def test_the_promised_times() -> None:
    assert SOON < 1
    assert GRACE < PATIENCE < 5
    assert LAST <= 1


def test_python_ends_at_the_first() -> None:
    program = Program("python")
    program.interrupt()
    assert program.end() == END


def test_what_runs_is_finished_and_said_so_before() -> None:
    program = Program("notices")
    program.interrupt()
    assert program.line() == "Ctrl-C: what runs first; Ctrl-C again ends at once"
    assert program.end() == END


@pytest.mark.parametrize("ignored", [False, True])
def test_sigterm_is_like_ctrl_c_also_where_that_is_ignored(ignored: bool) -> None:
    """Such as of a scheduler; a shell script starts programs in the background with Ctrl-C ignored."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if ignored else None
    try:
        program = Program("ignores")
    finally:
        if ignored:
            signal.signal(signal.SIGINT, before)
    program.interrupt(signal.SIGTERM)
    assert program.line() == "SIGTERM: what runs first; SIGTERM again ends at once"
    assert program.end() == (143, END[1])


def test_a_second_sigterm_ends_a_library() -> None:
    program = Program("native")
    program.interrupt(signal.SIGTERM)
    assert program.line().startswith("SIGTERM: ")
    program.interrupt(signal.SIGTERM)
    assert program.end() == (143, END[1])


@pytest.mark.parametrize("times", [BRIEF, pytest.param(TRUE, marks=pytest.mark.slow)])
def test_what_does_not_finish_is_ended(times: tuple[float, ...]) -> None:
    program, began = Program("ignores", times), time.monotonic()
    program.interrupt()
    assert program.line().startswith("Ctrl-C: what runs first")
    assert program.end() == END
    assert time.monotonic() - began >= times[0]


@pytest.mark.parametrize("times", [BRIEF, pytest.param(TRUE, marks=pytest.mark.slow)])
def test_a_library_at_work_is_no_hindrance(times: tuple[float, ...]) -> None:
    """The first is acknowledged meanwhile; the second ends the process in the middle of it."""
    program = Program("native", times)
    program.interrupt()
    assert program.line() == "Ctrl-C: ending the present step first; Ctrl-C again ends at once"
    assert program.process.poll() is None
    program.interrupt()
    assert program.end() == END


def test_a_second_one_does_not_wait_for_what_runs() -> None:
    program = Program("ignores", (10 * LONG, SOON, BRIEF[2]))
    program.interrupt()
    program.line()
    program.interrupt()
    assert program.end() == END


def test_everything_is_put_back() -> None:
    before, threads = signal.getsignal(signal.SIGINT), threading.active_count()
    said: list[str] = []
    with listening(said.append), finishing("this") as noted:
        assert signal.getsignal(signal.SIGINT) is not before
        os.kill(os.getpid(), signal.SIGINT)
        end = time.monotonic() + LONG
        while not (said and noted.is_set()) and time.monotonic() < end:
            time.sleep(0.01)
    assert said == ["Ctrl-C: this first; Ctrl-C again ends at once"]
    assert signal.getsignal(signal.SIGINT) is before
    assert signal.set_wakeup_fd(-1) == -1
    assert threading.active_count() == threads


def test_an_ignored_signal_stays_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with listening(pytest.fail), finishing("this") as noted:
            os.kill(os.getpid(), signal.SIGINT)
            assert not noted.is_set()
    finally:
        signal.signal(signal.SIGINT, before)


GOODBYE = """
import atexit, sys
from porocore import cli
from porocore.cli import entry

def command():
    print("what was written")
    sys.exit(int(sys.argv[1]))

class Library:
    def __del__(self):
        print("unloaded")

library = Library()
atexit.register(print, "goodbye")
entry.main = command
cli.program()
"""


@pytest.mark.parametrize(
    ("status", "processes", "more"),
    [
        (0, 1, ["goodbye"]),
        (130, 1, []),
        (143, 1, []),
        (0, 2, ["goodbye", "unloaded"]),
        (130, 2, ["goodbye", "unloaded"]),
        (2, 1, ["goodbye", "unloaded"]),
    ],
)
def test_a_command_that_is_done_or_interrupted_does_not_wait_for_its_libraries(
    status: int, processes: int, more: list[str]
) -> None:
    """What it has written is there; MPI, which would wait for a process that says nothing, is told."""
    environment = os.environ | {"OMPI_COMM_WORLD_RANK": "0", "OMPI_COMM_WORLD_SIZE": str(processes)}
    command = [sys.executable, "-c", GOODBYE, str(status)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=2 * LONG)
    assert done.returncode == status
    assert done.stdout.split("\n") == ["what was written", *more, ""]
