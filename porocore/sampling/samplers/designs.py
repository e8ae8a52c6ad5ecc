"""Base of samplers that ask in rounds (RoundSampler), checks of options; ``sobol`` and ``latin-hypercube``.

What a round asks for depends on all states before it and on nothing else: not on the order in which they were solved,
nor on the number of workers, nor on interruptions. Random states to test on, and undeformed members, are here too.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Container, Iterator, Mapping
from itertools import islice
from typing import Any, ClassVar

import numpy as np

from porocore.core.echo import choices, echo
from porocore.core.inputs import InputSpace, SampledRange, farthest
from porocore.core.models.bounds import LARGEST_SEED, MOST_STATES
from porocore.errors import ConfigurationError
from porocore.interfaces.sampler import Request, Sampler
from porocore.sampling.samplers.candidates import (
    MemberChoice,
    box_corners,
    halton_points,
    hypercube_points,
    sobol_points,
)
from porocore.states import Array, CellResponse, Status


def positive(key: str, value: Any) -> float:
    """Return a finite number above zero."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
        raise ConfigurationError(f"{key}: must be a positive number, got {echo(value)}")
    return float(value)


def whole(key: str, value: Any, least: int, most: int = MOST_STATES) -> int:
    """Return a whole number from ``least`` to ``most``."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ConfigurationError(f"{key}: must be a whole number of at least {least}, got {echo(value)}")
    if value > most:
        raise ConfigurationError(f"{key}: must be a whole number of at most {most}, got {echo(value)}")
    return value


def yes_or_no(key: str, value: Any) -> bool:
    """Return true or false."""
    if not isinstance(value, bool):
        raise ConfigurationError(f"{key}: must be true or false, got {echo(value)}")
    return value


def refuse_unknown(sampler: str, known: tuple[str, ...], unknown: Mapping[str, Any]) -> None:
    """Refuse options that the sampler has not; ``step`` and ``tolerance`` stand elsewhere in a configuration.

    Raises
    ------
    ConfigurationError
        There are some.
    """
    if not unknown:
        return
    if "step" in unknown:
        raise ConfigurationError(
            f"sampling.inputs.{next(iter(unknown['step']), 'NAME')}.step: {sampler} takes no steps; remove it"
        )
    if "tolerance" in unknown:
        raise ConfigurationError(f"sampling.tolerance: {sampler} takes no tolerance; remove it")
    raise ConfigurationError(
        f"sampling.options: unknown option {', '.join(map(echo, sorted(unknown)[:5]))} of {sampler}; "
        + choices(known, "the options are", "it has none")
    )


def check_waiting(key: str, waiting: Container[str]) -> None:
    """Refuse with a ValueError a key whose response the sampler does not wait for."""
    if key not in waiting:
        raise ValueError(f"state '{key}' was not asked for or has been told before")


class RoundSampler(Sampler):
    """Rounds of states until :meth:`next_round` is empty or ``count`` states have been asked for.

    Every state is solved from the undeformed cell: measured on designs of two and of seven inputs, the field of the
    nearest known state saves nothing worth waiting for. Keys are ``state-00000``, ``state-00001``, …

    Attributes
    ----------
    inputs
        The box.
    count
        The budget: states that are asked for at most, those without values included.
    points : (n, d)
        States asked for, in the unit box, in the order of asking.
    """

    #: Key of a state by its number.
    key = "state-{:05d}"

    def __init__(self, inputs: InputSpace, count: int) -> None:
        self.inputs, self.count = inputs, count
        self.points: Array = np.empty((0, len(inputs)))
        self._observed: dict[int, CellResponse] = {}
        self._waiting: dict[str, int] = {}
        self._over = False

    @abstractmethod
    def next_round(self, room: int) -> Array:
        """Return at most ``room`` points (m, d) of the unit box; none ends the sampling."""

    @property
    def observed(self) -> list[CellResponse]:
        """Responses at all ``points`` of complete rounds."""
        return [self._observed[i] for i in range(len(self.points))]

    def ask(self) -> list[Request]:
        """Return a whole round, once the one before it is complete."""
        if self._waiting or self._over:
            return []
        first, room = len(self.points), self.count - len(self.points)
        new = self.next_round(room) if room > 0 else np.empty((0, len(self.inputs)))
        if not len(new):
            self._over = True
            return []
        self.points = np.concatenate([self.points, new])
        requests = [
            Request(self.key.format(first + i), tuple(map(float, x)))
            for i, x in enumerate(from_unit(self.inputs, new))
        ]
        self._waiting = {request.key: first + i for i, request in enumerate(requests)}
        return requests

    def tell(self, key: str, response: CellResponse) -> None:
        """Record the response of one state that was asked for."""
        check_waiting(key, self._waiting)
        self._observed[self._waiting.pop(key)] = response

    @property
    def done(self) -> bool:
        """True when there are no more rounds."""
        return not self._waiting and (self._over or len(self.points) >= self.count)

    @property
    def expected(self) -> int:
        """The budget, or the number of states if the rounds have ended before."""
        return len(self.points) if self._over else self.count


def from_unit(inputs: InputSpace, unit: Array) -> Array:
    """Return points (n, d) of the unit box in the box of ``inputs``, no digit beyond its bounds."""
    low, high = np.array(inputs.lower), np.array(inputs.upper)
    return np.asarray(np.clip(low + (high - low) * unit, low, high))


#: Boxes of more inputs have too many corners to solve them all.
MOST_CORNER_INPUTS = 8


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
        """Return the whole design."""
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
        return MemberChoice(values, self.states_per_member).in_rows(states)

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
        return hypercube_points(count, d, self.seed)

    def parameter_filling(self, count: int, m: int) -> Array:
        """Return points of a hypercube of their own."""
        return hypercube_points(count, m, self.seed + 1)


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
        refuse_unknown("random states", ("count", "seed", "most_tries", "states_per_member"), unknown)
        whole("random states: count", count, 1)
        whole("random states: seed", seed, 0, LARGEST_SEED)
        whole("random states: most_tries", most_tries, 1)
        whole("random states: states_per_member", states_per_member, 1)
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


class UndeformedMembers(RoundSampler):
    """Members of a family spread over the ranges of its parameters, denser towards their ends.

    They are points of a Halton sequence u in the unit box, moved to (1 − cos πu)/2, where the Chebyshev points of a
    polynomial lie densest. There is no choice in it: a family has one set of them. Keys are ``member-000`` and so on.

    Parameters
    ----------
    inputs
        The parameters and their ranges, and nothing else.
    count
        Number of members.
    """

    choosing = "choosing members"
    key = "member-{:03d}"

    def next_round(self, room: int) -> Array:
        """Return all members."""
        return np.asarray((1 - np.cos(np.pi * halton_points(len(self.inputs), room, seed=0))) / 2)
