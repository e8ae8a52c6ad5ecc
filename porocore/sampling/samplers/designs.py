"""Samplers ``sobol`` and ``latin-hypercube``; sweeps of one input; random states to test on."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, ClassVar

import numpy as np

from porocore.core.inputs import InputSpace, SampledRange, farthest
from porocore.core.models.bounds import LARGEST_SEED
from porocore.errors import ConfigurationError
from porocore.interfaces.sampler import Request, Sampler
from porocore.sampling.samplers.rounds import RoundSampler, check_waiting, refuse_unknown, whole, yes_or_no
from porocore.states import Array, CellResponse, Status

#: Boxes of more inputs have too many corners to solve them all.
MOST_CORNER_INPUTS = 8
#: Up to so many numbers a Latin hypercube is improved by exchanges: about two seconds.
MOST_OPTIMISED = 4000


class Design(RoundSampler):
    """``count`` states in one round, the corners of the box first if they are wanted.

    Parameters
    ----------
    inputs
        The box.
    count : int, at least 1
        Number of states, corners included.
    seed : int, at least 0
        Seed of the randomisation.
    corners : bool
        Solve the 2^d corners of the box of up to eight inputs first, so that a surrogate never extrapolates within it.
    states_per_member : int, at least 1
        Number of states in a row that have the same parameters of the cell, which then are a design of their own; 1:
        the design is one of all inputs together. Without parameters it does nothing.

    Raises
    ------
    ConfigurationError
        An option is unknown or of no use; the message begins with its key in a configuration.
    """

    name: ClassVar[str]

    seeded = True

    def __init__(
        self,
        inputs: InputSpace,
        count: int = 100,
        seed: int = 0,
        corners: bool = False,
        states_per_member: int = 4,
        **unknown: Any,
    ) -> None:
        refuse_unknown(self.name, ("count", "seed", "corners", "states_per_member"), unknown)
        super().__init__(inputs, whole("sampling.options.count", count, 1))
        self.seed = whole("sampling.options.seed", seed, 0, LARGEST_SEED)
        self.corners = yes_or_no("sampling.options.corners", corners)
        self.states_per_member = whole("sampling.options.states_per_member", states_per_member, 1)
        if corners:
            d = len(inputs)
            if d > MOST_CORNER_INPUTS:
                raise ConfigurationError(
                    f"sampling.options.corners: {d} inputs have {2**d} corners; leave them out beyond "
                    f"{MOST_CORNER_INPUTS} inputs"
                )
            if count < (most := len(self._box_corners())):
                raise ConfigurationError(
                    f"sampling.options.count: {count} states are fewer than the {most} corners of {d} inputs; "
                    "raise it, or set corners: false"
                )

    def next_round(self, room: int) -> Array:
        """Return the whole design, once."""
        if len(self.points):
            return np.empty((0, len(self.inputs)))
        first = self._box_corners() if self.corners else np.empty((0, len(self.inputs)))
        filling = self._members(room - len(first)) if room > len(first) else first[:0]
        return np.concatenate([first, filling])

    def _members(self, count: int) -> Array:
        """Return points (count, d): a design over the components, and each point of one over m parameters for some.

        Where a body uses some values of the parameters alone, those are the farthest of these, in turns.
        """
        m, used = len(self.inputs.parameters), self.inputs.used_values
        if not m or (used is None and self.states_per_member == 1):
            return self.filling(count, len(self.inputs))
        states, members = self.filling(count, len(self.inputs) - m), -(-count // self.states_per_member)
        values = (
            self.parameter_filling(members, m) if used is None else used.unit[farthest(used.unit, members)]
        )
        which = np.arange(count) // self.states_per_member % len(values)
        return np.concatenate([states, values[which]], axis=1)

    def _box_corners(self) -> Array:
        """Return the corners of the box; those of one member follow each other."""
        m, used = len(self.inputs.parameters), self.inputs.used_values
        if used is None:
            return np.roll(box_corners(len(self.inputs)), -m, axis=1)
        corners, values = box_corners(len(self.inputs) - m), used.unit[farthest(used.unit, 2**m)]
        return np.concatenate(
            [np.tile(corners, (len(values), 1)), np.repeat(values, len(corners), axis=0)], axis=1
        )

    @property
    def members(self) -> int:
        """Number of members of a family of cells that are prepared for the states; 1 for a cell without parameters."""
        m = len(self.inputs.parameters)
        if not m:
            return 1
        corners = len(self._box_corners()) if self.corners else 0
        at_corners: int = corners // 2 ** (len(self.inputs) - m)
        return at_corners + -(-(self.count - corners) // self.states_per_member)

    @abstractmethod
    def filling(self, count: int, d: int) -> Array:
        """Return ``count`` points (n, d) of the unit box."""

    @abstractmethod
    def parameter_filling(self, count: int, m: int) -> Array:
        """Return points (count, m) of the unit box for the parameters of ``count`` members."""


class SobolDesign(Design):
    """The first ``count`` points of a scrambled Sobol sequence (Sobol' 1967, Owen 1998).

    A larger ``count`` with the same seed begins with the same states. A power of two fills the box most evenly. The
    parameters of a family of cells are points of a scrambled Halton sequence, since two Sobol sequences would be alike.
    """

    name = "sobol"

    def filling(self, count: int, d: int) -> Array:
        """Return points of the sequence."""
        return sobol_points(d, count, self.seed)

    def parameter_filling(self, count: int, m: int) -> Array:
        """Return points of the Halton sequence."""
        return halton_points(m, count, self.seed)


class LatinHypercube(Design):
    """A Latin hypercube (McKay, Beckman & Conover 1979): each input takes one value in each of ``count`` slices.

    Small ones are improved by random exchanges that lower the centred discrepancy.
    """

    name = "latin-hypercube"

    def filling(self, count: int, d: int) -> Array:
        """Return points of the hypercube."""
        return _hypercube(count, d, self.seed)

    def parameter_filling(self, count: int, m: int) -> Array:
        """Return points of a hypercube of their own."""
        return _hypercube(count, m, self.seed + 1)


def _hypercube(count: int, d: int, seed: int) -> Array:
    optimisation = "random-cd" if d > 1 and 1 < count * d <= MOST_OPTIMISED else None
    from scipy.stats import qmc  # slow to import

    points: Array = qmc.LatinHypercube(d, seed=seed, optimization=optimisation).random(count)
    return points


def sobol_points(d: int, count: int, seed: int) -> Array:
    """Return the first points (count, d) of a scrambled Sobol sequence."""
    power = max(0, int(np.ceil(np.log2(count))))
    from scipy.stats import qmc  # slow to import

    points: Array = qmc.Sobol(d, seed=seed).random_base2(power)[:count]
    return points


def halton_points(d: int, count: int, seed: int) -> Array:
    """Return the first points (count, d) of a scrambled Halton sequence (Halton 1960)."""
    from scipy.stats import qmc  # slow to import

    points: Array = qmc.Halton(d, seed=seed).random(count)
    return points


def box_corners(d: int) -> Array:
    """Return the corners (2^d, d) of the unit box."""
    return np.array(np.meshgrid(*[(0.0, 1.0)] * d, indexing="ij")).reshape(d, -1).T


#: A norm of <∇u¹>_s below this is round-off of the cell solver and counts as this.
SMALLEST_NORM = 1e-8


@dataclass(frozen=True, eq=False)
class LinePoint:
    """Solved point of a line."""

    value: float
    #: <∇u¹>_s (3, 3); None where the state has no values.
    mean_grad: Array | None


def density_residual(before: LinePoint, last: LinePoint, point: LinePoint, step: float) -> float:
    """Return the distance of ``point`` from the straight line through the two accepted points before it [-].

    max_ij |g − g_L| / ‖g‖_F with g = <∇u¹>_s and its linear extrapolation
    g_L = g_last + (g_last − g_before)/(I_last − I_before) · (I − I_last)
    (Dehghani & Zilian, eq. Res). The norm of g goes through zero where the effects of two inputs cancel, and
    the residual would then ask for small steps where nothing bends. So the norm counts as no smaller than
    the change of g over one default ``step`` along that line, nor as smaller than :data:`SMALLEST_NORM`.
    """
    assert before.mean_grad is not None
    assert last.mean_grad is not None
    assert point.mean_grad is not None
    slope = (last.mean_grad - before.mean_grad) / (last.value - before.value)
    extrapolated = last.mean_grad + slope * (point.value - last.value)
    norm = max(
        float(np.linalg.norm(point.mean_grad)), float(np.linalg.norm(slope)) * abs(step), SMALLEST_NORM
    )
    return float(np.abs(point.mean_grad - extrapolated).max()) / norm


@dataclass
class LineSweep:
    """Sweep of one input from zero to ``end``; those before it rest at ``prefix``, those after it at zero.

    A point ahead that is too far off the secant, or that has no values, moves the next point to the middle
    of the interval; the point ahead is kept and looked at again from there. An interval whose half would be
    below ``smallest`` default steps is accepted as it is. A point without values that is still ahead then is
    the edge of the computable region: from there on the line runs to ``end`` at the default step without
    checks, and every point with values counts as accepted.

    Attributes
    ----------
    prefix
        Values of the inputs before the moving one.
    origin
        The solved point at zero.
    end
        End of the line; its sign is the direction.
    step
        Default step, positive.
    tolerance
        Largest density residual that is accepted.
    smallest
        Smallest interval as a fraction of ``step``.
    """

    prefix: tuple[float, ...]
    origin: LinePoint
    end: float
    step: float
    tolerance: float
    smallest: float
    #: The last accepted point.
    last: LinePoint = field(init=False)
    #: Points of the default grid not yet asked for, next one last.
    grid: list[float] = field(init=False)
    #: Solved points that are not accepted yet, nearest last.
    ahead: list[LinePoint] = field(init=False, default_factory=list)
    _before: LinePoint | None = field(init=False, default=None)
    _beyond: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        self.last = self.origin
        self.grid = grid_values(self.end, self.step)[::-1]

    @property
    def position(self) -> int:
        """Index of the moving input among the inputs."""
        return len(self.prefix)

    def tell(self, point: LinePoint) -> list[LinePoint]:
        """Record the response at the point of :meth:`next_value`; return the points that it makes accepted."""
        self.ahead.append(point)
        accepted = []
        while self.ahead and (self._beyond or not self._wants_middle(self.ahead[-1])):
            nearest = self.ahead.pop()
            if nearest.mean_grad is None:
                self._beyond = True
            else:
                self._before, self.last = self.last, nearest
                accepted.append(nearest)
        return accepted

    def next_value(self) -> float | None:
        """Return the next value to solve; None at the end of the line."""
        if self.ahead:
            return (self.last.value + self.ahead[-1].value) / 2
        return self.grid.pop() if self.grid else None

    def _wants_middle(self, point: LinePoint) -> bool:
        half = abs(point.value - self.last.value) / 2
        if half < self.smallest * self.step * (1 - 1e-9):
            return False
        if point.mean_grad is None:
            return True
        if self._before is None:
            return False
        return density_residual(self._before, self.last, point, self.step) > self.tolerance


def grid_values(end: float, step: float) -> list[float]:
    """Return step, 2 step, … with the sign of ``end``, up to ``end`` itself, which is hit exactly."""
    return [float(np.copysign(i * step, end)) for i in range(1, grid_size(end, step))] + [end]


def grid_size(end: float, step: float) -> int:
    """Return the number of values of :func:`grid_values`."""
    return max(1, int(np.ceil(abs(end) / step - 1e-9)))


#: After so many states in a row beyond a sampled range, it is too thin to draw in, and the box stands in.
MOST_MISSES = 10_000


def random_requests(inputs: InputSpace, count: int, seed: int) -> list[Request]:
    """Return ``count`` states, uniform in the box of the inputs, with the keys ``test-000`` and so on.

    All start from the undeformed cell. A larger ``count`` with the same seed begins with the same states.
    """
    return list(islice(_draw(inputs, seed), count))


class RandomStates(Sampler):
    """Random states until ``count`` of them have values.

    The states are those of :func:`random_requests` from the first on, and as many as it takes: which ones
    does not depend on the order in which they are solved.

    Parameters
    ----------
    inputs
        The box to draw from.
    count
        Number of states with values that are wanted.
    seed
        Seed of the random states.
    most_tries
        After ``most_tries * count`` states there are no more, however few have values.
    within
        Only states in this range are drawn; None: in the whole box.
    states_per_member
        Number of states in a row that have the same parameters of the cell.

    Raises
    ------
    ConfigurationError
        An option is unknown or of no use.
    """

    seeded = True

    def __init__(
        self,
        inputs: InputSpace,
        count: int = 100,
        seed: int = 0,
        most_tries: int = 10,
        within: SampledRange | None = None,
        states_per_member: int = 1,
        **unknown: Any,
    ) -> None:
        if unknown:
            raise ConfigurationError(
                f"random states: unknown option {', '.join(map(repr, sorted(unknown)))}; "
                "the options are count, seed, most_tries and states_per_member"
            )
        for option, value, low in (
            ("count", count, 1),
            ("seed", seed, 0),
            ("most_tries", most_tries, 1),
            ("states_per_member", states_per_member, 1),
        ):
            if isinstance(value, bool) or not isinstance(value, int) or value < low:
                raise ConfigurationError(
                    f"random states: {option} must be a whole number of at least {low}, got {value!r}"
                )
        self.count, self.limit = count, count * most_tries
        self._draws = _draw(inputs, seed, within, states_per_member)
        self._asked = 0
        self._waiting: set[str] = set()
        self._failed = 0

    def ask(self) -> list[Request]:
        """Return one state for each that is wanted, and one more for each that failed."""
        # Solving one by one in the order of the draw until `count` have values would solve the same states:
        # the n asked for, f of them failed, are never more than those, and it ends with n − f = count.
        more = min(self.count + self._failed, self.limit) - self._asked
        requests = list(islice(self._draws, more))
        self._asked += more
        self._waiting |= {request.key for request in requests}
        return requests

    def tell(self, key: str, response: CellResponse) -> None:
        """Record the response of one state that was asked for."""
        check_waiting(key, self._waiting)
        self._waiting.remove(key)
        self._failed += not Status(int(response.status[0])).has_values

    @property
    def done(self) -> bool:
        """True when ``count`` states have values or the tries are used up."""
        return not self._waiting and self._asked == self.expected

    @property
    def expected(self) -> int:
        """Number of states asked for in all if no further one fails."""
        return min(self.count + self._failed, self.limit)


def _draw(
    inputs: InputSpace, seed: int, within: SampledRange | None = None, states_per_member: int = 1
) -> Iterator[Request]:
    random = np.random.default_rng(seed)
    low, high = np.array(inputs.lower), np.array(inputs.upper)
    own, used = len(inputs) - len(inputs.parameters), np.array(inputs.used)
    index = misses = 0
    member: Array = np.empty(0)
    while True:
        unit = random.random(len(inputs))
        if index % states_per_member == 0:
            member = low[own:] + (high - low)[own:] * unit[own:]
            if len(used):
                member = used[int(unit[own] * len(used))]
        x = np.concatenate([low[:own] + (high - low)[:own] * unit[:own], member])
        if within is not None and not within.contains(x)[0]:
            misses += 1
            if misses == MOST_MISSES:
                within = None
            continue
        misses = 0
        yield Request(f"test-{index:03d}", tuple(map(float, x)))
        index += 1
