"""A series of squares in a folder with a file for each; a log tells what was solved, where and when."""

from __future__ import annotations

import math
import os
import signal
import time
from pathlib import Path

from porocore.core.files.atomic import atomic_path
from porocore.errors import SolveError
from porocore.study.series import Case, CaseProgress, FromStore, RunSeries


def made(log):
    """What each process makes once."""
    note(log, "made")
    return (log,)


def note(log, *words):
    with open(log, "a") as file:
        file.write(" ".join(map(str, (os.getpid(), time.monotonic(), *words))) + "\n")


def square(tell, log, number, pause):
    """Return the square of a number; 13 fails, 17 raises what nobody expects, 19 ends its process."""
    note(log, "begins", number)
    tell(CaseProgress("half way", 0.5))
    time.sleep(pause)
    if number == 13:
        raise SolveError("13 has no square")
    if number == 17:
        raise ZeroDivisionError("by nothing")
    if number == 19:
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 1:
        tell(FromStore(1, 60.0))
    note(log, "ends", number)
    return float(number**2)


class Squares(RunSeries[float]):
    title, unit = "squares", "numbers"
    function = staticmethod(square)

    def __init__(self, folder, takes=(SolveError,), known=None):
        self.folder, self.takes, self.there = Path(folder), takes, known or {}
        self.log = self.folder / "log"
        super().__init__({}, (made, (self.log,)))
        self.kept = []

    def find(self, case):
        path = self.folder / case.key
        return float(path.read_text()) if path.exists() else None

    def save(self, case, result):
        self.kept.append(case.key)
        with atomic_path(self.folder / case.key) as part:
            part.write_text(str(result))

    def stored(self, case):
        return self.there.get(case.key)

    def lost(self, case, error):
        if not isinstance(error, self.takes):
            raise error
        return math.nan

    def failed(self, result):
        return math.isnan(result)

    def lines(self, word):
        """Words of the log behind one, with the process and the time."""
        rows = [line.split() for line in self.log.read_text().splitlines()]
        return [(int(row[0]), float(row[1]), *map(int, row[3:])) for row in rows if row[2] == word]


def cases(numbers, pauses=(), **how):
    pauses = dict(zip(numbers, pauses, strict=False))
    return [Case(str(n), (n, pauses.get(n, 0.0)), f"the number {n}", **how) for n in numbers]
