"""Random states in the box of the inputs, to test a surrogate on; further ones for failures."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any

import numpy as np

from porocore.core.inputs.input_space import InputSpace
from porocore.core.inputs.sampled_range import SampledRange
from porocore.errors import ConfigurationError
from porocore.interfaces.sampler import Request, Sampler
from porocore.sampling.samplers.options import check_waiting
from porocore.states import Array, CellResponse, Status

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
