"""Error of a closure against the exact averages of the cell, without any surrogate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.interfaces.law import UndeformedCells
from porocore.macro.laws.closure import Closure, ClosurePoints
from porocore.states import Array, CellResponse, MacroState

#: A component of the stress whose values span less than this share of the widest one is not judged.
FLAT = 1e-6


@dataclass(frozen=True)
class ClosureError:
    """Errors of a closure on solved states, in per cent of the range of the exact values over those states.

    The stress is the total first Piola–Kirchhoff stress P_E, its error that of all components that vary,
    referred to the one that varies most. The fluid is what was taken up since the undeformed state.
    """

    stress_rms: float
    stress_largest: float
    fluid_rms: float
    fluid_largest: float

    def for_json(self) -> dict[str, float]:
        """Return the errors by names that include their unit."""
        return {f"{name}_percent_of_range": value for name, value in vars(self).items()}


def closure_error(
    closure: Closure, states: MacroState, exact: CellResponse, cells: UndeformedCells | None = None
) -> ClosureError:
    """Compare the closure, given the cell's own responses, with the cell's own stress and fluid volume.

    The closure gives a storage *rate*; it is integrated in one step from the undeformed state by the trapezoidal
    rule, so that the error of backward Euler is left out. The mean-gradient closure is quadratic there, and the
    path matters little: along the sequence of the sampled states the drained fluid differs by 0.1 %.

    Parameters
    ----------
    states
        n states that were solved, two different ones at least.
    exact
        Their responses, with stress and fluid volume.
    cells
        Undeformed cell of each state; None: that of the closure.

    Raises
    ------
    ValueError
        The responses lack what they are compared with, or do not vary.
    """
    if exact.stress is None or exact.fluid_volume is None:
        raise ValueError("expected responses with stress and fluid volume")
    n, still = len(states), np.zeros((len(states), 3))
    at_rest, rest = MacroState.zeros(n), np.zeros((n, 3, 3))
    porosity = np.broadcast_to(1 - closure.solid_fraction_of(cells), n)
    at_start = CellResponse(mean_grad=rest, status=exact.status, stress=rest, fluid_volume=porosity)
    at_end = ClosurePoints(states, exact, still, closure.memory(at_rest, at_start, porosity), cells)
    returned = ClosurePoints(
        at_rest, at_start, still, closure.memory(states, exact, exact.fluid_volume), cells
    )
    there, back = (closure.respond(points, tangent=False) for points in (at_end, returned))

    components = exact.stress.reshape(n, 9)
    spans = np.ptp(components, axis=0)
    if not spans.max() > 0:
        raise ValueError("expected states under different stresses")
    varying = spans > FLAT * spans.max()
    stress_error = (there.stress.reshape(n, 9) - components)[:, varying]
    taken_up = exact.fluid_volume - porosity
    fluid_error = (there.storage - back.storage) / 2 - taken_up
    return ClosureError(
        *_rms_and_largest(stress_error, float(spans.max())),
        *_rms_and_largest(fluid_error, float(np.ptp(taken_up))),
    )


def _rms_and_largest(error: Array, span: float) -> tuple[float, float]:
    return 100 * float(np.sqrt(np.mean(error**2))) / span, 100 * float(np.abs(error).max()) / span
