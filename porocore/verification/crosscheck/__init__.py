"""Every installed backend on one case, each held against the others."""

from porocore.verification.crosscheck.backend_selection import BackendSelection, select_backends
from porocore.verification.crosscheck.check import CrossCheck, crosscheck
from porocore.verification.crosscheck.comparison import Comparison

__all__ = ["BackendSelection", "Comparison", "CrossCheck", "crosscheck", "select_backends"]
