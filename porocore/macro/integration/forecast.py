"""Forecast of the steps that a solve still takes, from its time plan and the accepted steps."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, field

from porocore.macro.integration.stepping import GROW, SAME, Stepper
from porocore.macro.problem import MacroProblem

#: While loads rest, steps h grow with the time s since the last kink of a load like s^RESTING: the front of the
#: pressure moves with √s, and the error of a step goes with h² s^(−3/2). Under a ramp it goes with h² s^(−1/2).
RESTING, RAMPED = 0.75, 0.25
#: Later pressures decay like exp(−s/τ), and steps grow like exp(s/2τ). Before that is seen, the time up to the next
#: kink is taken to be so many τ, and it is seen after this share of it. Where the end is far, τ is at most the
#: geometric mean of the time so far and the time of the end.
DECAY_TIMES, SEEN = 3.0, 0.1
#: A growth beyond this is that of a decay, whenever it is seen.
DECAYING = 1.0
#: Fewest steps, and the ratio of their times, that tell a growth of their own.
TOLD_BY, RATIO = 8, 3.0
#: Of so many steps one is not cut: before a stop, the last two share the way.
UNCUT = 3
#: Steps after a kink before their length says something.
SETTLED = 3
#: Steps that are played through at most; the rest counts as equally long.
MOST_PLAYED = 500


@dataclass(frozen=True)
class Growth:
    """Growth of the steps with the time s since a kink, h ∝ s^power exp(rate s)."""

    power: float
    rate: float


@dataclass(eq=False)
class Stretch:
    """Steps between two kinks of the loads.

    Attributes
    ----------
    begin
        Time of the first kink.
    since, lengths
        Time from the kink to the end of each accepted step, and its length.
    """

    begin: float
    since: list[float] = field(default_factory=list)
    lengths: list[float] = field(default_factory=list)

    def length(self, since: float, growth: Growth) -> float:
        """Return the length of a step that begins ``since`` after the kink; the last ones grow on."""
        k, last = bisect_right(self.since, since), self.since[-1]
        if k < len(self.since):
            return self.lengths[min(max(k, SETTLED - 1), len(self.since) - 1)]
        longer = (max(since, last) / last) ** growth.power * math.exp(min(growth.rate * (since - last), 50.0))
        return float(max(self.lengths[-UNCUT:]) * longer)

    @property
    def slope(self) -> float | None:
        """Exponent of the growth of the later half of the steps; None where they do not tell it."""
        half = len(self.since) // 2
        if len(self.since) < TOLD_BY or self.since[-1] < RATIO * self.since[half - 1]:
            return None
        longer = math.log(max(self.lengths[-UNCUT:]) / max(self.lengths[half - UNCUT : half]))
        return max(longer / math.log(self.since[-1] / self.since[half - 1]), 0.0)


class StepForecast:
    """Forecast of the number of steps that remain of a problem's time plan, whatever solver takes them.

    Steps of equal length are counted. Steps that their error decides are played through: they go on to grow as they
    have grown since the last kink of the loads. After a kink that is still to come they are taken to be those of the
    stretch between two kinks that is likest in duration.
    """

    def __init__(self, problem: MacroProblem) -> None:
        plan = problem.time
        self._problem, self._stepper = problem, Stepper(plan, problem.corners)
        self._kinks = sorted({kink for kink in self._stepper.kinks if kink < plan.end})
        self._first = Stretch(0.0, [plan.ramp_step], [plan.ramp_step])
        self._stretches: list[Stretch] = []
        self._time: float | None = None
        self._count = 0

    def add(self, time: float) -> None:
        """Take the end of an accepted step; the first of a resumed solve says no more than where it stands."""
        before = self._time
        if before is None:
            before = 0.0 if time <= self._stepper.plan.ramp_step * (1 + SAME) else time
        self._time = time
        begin = self._kink(before)
        if not self._stretches or self._stretches[-1].begin != begin:
            self._stretches.append(Stretch(begin))
        if time > before:
            self._count += 1
            self._stretches[-1].since.append(time - begin)
            self._stretches[-1].lengths.append(time - before)

    @property
    def work(self) -> tuple[float, float]:
        """Numbers of steps that were taken and that are still to come."""
        return self._count, self.remaining()

    def remaining(self) -> float:
        """Return the number of steps that are still to come."""
        stepper, count, length = self._stepper, 0, math.inf
        stepper.time = self._time or 0.0
        patterns: dict[float, tuple[Stretch, Growth]] = {}
        while not stepper.done and count < MOST_PLAYED:
            begin = self._kink(stepper.time)
            if begin not in patterns:
                patterns[begin] = self._pattern(begin)
            stretch, growth = patterns[begin]
            if stepper.plan.tolerance is not None:
                stepper.proposed = min(stretch.length(stepper.time - begin, growth), GROW * length)
            length = stepper.next() - stepper.time
            stepper.time, count = stepper.next(), count + 1
        return count if stepper.done else count + (stepper.plan.end - stepper.time) / length

    def _kink(self, time: float) -> float:
        """Return the last kink up to a time."""
        return self._kinks[bisect_right(self._kinks, time + SAME * self._stepper.plan.ramp_step) - 1]

    def _end(self, begin: float) -> float:
        """Return the kink after ``begin``, or the end."""
        after = bisect_right(self._kinks, begin)
        return self._kinks[after] if after < len(self._kinks) else self._stepper.plan.end

    def _pattern(self, begin: float) -> tuple[Stretch, Growth]:
        """Return the stretch after which steps behind the kink ``begin`` are taken, and how they grow on."""
        known = [stretch for stretch in self._stretches if len(stretch.since) >= SETTLED]
        if known and known[-1].begin == begin:
            return known[-1], self._growth(begin, known[-1])
        duration = self._end(begin) - begin

        def unlike(stretch: Stretch) -> float:
            return abs(math.log((self._end(stretch.begin) - stretch.begin) / duration))

        return min(known, key=unlike, default=self._first), self._growth(begin, None)

    def _growth(self, begin: float, present: Stretch | None) -> Growth:
        """Return the growth behind the kink ``begin``, of which ``present`` holds what is known."""
        end, slope = self._end(begin), None if present is None else present.slope
        functions = self._problem.time_functions
        if any(function.expression is not None for function in functions):
            return Growth(0.0 if slope is None else min(slope, 1.0), 0.0)
        if any(value(begin) != value(end) for value in (self._problem.ramp, *(f.at for f in functions))):
            return Growth(RAMPED if slope is None else min(slope, 1.0), 0.0)
        since = self._first.since[0] if present is None else present.since[-1]
        time = min((end - begin) / DECAY_TIMES, math.sqrt(since * (end - begin)))
        rate = 1 / (2 * time)
        if present is None or slope is None:
            return Growth(RESTING, rate)
        power = min(max(slope, RESTING), DECAYING)
        if slope > DECAYING or since > SEEN * (end - begin):
            middle = (since * present.since[len(present.since) // 2 - 1]) ** 0.5
            rate = max(rate, (slope - power) / middle)
        return Growth(power, rate)
