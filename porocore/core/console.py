"""Progress of a run: a live bar on a terminal, occasional plain lines elsewhere.

Everything goes to standard error; standard output is for results.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

#: Seconds between two plain lines of one task.
INTERVAL = 15.0


class Task:
    """One task, such as ``sampling`` in ``states``, whose total amount of work is known, at least roughly.

    ``show`` is called with share done (0 to 1) and text at every update; ``clock`` returns seconds.
    """

    def __init__(
        self, title: str, unit: str, show: Callable[[float, str], None], clock: Callable[[], float]
    ) -> None:
        self.title, self.unit = title, unit
        self._show, self._clock = show, clock
        self._begun: tuple[float, float] | None = None
        self.text = ""

    def update(self, done: float, total: float, *, failed: int = 0, detail: str = "") -> None:
        """Report where the work stands.

        Parameters
        ----------
        done, total
            In units of the task. What the first report finds done, in a resumed run, does not count for the
            rate.
        failed
            How many of those done failed.
        detail
            Anything else, such as the present loss.
        """
        now = self._clock()
        if self._begun is None:
            self._begun = (now, done)
        elapsed, progressed = now - self._begun[0], done - self._begun[1]
        parts = [f"{done:g} of {total:g} {self.unit}"]
        if failed:
            parts.append(f"{failed} failed")
        if detail:
            parts.append(detail)
        if elapsed > 0 and progressed > 0 and done < total:
            rate = progressed / elapsed
            per_second = f"{rate:.2g}/s" if rate >= 0.5 else f"{60 * rate:.2g}/min"
            parts += [per_second, f"about {duration((total - done) / rate)} left"]
        self.text = ", ".join(parts)
        self._show(min(1.0, done / total) if total > 0 else 1.0, self.text)


class Console:
    """Notes, warnings and tasks on a stream, by default standard error; ``clock`` returns seconds."""

    def __init__(self, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self.stream = sys.stderr if stream is None else stream
        self.clock = clock
        self._live: Progress | None = None

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
    def task(self, title: str, unit: str) -> Iterator[Task]:
        """Show the progress of a task while the block runs, and its duration at the end."""
        begun = self.clock()
        with self._bar(title) if self.stream.isatty() else self._lines(title) as show:
            task = Task(title, unit, show, self.clock)
            yield task
        self.note(f"{title}: {task.text or 'nothing to do'}; took {duration(self.clock() - begun)}")

    @contextmanager
    def _lines(self, title: str) -> Iterator[Callable[[float, str], None]]:
        last = self.clock()

        def show(share: float, text: str) -> None:
            nonlocal last
            if share < 1 and self.clock() - last >= INTERVAL:
                last = self.clock()
                self.note(f"{title}: {text}")

        yield show

    @contextmanager
    def _bar(self, title: str) -> Iterator[Callable[[float, str], None]]:
        from rich.console import Console as RichConsole
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

        columns = (
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TaskProgressColumn(),
            TextColumn("{task.fields[text]}", markup=False),
        )
        with Progress(*columns, console=RichConsole(file=self.stream), transient=True) as live:
            bar: TaskID = live.add_task(title, total=1.0, text="")
            self._live = live
            try:
                yield lambda share, text: live.update(bar, completed=share, text=text)
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
