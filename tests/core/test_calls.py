"""Calls in other processes: what they tell comes in order, whenever it is asked for; errors, deaths, interruptions."""

import os
import subprocess
import sys
import time
from multiprocessing import active_children

import pytest

from porocore.core.parallel.calls import CallProcesses
from porocore.errors import PorocoreError, SolveError, UnexpectedError
from tests.helpers import called


def test_what_is_told_and_returned_comes_in_the_order_of_asking():
    with CallProcesses(2) as processes:
        calls = [processes.submit("while it counted", called.counts, str(i), 500) for i in range(4)]
        told, found, times = [], [], []
        for call in calls:
            call.begin()
            times.append(call.time())
            told += call.reports()
            times.append(call.time())
            found.append(call.result())
    assert told == [(str(i), number) for i in range(4) for number in range(500)]
    names, processes, threads, scripts = zip(*found, strict=True)
    assert names == ("0", "1", "2", "3")
    assert os.getpid() not in processes
    assert len(set(processes)) <= 2
    assert set(threads) == {"1"}
    assert set(scripts) == {False}
    assert all(begin <= end <= time.monotonic() for begin, end in zip(times[::2], times[1::2], strict=True))
    assert not active_children()


def test_errors_are_those_of_the_call():
    with CallProcesses(1) as processes:
        refused = processes.submit("while it refused", called.refuses, "no step is small enough")
        broken = processes.submit("while it divided", called.breaks)
        fine = processes.submit("while it counted", called.counts, "a", 1)
        with pytest.raises(SolveError, match=r"^no step is small enough$"):
            refused.result()
        with pytest.raises(
            UnexpectedError, match=r"^a process raised ZeroDivisionError while it divided: by nothing$"
        ):
            broken.result()
        assert fine.result()[0] == "a"


def test_a_process_that_is_killed_is_one_message():
    with CallProcesses(1) as processes:
        call = processes.submit("while it died", called.dies)
        told = []
        with pytest.raises(PorocoreError, match=r"a process ended without a message while it died .* resume"):
            told.extend(call.reports())
    assert not active_children()


def test_an_interrupted_block_ends_its_processes_at_once():
    began = time.monotonic()
    calls = []

    def begin():
        with CallProcesses(2) as processes:
            calls.extend(processes.submit("while it counted", called.counts, "a", 600, 0.1) for _ in range(3))
            next(calls[0].reports())
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        begin()
    assert time.monotonic() - began < 20
    assert not active_children()
    assert calls[0].began is not None
    calls[0].catch_up()
    assert calls[0].time() > calls[0].began


#: What the command line does after Ctrl-C: it ends with nothing unloaded.
INTERRUPTED = """
import os, signal
from tests.helpers import called
from porocore.core.parallel.calls import CallProcesses
try:
    with CallProcesses(1) as processes:
        call = processes.submit("while it counted", called.counts, "a", 600, 0.1)
        signal.signal(signal.SIGALRM, signal.default_int_handler)
        signal.setitimer(signal.ITIMER_REAL, 0.5)
        list(call.reports())
except KeyboardInterrupt:
    os._exit(130)
"""


def test_python_tells_of_no_leak_after_an_interruption():
    """It warned of three leaked semaphores, those of the channel."""
    paths = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    end = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], env=paths, capture_output=True, text=True, check=False
    )
    assert (end.returncode, end.stderr) == (130, "")


def test_processes_that_nobody_needs_are_not_started():
    with CallProcesses(2) as processes:
        assert not active_children()
        assert not processes.receive(0.0)
