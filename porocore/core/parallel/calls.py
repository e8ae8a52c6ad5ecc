"""Calls in other processes (CallProcesses, Call): reports, results, exceptions as text."""

from __future__ import annotations

import gc
import queue
import sys
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import active_children, get_context
from multiprocessing.process import BaseProcess
from time import perf_counter
from types import TracebackType
from typing import Any, Self

from porocore import errors
from porocore.core.parallel.children import begin_child, require_children, starting_children
from porocore.errors import PorocoreError, UnexpectedError


@dataclass(frozen=True)
class Failure:
    """Exception as text, since not every exception survives pickling."""

    kind: str
    message: str
    details: str

    @classmethod
    def from_exception(cls, error: Exception) -> Failure:
        """Return the exception that is being handled, as text."""
        return cls(type(error).__name__, str(error), traceback.format_exc())

    def as_error(self, who: str, where: str) -> PorocoreError:
        """Return the error to raise in the asking process; one that nobody expected says who raised it, and where."""
        kind = getattr(errors, self.kind, None)
        if isinstance(kind, type) and issubclass(kind, PorocoreError):
            return kind(self.message)
        return UnexpectedError(f"{who} raised {self.kind} {where}: {self.message}", self.details)


class ProcessEnded(PorocoreError):
    """End of a process that had a call, without a message."""


#: Seconds between two looks at processes and interrupts while nothing is reported.
PATIENCE = 0.2
#: Takes what a call has to tell while it runs.
Tell = Callable[[Any], None]


@dataclass(frozen=True)
class Report:
    """A report of a call, with its time by the monotonic clock."""

    at: float
    told: Any


