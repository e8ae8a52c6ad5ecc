"""Progress of a run: a bar on a terminal, plain lines elsewhere; time that is left, durations as text.

Everything goes to standard error; standard output is for results.
"""

from __future__ import annotations

import io
import logging
import sys
import time
from bisect import bisect_left
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from operator import itemgetter
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

#: Seconds between two plain lines of one task.
INTERVAL = 15.0
#: Columns of a line.
WIDTH = 80
#: Width of the bar.
BAR = 10
#: The time left is estimated after so many reports, and shown after so many seconds, if the whole time has been
#: estimated alike, within this factor, over this last share of the time so far, and twice at least.
REPORTS, FIRST_SHOWN, ALIKE, LATELY = 3, 2.0, 2.5, 0.25
#: A time left that is longer [s], some six weeks, is none: steps that shrink without end told 2.2e+05 h.
LONGEST = 1000 * 3600.0
#: Before so many reports, one part in their number goes by the pace since the first: workers end states together.
FEW = 8


def quieten_libraries() -> None:
    """Keep remarks of libraries, such as matplotlib's on a home that cannot be written, from standard error."""
    logging.getLogger("matplotlib").setLevel(logging.ERROR)


class Pace:
    """Estimate of the time that is left, from the pace of the later half of the work so far.

    Parameters
    ----------
    now
        Time at the beginning [s].
    """

    def __init__(self, now: float) -> None:
        self.begun = now
        #: Time and work at each report; what the first one finds done, in a resumed run, is none.
        self._known: list[tuple[float, float]] = []
        #: Time, and the whole time as it was estimated then.
        self._estimates: list[tuple[float, float]] = []

    def left(self, now: float, done: float, left: float) -> float | None:
        """Return the seconds left after a report of work done and left; None before they mean something."""
        if not self._known or done > self._known[-1][1]:
            self._known.append((now, done))
        if (count := len(self._known)) < REPORTS or left <= 0:
            return None
        first, (end, reached) = self._known[0][1], self._known[-1]
        k = bisect_left(self._known, first + (reached - first) / 2, key=itemgetter(1))
        start, before = self._known[min(k, len(self._known) - 2)]
        pace, whole = (end - start) / (reached - before), (end - self._known[0][0]) / (reached - first)
        if count < FEW:
            pace = pace ** (1 - 1 / count) * whole ** (1 / count)
        seconds = left * pace
        self._estimates.append((now, now - self.begun + seconds))
        return seconds if seconds <= LONGEST and self._agrees(now) else None

    def _agrees(self, now: float) -> bool:
        """Return whether the last estimates, at least two, are alike."""
        if len(self._estimates) < 2 or now - self.begun < FIRST_SHOWN:
            return False
        lately = bisect_left(self._estimates, now - LATELY * (now - self.begun), key=itemgetter(0))
        whole = [seconds for _, seconds in self._estimates[min(lately, len(self._estimates) - 2) :]]
        return max(whole) <= ALIKE * min(whole)


class Task:
    """One task, such as ``sampling`` in ``states``, whose total amount of work is known, at least roughly.

    Attributes
    ----------
    begins
        What stands before the amount, such as ``t = ``.
    left
        Seconds left, as the last report estimated them; None: that means nothing yet.
    """

    def __init__(
        self, title: str, unit: str, begins: str, show: Callable[[float], None], clock: Callable[[], float]
    ) -> None:
        self.title, self.unit, self.begins = title, unit, begins
        self._show, self._clock = show, clock
        self._pace = Pace(clock())
        self._parts, self._detail = ["nothing to do"], ""
        self.left: float | None = None

    def update(
        self,
        done: float,
        total: float,
        *,
        failed: int = 0,
        detail: str = "",
        work: tuple[float, float] | None = None,
        seconds: float | None = None,
    ) -> None:
        """Report where the work stands.

        Parameters
        ----------
        done, total
            In units of the task.
        failed
            How many of those done failed.
        detail
            Anything else, such as the present loss; left out where a line is too short for it.
        work
            Work that is done and work that is left, in any unit, from whose pace the time left is estimated; by default
            those in units of the task. What the first report finds done, in a resumed run, does not count.
        seconds
            Seconds left, where something better than the pace gives them.
        """
        now = self._clock()
        paced = self._pace.left(now, *(work or (done, total - done)))
        self.left = paced if seconds is None else seconds if seconds > 0 else None
        self._parts, self._detail = [f"{self.begins}{done:g} of {total:g} {self.unit}".rstrip()], detail
        if failed:
            self._parts.append(f"{failed} failed")
        self._show(min(1.0, done / total) if total > 0 else 1.0)

    def done_at_once(self, detail: str) -> None:
        """Report work that is done and has no steps to count."""
        self._parts, self._detail = [], detail
        self._show(1.0)

    def text(self, room: int) -> str:
        """Return what the last report said, in a line of ``room`` characters."""
        return self._fitting(room, "" if self.left is None else f"{roughly(self.left)} left", ", ")

    def summary(self, room: int) -> str:
        """Return what the last report said and how long the task took."""
        return self._fitting(room, f"took {duration(self._clock() - self._pace.begun)}", "; ")

    def _fitting(self, room: int, ends: str, before: str) -> str:
        """Return as much of the last report as fits, and how it ends."""
        text = ""
        for parts in ([*self._parts, self._detail], self._parts, self._parts[:1]):
            text = before.join(part for part in (", ".join(filter(None, parts)), ends) if part)
            if len(text) <= room:
                break
        return text


