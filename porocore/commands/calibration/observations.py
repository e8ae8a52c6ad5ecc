"""Measured curves (ObservedCurve) and the same quantities of a solution, interpolated at their times."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from porocore.commands.calibration.clouds import FilmComponent
from porocore.commands.calibration.problem import CurveData
from porocore.commands.calibration.settings import Kind, ObservationSettings
from porocore.core.echo import echo, suggestion
from porocore.core.units import (
    ADD_SCALES,
    NO_SCALES,
    QUANTITIES,
    Scales,
    UnitError,
    in_si,
    number_or_quantity,
    pretty,
    unit_in_si,
)
from porocore.errors import ConfigurationError
from porocore.interfaces.sensitivities import HistoryWeights, MacroSensitivities
from porocore.interfaces.solution import CONTACT, MacroSolution
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
    "contact_radius": "displacement",
    "contact_area": "area",
}
#: Kinds that an indenter has, of its contact.
OF_INDENTERS: tuple[Kind, ...] = ("force", "displacement", "contact_radius", "contact_area")
#: Kinds whose name in the history is another.
_IN_HISTORY: dict[Kind, str] = {"pressure": "pressure_max"}
#: Numbers of components of the vectors in a group.
_WIDTHS = {"probes": 4, "reactions": 3, "contact": len(CONTACT)}
#: Columns of a contact by kind.
_COLUMNS: dict[Kind, int] = {
    kind: [name for name, *_ in CONTACT].index(kind.removeprefix("contact_")) for kind in OF_INDENTERS
}
#: Key of the names in a group, and words for those that there are.
_LISTED = {
    "probes": ("probe", "probes are"),
    "inflow": ("surface", "surfaces with a pressure are"),
    "compression": ("surface", "plane surfaces that are held or moved are"),
    "reactions": ("surface", "surfaces that are held or moved are"),
    "contact": ("indenter", "indenters of macro.contact are"),
}


#: Standard deviations that no value of a film reaches by chance.
BY_CHANCE = 6.0


@dataclass(frozen=True)
class SeriesPlace:
    """Place of a series, the same in a solution, its derivatives and weights.

    Attributes
    ----------
    group
        Field of the history, or mapping of surfaces, probes or indenters.
    name
        Surface, probe or indenter; empty for a field of the history.
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
            There is no such probe, surface or indenter.
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
        """Refuse a surface, probe or indenter that is none of some.

        Raises
        ------
        ConfigurationError
            It is none; the message begins with the key of the observation.
        """
        if self.name and self.name not in names:
            key, listed = _LISTED[self.group]
            advice = suggestion(self.name, names, f"the {listed}", "the run has none")
            if self.group in ("compression", "reactions"):
                advice += "; under a traction the force is given, and no result"
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
    indenter
        Of which it was measured, along its direction; empty: of none.
    """

    kind: Kind
    surface: str = ""
    probe: str = ""
    component: int = 0
    indenter: str = ""

    @classmethod
    def chosen(cls, settings: ObservationSettings) -> MeasuredSeries:
        """Return the series that an observation is of."""
        where = (settings.surface or "", settings.probe or "")
        return cls(settings.quantity, *where, settings.component or 0, settings.indenter or "")

    @property
    def quantity(self) -> str:
        """Quantity of its unit, of :data:`porocore.core.units.QUANTITIES`."""
        return QUANTITY[self.kind]

    @property
    def words(self) -> str:
        """Quantity with its component and where it was measured, such as ``displacement 2 at tip``."""
        component = f" {self.component}" if self.component else ""
        where = (self.surface and f" on {self.surface}") or (self.probe and f" at {self.probe}")
        where = where or (self.indenter and f" of {self.indenter}")
        return f"{self.kind.replace('_', ' ')}{component}{where}"

    @property
    def place(self) -> SeriesPlace:
        """Place of the series."""
        if self.indenter:
            return SeriesPlace("contact", self.indenter, _COLUMNS[self.kind])
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
        """Refuse a probe or indenter that a study does not have, and a surface without the measured force or inflow.

        Raises
        ------
        ConfigurationError
            See :meth:`SeriesPlace.require_among`; or the contact of the indenter has no radius.
        """
        place = self.place
        if place.group == "contact":
            place.require_among(macro.contact)
            indenter, section = macro.contact[place.name], macro.body.is_section
            if self.kind == "contact_radius" and not indenter.touches_circle(section=section):
                raise ConfigurationError(
                    "quantity: expected an indenter whose contact is a circle, got the "
                    f"{indenter.shape.kind} {echo(place.name)}{' on a section' * section}; fit its contact_area"
                )
        if place.group == "probes":
            place.require_among(macro.probes)
        elif place.group == "inflow":
            place.require_among([name for name, each in macro.boundary.items() if each.pressure is not None])
        elif place.group in ("compression", "reactions"):
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


@dataclass(frozen=True)
class DataFile:
    """File of a measured curve, as a report names it.

    Attributes
    ----------
    name
        As the configuration names it.
    rows
        Rows of data in it.
    size
        In bytes.
    sha256
        Hash of its bytes.
    """

    name: str
    rows: int
    size: int
    sha256: str

    @classmethod
    def of(cls, path: Path, name: str, rows: int) -> DataFile:
        """Return the record of a file that was read."""
        content = path.read_bytes()
        return cls(name, rows, len(content), hashlib.sha256(content).hexdigest())


@dataclass(frozen=True, eq=False)
class ObservedCurve:
    """A curve that was measured in one experiment, or will be.

    Attributes
    ----------
    name
        Name of the experiment and of the observation, such as ``confined: settlement``.
    series
        What was measured.
    times : (m,)
        Ascending, in the dimensionless times of the study.
    unit, time_unit
        Of the numbers in files; empty for dimensionless ones.
    factor, time_factor
        A dimensionless result, or time, of the study times it is in these units.
    weights : (m,)
        How often each value counts.
    measured : (m,)
        Values in ``unit``; None: there are none yet.
    spread
        Standard deviation of every value, or of each (m,), in ``unit``; None: it is ``share`` of the largest value.
    share
        Share of the largest value in size.
    notes
        What was done to the rows of the file, in words.
    file
        Where it was read; None: it is made up.
    """

    name: str
    series: MeasuredSeries | FilmComponent
    times: Array
    unit: str
    time_unit: str
    factor: float
    time_factor: float
    weights: Array
    measured: Array | None = None
    spread: float | Array | None = None
    share: float | None = None
    notes: tuple[str, ...] = ()
    file: DataFile | None = None

    def __len__(self) -> int:
        return len(self.times)

    @property
    def deviations(self) -> Array:
        """Standard deviations (m,) in :attr:`unit`, weights included.

        Raises
        ------
        ConfigurationError
            They are a share of values that are all zero.
        """
        plain = self.spread
        if plain is None:
            assert self.measured is not None
            assert self.share is not None
            plain = self.share * float(np.abs(self.measured).max())
            if plain == 0:
                raise ConfigurationError(
                    f"{self.name}: a share of the largest value is no standard deviation, since all values are 0; "
                    "give 'deviation:'"
                )
        return np.asarray(plain / np.sqrt(self.weights))

    @property
    def is_noise(self) -> bool:
        """True for a component of a film that shows nothing but what is there by chance."""
        if self.measured is None or not isinstance(self.series, FilmComponent):
            return False
        return bool((np.abs(self.measured) <= BY_CHANCE * self.deviations).all())

    @property
    def unit_key(self) -> str:
        """Key of the unit of its values."""
        return f"{self.series.quantity}_unit" if isinstance(self.series, FilmComponent) else "unit"

    @property
    def displayed_times(self) -> Array:
        """Times (m,) in :attr:`time_unit`."""
        return np.asarray(self.times * self.time_factor)

    @property
    def outline(self) -> str:
        """Number of values, first and last time, least and largest value, standard deviation, with units."""
        first, last = self.displayed_times[0], self.displayed_times[-1]
        span = _span(first, last, self.time_unit)
        times = f"from {span}" if " to " in span else f"at {span}"
        if isinstance(self.series, FilmComponent):
            frames = len(np.unique(self.times))
            times = f"at {frames} times {times}" if frames > 1 else times
        if self.measured is None:
            what = "points" if isinstance(self.series, FilmComponent) else "times"
            return f"{len(self)} {what} {times}; no values yet; {self._scatter}"
        values = _span(self.measured.min(), self.measured.max(), self.unit)
        return f"{len(self)} values {times}; they are {values}; {self._scatter}"

    @property
    def _scatter(self) -> str:
        """Standard deviation, in :attr:`unit` and as a share of the largest value, as far as they are known."""
        largest = 0.0 if self.measured is None else float(np.abs(self.measured).max())
        if self.spread is None and not largest:
            return f"deviation {100 * (self.share or 0):.3g} % of the largest value"
        low, high = float(self.deviations.min()), float(self.deviations.max())
        deviation = f"deviation {_range(low, high)} {pretty(self.unit)}".rstrip()
        if not largest:
            return deviation
        return f"{deviation}, {_range(100 * low / largest, 100 * high / largest)} % of the largest value"

    def made_up(self, exact: Array, seed: Sequence[int]) -> ObservedCurve:
        """Return the curve with exact values (m,) and normal noise of its standard deviation."""
        known = replace(self, measured=exact)
        noise = np.random.default_rng(seed).standard_normal(len(exact))
        return replace(
            known,
            measured=exact + noise * known.deviations,
            spread=known.deviations,
            weights=np.ones(len(exact)),
            file=None,
        )


def _span(first: float, last: float, unit: str) -> str:
    ends = dict.fromkeys((f"{first:.5g}", f"{last:.5g}"))
    return f"{' to '.join(ends)} {pretty(unit)}".rstrip()


def _range(low: float, high: float) -> str:
    return " to ".join(dict.fromkeys((f"{low:.3g}", f"{high:.3g}")))


def curve_data(curves: Sequence[ObservedCurve]) -> CurveData:
    """Return all curves one after the other, times in the units of the curves."""
    values = [curve.measured for curve in curves if curve.measured is not None]
    assert len(values) == len(curves)
    return CurveData(
        np.concatenate(values),
        np.concatenate([curve.deviations for curve in curves]),
        np.repeat(np.arange(len(curves)), [len(curve) for curve in curves]).astype(np.int64),
        np.concatenate([curve.displayed_times for curve in curves]),
        tuple(curve.name for curve in curves),
        tuple(curve.unit for curve in curves),
        tuple(curve.time_unit for curve in curves),
        frozenset(curve.name for curve in curves if isinstance(curve.series, FilmComponent)),
    )


def by_curve(values: Array, curves: Sequence[ObservedCurve]) -> list[Array]:
    """Return the parts of values (m, ...) of all curves one after the other that belong to each curve."""
    return np.split(values, np.cumsum([len(curve) for curve in curves])[:-1])


#: Advice on a unit that a key gives: on one of another quantity, and on one in a study without scales.
IN_A_KEY = ("change the key", "leave the key out where the numbers are dimensionless")


def size_of(unit: str, quantity: str) -> Fraction | None:
    """Return one unit in the SI unit of a quantity; None: it is no unit of it."""
    try:
        return unit_in_si(unit, quantity)
    except UnitError:
        return None


def as_unit(text: str, quantity: str) -> str:
    """Return the unit that a machine writes with other capitals, such as Sec or MIN, or else the text itself.

    The text has three letters at least, so that prefixes such as m and M are not confused.
    """
    small = text.lower()
    other = len(text) > 2 and text.isalpha() and size_of(text, quantity) is None
    return small if other and size_of(small, quantity) is not None else text


def is_unit(text: str) -> bool:
    """Return whether a text is a unit of any quantity."""
    return any(size_of(as_unit(text, quantity), quantity) is not None for quantity in QUANTITIES)


@dataclass(frozen=True)
class StudyUnit:
    """Unit of numbers that belong to one study.

    Attributes
    ----------
    name
        Empty: the numbers are dimensionless.
    quantity
        Of :data:`porocore.core.units.QUANTITIES`.
    scales
        Of the study.
    """

    name: str
    quantity: str
    scales: Scales | None

    @classmethod
    def at_key(
        cls, key: str, name: str, quantity: str, scales: Scales | None, advice: tuple[str, str] = IN_A_KEY
    ) -> StudyUnit:
        """Return a unit that a key, or the heading of a file, gives.

        Parameters
        ----------
        key
            Where it stands.
        name, quantity, scales
            See the class.
        advice
            What to do about a unit that is none of the quantity, and, beside adding scales, about one without scales.

        Raises
        ------
        ConfigurationError
            The unit is none of the quantity, or the study has no scales; the message begins with the key.
        """
        if scales is None and name and size_of(name, quantity) is not None:
            raise ConfigurationError(f"{key}: {echo(name)} is a unit, but {ADD_SCALES}, or {advice[1]}")
        unit = cls(name, quantity, scales)
        try:
            _ = unit.factor
        except UnitError as error:
            end = " " if str(error).endswith("?") else "; "
            raise ConfigurationError(f"{key}: {error}{end}{advice[0]}") from None
        return unit

    @property
    def factor(self) -> float:
        """A dimensionless number times it is in this unit.

        Raises
        ------
        UnitError
            The unit is none of the quantity, or the study has no scales.
        """
        if not self.name:
            return 1.0
        size = unit_in_si(self.name, self.quantity)
        if self.scales is None:
            raise UnitError(f"{echo(self.name)} {NO_SCALES}")
        return float(QUANTITIES[self.quantity].factor(self.scales.exact) / size)

    def converted(self, key: str, value: float | str) -> float:
        """Return the number of a key, or its text with a unit, in this unit.

        Raises
        ------
        ConfigurationError
            It is no finite number and no value of the quantity; the message begins with the key.
        """
        try:
            found = self._number(value)
        except UnitError as error:
            raise ConfigurationError(f"{key}: {error}") from None
        if not math.isfinite(found):
            raise ConfigurationError(f"{key}: expected a finite number, got {echo(value)}")
        return found

    def _number(self, value: float | str) -> float:
        value = number_or_quantity(value)
        if not isinstance(value, str):
            return value
        factor = self.factor
        si = in_si(value, self.quantity)
        if self.scales is None:
            raise UnitError(f"{echo(value)} {NO_SCALES}")
        return float(si / QUANTITIES[self.quantity].factor(self.scales.exact)) * factor
