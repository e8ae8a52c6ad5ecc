"""Every installed backend on one case, each held against the others."""

from porocore.verification.crosscheck.check import CrossCheck, crosscheck
from porocore.verification.crosscheck.comparison import Comparison
from porocore.verification.crosscheck.contestants import Contestants, find_contestants

__all__ = ["Comparison", "Contestants", "CrossCheck", "crosscheck", "find_contestants"]
