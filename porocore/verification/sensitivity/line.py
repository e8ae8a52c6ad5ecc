"""Half line: one load of one sign, solved to its goal or to the last state with a solution."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from porocore.interfaces.cell import CellField
from porocore.sampling.execution import FinishedSolve
from porocore.states import Array, CellResponse, MacroState, Status
from porocore.verification.sensitivity.plan import states_of


@dataclass(frozen=True, eq=False)
class HalfLine:
    """n states in the order of their load, from the undeformed cell on.

    All have values but the last, where the load's goal was not reached: that one lies beyond the end of what can be
    solved, by no more than the tolerance of the plan.

    Attributes
    ----------
    load, sign
        Name of the load, and +1 or −1.
    values : (n,)
        Of the load, the first one 0.
    response : n rows
        With tangent and extrema.
    seconds : (n,)
        Wall time of each solve.
    """

    load: str
    sign: int
    values: Array
    response: CellResponse
    seconds: Array

    def __len__(self) -> int:
        return len(self.values)

    @property
    def end(self) -> Status | None:
        """Status that ended the line before its goal; None if the goal was reached."""
        last = Status(int(self.response.status[-1]))
        return None if last.has_values else last


def targets(goal: float, step: float, tolerance: float) -> Generator[float, bool, None]:
    """Values of the load to be solved one after another; is sent whether the last one could be solved.

    Equal steps to the goal, not longer than ``step``. Behind the first value that cannot be solved the interval
    between it and the last one that could is halved until it is not wider than the tolerance.
    """
    count = step_count(goal, step)
    solved = 0.0
    for k in range(1, count + 1):
        value = goal * k / count
        if (yield value):
            solved = value
            continue
        failed = value
        while abs(failed - solved) > tolerance * (1 + 1e-9):
            middle = (solved + failed) / 2
            if (yield middle):
                solved = middle
            else:
                failed = middle
        return


def step_count(goal: float, step: float) -> int:
    """Return the number of equal steps from zero to the goal."""
    return max(1, math.ceil(abs(goal / step) - 1e-9))


class HalfLineSolve:
    """Solution of a half line: the next state, its start field and the states solved so far.

    Parameters
    ----------
    rest
        Response of the undeformed cell, one row with tangent.
    """

    def __init__(
        self, load: str, sign: int, goal: float, step: float, tolerance: float, rest: CellResponse
    ) -> None:
        self.load, self.sign = load, sign
        self.field: CellField | None = None
        self._rows = [(0.0, rest, 0.0)]
        self._failed: tuple[float, CellResponse, float] | None = None
        self._targets = targets(goal, step, tolerance)
        self.steps = step_count(goal, step)
        self.value = next(self._targets)
        self.done = False

    @property
    def state(self) -> MacroState:
        """The one to solve next, one row; its neighbour is :attr:`field`."""
        return states_of(self.load, self.value)

    def record(self, outcome: FinishedSolve) -> None:
        """Record the solution of :attr:`state`."""
        row = self.value, outcome.response, outcome.seconds
        solved = bool(outcome.response.valid[0])
        if solved:
            self._rows.append(row)
            self.field = outcome.field
        else:
            self._failed = row
        try:
            self.value = self._targets.send(solved)
        except StopIteration:
            self.done = True

    def line(self) -> HalfLine:
        """Return the states solved so far."""
        rows = self._rows + ([self._failed] if self._failed else [])
        values, responses, seconds = zip(*rows, strict=True)
        response = CellResponse.concatenate(list(responses))
        return HalfLine(self.load, self.sign, np.array(values), response, np.array(seconds))
