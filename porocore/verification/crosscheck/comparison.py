"""One line of a crosscheck (Comparison): difference of two backends, tolerance, passed or not."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Part = Literal["plugin", "cell", "surrogate", "body"]

#: Of averages, derivatives and K: two backends solve the same algebraic equations to some 1e-11.
CELL = 1e-8
#: Of histories: each step is solved to 1e-9 of its forces, and errors of some hundred steps add up.
BODY = 1e-6
#: Two surrogates may differ between the held-out states by so many times the sum of their errors there.
SPREAD = 3.0


@dataclass(frozen=True)
class Comparison:
    """Two backends on one quantity, or one that could not be compared.

    Attributes
    ----------
    part
        Of the study: the cell solvers, the surrogates, or the macro solvers; or a plugin that cannot be used.
    case
        The state of the cell, or the law of the body.
    quantity
        What is compared.
    one, other
        Names of the backends; ``other`` is empty where one failed alone.
    difference
        The largest, relative to the scale of the quantity (docs/crosscheck.md); infinite where there is no number.
    tolerance
        Up to which it passes.
    reason
        Why there is no number; empty where there is one.
    skipped
        Whether a backend declares not to offer what would be compared, which is no failure.
    """

    part: Part
    case: str
    quantity: str
    one: str
    other: str
    difference: float
    tolerance: float
    reason: str = ""
    skipped: bool = False

    @classmethod
    def left_out(
        cls, part: Part, case: str, quantity: str, one: str, reason: str, *, other: str = ""
    ) -> Comparison:
        """Return a comparison that is not made, because of what a backend declares."""
        return cls(part, case, quantity, one, other, 0.0, math.inf, reason, skipped=True)

    @classmethod
    def failure(
        cls, part: Part, case: str, quantity: str, one: str, reason: str, *, other: str = ""
    ) -> Comparison:
        """A comparison that there is nothing to compare for, which is a failure too."""
        return cls(part, case, quantity, one, other, math.inf, 0.0, reason)

    @property
    def passed(self) -> bool:
        """True if the difference is within the tolerance, or nothing was to be compared."""
        return self.skipped or (not self.reason and self.difference <= self.tolerance)

    @property
    def excess(self) -> float:
        """The difference in units of its tolerance; infinite for a failure."""
        if self.skipped:
            return 0.0
        if self.reason or math.isnan(self.difference):
            return math.inf
        if self.difference == 0:
            return 0.0
        return self.difference / self.tolerance if self.tolerance > 0 else math.inf

    @property
    def pair(self) -> str:
        """Names of the compared backends."""
        return f"{self.one} – {self.other}" if self.other else self.one

    def describe(self) -> str:
        """Return the comparison as text."""
        where = f"{self.quantity}, {self.case}" if self.case else self.quantity
        if self.reason:
            return f"{where}, {self.pair}: {self.reason}"
        return f"{where}, {self.pair}: differs by {self.difference:.2e}, tolerance {self.tolerance:.0e}"
