"""Measured quantity of a solution (MeasuredSeries): settlement, probe, force, pressure, volume, inflow."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.calibration.config.settings import Kind, ObservationSettings
from porocore.core.echo import echo, suggestion
from porocore.errors import ConfigurationError
from porocore.interfaces.sensitivities import HistoryWeights, MacroSensitivities
from porocore.interfaces.solution import MacroSolution
from porocore.macro.problem import MacroSetup
from porocore.states import Array

#: Quantities of the units of each kind.
QUANTITY: dict[Kind, str] = {
    "settlement": "displacement",
    "heave": "displacement",
    "displacement": "displacement",
    "force": "force",
    "pressure": "pressure",
    "pressure_min": "pressure",
    "drained": "volume",
    "inflow": "flow",
}
#: Kinds whose name in the history is another.
_IN_HISTORY: dict[Kind, str] = {"pressure": "pressure_max"}
#: Numbers of components of the vectors in a group.
_WIDTHS = {"probes": 4, "reactions": 3}
#: Key of the names in a group, and words for those that there are.
_LISTED = {
    "probes": ("probe", "probes are"),
    "inflow": ("surface", "surfaces with a pressure are"),
    "compression": ("surface", "plane surfaces that are held or moved are"),
    "reactions": ("surface", "surfaces that are held or moved are"),
}


@dataclass(frozen=True)
class SeriesPlace:
    """Place of a series, the same in a solution, its derivatives and weights.

    Attributes
    ----------
    group
        Field of the history, or mapping of surfaces or probes.
    name
        Surface or probe; empty for a field of the history.
    component
        Column, from 0, of a group of vectors; None: the group is of scalars.
    """

    group: str
    name: str = ""
    component: int | None = None

    def part(self, found: Any) -> Array:
        """Return the series (steps, ...) in derivatives of histories, or in a history or solution that has the group.

        Raises
        ------
        ConfigurationError
            There is no such probe or surface.
        """
        of: Any = getattr(found, self.group)
        if self.name:
            of = self._entry(of)
        series: Array = of if self.component is None else of[:, self.component]
        return series

    def _entry(self, group: Mapping[str, Array]) -> Array:
        self.require_among(group)
        return group[self.name]

    def require_among(self, names: Collection[str]) -> None:
        """Refuse a surface or probe that is none of some.

        Raises
        ------
        ConfigurationError
            It is none; the message begins with the key of the observation.
        """
        if self.name and self.name not in names:
            key, listed = _LISTED[self.group]
            advice = suggestion(self.name, names, f"the {listed}", "the run has none")
            raise ConfigurationError(f"{key}: expected one with this result, got {echo(self.name)}; {advice}")

    def weight(self, each: Array) -> Array:
        """Return weights (steps, f) of the series as those of the whole field or vectors."""
        if self.component is None:
            return each
        weight: Array = np.eye(_WIDTHS[self.group])[self.component][:, None] * each[:, None]
        return weight


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

    @property
    def words(self) -> str:
        """Quantity with its component and where it was measured, such as ``displacement 2 at tip``."""
        component = f" {self.component}" if self.component else ""
        where = (self.surface and f" on {self.surface}") or (self.probe and f" at {self.probe}")
        return f"{self.kind.replace('_', ' ')}{component}{where}"

    @property
    def place(self) -> SeriesPlace:
        """Place of the series."""
        if self.kind == "inflow":
            return SeriesPlace("inflow", self.surface)
        if self.kind == "force":
            of_axis = SeriesPlace("reactions", self.surface, self.component - 1)
            return of_axis if self.component else SeriesPlace("compression", self.surface)
        if self.probe:
            # Pressures stand behind the three displacements.
            return SeriesPlace("probes", self.probe, self.component - 1 if self.component else 3)
        return SeriesPlace(_IN_HISTORY.get(self.kind, self.kind))

    def values(self, solution: MacroSolution) -> Array:
        """Return the series (steps,) of the solution of a whole specimen.

        Raises
        ------
        ConfigurationError
            The solution has no such probe, surface or force.
        """
        place = self.place
        return place.part(solution if place.name else solution.history)

    def require_in(self, macro: MacroSetup) -> None:
        """Refuse a probe that a study does not have, and a surface without the measured force or inflow.

        Raises
        ------
        ConfigurationError
            See :meth:`SeriesPlace.require_among`.
        """
        place = self.place
        if place.group == "probes":
            place.require_among(macro.probes)
        elif place.group == "inflow":
            place.require_among([name for name, each in macro.boundary.items() if each.pressure is not None])
        elif place.name:
            place.require_among([name for name, each in macro.boundary.items() if each.is_held])

    def slopes(self, found: MacroSensitivities) -> Array:
        """Return the derivatives (steps, k) of the series by the unknowns of a run of a whole specimen."""
        return self.place.part(found)


def weights_of(series: Sequence[MeasuredSeries], weights: Sequence[Array]) -> HistoryWeights:
    """Return the weights of the histories of a whole specimen in f sums over some series.

    Parameters
    ----------
    series
        The series.
    weights : (steps, f)
        Of each of them.
    """
    histories: dict[str, Any] = {}
    groups: dict[str, Any] = {}
    for one, given in zip(series, weights, strict=True):
        place, each = one.place, one.place.weight(given)
        into, name = (
            (groups.setdefault(place.group, {}), place.name) if place.name else (histories, place.group)
        )
        into[name] = into[name] + each if name in into else each
    return HistoryWeights(weights[0].shape[1], **histories, **groups)
