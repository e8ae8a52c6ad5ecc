"""Record of the work of a linear solver, filled by a backend and taken after every step."""

from __future__ import annotations

from dataclasses import dataclass, field
from time import perf_counter

from porocore.interfaces.solution import StepWork


@dataclass
class LinearWork:
    """Work of the linear solver of one discretisation since it was last taken, and lines for the log.

    Attributes
    ----------
    choice
        Chosen solver, and why, in one line.
    """

    choice: str = ""
    _systems: int = 0
    _iterations: int = 0
    _most_iterations: int = 0
    _set_ups: int = 0
    _set_up_seconds: float = 0.0
    _solve_seconds: float = 0.0
    _notes: list[str] = field(default_factory=list)
    _taken: float = field(default_factory=perf_counter)

    def begin(self) -> None:
        """Forget what was not taken, such as the trials of a solve that failed, and start the clock."""
        self.take()

    def add_set_up(self, seconds: float, *, whole: bool = True) -> None:
        """Count one factor or preconditioner; a part of one takes time alone."""
        self._set_ups += whole
        self._set_up_seconds += seconds

    def add_solve(self, iterations: int, seconds: float) -> None:
        """Count one system, solved in so many iterations; a factor needs none."""
        self._systems += 1
        self._iterations += iterations
        self._most_iterations = max(self._most_iterations, iterations)
        self._solve_seconds += seconds

    def note(self, line: str) -> None:
        """Add a line for the log, such as that a factor takes over."""
        if line not in self._notes:
            self._notes.append(line)

    def take(self) -> tuple[StepWork, tuple[str, ...]]:
        """Return the work and the lines since this was last called, and begin anew."""
        now = perf_counter()
        work = StepWork(
            float(self._systems),
            float(self._iterations),
            float(self._most_iterations),
            float(self._set_ups),
            self._set_up_seconds,
            self._solve_seconds,
            now - self._taken,
        )
        notes = tuple(self._notes)
        self._systems = self._iterations = self._most_iterations = self._set_ups = 0
        self._set_up_seconds = self._solve_seconds = 0.0
        self._notes, self._taken = [], now
        return work, notes
