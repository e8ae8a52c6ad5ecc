"""Recorder of the derivatives of the histories (SensitivityRecorder), linear in those of a step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from porocore.interfaces.law import Integrand
from porocore.interfaces.sensitivities import HISTORY_SERIES, MacroChange, MacroSensitivities
from porocore.macro.boundary.conditions import Loads
from porocore.macro.integration.recorder import HistoryRecorder, extremes
from porocore.states import Array

DRAINED = HISTORY_SERIES.index("drained")


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
        #: Values by unknown of each step: series of the history; probes; reactions and inflows.
        self._rows: list[Array] = []

    def add_start(self, x: Array, changes: list[Array]) -> None:
        """Add the initial state with its derivatives, t = 0."""
        supports, drains = self._names[1:]
        nothing = np.zeros(3 * len(supports) + len(drains))
        places = self._places(x)
        self._rows.append(
            np.stack([np.concatenate([*self._nodal(places, each, 0.0), nothing]) for each in changes])
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
        record, places, rows = self._record, self._places(x), []
        for j, change in enumerate(changes):
            left = self._rows[-1][j, DRAINED] + record.outflow(residuals[j], loads[j], dt)
            sums = record.sums(residuals[j], at_points[j], dt)
            rows.append(np.concatenate([*self._nodal(places, change, left), *sums]))
        self._rows.append(np.stack(rows))

    def _places(self, x: Array) -> dict[str, tuple[int, float]]:
        """Return the unknown that each extreme of a solution is, and its sign."""
        return extremes(self._record.d.to_mesh(x), self._record.d.mesh.n_u)

    def _nodal(
        self, places: dict[str, tuple[int, float]], change: Array, drained: float
    ) -> tuple[Array, Array]:
        """Return the derivatives of the series of the history, and those of the probes."""
        moved = self._record.d.to_mesh(change)
        found = {"drained": drained} | {name: sign * moved[i] for name, (i, sign) in places.items()}
        return np.array([found[name] for name in HISTORY_SERIES]), self._record.probe @ moved

    def result(self) -> MacroSensitivities:
        """Return all derivatives."""
        rows = np.swapaxes(np.array(self._rows), 1, 2)
        probes, supports, drains = self._names
        first, widths = len(HISTORY_SERIES), (4, 3, 1)
        found: list[dict[str, Array]] = []
        for names, width in zip((probes, supports, drains), widths, strict=True):
            found.append(
                {name: rows[:, first + i * width : first + (i + 1) * width] for i, name in enumerate(names)}
            )
            first += width * len(names)
        return MacroSensitivities(
            self._changes,
            **{name: rows[:, i] for i, name in enumerate(HISTORY_SERIES)},
            probes=found[0],
            reactions=found[1],
            inflow={name: values[:, 0] for name, values in found[2].items()},
            compression={},
        )
