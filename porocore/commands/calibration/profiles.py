"""Profile likelihood: along a line, confidence intervals, the 95 % region of two unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
import numpy.typing as npt

from porocore.commands.calibration.minimum import Minimum, Objective, minimise
from porocore.commands.calibration.problem import Fitted, Unknown
from porocore.core.echo import joined
from porocore.errors import SolveError
from porocore.states import Array, IntArray

#: The root of the rise is met to this; a last Newton step, which costs nothing, then makes the end far better.
ROOT_TOLERANCE = 0.15
#: A point of a walk is accepted where the next step would lower its sum of squares by less than this. The rise counts
#: that step, so that an end (a rise of 3.84) moves by a small part of it, and most walks need one evaluation.
LEFT = 0.01
#: Points of one walk, and halvings of a step whose point cannot be computed or trusted.
MOST_POINTS, MOST_HALVINGS = 40, 4
#: A step reaches at most so much of the way to the bound, and so many times as far as the walk has come.
FIRST_SHARE, GROWTH = 0.25, 3.0
#: It ends somewhat behind the place where another unknown reaches its bound, and is no shorter than so much of the way.
PAST_BOUND, LEAST_SHARE = 1.1, 0.02
#: Each such point of a bracket bisects it: Newton and secant stagnate where the rise begins suddenly, at a bound.
BISECTED = 6
#: Width of a bracket, a share of the distance, in which the rise is a jump.
NARROWEST = 1e-4
#: A sum of squares that is lower than the best by this shows that the best point was none. Along a direction that is
#: hardly identifiable the search ends where little is to be gained; an end by a best that is so much too high is 1.3 %
#: too far.
LOWER = 0.1
#: At an end, the rise that is owed to bounds of other unknowns may be at most this share of it.
OWED_TO_BOUNDS = 0.05


class End(Enum):
    """Reason for which a walk ended."""

    crossed = "the rise was reached"
    bound = "a fixed unknown reached its bound"
    held = "only bounds of other unknowns made the rise"
    uncomputable = "the experiment cannot be computed"
    flagged = "the surrogate leaves the states that it is trusted in"
    unfinished = "the profile could not be followed"


class LowerPoint(Exception):
    """A walk has met a lower sum of squares than that of the best point; it starts again from there.

    Attributes
    ----------
    fitted
        The lower point.
    """

    def __init__(self, fitted: Fitted) -> None:
        super().__init__("lower than the best point")
        self.fitted = fitted


@dataclass(frozen=True, eq=False)
class ProfilePoint:
    """Least sum of squares at one distance along a walk.

    Attributes
    ----------
    distance
        Of the fixed coordinates from the best point, in units of the walk's direction.
    root
        Square root of the rise of the sum of squares over its least value: 1.96 at the end of a 95 % interval.
    slope
        Derivative of ``root`` by the distance.
    fitted
        The point.
    """

    distance: float
    root: float
    slope: float
    fitted: Fitted


@dataclass(eq=False)
class ProfileWalk:
    """Walk along a line of fixed coordinates, the others optimised at each point.

    Parameters
    ----------
    objective
        Of which the sum of squares is profiled.
    best
        Its minimum.
    fixed : (f,)
        Indices of the coordinates that the walk moves.
    direction : (f,)
        Their move for one unit of distance.
    target
        Root of the rise at which the walk ends.
    strict
        Whether a lower point than the best one is an error; else it counts as no rise.
    """

    objective: Objective
    best: Minimum
    fixed: IntArray
    direction: Array
    target: float
    strict: bool = True
    points: list[ProfilePoint] = field(default_factory=list)
    end: End = End.unfinished
    #: Distance at which the rise is reached; NaN for another end.
    distance: float = float("nan")
    #: Unknowns whose bounds hold the end.
    held_by: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def run(self) -> ProfileWalk:
        """Walk until the rise is reached or the walk has another end, and return this walk.

        Raises
        ------
        LowerPoint
            The best point was none.
        """
        self.points = [self._first()]
        room = self.room
        beyond: ProfilePoint | None = None
        lost, halvings, why = room, 0, End.bound
        if room <= 0:
            self.end = End.bound
            return self
        for _ in range(MOST_POINTS):
            inside = self._last_inside()
            distance = self._next(inside, beyond, lost, room)
            found = self._point(inside, distance)
            failure = (
                End.uncomputable if found is None else End.flagged if self._is_untrusted(found) else None
            )
            if failure is not None or found is None:
                lost, halvings, why = distance, halvings + 1, failure or End.uncomputable
                # Nothing nearer to a best point that is not trusted itself is trusted more.
                hopeless = failure is End.flagged and self.best.fitted.prediction.flagged
                if hopeless or halvings > MOST_HALVINGS:
                    self.end = why
                    return self
                continue
            self.points.append(found)
            if abs(found.root - self.target) < ROOT_TOLERANCE and self._end(found) <= min(lost, room):
                return self._crossed(found)
            if found.root > self.target:
                beyond = found
                if distance - self._last_inside().distance < NARROWEST * distance or self._is_held(found):
                    return self._crossed(found)
            elif distance >= room:
                self.end = End.bound
                return self
        return self

    @property
    def linear_distance(self) -> float:
        """Distance of the rise to first order; very large where the data do not depend on it."""
        return self.target / max(self._first().slope, 1e-300)

    @property
    def honest(self) -> list[ProfilePoint]:
        """Points that bounds of other unknowns do not raise, in the order of distance."""
        kept = [each for each in self.points if not len(self._holding(each.fitted))]
        return sorted(kept, key=lambda each: each.distance)

    def _first(self) -> ProfilePoint:
        """Return the best point; its slope is the reciprocal of the standard deviation along the walk."""
        fitted = self.best.fitted
        rows = fitted.jacobian @ self._full(1.0)
        free = fitted.jacobian[:, self._free] * self.objective.scale[self._free]
        if free.shape[1]:
            rows = rows - free @ np.linalg.lstsq(free, rows, rcond=1e-10)[0]
        return ProfilePoint(0.0, 0.0, float(np.linalg.norm(rows)), fitted)

    @property
    def _free(self) -> IntArray:
        return np.setdiff1d(np.arange(len(self.objective.lower)), self.fixed)

    def _full(self, distance: float) -> Array:
        full = np.zeros(len(self.objective.lower))
        full[self.fixed] = distance * self.direction
        return full

    @property
    def room(self) -> float:
        """Distance at which a fixed coordinate reaches its bound."""
        start = self.best.fitted.coordinates[self.fixed]
        ends = np.where(
            self.direction > 0, self.objective.upper[self.fixed], self.objective.lower[self.fixed]
        )
        moving = self.direction != 0
        return float(((ends - start)[moving] / self.direction[moving]).min())

    def _last_inside(self) -> ProfilePoint:
        """Return the furthest point below the rise."""
        return max((each for each in self.points if each.root < self.target), key=lambda each: each.distance)

    def _next(self, inside: ProfilePoint, beyond: ProfilePoint | None, lost: float, room: float) -> float:
        """Return the distance of the next point: Newton's, kept in the bracket and within a growth of the walk."""
        newton = np.inf
        nearest = inside
        if beyond is not None and abs(beyond.root - self.target) < abs(inside.root - self.target):
            nearest = beyond
        if nearest.slope > 0:
            newton = nearest.distance + (self.target - nearest.root) / nearest.slope
        low, high = inside.distance, min(lost, room)
        if beyond is not None:
            width = beyond.distance - low
            if len(self.points) % BISECTED == 0:
                return low + width / 2
            if not low + 0.01 * width < newton < beyond.distance - 0.01 * width:
                newton = low + width * (self.target - inside.root) / (beyond.root - inside.root)
            return float(np.clip(newton, low + 0.02 * width, low + 0.98 * width))
        if lost < room:
            return min(newton, (low + lost) / 2)
        least = low + LEAST_SHARE * room
        bounded = max(low + PAST_BOUND * self._to_bound(inside), least)
        return min(newton, max(FIRST_SHARE * room, GROWTH * low), bounded, high)

    def _to_bound(self, inside: ProfilePoint) -> float:
        """Return the further distance at which a free unknown is expected to reach its bound."""
        free, here = self._free, inside.fitted
        if not len(free):
            return np.inf
        scale = self.objective.scale[free]
        rows = here.jacobian[:, free] * scale
        moves = -scale * np.linalg.lstsq(rows, here.jacobian @ self._full(1.0), rcond=1e-8)[0]
        bounds = np.where(moves > 0, self.objective.upper[free], self.objective.lower[free])
        room = np.abs(bounds - here.coordinates[free])
        # One that lies on its bound is held there from now on.
        moving = (np.abs(moves) > 0) & ~self._at_bound(here)
        return float((room[moving] / np.abs(moves[moving])).min(initial=np.inf))

    def _point(self, inside: ProfilePoint, distance: float) -> ProfilePoint | None:
        """Return the point at a distance, from the linear continuation of ``inside``; None: it cannot be computed."""
        moved = self._full(distance - inside.distance)
        free = self._free
        step = self.objective.step(inside.fitted, free, moved)
        start = inside.fitted.coordinates + step
        start[self.fixed] = (self.best.fitted.coordinates + self._full(distance))[self.fixed]
        try:
            minimum = minimise(self.objective, start, free, LEFT)
        except SolveError:
            return None
        rise = minimum.squares - self.best.squares
        if self.strict and rise < -LOWER:
            raise LowerPoint(minimum.fitted)
        root, fitted = float(np.sqrt(max(rise, 0.0))), minimum.fitted
        # By the envelope theorem the others do not count.
        slope = float(minimum.residuals @ (fitted.jacobian @ self._full(1.0)))
        return ProfilePoint(distance, root, slope / root if root > 0 else 0.0, fitted)

    def _is_untrusted(self, found: ProfilePoint) -> bool:
        """Tell whether the point is flagged where the rise is not passed; one beyond it only closes the bracket."""
        return found.fitted.prediction.flagged and found.root < self.target + ROOT_TOLERANCE

    def _crossed(self, found: ProfilePoint) -> ProfileWalk:
        bounds = self._holding(found.fitted)
        if len(bounds):
            self.end, self.held_by = End.held, bounds
            return self
        self.end, self.distance = End.crossed, self._end(found)
        return self

    def _end(self, found: ProfilePoint) -> float:
        """Return the distance of the end by a last Newton step from a point near it; that of the point from afar."""
        if abs(found.root - self.target) >= ROOT_TOLERANCE or found.slope <= 0:
            return found.distance
        return found.distance + (self.target - found.root) / found.slope

    def _holding(self, fitted: Fitted) -> IntArray:
        """Return the free unknowns at bounds without which the rise would not be there."""
        held = self._owed(fitted) > OWED_TO_BOUNDS * self.target**2
        return self._free[self._at_bound(fitted)] if held else self._free[:0]

    def _is_held(self, beyond: ProfilePoint) -> bool:
        """Tell whether the rise would not be reached up to a point beyond it, if the others had no bounds."""
        return beyond.root**2 - self._owed(beyond.fitted) < (1 - OWED_TO_BOUNDS) * self.target**2

    def _at_bound(self, fitted: Fitted) -> npt.NDArray[np.bool_]:
        slack = 1e-9 * (self.objective.upper - self.objective.lower)
        low = fitted.coordinates <= self.objective.lower + slack
        return np.asarray((low | (fitted.coordinates >= self.objective.upper - slack))[self._free])

    def _owed(self, fitted: Fitted) -> float:
        """Return the part of the rise that is owed to bounds of the free unknowns, to first order."""
        if not self._at_bound(fitted).any():
            return 0.0
        # A bound on which the best point lies as well is owed as much there.
        return self._gain(fitted) - self._gain(self.best.fitted)

    def _gain(self, fitted: Fitted) -> float:
        """Return the decrease of the sum of squares, to first order, by free unknowns that have no bounds."""
        rows = fitted.jacobian[:, self._free] * self.objective.scale[self._free]
        left = fitted.residuals - rows @ np.linalg.lstsq(rows, fitted.residuals, rcond=1e-8)[0]
        return 2 * fitted.cost - float(left @ left)


