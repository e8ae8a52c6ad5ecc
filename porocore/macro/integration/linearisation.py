"""Tangent of a time step: its factorised systems, how long one serves, accuracy of a linear solve."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from porocore.interfaces.law import MacroLaw, MacroResponse
from porocore.macro.boundary.conditions import Loads
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.linear_systems.reuse import forcing, sufficient
from porocore.states import Array

#: Decimals of the Δt whose system serves for all steps that differ from it by round-off only. It depends on the step
#: alone, so that a run that continues from a checkpoint solves with the same numbers.
DECIMALS = 11
#: A factor serves for so many more iterations, if they are expected to suffice: each takes a quarter of the time of one
#: with a new factor, with the law of the benchmark's column.
MOST_CHORDS = 3


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Tangent of all unknowns.

    Attributes
    ----------
    system
        Of the discretisation.
    stiffest
        Largest entry of ∂P_E/∂H.
    fullest
        Largest entry of ∂storage/∂H.
    """

    system: Any
    stiffest: float
    fullest: float


class Linearisations:
    """Linearisations of the steps of one solve; where the law's tangent is constant, one serves all of a length.

    Parameters
    ----------
    chords
        Iterations at most that reuse the linearisation of an earlier one, where the discretisation keeps its factor.
    varies
        Whether parameters or axes change with time, so that no tangent is constant.
    """

    def __init__(
        self, d: Discretisation, law: MacroLaw, chords: int = MOST_CHORDS, *, varies: bool = False
    ) -> None:
        self._d, self._constant = d, law.constant_tangent and not varies
        self._chords = chords if d.keeps_factor else 0
        self._dt, self._age = 0.0, 0
        self._last: Linearisation | None = None

    def begin(self, dt: float, loads: Loads) -> Linearisation | None:
        """Return the linearisation that is known for a new step of length ``dt``; None: there is none."""
        self._age = 0
        same = self._is_exact(loads) and self._dt == _rounded(dt)
        return self._last if same else None

    def _is_exact(self, loads: Loads) -> bool:
        return self._constant and not any(loads.pressures)

    def accuracy(self, misfit: float, before: float | None, tolerance: float, loads: Loads) -> float:
        """Return the relative residual to which a system is to be solved; see :func:`forcing`."""
        if self._is_exact(loads):
            return sufficient(misfit, tolerance)
        return forcing(misfit, before, tolerance)

    def at(self, response: MacroResponse, dt: float, x: Array, loads: Loads) -> Linearisation:
        """Return the linearisation at the response to the unknowns ``x``."""
        d, tangent = self._d, response.tangent
        assert tangent is not None
        self._dt = _rounded(dt) if self._constant else dt
        stiffest, fullest = (
            d.communicator.max(float(max(each.max(initial=0.0), -each.min(initial=0.0))))
            for each in (tangent.stress_grad_u, tangent.storage_grad_u)
        )
        system = d.system(tangent, self._dt, d.follower_tangent(x, loads))
        self._last, self._age = Linearisation(system, stiffest, fullest), 0
        return self._last

    def serves(self, misfits: list[float], tolerance: float) -> bool:
        """Tell whether the last linearisation brings the last of ``misfits`` below the tolerance soon enough.

        With an error e, Newton's iteration leaves C e², and one with the tangent of the iterate before some 2 C e times
        the error; from then on errors fall by that factor.
        """
        before, misfit = misfits[-2:]
        if self._age >= self._chords or not 0 < misfit < before:
            return False
        factor = misfit / before * (1 if self._age else 2)
        left = self._chords - self._age
        if factor >= 1 or math.log(tolerance / misfit) < left * math.log(factor):
            return False
        self._age += 1
        return True


def _rounded(dt: float) -> float:
    return float(f"{dt:.{DECIMALS}e}")
