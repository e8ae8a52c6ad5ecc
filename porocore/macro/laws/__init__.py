"""From the responses of a cell to stress, fluid storage and flux of the macroscale.

A closure is written once, here, in numpy, and serves every macro backend. With a cell law (a surrogate, the
cell solver itself, the linear limit: whatever predicts the responses of a batch of states) it makes a
:class:`~porocore.interfaces.law.MacroLaw`.
"""

from porocore.macro.laws.adaptive_law import AdaptiveLaw
from porocore.macro.laws.closed_law import ClosedLaw, PathCellLaw
from porocore.macro.laws.closure import CellLaw, Closure
from porocore.macro.laws.linear_cell import LinearCellLaw, reference_tangents
from porocore.macro.laws.mean_gradient import MeanGradientClosure
from porocore.macro.laws.potential import PotentialClosure

#: The closures by the name that the user writes.
CLOSURES: dict[str, type[Closure]] = {
    closure.name: closure for closure in (MeanGradientClosure, PotentialClosure)
}

__all__ = [
    "CLOSURES",
    "AdaptiveLaw",
    "CellLaw",
    "ClosedLaw",
    "Closure",
    "LinearCellLaw",
    "MeanGradientClosure",
    "PathCellLaw",
    "PotentialClosure",
    "reference_tangents",
]
