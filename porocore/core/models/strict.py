"""The base of configuration sections, and sections that have other keys for each ``kind``."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Discriminator


class StrictModel(BaseModel):
    """Immutable model that refuses unknown keys and numbers that are not finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


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
