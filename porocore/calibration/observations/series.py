"""Measured quantity of a solution (MeasuredSeries): settlement, probe, force, pressure, volume, inflow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from porocore.calibration.config.settings import Kind, ObservationSettings
from porocore.core.echo import echo, suggestion
from porocore.errors import ConfigurationError
from porocore.interfaces.sensitivities import HistoryWeights, MacroSensitivities
from porocore.interfaces.solution import MacroSolution
from porocore.states import Array

#: Quantities of the units of each kind.
QUANTITY: dict[Kind, str] = {
    "settlement": "displacement",
    "displacement": "displacement",
    "force": "force",
    "pressure": "pressure",
    "drained": "volume",
    "inflow": "flow",
}


@dataclass(frozen=True)
class MeasuredSeries:
    """A column of a solution against time, of the whole specimen.

    Attributes
    ----------
    kind
        As ``observations.NAME.quantity`` has it.
    surface, probe
        Where it was measured, empty where that is plain.
    component
        1, 2 or 3; 0: none, a force is that in compression.
    """

    kind: Kind
    surface: str = ""
    probe: str = ""
    component: int = 0

    @classmethod
    def chosen(cls, settings: ObservationSettings) -> MeasuredSeries:
        """Return the series that an observation is of."""
        return cls(settings.quantity, settings.surface or "", settings.probe or "", settings.component or 0)

    @property
    def quantity(self) -> str:
        """Quantity of its unit, of :data:`porocore.core.units.scales.QUANTITIES`."""
        return QUANTITY[self.kind]

    def values(self, solution: MacroSolution) -> Array:
        """Return the series (steps,) of the solution of a whole specimen.

        Raises
        ------
        ConfigurationError
            The solution has no such probe, surface or force.
        """
        history = solution.history
        if self.kind == "settlement":
            return history.settlement
        if self.kind == "drained":
            return history.drained
        if self.kind == "inflow":
            return _entry(solution.inflow, self.surface, "surface", "surfaces with a pressure are")
        if self.kind == "force" and not self.component:
            return _entry(
                solution.compression, self.surface, "surface", "plane surfaces that are held or moved are"
            )
        if self.kind == "force":
            forces: Array = _entry(
                solution.reactions, self.surface, "surface", "surfaces that are held or moved are"
            )
            return forces[:, self.component - 1]
        if not self.probe:
            return history.pressure_max
        probe: Array = _entry(solution.probes, self.probe, "probe", "probes are")
        return probe[:, self.component - 1 if self.component else 3]

    def slopes(self, found: MacroSensitivities) -> Array:
        """Return the derivatives (steps, k) of the series by the unknowns of a run of a whole specimen."""
        plain = {
            "settlement": found.settlement,
            "drained": found.drained,
            "pressure": found.pressure_max,
        }
        if self.kind in plain and not self.probe:
            return plain[self.kind]
        if self.kind == "inflow":
            return found.inflow[self.surface]
        if self.kind == "force":
            force = found.compression if not self.component else found.reactions
            return force[self.surface] if not self.component else force[self.surface][:, self.component - 1]
        return found.probes[self.probe][:, self.component - 1 if self.component else 3]


def weights_of(series: Sequence[MeasuredSeries], weights: Sequence[Array]) -> HistoryWeights:
    """Return the weights of the histories of a whole specimen in f sums over some series.

    Parameters
    ----------
    series
        The series.
    weights : (steps, f)
        Of each of them.
    """
    found: dict[str, dict[str, Array]] = {"probes": {}, "reactions": {}, "inflow": {}, "compression": {}}
    plain: dict[str, Array] = {}

    def add(group: dict[str, Array], name: str, each: Array, width: int = 0, component: int = 0) -> None:
        if width:
            each = np.eye(width)[component][:, None] * each[:, None]
        group[name] = group[name] + each if name in group else each

    for one, each in zip(series, weights, strict=True):
        if one.kind == "inflow":
            add(found["inflow"], one.surface, each)
        elif one.kind == "force" and one.component:
            add(found["reactions"], one.surface, each, 3, one.component - 1)
        elif one.kind == "force":
            add(found["compression"], one.surface, each)
        elif one.probe:
            add(found["probes"], one.probe, each, 4, one.component - 1 if one.component else 3)
        else:
            add(plain, "pressure_max" if one.kind == "pressure" else one.kind, each)
    return HistoryWeights(
        weights[0].shape[1],
        plain.get("settlement"),
        plain.get("pressure_max"),
        plain.get("drained"),
        found["probes"],
        found["reactions"],
        found["inflow"],
        found["compression"],
    )


def _entry(found: Mapping[str, Array], name: str, key: str, listed: str) -> Array:
    if name not in found:
        advice = suggestion(name, found, f"the {listed}") if found else f"there is no such {key}"
        raise ConfigurationError(f"{key}: expected one with this result, got {echo(name)}; {advice}")
    return found[name]