class _Nowhere(io.StringIO):
    """Stream of a process whose standard error is closed: it takes everything and shows nothing."""

    def write(self, text: str) -> int:
        return len(text)


class Console:
    """Notes, warnings and tasks on a stream, by default standard error; ``clock`` returns seconds."""

    def __init__(self, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self.clock = clock
        self._live: Progress | None = None

    @classmethod
    def shown(cls, progress: bool) -> Console:
        """Return a console on standard error, or one that shows nothing."""
        return cls(None if progress else io.StringIO())

    @property
    def stream(self) -> TextIO:
        """The stream; standard error is that of the process that asks, since a console may be pickled."""
        found = sys.stderr if self._stream is None else self._stream
        return _Nowhere() if found is None else found

    def note(self, text: str) -> None:
        """Print one line."""
        if self._live is None:
            print(text, file=self.stream, flush=True)
        else:
            self._live.console.print(text, markup=False, highlight=False, soft_wrap=True)

    def warn(self, text: str) -> None:
        """Print one line that is marked as a warning."""
        self.note(f"warning: {text}")

    @contextmanager
    def task(
        self, title: str, unit: str, begins: str = "", clock: Callable[[], float] | None = None
    ) -> Iterator[Task]:
        """Show the progress of a task while the block runs, and its duration at the end; see :class:`Task`.

        ``clock`` gives the times of work that another process does; by default the console's own does.
        """
        with self._bar(title) if self.stream.isatty() else self._lines(title) as show:
            task = Task(title, unit, begins, lambda share: show(share, task), clock or self.clock)
            yield task
        self.note(f"{title}: {task.summary(WIDTH - len(title) - 2)}")

    @contextmanager
    def _lines(self, title: str) -> Iterator[Callable[[float, Task], None]]:
        last = self.clock()

        def show(share: float, task: Task) -> None:
            nonlocal last
            if share < 1 and self.clock() - last >= INTERVAL:
                last = self.clock()
                self.note(f"{title}: {task.text(WIDTH - len(title) - 2)}")

        yield show

    @contextmanager
    def _bar(self, title: str) -> Iterator[Callable[[float, Task], None]]:
        from rich.console import Console as RichConsole
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

        columns = (
            TextColumn("{task.description}"),
            BarColumn(bar_width=BAR),
            TaskProgressColumn(),
            TextColumn("{task.fields[text]}", markup=False),
        )
        # Between the columns is a space each, and the share takes four.
        rest = len(title) + BAR + 4 + 3
        with Progress(*columns, console=RichConsole(file=self.stream), transient=True) as live:
            bar: TaskID = live.add_task(title, total=1.0, text="")
            self._live = live
            try:
                yield lambda share, task: live.update(
                    bar, completed=share, text=task.text(live.console.width - rest)
                )
            finally:
                self._live = None


def duration(seconds: float) -> str:
    """Return a duration as text: ``1 h 05 min``, ``3 min 20 s`` or ``1.4 s``."""
    if seconds < 60:
        return f"{seconds:.1f} s" if seconds < 10 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"


def roughly(seconds: float) -> str:
    """Return an estimated duration as text, with as many digits as it deserves: ``40 s``, ``3 min`` or ``2.5 h``."""
    if seconds < 90:
        return f"{round(seconds) if seconds < 20 else 10 * round(seconds / 10)} s"
    return f"{round(seconds / 60)} min" if seconds < 5400 else f"{seconds / 3600:.2g} h"
