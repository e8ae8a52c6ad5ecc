"""Check of the keys that a sampler receives."""

from __future__ import annotations

from collections.abc import Container


def check_waiting(key: str, waiting: Container[str]) -> None:
    """Refuse a key whose response the sampler does not wait for.

    Raises
    ------
    ValueError
        It was not asked for, or was told before.
    """
    if key not in waiting:
        raise ValueError(f"state '{key}' was not asked for or has been told before")
