"""Batch of rows (Batch): a dataclass of arrays whose rows can be selected and joined, nested batches included."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, Self

import numpy as np


class Batch:
    """Dataclass of arrays whose rows can be selected, nested ones included."""

    def __getitem__(self, rows: Any) -> Self:
        picked = {}
        for f in fields(self):  # type: ignore[arg-type]
            value = getattr(self, f.name)
            picked[f.name] = None if value is None else value[rows]
        return type(self)(**picked)

    @classmethod
    def concatenate(cls, parts: list[Self]) -> Self:
        """Join batches end to end; a field that is None in the first part must be None in all."""
        joined: dict[str, Any] = {}
        for f in fields(cls):  # type: ignore[arg-type]
            values = [getattr(part, f.name) for part in parts]
            if values[0] is None:
                joined[f.name] = None
            elif isinstance(values[0], Batch):
                joined[f.name] = type(values[0]).concatenate(values)
            else:
                joined[f.name] = np.concatenate(values)
        return cls(**joined)
