"""Configuration of a solid that relaxes (Relaxation): branches of a Prony series."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from porocore.core.models.strict import StrictModel
from porocore.core.units import Dimension

#: Key of the relaxation below a material.
RELAXATION = "relaxation"
#: Branches are the decades of time that an experiment spans, and few more.
MOST_BRANCHES = 8
#: A stronger branch is a mistake: the instantaneous stress is the sum of the strengths over that of equilibrium.
STRONGEST = 1e6


class Branch(StrictModel):
    """One branch of a Prony series: an overstress that a sudden strain raises and that dies out."""

    strength: Annotated[float, Field(ge=0, le=STRONGEST)]
    """γ, overstress of a sudden strain over the stress of equilibrium; 0 changes nothing."""
    time: Annotated[float, Field(gt=0), Dimension("time")]
    """τ, in which the overstress falls to 1/e."""


class Relaxation(StrictModel):
    """Prony series by which the stress of a solid relaxes to that of its strain energy.

    The second Piola–Kirchhoff stress is S_∞ + Σ Q_i with dQ_i/dt + Q_i/τ_i = γ_i dS_∞/dt, so that of a sudden strain is
    1 + Σγ_i times that of equilibrium. Cells are solved in equilibrium; the series acts in the laws of the body.
    """

    branches: Annotated[tuple[Branch, ...], Field(min_length=1, max_length=MOST_BRANCHES)]
    """Branches, whose overstresses add up."""
