"""Halton sequences."""

from itertools import cycle

from scipy.stats import qmc

from porocore import CellResponse, ConfigurationError, InputSpace, Request, Sampler


class HaltonSampler(Sampler):
    """``count`` states of a scrambled Halton sequence (Owen 2017); all start from the undeformed cell.

    Raises
    ------
    ConfigurationError
        An option is unknown or of no use.
    """

    seeded = True

    def __init__(self, inputs: InputSpace, count: int = 64, seed: int = 0, **unknown):
        if unknown:
            raise ConfigurationError(
                f"sampling.options: unknown option '{min(unknown)}' of halton; its options are count and seed"
            )
        for option, value, least in (("count", count, 1), ("seed", seed, 0)):
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise ConfigurationError(
                    f"sampling.options.{option}: must be a whole number of at least {least}, got {value!r}"
                )
        unit = qmc.Halton(len(inputs), seed=seed).random(count)
        points = qmc.scale(unit, inputs.lower, inputs.upper)
        for i, values in zip(range(count), cycle(inputs.used)):
            points[i, len(inputs) - len(values) :] = values  # the body has no other values of the parameters
        self._ready = [Request(f"halton-{i:04d}", tuple(map(float, x))) for i, x in enumerate(points)]
        self._count = count
        self._waiting: set[str] = set()
        self._told = 0

    def ask(self) -> list[Request]:
        ready, self._ready = self._ready, []
        self._waiting |= {request.key for request in ready}
        return ready

    def tell(self, key: str, response: CellResponse) -> None:
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