class CallProcesses:
    """Processes that take calls, each one at a time; a context manager, at whose end they end.

    They start when they are needed, ignore Ctrl-C and end with this process, however it ends. They import the library,
    not the script that runs. An interrupted block ends them with the calls that they are at.

    Parameters
    ----------
    count
        Number of processes, at least 1.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._executor: ProcessPoolExecutor | None = None
        self._reports: Any = None
        self._calls: list[Call] = []
        self._processes: set[BaseProcess] = set()

    def submit(self, what: str, function: Callable[..., Any], *args: Any) -> Call:
        """Start ``function(tell, *args)`` as soon as a process is free; ``tell`` sends here whatever is not None.

        Parameters
        ----------
        what
            The call in words, for messages: ``while it …``.
        function
            Function at the top level of a module of the library.

        Raises
        ------
        PorocoreError
            This process may not have children.
        """
        if self._executor is None:
            require_children()
            context = get_context("spawn")
            self._reports = context.Queue()
            # Windows waits for 61 processes at most.
            count = min(self.count, 61) if sys.platform == "win32" else self.count
            self._executor = ProcessPoolExecutor(
                count, context, initializer=_begin, initargs=(self._reports,)
            )
        others = set(active_children())
        with starting_children():
            future = self._executor.submit(_called, len(self._calls), function, args)
        self._processes |= set(active_children()) - others
        self._calls.append(Call(what, future, self))
        return self._calls[-1]

    @property
    def started(self) -> bool:
        """True if a call has been submitted."""
        return bool(self._calls)

    def receive(self, seconds: float) -> bool:
        """Hand the next report to its call; wait for at most so many seconds, and return whether one came."""
        if self._reports is None:
            return False
        try:
            number, report = self._reports.get(timeout=seconds)
        except queue.Empty:
            return False
        self._calls[number].take(report)
        return True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._executor is None:
            return
        if kind is not None:
            for process in self._processes:
                process.terminate()
        self._executor.shutdown(cancel_futures=True)
        if kind is not None:  # else Python reports its semaphores as leaked where the program ends at once
            self._executor = self._reports = None
            traceback.clear_frames(trace)  # one of which waits for the channel


class Call:
    """Call in another process.

    Attributes
    ----------
    future
        Its result, or what it raised as text.
    began, ended
        Times of its begin and end by the monotonic clock; None before they are known.
    """

    def __init__(self, what: str, future: Future[Any], processes: CallProcesses) -> None:
        self.what = what
        self.began: float | None = None
        self.ended: float | None = None
        self._shown = 0.0
        self.future, self._processes = future, processes
        self._waiting: deque[Report] = deque()

    def take(self, report: Report) -> None:
        """Take a report of the process; the first is of the begin of the call, the last its end."""
        if self.began is None:
            self.began = self._shown = report.at
        elif report.told is None:
            self.ended = report.at
        else:
            self._waiting.append(report)

    def begin(self) -> None:
        """Wait until the call has begun."""
        while self.began is None:
            self._look()

    def reports(self) -> Iterator[Any]:
        """Yield the reports of the call since the last time, and those until it ends."""
        while True:
            yield from self._told()
            if self.ended is not None:
                self._shown = self.ended
                return
            self._look()

    def told(self) -> list[Any]:
        """Return what the call has told since the last time, without waiting."""
        while self._processes.receive(0):
            pass
        return list(self._told())

    def _told(self) -> Iterator[Any]:
        while self._waiting:
            report = self._waiting.popleft()
            self._shown = report.at
            yield report.told

    def time(self) -> float:
        """Return the time of what :meth:`reports` has yielded last, by the monotonic clock, or of the begin or end."""
        return self._shown

    def catch_up(self) -> None:
        """Let :meth:`time` be that of the end of the call, or the present."""
        self._shown = time.monotonic() if self.ended is None else self.ended

    def result(self) -> Any:
        """Return what the call returned, once it has.

        Raises
        ------
        PorocoreError
            What the call raised, or its process ended before it.
        """
        for _ in self.reports():
            pass
        found = self.future.result()
        if isinstance(found, Failure):
            raise found.as_error("a process", self.what)
        return found

    def _look(self) -> None:
        if self._processes.receive(PATIENCE) or not self.future.done():
            return
        trouble = self.future.exception()
        if isinstance(trouble, BrokenProcessPool):
            raise ProcessEnded(
                f"a process ended without a message {self.what} (out of memory, or killed); what is finished is kept: "
                "resume, where memory is short with sampling.workers: 1"
            )
        if trouble is not None:  # of what cannot be sent to the process
            raise trouble


def side_by_side(
    processes: CallProcesses | None,
    function: Callable[..., Any],
    calls: Sequence[tuple[str, tuple[Any, ...]]],
    tell: Tell = lambda told: None,
) -> list[Any]:
    """Return ``function(tell, *arguments)`` of each call, in processes where there are some and several calls.

    All calls are waited for, so that an error leaves none behind.

    Parameters
    ----------
    processes
        Take the calls; None: this process makes one after the other.
    function
        As for :meth:`CallProcesses.submit`.
    calls
        Words for messages, ``while it …``, and arguments of each call.
    tell
        Takes the reports of calls of this process; those of others are dropped.

    Raises
    ------
    PorocoreError
        As :meth:`Call.result`, of the first call that failed.
    """
    if processes is None or len(calls) < 2:
        return [function(tell, *arguments) for _, arguments in calls]
    failures, found = [], []
    for call in [processes.submit(what, function, *arguments) for what, arguments in calls]:
        try:
            found.append(call.result())
        except Exception as error:  # noqa: BLE001 - it is raised again below
            failures.append(error)
    if failures:
        raise failures[0]
    return found


_channel: Any = None


def _begin(channel: Any) -> None:
    global _channel
    _channel = channel
    begin_child()


def _called(number: int, function: Callable[..., Any], args: tuple[Any, ...]) -> Any:
    def tell(what: Any) -> None:
        _channel.put((number, Report(time.monotonic(), what)))

    tell(None)
    try:
        return function(tell, *args)
    except Exception as error:  # noqa: BLE001 - it is raised again where the result is asked for
        return Failure.from_exception(error)
    finally:
        tell(None)


#: Time between two collections, in times of the first: they take at most about a tenth of all time.
PAUSE = 10.0


class CycleCollection:
    """Calls of Python's collector that are left out while they would cost too much.

    A call takes 0.05 s with the libraries of a study loaded, and a second in a large session, as long as the solves of
    some small cells. What is left behind by solves of so short a time is small.

    Parameters
    ----------
    clock
        Time in seconds.
    """

    def __init__(self, clock: Callable[[], float] = perf_counter) -> None:
        self._clock, self._next = clock, -float("inf")

    def offer(self) -> None:
        """Collect, unless the last call was too short a time ago."""
        began = self._clock()
        if began < self._next:
            return
        gc.collect()
        ended = self._clock()
        self._next = ended + PAUSE * (ended - began)
