"""Every installed backend on one case, each held against the others."""

from porocore.verification.crosscheck.check import CrossCheck, crosscheck
from porocore.verification.crosscheck.comparison import Comparison, select_backends

__all__ = ["Comparison", "CrossCheck", "crosscheck", "select_backends"]
