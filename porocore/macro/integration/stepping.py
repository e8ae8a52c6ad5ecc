"""Choice of the next time step: plan, kinks, error by halves or rates, halving after a failure.

Independent of the macro backend, and deterministic: the same successes and failures give the same times.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from porocore.core.units import units_now
from porocore.errors import SolveError
from porocore.interfaces.law import InternalVariable, columns_of
from porocore.macro.boundary.conditions import BoundaryData
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.problem import MacroProblem, TimePlan
from porocore.states import Array, IntArray

#: Of the step that the error of the last one asks for: on the safe side, and the largest changes.
SAFETY, SHRINK, GROW = 0.9, 0.2, 2.0
#: An error beyond this many times the tolerance is not accepted.
TOO_MUCH = 2.0
#: Accepted steps in a row after which a halving is taken back.
PATIENCE = 2
#: Steps in a row at the smallest length whose error is still beyond it: the solution is no longer one in time. After a
#: jump of the load there are few.
STUCK = 100
#: Advice on a load that a body does not follow.
GENTLER = (
    "lower the load, bring it up over a longer time ('until' of its ramp, else ramp_increments times ramp_step), or "
    "use a finer mesh"
)
#: Two times closer than this share of a step are one.
SAME = 1e-9


@dataclass
class Stepper:
    """Step control that proposes steps and learns whether they succeed.

    Every ramp increment, profile time, corner of the load curve and the end are hit exactly; between two such stops the
    steps are equal and at most ``plan.step`` (``plan.ramp_step`` on the ramp), divided by 2^``halvings``. With
    ``plan.tolerance`` they are also at most as long as the last error asks for; after every kink of a load
    ``plan.ramp_step`` is tried first.

    Attributes
    ----------
    plan
        What is to be stepped through.
    corners
        Further times at which a load has a kink.
    time
        The last accepted time.
    halvings
        How often the planned step is halved at present.
    streak
        Accepted steps in a row since a halving was made or taken back.
    proposed
        Step that the last error asks for.
    stuck
        Steps in a row that were accepted at the smallest length with an error that was too large.
    """

    plan: TimePlan
    corners: tuple[float, ...] = ()
    time: float = 0.0
    halvings: int = 0
    streak: int = 0
    proposed: float = math.inf
    stuck: int = 0
    _ramp_end: float = field(init=False, repr=False)
    _stops: tuple[float, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        plan = self.plan
        self._ramp_end = plan.end_of_ramp
        increments = (k * plan.ramp_step for k in range(1, plan.ramp_increments + 1))
        stops: list[float] = []
        curve = (time for time, _ in plan.load_curve)
        for time in sorted({*increments, *curve, *self.corners, *plan.profiles, plan.end}):
            if stops and time - stops[-1] <= SAME * plan.ramp_step:
                stops[-1] = time
            else:
                stops.append(time)
        self._stops = tuple(stops)
        if plan.tolerance is not None and math.isinf(self.proposed):
            self.proposed = plan.ramp_step

    @property
    def done(self) -> bool:
        """True at the end of the plan."""
        return self.time >= self._stops[-1]

    def next(self) -> float:
        """Return the time to solve for; the same until :meth:`accept` or :meth:`reject` is called."""
        stop = self._stops[bisect_right(self._stops, self.time)]
        planned = self.plan.ramp_step if stop <= self._ramp_end * (1 + SAME) else self.plan.step
        planned = min(planned, self.proposed)
        rest = stop - self.time
        steps = math.ceil(rest / (planned / 2**self.halvings) - SAME)
        return stop if steps <= 1 else self.time + rest / steps

    @property
    def at_corner(self) -> bool:
        """True if a load has a kink at the present time, so that rates are not continuous."""
        return any(abs(self.time - t) <= SAME * self.plan.ramp_step for t in self.kinks)

    @property
    def kinks(self) -> tuple[float, ...]:
        """Times at which a load has a kink, in no order."""
        return (0.0, self._ramp_end, *(time for time, _ in self.plan.load_curve), *self.corners)

    def is_profile(self, time: float) -> bool:
        """Tell whether ``time``, from :meth:`next`, is a profile time or the end, where fields are kept."""
        wanted = (*self.plan.profiles, self.plan.end)
        return any(abs(time - t) <= SAME * self.plan.ramp_step for t in wanted)

    def tolerates(self, error: float | None) -> bool:
        """Tell whether a step to :meth:`next` with this error can be accepted; else the next one is shorter.

        Raises
        ------
        SolveError
            Many steps in a row have such an error at ``plan.smallest_step``.
        """
        tolerance, length = self.plan.tolerance, self.next() - self.time
        if tolerance is None or error is None or error <= TOO_MUCH * tolerance:
            self.stuck = 0
            return True
        if length <= self.plan.smallest_step * (1 + SAME):
            self.stuck += 1
            if self.stuck >= STUCK:
                now, least = (units_now().text(t, "time", 6) for t in (self.time, self.plan.smallest_step))
                raise SolveError(
                    f"the macroscale steps before t = {now} are in error by more than time.tolerance = {tolerance:g} "
                    f"at their smallest length {least} (smallest_step), {STUCK} of them in a row: the solution "
                    f"runs away; {GENTLER}"
                )
            return True
        self.stuck = 0
        self.proposed = max(self._wanted(length, error), self.plan.smallest_step)
        return False

    def _wanted(self, length: float, error: float) -> float:
        """Return the step whose error, which goes with its square, is the tolerance."""
        assert self.plan.tolerance is not None
        factor = SAFETY * math.sqrt(self.plan.tolerance / error) if error > 0 else GROW
        return length * min(max(factor, SHRINK), GROW)

    def accept(self, error: float | None = None) -> None:
        """Accept the step to :meth:`next`, with this error if it is known."""
        length, self.time = self.next() - self.time, self.next()
        if self.plan.tolerance is not None:
            if self.at_corner:
                self.proposed = self.plan.ramp_step
            elif error is not None:
                self.proposed = max(self._wanted(length, error), self.plan.smallest_step)
        self.streak += 1
        if self.halvings and self.streak >= PATIENCE:
            self.halvings, self.streak = self.halvings - 1, 0

    def reject(self, reason: str, more: Callable[[], str] = str) -> None:
        """Reject the step to :meth:`next` for ``reason``; the next one is at most half as long.

        ``more`` is asked what else to say where there is no next one.

        Raises
        ------
        SolveError
            Half of it would be shorter than ``plan.smallest_step``.
        """
        failed = self.next() - self.time
        if failed / 2 < self.plan.smallest_step:
            raise SolveError(
                f"the macroscale step from t = {units_now().text(self.time, 'time', 6)} failed at its smallest length "
                f"{units_now().text(failed, 'time', 3)} (smallest_step = "
                f"{units_now().text(self.plan.smallest_step, 'time', 6)}): {reason}{more()}; {GENTLER}"
            )
        self.streak = 0
        while self.next() - self.time > failed / 2 * (1 + SAME):
            self.halvings += 1


#: Share of an internal variable that counts as its change at least: at the beginning there is none.
SLIGHT = 0.01
#: Times up to the first kink at which the loads are evaluated for their largest values.
SAMPLES = 100


@dataclass(frozen=True, eq=False)
class TimeState:
    """Quantities whose change with time is integrated.

    Attributes
    ----------
    x : (local unknowns,)
        Displacements and pressures.
    internal : (points, v)
        Numbers of the law's internal variables.
    """

    x: Array
    internal: Array

    def rate(self, before: TimeState, dt: float) -> TimeState:
        """Return the rates from ``before``, a time ``dt`` earlier."""
        return TimeState((self.x - before.x) / dt, (self.internal - before.internal) / dt)


class ErrorControl:
    """Error estimate from the rate of the last accepted step and the largest values so far.

    Quantities are the displacements, the pressures, and each group of the internal variables, of which the changes
    since the beginning count.

    Parameters
    ----------
    d
        Discretisation.
    variables
        Internal variables of the law.

    Attributes
    ----------
    rate
        Of the last accepted step; None at the start and after a kink of the loads.
    length
        Δt of that step.
    scales
        Largest |u|, |p| and changes of the numbers of each group so far.
    start
        Internal variables at the beginning (points, v), from which their changes count; one number: all alike.
    """

    def __init__(self, d: Discretisation, variables: Sequence[InternalVariable] = ()) -> None:
        own = np.arange(len(d.is_force)) < d.owned
        self._d, self._blocks = d, (d.is_force & own, ~d.is_force & own)
        self._groups = _columns_of_groups(variables)
        self.rate: TimeState | None = None
        self.length = 0.0
        self.start: Array | float = 0.0
        self.scales = (0.0,) * (len(self._blocks) + len(self._groups))
        self._found = self.scales

    def error(
        self,
        old: TimeState,
        new: TimeState,
        dt: float,
        finer: TimeState | None = None,
        reached: float = 1.0,
    ) -> float | None:
        """Return the largest Δt² ẍ / 2 of each quantity x, as a share of its largest so far.

        ẍ is the change of the rate over half of both steps (Milne's device for backward Euler). Where no rate is known
        two steps of half the length give it, whose error is half that of one [Hairer, Nørsett & Wanner, Solving
        Ordinary Differential Equations I, II.4].

        Parameters
        ----------
        finer
            Where two steps of half the length end; without and without a rate there is no estimate, None.
        reached
            Share that has acted of the load that first comes up, by which the largest values are divided: at its
            beginning they say nothing yet, and the first step would be in error by a quarter however short it is.
        """
        changes = self._largest(TimeState(new.x, new.internal - self.start))
        largest = [
            max(change, SLIGHT * size) for change, size in zip(changes, self._largest(new), strict=True)
        ]
        self._found = tuple(max(pair) for pair in zip(self.scales, largest, strict=True))
        if self.rate is not None:
            change, factor = new.rate(old, dt).rate(self.rate, 1.0), dt**2 / (dt + self.length)
        elif finer is not None:
            change, factor = new.rate(finer, 1.0), 2.0
        else:
            return None
        errors = [
            reached * factor * found / scale if scale > 0 else 0.0
            for found, scale in zip(self._largest(change), self._found, strict=True)
        ]
        return max(errors)

    @property
    def follows_variables(self) -> bool:
        """True where errors of internal variables count."""
        return bool(self._groups)

    def _largest(self, of: TimeState) -> list[float]:
        """Return the largest size of each quantity over all processes."""
        parts = [*(of.x[block] for block in self._blocks), *(of.internal[:, each] for each in self._groups)]
        return [self._d.communicator.max(float(np.abs(part).max(initial=0.0))) for part in parts]

    def accept(self, old: TimeState, new: TimeState, dt: float) -> None:
        """Take the step whose error was estimated last."""
        self.scales = tuple(max(pair) for pair in zip(self.scales, self._found, strict=True))
        self.rate, self.length = new.rate(old, dt), dt

    def reset(self) -> None:
        """Drop the rate, which is not continuous where a load has a kink."""
        self.rate = None


def _columns_of_groups(variables: Sequence[InternalVariable]) -> list[IntArray]:
    """Return the numbers of the internal variables of each group, in the order in which groups occur."""
    columns, found = columns_of(variables), dict[str, list[int]]()
    for each in variables:
        if each.group:
            at = columns[each.name]
            found.setdefault(each.group, []).extend(range(at.start, at.stop))
    return [np.array(numbers) for numbers in found.values()]


class Reached:
    """Largest share that any load has reached of its maximum before the first kink of the loads."""

    def __init__(self, boundary: BoundaryData, problem: MacroProblem) -> None:
        self._boundary, self._problem = boundary, problem
        plan = problem.time
        self._end = min(plan.end_of_ramp, *problem.corners, plan.end)
        self._times = np.linspace(0, self._end, SAMPLES + 1)[1:]
        self._sizes = np.abs([boundary.amplitudes(problem, time) for time in self._times.tolist()])
        self._peaks = self._sizes.max(axis=0)
        begins = problem.initial.pressure != 0 or any(map(any, problem.initial.gradient))
        self._acts = boundary.acting & (self._peaks > 0) & (not begins)

    def __call__(self, time: float) -> float:
        """Return the share, at most 1; 1 from the kink on, where no load acts, or the body does not begin at rest."""
        if time >= self._end or not self._acts.any():
            return 1.0
        now = np.abs(self._boundary.amplitudes(self._problem, time))
        so_far = np.maximum(now, self._sizes[self._times <= time].max(axis=0, initial=0.0))
        return min(1.0, float((so_far[self._acts] / self._peaks[self._acts]).max()))
