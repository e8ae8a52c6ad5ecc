"""Time of a call of the surrogate, measured once and kept in a file."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import complete, read_json
from porocore.interfaces.surrogate import Surrogate
from porocore.states import MacroState

#: Calls in one time increment of the paper's example.
POINTS = 2250
REPEATS = 30


@dataclass(frozen=True)
class CallTimes:
    """Seconds that the responses with all derivatives of so many states take at once, the best of several times."""

    points: int
    seconds: float


def call_times(path: Path, surrogate: Surrogate, states: MacroState) -> CallTimes:
    """Read the times from ``path``, or measure and write them.

    Parameters
    ----------
    states
        Some in the sampled range; they are repeated until there are :data:`POINTS`.

    Raises
    ------
    DataError
        The file is damaged.
    """
    if path.exists():
        with complete(path, "record of call times", "start again"):
            return CallTimes(**read_json(path))
    asked = states[np.resize(np.arange(len(states)), POINTS)]
    best = np.inf
    for _ in range(REPEATS):
        began = time.perf_counter()
        surrogate.predict(asked)
        best = min(best, time.perf_counter() - began)
    found = CallTimes(POINTS, best)
    write_json(path, asdict(found), indent=1)
    return found
