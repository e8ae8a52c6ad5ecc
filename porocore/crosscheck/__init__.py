"""Every installed backend on one case, each held against the others."""

from porocore.crosscheck.check import CrossCheck, crosscheck
from porocore.crosscheck.comparison import Comparison
from porocore.crosscheck.contestants import Contestants, find_contestants

__all__ = ["Comparison", "Contestants", "CrossCheck", "crosscheck", "find_contestants"]
