"""Call of a backend whose failure is a result, with its wall time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, ParamSpec, TypeVar

T = TypeVar("T")
P = ParamSpec("P")


@dataclass(frozen=True)
class TimedOutcome(Generic[T]):
    """Value of a call, or the reason of its failure, and the wall time [s]."""

    value: T | None
    reason: str
    seconds: float


def attempt(what: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> TimedOutcome[T]:
    """Call foreign code; whatever it raises is the reason."""
    began = time.perf_counter()
    try:
        value = what(*args, **kwargs)
    except (Exception, SystemExit) as error:  # noqa: BLE001 - foreign code, kept and shown
        text = " ".join(str(error).split()) or "no message"
        return TimedOutcome(None, f"{type(error).__name__}: {text}", time.perf_counter() - began)
    return TimedOutcome(value, "", time.perf_counter() - began)
