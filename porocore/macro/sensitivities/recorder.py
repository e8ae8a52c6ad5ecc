"""Recorder of the derivatives of the histories (SensitivityRecorder), linear in those of a step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from porocore.interfaces.law import Integrand
from porocore.interfaces.sensitivities import MacroChange, MacroSensitivities
from porocore.macro.boundary.conditions import Loads
from porocore.macro.integration.recorder import HistoryRecorder, extremes
from porocore.states import Array

#: Extremes of the history.
EXTREMES = ("settlement", "heave", "pressure_max", "pressure_min")


class SensitivityRecorder:
    """Recorder of the derivatives of the histories by k unknowns.

    Parameters
    ----------
    record
        Recorder of the histories.
    changes
        The unknowns.
    """

    def __init__(self, record: HistoryRecorder, changes: tuple[MacroChange, ...]) -> None:
        self._record, self._changes = record, changes
        d = record.d
        self._names = list(d.problem.probes), list(d.boundary.supports), list(d.boundary.drains)
        #: Values by unknown of each step: drained volume, extremes; probes; reactions and inflows.
        self._rows: list[Array] = []

    def add_start(self, x: Array, changes: list[Array]) -> None:
        """Add the initial state with its derivatives, t = 0."""
        supports, drains = self._names[1:]
        nothing = np.zeros(3 * len(supports) + len(drains))
        self._rows.append(
            np.stack([np.concatenate([*self._nodal(x, each, 0.0), nothing]) for each in changes])
        )

    def add_step(
        self,
        x: Array,
        changes: list[Array],
        at_points: Sequence[Integrand],
        residuals: list[Array],
        loads: list[Loads],
        dt: float,
    ) -> None:
        """Add an accepted step.

        Parameters
        ----------
        x : (local unknowns,)
            The solution.
        changes, at_points, residuals, loads
            For each unknown the derivative of the solution, of what is integrated, of the residual and of the loads.
        """
        record, rows = self._record, []
        for j, change in enumerate(changes):
            left = self._rows[-1][j, 0] + record.outflow(residuals[j], loads[j], dt)
            sums = record.sums(residuals[j], at_points[j], dt)
            rows.append(np.concatenate([*self._nodal(x, change, left), *sums]))
        self._rows.append(np.stack(rows))

    def _nodal(self, x: Array, change: Array, drained: float) -> tuple[Array, Array]:
        """Return the derivatives of drained volume and extremes, and those of the probes."""
        d = self._record.d
        moved, places = d.to_mesh(change), extremes(d.to_mesh(x), d.mesh.n_u)
        found = [drained, *(places[name][1] * moved[places[name][0]] for name in EXTREMES)]
        return np.array(found), self._record.probe @ moved

    def result(self) -> MacroSensitivities:
        """Return all derivatives."""
        rows = np.swapaxes(np.array(self._rows), 1, 2)
        probes, supports, drains = self._names
        first, widths = 1 + len(EXTREMES), (4, 3, 1)
        found: list[dict[str, Array]] = []
        for names, width in zip((probes, supports, drains), widths, strict=True):
            found.append(
                {name: rows[:, first + i * width : first + (i + 1) * width] for i, name in enumerate(names)}
            )
            first += width * len(names)
        return MacroSensitivities(
            self._changes,
            drained=rows[:, 0],
            **{name: rows[:, 1 + i] for i, name in enumerate(EXTREMES)},
            probes=found[0],
            reactions=found[1],
            inflow={name: values[:, 0] for name, values in found[2].items()},
            compression={},
        )
