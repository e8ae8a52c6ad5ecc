"""Laws of the macroscale: closures and their list, laws of them, direct FE², adaptive surrogates.

A closure is written once, here, in numpy, and serves every macro backend. With a cell law (a surrogate, the
cell solver itself, the linear limit: whatever predicts the responses of a batch of states) it makes a
:class:`~porocore.interfaces.law.MacroLaw`.
"""

from porocore.cell.materials.hyperelastic import Solid
from porocore.interfaces.law import CellLaw
from porocore.macro.laws.closure import Closure, ConductivityLaw, MeanGradientClosure, PotentialClosure
from porocore.macro.laws.linear import LinearCellLaw, reference_tangents
from porocore.macro.laws.macro_law import AdaptiveLaw, ClosedLaw
from porocore.states import Array

#: The closures by the name that the user writes.
CLOSURES: dict[str, type[Closure]] = {
    closure.name: closure for closure in (MeanGradientClosure, PotentialClosure)
}


def make_closure(
    name: str, solid_fraction: float, material: Solid, conductivity: Array, *, law: ConductivityLaw = "piola"
) -> Closure:
    """Return the closure of that name; see :class:`Closure` for its constants."""
    return CLOSURES[name](solid_fraction, material, conductivity, law=law)


__all__ = [
    "CLOSURES",
    "AdaptiveLaw",
    "CellLaw",
    "ClosedLaw",
    "Closure",
    "LinearCellLaw",
    "MeanGradientClosure",
    "PotentialClosure",
    "make_closure",
    "reference_tangents",
]
