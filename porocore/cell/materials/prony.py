"""Configuration of a solid that relaxes (Relaxation): branches of a Prony series, and their factors in a step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from porocore.core.models.strict import StrictModel
from porocore.core.units import Dimension
from porocore.states import Array

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

    @property
    def acting(self) -> tuple[Branch, ...]:
        """Branches whose strength is not 0; the others never have a stress."""
        return tuple(branch for branch in self.branches if branch.strength > 0)

    def in_times_of(self, unit: float) -> Relaxation:
        """Return it with its times in a ``unit``, a multiple of the present one."""
        branches = tuple(each.model_copy(update={"time": each.time / unit}) for each in self.branches)
        return self.model_copy(update={"branches": branches})


def decays_and_shares(ratio: Array) -> tuple[Array, Array]:
    """Return e = exp(−a) and c = (1 − e)/a of steps a = Δt/τ ≥ 0: what is left of an overstress, and of one that grows.

    They are exact where the stress of equilibrium changes at a constant rate.
    """
    share = np.divide(-np.expm1(-ratio), ratio, out=np.ones_like(ratio), where=ratio > 0)
    return np.exp(-ratio), share


def step_factors(branches: Sequence[Branch], length: float) -> tuple[Array, Array]:
    """Return the factors (b,) of a step Δt ≥ 0, in which Q_i ← e_i Q_i + g_i (S_new − S_old): e_i and g_i = c_i γ_i."""
    decays, shares = decays_and_shares(length / np.array([branch.time for branch in branches]))
    return decays, shares * np.array([branch.strength for branch in branches])
