"""What the linear solvers have in common: an approximate inverse of a symmetric matrix of fixed pattern."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any


class SymmetricFactor(ABC):
    """An approximate inverse of a symmetric matrix whose pattern is fixed."""

    #: Number of negative pivots of the last factorisation; -1: this solver cannot tell.
    negative: int

    @abstractmethod
    def factor(self, data: Any) -> None:
        """Set up for the entries (nnz of the upper triangle)."""

    @abstractmethod
    def solve(self, rhs: Any) -> Any:
        """Apply to (n,) or (n, k)."""
