"""Which time comes next: the time plan of a problem, halving after a failed step and growing back.

Independent of the macro backend, and deterministic: the same successes and failures give the same times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from porocore.errors import SolveError
from porocore.problem import TimePlan

#: Accepted steps in a row after which a halving is taken back.
PATIENCE = 2
#: Two times closer than this share of a step are one.
SAME = 1e-9


@dataclass
class Stepper:
    """Proposes steps and learns whether they succeeded.

    Every ramp increment, profile time, corner of the load curve and the end are hit exactly; between two such stops the
    steps are equal and at most ``plan.step`` (``plan.ramp_step`` on the ramp), divided by 2^``halvings``.

    Attributes
    ----------
    plan
        What is to be stepped through.
    time
        The last accepted time.
    halvings
        How often the planned step is halved at present.
    streak
        Accepted steps in a row since a halving was made or taken back.
    """

    plan: TimePlan
    time: float = 0.0
    halvings: int = 0
    streak: int = 0
    _ramp_end: float = field(init=False, repr=False)
    _stops: tuple[float, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        plan = self.plan
        self._ramp_end = plan.ramp_increments * plan.ramp_step
        increments = (k * plan.ramp_step for k in range(1, plan.ramp_increments + 1))
        stops: list[float] = []
        corners = (time for time, _ in plan.load_curve)
        for time in sorted({*increments, *corners, *plan.profiles, plan.end}):
            if stops and time - stops[-1] <= SAME * plan.ramp_step:
                stops[-1] = time
            else:
                stops.append(time)
        self._stops = tuple(stops)

    @property
    def done(self) -> bool:
        """Whether the end is reached."""
        return self.time >= self._stops[-1]

    def next(self) -> float:
        """The time to solve for; the same until :meth:`accept` or :meth:`reject` is called."""
        stop = next(t for t in self._stops if t > self.time)
        planned = self.plan.ramp_step if stop <= self._ramp_end * (1 + SAME) else self.plan.step
        rest = stop - self.time
        steps = math.ceil(rest / (planned / 2**self.halvings) - SAME)
        return stop if steps <= 1 else self.time + rest / steps

    def is_profile(self, time: float) -> bool:
        """Whether ``time``, from :meth:`next`, is a profile time or the end, where fields are kept."""
        wanted = (*self.plan.profiles, self.plan.end)
        return any(abs(time - t) <= SAME * self.plan.ramp_step for t in wanted)

    def accept(self) -> None:
        """The step to :meth:`next` succeeded."""
        self.time = self.next()
        self.streak += 1
        if self.halvings and self.streak >= PATIENCE:
            self.halvings, self.streak = self.halvings - 1, 0

    def reject(self, reason: str) -> None:
        """The step to :meth:`next` failed, for ``reason``; the next one is at most half as long.

        Raises
        ------
        SolveError
            Half of it would be shorter than ``plan.smallest_step``.
        """
        failed = self.next() - self.time
        if failed / 2 < self.plan.smallest_step:
            raise SolveError(
                f"the macroscale step from t = {self.time:g} failed at its smallest length {failed:.3g} "
                f"(smallest_step = {self.plan.smallest_step:g}): {reason}; "
                "lower the load, use more ramp_increments or a finer mesh"
            )
        self.streak = 0
        while self.next() - self.time > failed / 2 * (1 + SAME):
            self.halvings += 1
