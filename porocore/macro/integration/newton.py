"""Newton's iteration of one time step: first iterate, tangent, convergence; forecast of the steps."""

from __future__ import annotations

import math
from bisect import bisect_right
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from porocore.core.fields import provided
from porocore.interfaces.law import Interval, LawMemory, MacroLaw, MacroResponse
from porocore.macro.boundary.conditions import Loads
from porocore.macro.composition.regions import EVERYWHERE_ALIKE, CellsAtPoints
from porocore.macro.integration.discretisation import CoupledSystem, Discretisation, Residual, StepFailed
from porocore.macro.integration.stepping import GROW, SAME, Stepper
from porocore.macro.linear_systems import forcing, sufficient
from porocore.macro.problem import MacroProblem, NewtonSettings
from porocore.states import Array

#: Decimals of the Δt whose system serves for all steps that differ from it by round-off only. It depends on the step
#: alone, so that a run that continues from a checkpoint solves with the same numbers.
DECIMALS = 11
#: A factor serves for so many more iterations, if they are expected to suffice: each takes a quarter of the time of one
#: with a new factor, with the law of the benchmark's column.
MOST_CHORDS = 3


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Tangent of all unknowns.

    Attributes
    ----------
    system
        Of the discretisation, with that of the forces on the surface.
    stiffest
        Largest entry of ∂P_E/∂H.
    fullest
        Largest entry of ∂storage/∂H.
    """

    system: CoupledSystem
    stiffest: float
    fullest: float


class Linearisations:
    """Linearisations of the steps of one solve; where the law's tangent is constant, one serves all of a length.

    Parameters
    ----------
    chords
        Iterations at most that reuse the linearisation of an earlier one, where the discretisation keeps its factor.
    varies
        Whether parameters or axes change with time, so that no tangent is constant.
    """

    def __init__(
        self, d: Discretisation, law: MacroLaw, chords: int = MOST_CHORDS, *, varies: bool = False
    ) -> None:
        self._d, self._constant = d, law.constant_tangent and not varies
        self._chords = chords if d.keeps_factor else 0
        self._dt, self._age = 0.0, 0
        self._last: Linearisation | None = None

    def begin(self, dt: float, loads: Loads) -> Linearisation | None:
        """Return the linearisation that is known for a new step of length ``dt``; None: there is none."""
        self._age = 0
        same = self._is_exact(loads) and self._dt == _rounded(dt)
        return self._last if same else None

    def _is_exact(self, loads: Loads) -> bool:
        return self._constant and not self._d.has_surface_forces(loads)

    def accuracy(self, misfit: float, before: float | None, tolerance: float, loads: Loads) -> float:
        """Return the relative residual to which a system is to be solved; see :func:`forcing`."""
        if self._is_exact(loads):
            return sufficient(misfit, tolerance)
        return forcing(misfit, before, tolerance)

    def at(self, response: MacroResponse, dt: float, x: Array, loads: Loads) -> Linearisation:
        """Return the linearisation at the response to the unknowns ``x``."""
        d, tangent = self._d, provided(response.tangent)
        self._dt = _rounded(dt) if self._constant else dt
        stiffest, fullest = (
            d.communicator.max(float(max(each.max(initial=0.0), -each.min(initial=0.0))))
            for each in (tangent.stress_grad_u, tangent.storage_grad_u)
        )
        system = d.coupled(tangent, self._dt, x, loads)
        self._last, self._age = Linearisation(system, stiffest, fullest), 0
        return self._last

    def serves(self, misfits: list[float], tolerance: float) -> bool:
        """Tell whether the last linearisation brings the last of ``misfits`` below the tolerance soon enough.

        With an error e, Newton's iteration leaves C e², and one with the tangent of the iterate before some 2 C e times
        the error; from then on errors fall by that factor.
        """
        before, misfit = misfits[-2:]
        if self._age >= self._chords or not 0 < misfit < before:
            return False
        factor = misfit / before * (1 if self._age else 2)
        left = self._chords - self._age
        if factor >= 1 or math.log(tolerance / misfit) < left * math.log(factor):
            return False
        self._age += 1
        return True


def _rounded(dt: float) -> float:
    return float(f"{dt:.{DECIMALS}e}")


#: How many units of round-off of the terms of a residual count as none.
ROUND_OFF = 20 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Step:
    """Solved time step.

    Attributes
    ----------
    x : (local unknowns,)
        Displacements and pressures.
    response
        Of the law there, without tangent where it was not needed.
    residual
        What is left, and the reactions.
    iterations
        Linear systems solved.
    misfits
        Residual over its scale (the larger of force and volume) before each iteration and at the end.
    """

    x: Array
    response: MacroResponse
    residual: Residual
    iterations: int
    misfits: list[float] = field(default_factory=list)


def newton_step(
    d: Discretisation,
    law: MacroLaw,
    memory: LawMemory,
    x: Array,
    interval: Interval,
    loads: Loads,
    settings: NewtonSettings,
    *,
    guess: Array | None = None,
    linearisations: Linearisations | None = None,
    fields: CellsAtPoints = EVERYWHERE_ALIKE,
    before: Loads | None = None,
) -> Step:
    """Solve one backward Euler step over ``interval`` under ``loads`` from the unknowns ``x``.

    The first iteration linearises at the old state and moves prescribed values as part of the linear system,
    so that a jump at the boundary does not fold the elements beside it.

    Parameters
    ----------
    guess
        First iterate, instead of ``x``; where it leads nowhere, the iteration begins again at ``x``.
    linearisations
        Those of the solve; without, every iteration linearises anew.
    fields
        Parameters and places of the points at the end of the step.
    before
        Loads at ``x``, from which indenters are moved as part of the linear system, too.

    Raises
    ------
    StepFailed
        No convergence, no values of the law, or a singular matrix; on all processes alike.
    """
    linearisations = linearisations or Linearisations(d, law, chords=0)
    # What is continued smoothly touches too much or too little while an indenter moves on.
    pushes = before is not None and before.indenters != loads.indenters
    if guess is not None and not pushes:
        with suppress(StepFailed):
            return _iterated(d, law, memory, guess, interval, loads, settings, linearisations, fields)
    return _iterated(d, law, memory, x, interval, loads, settings, linearisations, fields, before)


def _iterated(
    d: Discretisation,
    law: MacroLaw,
    memory: LawMemory,
    x: Array,
    interval: Interval,
    loads: Loads,
    settings: NewtonSettings,
    linearisations: Linearisations,
    fields: CellsAtPoints,
    before: Loads | None = None,
) -> Step:
    x, dt = x.copy(), interval.length
    loads = d.resting(x, loads, before)
    linear = linearisations.begin(dt, loads)
    misfits: list[float] = []
    for iteration in range(settings.iterations + 1):
        jump = loads.values - x[d.prescribed]
        lag = d.lag(loads)
        moving = d.communicator.max(float(jump.any() or any(lag))) > 0
        states, grad_p = d.states(x)
        states = fields.given_to(states)
        # Most iterates beyond the first are the last, whose tangent nobody needs.
        response = law.respond(states, grad_p, memory, step=interval, tangent=linear is None)
        _refuse_missing_values(d, response)
        residual = d.residual(response, dt, loads, x)
        linear = linear or linearisations.at(response, dt, x, loads)
        # A first guess within the tolerance is improved all the same: over many steps its errors add up.
        allowed = settings.tolerance if iteration else 0.0
        excess, stiffness = d.pushed(x, loads)
        misfit = misfit_of(d, residual, pushed=excess)
        if misfit > allowed:
            share = max(ROUND_OFF, law.noise)
            floor = _round_off(d, linear, x, share, begun=iteration > 0)
            misfit = misfit_of(d, residual, floor, excess)
        misfits.append(misfit)
        if misfit <= allowed and not moving:
            return Step(x, response, residual, iteration, misfits)
        if iteration < settings.iterations:
            if iteration and not linearisations.serves(misfits, settings.tolerance):
                response = law.respond(states, grad_p, memory, step=interval)
                linear = linearisations.at(response, dt, x, loads)
            last = misfits[-2] if iteration else None
            accuracy = linearisations.accuracy(misfit, last, settings.tolerance, loads)
            free = stiffness <= 0
            if (free & (excess < 0)).any():
                loads = d.resting(x, loads)  # an indenter has lost the body
                continue
            own = np.where(free, 0.0, -excess / np.where(free, 1.0, stiffness))
            right = residual.values + linear.system.left @ own
            if any(lag):
                still = replace(loads, indenters=lag, pressures=(0.0,) * len(loads.pressures))
                right = right + d.surface_change(x, loads, still, dt)
            change = -linear.system.solve(right, -jump, again=iteration > 0, accuracy=accuracy)
            motion = linear.system.weighed(change) + own if len(own) else own
            if not moving:
                taken = contact_share(d, x, change, motion, residual.values, loads, dt)
                change, motion = taken * change, taken * motion
            x += change
            loads = d.moved_indenters(loads, motion, lag)
            if free.any():
                loads = d.resting(x, loads, loads)  # an indenter without a force follows the surface
            x[d.prescribed] = loads.values
    raise StepFailed(
        f"the relative residual of Newton's method was still {misfits[-1]:.2g} after {settings.iterations} iterations "
        f"(newton.tolerance = {settings.tolerance:g})"
    )


#: Share of the work at the beginning of a change below which that at its end is small.
SMALL_WORK = 0.5
#: Evaluations of the contacts at most along one change, and the least share of it that is taken.
MOST_SHARES, LEAST_SHARE = 20, 0.1


def contact_share(
    d: Discretisation, x: Array, change: Array, motion: Array, residual: Array, loads: Loads, dt: float
) -> float:
    """Return the share of a change of the unknowns that Newton's method takes, 1 but where contacts come or go.

    The work of the forces on the displacements of the change vanishes at its end but for what the tangent does not
    know. It is most of all which points touch: where too many come or go, the work changes its sign along the way, and
    there the method stops. Apart from contacts the forces are taken to be linear along the change. ``motion`` (r,) are
    the changes of the displacements of indenters under a force.
    """
    surface = d.surface_tangent(x, loads, dt) if loads.indenters else None
    if surface is None:
        return 1.0
    moved = np.where(d.is_force, change, 0.0)
    before = d.surface_forces(x, loads, dt)
    linear = d.surface_product(replace(surface, right=0 * surface.right), change) + surface.left @ motion

    def work(share: float) -> float:
        here, there = d.moved_indenters(loads, share * motion), x + share * change
        forces = (1 - share) * residual - share * linear - before + d.surface_forces(there, here, dt)
        pushed = float(motion @ d.pushed(there, here)[0]) if len(motion) else 0.0
        return float(d.communicator.sum(float(moved[: d.owned] @ forces[: d.owned]))) + pushed

    begin, end = work(0.0), work(1.0)
    if not begin < 0 or end < -SMALL_WORK * begin:
        return 1.0
    low, high, at_low, at_high = 0.0, 1.0, begin, end
    for _ in range(MOST_SHARES):
        share = low - at_low * (high - low) / (at_high - at_low)
        share = min(max(share, low + 0.1 * (high - low)), high - 0.1 * (high - low))
        found = work(share)
        if abs(found) < 0.1 * abs(begin):
            break
        if found < 0:
            low, at_low = share, found
        else:
            high, at_high = share, found
    return max(share, LEAST_SHARE)


def _refuse_missing_values(d: Discretisation, response: MacroResponse) -> None:
    parts = (response.stress, response.storage, response.flux)
    bad = np.zeros(d.n_points, bool)
    for part in parts:
        finite = np.isfinite(part)
        if not finite.all():  # seldom
            bad |= ~finite.reshape(d.n_points, -1).all(axis=1)
    count, points = d.communicator.sum(np.array([bad.sum(), len(bad)]))
    if count:
        which = f"{int(count)} of {int(points)} points"
        raise StepFailed(f"the law has no values at {which} (det F̄ ≤ 0, or a cell without solution)")


def misfit_of(
    d: Discretisation,
    residual: Residual,
    round_off: tuple[float, float] = (0.0, 0.0),
    pushed: Array | None = None,
) -> float:
    """Return the largest free residual over its scale, of forces and volumes; zero where only round-off is left.

    ``pushed`` are out-of-balance forces of indenters.
    """
    scales = (residual.force_scale, residual.volume_scale)
    force, volume = largest_free(d, residual.values)
    if pushed is not None and len(pushed):
        force = max(force, float(np.abs(pushed).max()))
    # Nothing resists the force on an indenter that has lost the body.
    return max(
        (r / s if s > 0 else math.inf) if r > floor else 0.0
        for r, s, floor in zip((force, volume), scales, round_off, strict=True)
    )


def largest_free(d: Discretisation, values: Array) -> tuple[float, float]:
    """Return the largest free force and the largest free volume over all processes."""
    magnitude, is_force = np.abs(d.equations(values)), d.is_force[d.free[d.leading]]
    blocks = (magnitude[is_force], magnitude[~is_force])
    force, volume = (d.communicator.max(float(block.max(initial=0.0))) for block in blocks)
    return force, volume


def _round_off(
    d: Discretisation, tangent: Linearisation, x: Array, share: float, *, begun: bool
) -> tuple[float, float]:
    """Return the forces and volumes that are round-off, a ``share`` of the terms that cancel in them.

    These are |A| |x|, and for forces also the stress of the 1 in I + H, which hides loads below some 1e-12. Volumes
    differ by what a step takes up, and their round-off is that of the fluid volume itself, again of the 1 in I + H: a
    step 1e-7 of the consolidation time long takes up so little that it was 2e-9 of it, and no step could be short
    enough. Of a first guess (not ``begun``) that counts as an error, for over many steps such errors add up.
    """
    force, volume = largest_free(d, tangent.system.magnitudes(x))
    filled = tangent.fullest * d.mesh.share_of_volume if begun else 0.0
    pushed = tangent.system.size
    return share * (force + tangent.stiffest * d.stretch + pushed), share * (volume + filled)


#: So many accepted states are continued by a polynomial. On the benchmark's column under P = −0.2 Newton's method takes
#: 210 iterations for 89 steps from the last state, 185 from a line through two, 129 from a parabola, 129 from a cubic.
MOST = 3


@dataclass
class Predictor:
    """Accepted states since the last kink of the loads, which are smooth in time from there.

    Attributes
    ----------
    times, states
        The last of them, at most :data:`MOST`, the latest last; a state holds the local unknowns.
    """

    times: list[float] = field(default_factory=list)
    states: list[Array] = field(default_factory=list)

    def guess(self, time: float) -> Array | None:
        """Return the unknowns expected at ``time``; None where one state alone is known."""
        if len(self.times) < 2:
            return None
        guess = np.zeros_like(self.states[-1])
        for i, (own, state) in enumerate(zip(self.times, self.states, strict=True)):
            others = np.array(self.times[:i] + self.times[i + 1 :])
            guess += float(np.prod((time - others) / (own - others))) * state
        return guess

    def add(self, time: float, x: Array, kink: bool) -> None:
        """Add an accepted state; before a kink nothing is continued."""
        known = 0 if kink else MOST - 1
        first = max(0, len(self.times) - known)
        self.times, self.states = [*self.times[first:], time], [*self.states[first:], x]


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
