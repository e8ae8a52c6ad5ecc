"""Loading mode of a body, which decides which results are of interest."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.core.formulas.time_function import TimeFunction, Value
from porocore.interfaces.solution import MacroSolution
from porocore.macro.problem import Boundary, MacroSetup

#: A component of a force below this share of the largest of all surfaces is round-off.
VISIBLE = 1e-6
#: Components that differ by less than this share are the same.
SAME = 1e-3


@dataclass(frozen=True)
class LoadingMode:
    """Loading by prescribed displacements or by stresses.

    Attributes
    ----------
    displaced
        Surfaces that are moved by a given displacement.
    stressed
        Whether a traction, a pressure or the force on a plate is scaled by the load.
    """

    displaced: tuple[str, ...] = ()
    stressed: bool = True

    @classmethod
    def from_setup(cls, macro: MacroSetup) -> LoadingMode:
        """Return the mode of the boundary conditions that are not zero."""
        faces = macro.boundary.items()
        return cls(
            tuple(name for name, b in faces if _any((*b.displacement, b.normal))),
            any(_any(_stresses(b)) for _, b in faces),
        )


def _stresses(boundary: Boundary) -> tuple[Value | None, ...]:
    return (*boundary.traction, boundary.follower, boundary.plate, boundary.pressure)


def _any(values: Iterable[Value | None]) -> bool:
    return any(isinstance(value, TimeFunction) or bool(value) for value in values if value is not None)


def reactions(solution: MacroSolution) -> dict[str, dict[str, Any]]:
    """Return the force on each surface that is held or moved, ready for JSON.

    Of its three components the one that becomes largest, from outside on the body: ``component`` (1 to 3), ``peak``
    with its sign, ``time_of_peak`` and ``final``, dimensionless. Surfaces on which no force acts are left out.
    """
    largest = max((float(np.abs(force).max()) for force in solution.reactions.values()), default=0.0)
    found = {}
    for name, force in solution.reactions.items():
        peaks = np.abs(force).max(axis=0)
        if peaks.max() <= VISIBLE * largest:
            continue
        # Of components that are the same by symmetry always the first.
        i = int(np.argmax(peaks >= (1 - SAME) * peaks.max()))
        step = int(np.abs(force[:, i]).argmax())
        found[name] = {
            "component": i + 1,
            "peak": float(force[step, i]),
            "time_of_peak": float(solution.history.time[step]),
            "final": float(force[-1, i]),
        }
    return found