#: Root of the 95 % quantile of χ² with two degrees of freedom.
ROOT_95_OF_TWO = 2.447746830680816
#: So many rays or more are walked every other one first. One between two whose radii, over those to first order,
#: differ by less than this share has their mean, which no picture can distinguish.
MANY, ALIKE = 8, 0.02


@dataclass(frozen=True, eq=False)
class ParameterPlane:
    """Region of two unknowns, the others optimised.

    Attributes
    ----------
    indices
        The two unknowns.
    best : (2,)
        Coordinates of the best point.
    axes : (2, 2)
        Half axes of a region of one standard deviation to first order, one a row, none longer than the search.
    angles : (n,)
        Of the rays, even and ascending, in units of the half axes.
    radii : (n,)
        Lengths of the rays in the same units; one whose neighbours are alike has their mean.
    closed : (n,) bool
        True where the region ends there; elsewhere it goes on, or the model could not be followed.
    linear_radii : (n,)
        The same to first order; very large where the data do not depend on it.
    """

    indices: tuple[int, int]
    best: Array
    axes: Array
    angles: Array
    radii: Array
    closed: npt.NDArray[np.bool_]
    linear_radii: Array

    def points(self, angles: Array, radii: Array) -> Array:
        """Return coordinates (n, 2) of points at angles and radii (n,)."""
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ self.axes
        return np.asarray(self.best + radii[:, None] * directions)

    @property
    def rim(self) -> Array:
        """Coordinates of the ends of the rays, (n, 2)."""
        return self.points(self.angles, self.radii)


