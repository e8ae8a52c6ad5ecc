"""Checks of a sampler's options and of the keys of states that it is told."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping
from typing import Any

from porocore.core.echo import choices, echo
from porocore.core.models.bounds import MOST_STATES
from porocore.errors import ConfigurationError


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
