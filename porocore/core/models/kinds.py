"""Sections of the configuration that have other keys for each ``kind``."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Discriminator


def by_kind(base: type[BaseModel], default: str) -> Discriminator:
    """Return the discriminator of a union by the ``kind`` of a mapping or of an instance of ``base``.

    Parameters
    ----------
    base
        What all classes derive from.
    default
        The kind of a mapping that names none.
    """

    def kind(value: Any) -> Any:
        if isinstance(value, base):
            return getattr(value, "kind", None)
        return value.get("kind", default) if isinstance(value, dict) else default

    return Discriminator(kind)