def parameter_plane(
    objective: Objective,
    best: Minimum,
    indices: tuple[int, int],
    rays: int,
) -> ParameterPlane:
    """Return the region of two unknowns by walks along rays, which are even in the scales of a fit to first order.

    Without rays the plane has the best point and the scales alone.
    """
    pair = np.array(indices)
    axes = _scales(objective, best, pair)
    angles = 2 * np.pi * np.arange(rays) / max(rays, 1)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ axes
    walks = [ProfileWalk(objective, best, pair, each, ROOT_95_OF_TWO, strict=False) for each in directions]
    linear = np.array([walk.linear_distance for walk in walks])
    radii, closed = np.full(rays, np.nan), np.zeros(rays, bool)
    names = " and ".join(objective.misfit.unknowns[i].name for i in indices)
    spared = [*range(1, rays, 2)] if rays >= MANY and rays % 2 == 0 else []
    for n in [*(n for n in range(rays) if n not in spared), *spared]:
        between = np.array([n - 1, n + 1]) % rays
        shares = radii[between] / linear[between]
        if n in spared and closed[between].all() and abs(np.log(shares[1] / shares[0])) < ALIKE:
            radii[n], closed[n] = linear[n] * np.sqrt(shares.prod()), True
            continue
        objective.tell(f"plane of {names}, ray {n + 1} of {rays}")
        walk = walks[n].run()
        closed[n] = walk.end is End.crossed
        furthest = max(each.distance for each in walk.points if each.root <= ROOT_95_OF_TWO)
        radii[n] = walk.distance if closed[n] else furthest
    return ParameterPlane(indices, best.fitted.coordinates[pair], axes, angles, radii, closed, linear)


