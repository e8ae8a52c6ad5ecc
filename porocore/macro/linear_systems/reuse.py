"""Age at which a kept preconditioner is renewed; tolerance of a linear solve within Newton's iteration."""

from __future__ import annotations

import math
from dataclasses import dataclass

#: A preconditioner is made anew when a digit costs so many times the iterations that it did at first. On marches of
#: 24 systems one or two are then made instead of 24.
AGED = 1.5
#: Digits that fewer iterations than these say nothing of.
FEWEST_DIGITS = 1.0
#: Relative residual of a linear system: at most this,
LOOSEST = 1e-4
#: else this times the square of the last reduction of Newton's misfit (Eisenstat & Walker 1996, choice 2),
SAFETY = 0.9
#: but never less than this share of what Newton's tolerance needs, nor than this.
ENOUGH, TIGHTEST = 0.1, 1e-10


@dataclass
class ReusePolicy:
    """Age of a preconditioner, told by iterations for each digit."""

    _fresh: float | None = None
    _aged: bool = True

    @property
    def due(self) -> bool:
        """True if the next system wants a new preconditioner."""
        return self._aged

    def renewed(self) -> None:
        """Take note that the preconditioner is new."""
        self._fresh, self._aged = None, False

    def expire(self) -> None:
        """Have the next system make a new one."""
        self._aged = True

    def add(self, iterations: int, reduction: float) -> None:
        """Take note of a solve that reduced the residual to ``reduction`` times that of the right-hand side."""
        digits = -math.log10(reduction) if 0 < reduction < 1 else 0.0
        if digits < FEWEST_DIGITS:
            return
        pace = iterations / digits
        if self._fresh is None:
            self._fresh = pace
        self._aged = self._aged or pace > AGED * self._fresh


def sufficient(misfit: float, tolerance: float) -> float:
    """Return the relative residual with which one system ends the iteration if the tangent does not change."""
    return max(ENOUGH * tolerance / misfit, TIGHTEST) if 0 < misfit < math.inf else TIGHTEST


def forcing(misfit: float, before: float | None, tolerance: float) -> float:
    """Return the relative residual to which Newton's linear system is to be solved.

    Parameters
    ----------
    misfit, before
        Of the present iterate, and of the one before; None for the first.
    tolerance
        Misfit that ends the iteration.
    """
    if not 0 < misfit < math.inf:
        return TIGHTEST
    quadratic = LOOSEST if before is None or not before > 0 else SAFETY * (misfit / before) ** 2
    return min(LOOSEST, max(quadratic, sufficient(misfit, tolerance)))
