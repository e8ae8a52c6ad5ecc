"""Base of samplers that ask in rounds (RoundSampler); checks of a sampler's options.

So what a round asks for depends on all states before it and on nothing else: not on the order in which they were
solved, nor on the number of workers, nor on interruptions.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Container, Mapping
from typing import Any

import numpy as np

from porocore.core.echo import choices, echo
from porocore.core.inputs import InputSpace
from porocore.core.models.bounds import MOST_STATES
from porocore.errors import ConfigurationError
from porocore.interfaces.sampler import Request, Sampler
from porocore.states import Array, CellResponse


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
            Request(f"state-{first + i:05d}", tuple(map(float, x)))
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