def _scales(objective: Objective, best: Minimum, pair: npt.NDArray[np.int64]) -> Array:
    """Return the half axes of the region to first order, one a row, none longer than the search."""
    from scipy.linalg import svd

    scale = objective.scale
    rows = best.fitted.jacobian * scale
    others = np.delete(rows, pair, axis=1)
    own = rows[:, pair]
    if others.shape[1]:
        own = own - others @ np.linalg.lstsq(others, own, rcond=1e-10)[0]
    _, values, axes = svd(own, full_matrices=False)
    room = (objective.upper - objective.lower)[pair] / scale[pair]
    most = 1 / np.sqrt(((axes / room) ** 2).sum(axis=1))
    return np.asarray(axes * np.minimum(1 / np.maximum(values, 1e-300), most)[:, None] * scale[pair])


#: Root of the 95 % quantile of χ² with one degree of freedom.
ROOT_95 = 1.959963984540054


@dataclass(frozen=True)
class IntervalEnd:
    """End of an interval.

    Attributes
    ----------
    value
        The unknown there; None: the data set no end.
    reason
        Why there is none.
    """

    value: float | None
    reason: str = ""


def interval_words(ends: tuple[float | None, float | None]) -> str:
    """Return an interval such as ``1.2 to open``, by its ends."""
    return " to ".join("open" if end is None else f"{end:.4g}" for end in ends)


