"""A grid of states in the box of the inputs."""

from itertools import product

import numpy as np

from porocore import CellResponse, ConfigurationError, InputSpace, Request, Sampler


class HaltonSampler(Sampler):
    """All combinations of ``points`` equally spaced values of each input, the ends of the ranges included.

    Parameters
    ----------
    inputs
        The box.
    points
        Values of each input.

    Raises
    ------
    ConfigurationError
        An option is unknown or of no use.
    """

    def __init__(self, inputs: InputSpace, points: int = 5, **unknown):
        if unknown:
            raise ConfigurationError(
                f"sampling.options.{min(unknown)}: halton has no such option; its option is points"
            )
        if isinstance(points, bool) or not isinstance(points, int) or points < 2:
            raise ConfigurationError(
                f"sampling.options.points: must be a whole number of at least 2, got {points!r}"
            )
        ranges = zip(inputs.lower, inputs.upper, strict=True)
        axes = [np.linspace(low, high, points) for low, high in ranges]
        # A key names a state for ever: a run that is resumed finds by it what is solved already.
        self._ready = [Request(f"halton-{i:05d}", tuple(map(float, x))) for i, x in enumerate(product(*axes))]
        self._count = len(self._ready)
        self._waiting: set[str] = set()
        self._told = 0

    def ask(self) -> list[Request]:
        """All states at once: none depends on the outcome of another."""
        ready, self._ready = self._ready, []
        self._waiting |= {request.key for request in ready}
        return ready

    def tell(self, key: str, response: CellResponse) -> None:
        """One outcome; a failed state is one too.

        Raises
        ------
        ValueError
            The key was not asked for, or was told before.
        """
        if key not in self._waiting:
            raise ValueError(f"state '{key}' was not asked for or has been told before")
        self._waiting.remove(key)
        self._told += 1

    @property
    def done(self) -> bool:
        return self._told == self._count

    @property
    def expected(self) -> int:
        return self._count
