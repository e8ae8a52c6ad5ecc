"""Exceptions of other processes, as text (Failure)."""

from __future__ import annotations

import traceback
from dataclasses import dataclass

from porocore import errors
from porocore.errors import PorocoreError, UnexpectedError


@dataclass(frozen=True)
class Failure:
    """Exception as text, since not every exception survives pickling."""

    kind: str
    message: str
    details: str

    @classmethod
    def from_exception(cls, error: Exception) -> Failure:
        """Return the exception that is being handled, as text."""
        return cls(type(error).__name__, str(error), traceback.format_exc())

    def as_error(self, who: str, where: str) -> PorocoreError:
        """Return the error to raise in the asking process; one that nobody expected says who raised it, and where."""
        kind = getattr(errors, self.kind, None)
        if isinstance(kind, type) and issubclass(kind, PorocoreError):
            return kind(self.message)
        return UnexpectedError(f"{who} raised {self.kind} {where}: {self.message}", self.details)