@dataclass(frozen=True, eq=False)
class ConfidenceInterval:
    """95 % interval of a number.

    Attributes
    ----------
    low, high
        Its ends.
    """

    low: IntervalEnd
    high: IntervalEnd

    @property
    def values(self) -> tuple[float | None, float | None]:
        """Both ends as values."""
        return self.low.value, self.high.value

    @property
    def open_ends(self) -> dict[str, str]:
        """Reasons of the ends that the data do not set, by ``low`` and ``high``."""
        ends = {"low": self.low, "high": self.high}
        return {name: end.reason for name, end in ends.items() if end.value is None}


@dataclass(frozen=True, eq=False)
class ProfileInterval(ConfidenceInterval):
    """95 % interval of one unknown, with its profile.

    Attributes
    ----------
    coordinates : (n, k)
        Points of the profile in the order of the unknown: its coordinate, and the best of the others. Points at which
        bounds of the others raise the sum of squares are left out.
    roots : (n,)
        Square root of the rise of the sum of squares, negative below the best value; ±1.96 at the ends.
    """

    coordinates: Array
    roots: Array

    def widened(self, unknown: Unknown, shift: float) -> ProfileInterval:
        """Return the interval that holds the values of this one, and all of them after a shift of the coordinate."""
        low, high = (
            _shifted(end, unknown, move)
            for end, move in ((self.low, min(shift, 0.0)), (self.high, max(shift, 0.0)))
        )
        return replace(self, low=low, high=high)


def _shifted(end: IntervalEnd, unknown: Unknown, move: float) -> IntervalEnd:
    """Return an end of an interval after a move of its coordinate; none beyond a bound of the search."""
    if end.value is None or move == 0:
        return end
    value = unknown.value(unknown.coordinate(end.value) + move)
    if unknown.lower <= value <= unknown.upper:
        return IntervalEnd(value)
    bound = unknown.text(unknown.lower if move < 0 else unknown.upper)
    return IntervalEnd(None, f"an error of the curves moves it beyond the bound of the search, {bound}")


def confidence_interval(
    objective: Objective,
    best: Minimum,
    index: int,
    strict: bool = True,
) -> ProfileInterval:
    """Return the 95 % interval of an unknown by its profile likelihood.

    The ends are where the least sum of squares over all other unknowns has risen by 3.84, the 95 % quantile of χ²
    (Wilks 1938; Venzon & Moolgavkar 1988, Appl. Statist. 37:87–94). An end is None where the profile reaches a bound of
    the search before, where a bound of another unknown alone makes it rise, or where the model cannot be computed or
    trusted.

    Raises
    ------
    LowerPoint
        ``best`` was not the minimum, and the interval is ``strict`` about that.
    """
    unknown, walks = objective.misfit.unknowns[index], list[ProfileWalk]()
    for sign, name in ((-1.0, "lower"), (1.0, "upper")):
        objective.tell(f"{name} end of {unknown.name}")
        walk = ProfileWalk(objective, best, np.array([index]), np.array([sign]), ROOT_95, strict)
        walks.append(walk.run())
    below, above = (walk.honest for walk in walks)
    # The best point is the first one of both walks.
    points = [*((-1, each) for each in reversed(below[1:])), *((1, each) for each in above)]
    ends = [
        _end(walk, sign, objective.misfit.unknowns, index) for walk, sign in zip(walks, (-1, 1), strict=True)
    ]
    return ProfileInterval(
        ends[0],
        ends[1],
        np.array([point.fitted.coordinates for _, point in points]),
        np.array([sign * point.root for sign, point in points]),
    )


def _end(walk: ProfileWalk, sign: int, unknowns: Sequence[Unknown], index: int) -> IntervalEnd:
    """Return the end of an interval that a walk has found, or the reason why it has none."""
    unknown = unknowns[index]
    best = walk.best.fitted.coordinates
    if walk.end is End.crossed:
        return IntervalEnd(unknown.value(float(best[index] + sign * walk.distance)))
    furthest = max(walk.points, key=lambda each: each.distance).fitted.coordinates
    reached = [one.text(one.value(float(x))) for one, x in zip(unknowns, furthest, strict=True)]
    if walk.end is End.bound:
        why = f"the data do not exclude any value up to the bound of the search, {reached[index]}"
    elif walk.end is End.held:
        held = joined(f"{unknowns[i].name} at its bound {reached[i]}" for i in walk.held_by)
        why = f"the data set no end here; only {held} would"
    else:
        why = f"the profile is known up to {reached[index]}; beyond it {walk.end.value}"
    return IntervalEnd(None, why)
