"""From the responses of a cell to stress, fluid storage and flux of the macroscale.

A closure is written once, here, in numpy, and serves every macro backend. With a cell law (a surrogate, the
cell solver itself, the linear limit: whatever predicts the responses of a batch of states) it makes a
:class:`~porocore.laws.MacroLaw`.
"""

from porocore.closures.closed_law import ClosedLaw, PathCellLaw
from porocore.closures.closure import CellLaw, Closure
from porocore.closures.learning_law import LearningLaw
from porocore.closures.linear_cell import LinearCellLaw, reference_tangents
from porocore.closures.mean_gradient import MeanGradientClosure
from porocore.closures.potential import PotentialClosure

#: The closures by the name that the user writes.
CLOSURES: dict[str, type[Closure]] = {
    closure.name: closure for closure in (MeanGradientClosure, PotentialClosure)
}

__all__ = [
    "CLOSURES",
    "CellLaw",
    "ClosedLaw",
    "Closure",
    "LearningLaw",
    "LinearCellLaw",
    "MeanGradientClosure",
    "PathCellLaw",
    "PotentialClosure",
    "reference_tangents",
]
