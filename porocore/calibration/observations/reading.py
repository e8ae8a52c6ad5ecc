"""Reading of an observation (read_curve): its columns from the file, the part that counts."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from porocore.calibration.config.settings import ObservationSettings, SyntheticTimes
from porocore.calibration.observations.curve import DataFile, ObservedCurve
from porocore.calibration.observations.series import MeasuredSeries
from porocore.calibration.observations.table import CurveTable
from porocore.calibration.observations.unit import StudyUnit
from porocore.core.echo import echo, joined
from porocore.core.units.scales import Scales
from porocore.errors import ConfigurationError
from porocore.states import Array

#: Values that a measured curve has at least, and times that a planned one has.
FEWEST, FEWEST_TIMES = 3, 2


def read_curve(
    name: str,
    settings: ObservationSettings,
    folder: Path,
    scales: Scales | None,
    end: float,
    *,
    experiment: str = "",
    synthetic: bool = False,
) -> ObservedCurve:
    """Return the curve of an observation.

    Parameters
    ----------
    name
        Of the observation.
    settings
        What was measured, and where it stands.
    folder
        Where a relative path starts.
    scales, end
        Of the study, and the end of its time.
    experiment
        Name of the experiment, where there are several.
    synthetic
        Values will be made up: a file is not needed, and its values do not count.

    Raises
    ------
    ConfigurationError
        The file or a column is missing, an entry is no number, times do not increase, a unit is wrong, or too few
        values count. The message begins with a key below that of the observation, and a colon, where it is about one.
    """
    series = MeasuredSeries.chosen(settings)
    title = f"{experiment}: {name}" if experiment else name
    if settings.file is None:
        if not synthetic:
            raise ConfigurationError(
                "file: missing; add the CSV file of the measured curve, or plan the experiment with --synthetic"
            )
        curve = _planned(title, settings, series, scales)
    else:
        table = CurveTable.read(folder / settings.file)
        curve = _measured(title, name, settings, series, table, scales)
        file = DataFile.of(folder / settings.file, settings.file, len(table.lines))
        curve = replace(curve, file=file)
    if (last := curve.times[-1]) > end * (1 + 1e-9):
        t = last * curve.time_factor
        raise ConfigurationError(
            f"the last time {t:g}{_unit(curve.time_unit)} lies behind the end of the study at "
            f"{end * curve.time_factor:g}{_unit(curve.time_unit)}; raise its macro.time.end, or give 'until:'"
        )
    return curve


def _unit(name: str) -> str:
    return f" {name}" if name else ""


def _planned(
    title: str, settings: ObservationSettings, series: MeasuredSeries, scales: Scales | None
) -> ObservedCurve:
    """Return a curve without values at the times that the settings list."""
    if settings.times is None:
        raise ConfigurationError("times: missing; made-up data need a 'file:' with times, or 'times:'")
    if settings.deviation_column or settings.weight_column:
        raise ConfigurationError("file: missing; the columns of deviations or weights stand in it")
    time = StudyUnit.at_key("time_unit", settings.time_unit or "", "time", scales)
    unit = StudyUnit.at_key("unit", settings.unit or "", series.quantity, scales)
    times = _times(settings.times, time)
    times = times[_counting("times", settings, times, time, FEWEST_TIMES)]
    return ObservedCurve(
        title, series, times / time.factor, unit.name, time.name, unit.factor, time.factor,
        np.full(len(times), settings.weight), None, _spread(settings, unit), settings.deviation_share,
    )  # fmt: skip


def _times(settings: SyntheticTimes, unit: StudyUnit) -> Array:
    first, last = (
        unit.converted(f"times.{key}", value)
        for key, value in (("first", settings.first), ("last", settings.last))
    )
    if not (0 <= first < last and (first > 0 or settings.spacing == "linear")):
        raise ConfigurationError(
            "times: expected a first time before the last one, and above 0 where the spacing is log, got "
            f"{first:g} and {last:g}"
        )
    space = np.geomspace if settings.spacing == "log" else np.linspace
    return np.asarray(space(first, last, settings.count))


def _measured(
    title: str,
    name: str,
    settings: ObservationSettings,
    series: MeasuredSeries,
    table: CurveTable,
    scales: Scales | None,
) -> ObservedCurve:
    """Return the curve in a table."""
    at = table.find(settings.time)
    column = (
        table.find(settings.values)
        if settings.values is not None
        else _values_column(table, at, name, settings)
    )
    if column == at:
        raise ConfigurationError(
            f"values: expected another column than the times, got {echo(table.names[at])}"
        )
    time = _of_column("time_unit", settings.time_unit, table, at, "time", scales)
    unit = _of_column("unit", settings.unit, table, column, series.quantity, scales)
    table.require_rising(at)
    times, values = table.numbers(at), settings.factor * table.numbers(column)
    weights = np.full(len(times), settings.weight)
    if settings.weight_column is not None:
        weights *= _positive(table, settings.weight_column)
    spread: float | Array | None = _spread(settings, unit)
    if settings.deviation_column is not None:
        spread = abs(settings.factor) * _positive(table, settings.deviation_column)
    kept = _counting(str(table.path), settings, times, time, FEWEST)
    of_each = isinstance(spread, np.ndarray)
    return ObservedCurve(
        title, series, times[kept] / time.factor, unit.name, time.name, unit.factor, time.factor, weights[kept],
        values[kept], np.asarray(spread)[kept] if of_each else spread, settings.deviation_share,
    )  # fmt: skip


def _values_column(table: CurveTable, at: int, name: str, settings: ObservationSettings) -> int:
    """Return the column of the values where none is named: that with the name of the curve, or the only one left."""
    used = {at}
    used |= {
        table.find(each) for each in (settings.deviation_column, settings.weight_column) if each is not None
    }
    rest = [k for k in range(len(table.headings)) if k not in used]
    alike = [k for k in rest if table.names[k].casefold() in (name.casefold(), settings.quantity)]
    for found in (alike, rest):
        if len(found) == 1:
            return found[0]
    raise ConfigurationError(
        f"values: missing; {table.path} has the columns {joined(table.names)}, name that of the values"
    )


def _of_column(
    key: str, given: str | None, table: CurveTable, column: int, quantity: str, scales: Scales | None
) -> StudyUnit:
    """Return the unit of a column: that of the key or of the heading, which agree where both are there."""
    heading = table.headings[column]
    if given is not None and heading.unit and given.strip() != heading.unit:
        raise ConfigurationError(
            f"{key}: expected {echo(heading.unit)}, the unit in the heading of {echo(heading.name)} in {table.path}, "
            f"got {echo(given)}; remove one of the two"
        )
    if given is not None:
        return StudyUnit.at_key(key, given.strip(), quantity, scales)
    return StudyUnit.at_key(f"{table.path}: {heading.name}", heading.unit, quantity, scales)


def _spread(settings: ObservationSettings, unit: StudyUnit) -> float | None:
    if settings.deviation is None:
        return None
    found = unit.converted("deviation", settings.deviation)
    if found <= 0:
        raise ConfigurationError(f"deviation: expected a number above 0, got {echo(settings.deviation)}")
    return found


def _positive(table: CurveTable, name: str) -> Array:
    """Return a column of numbers above zero."""
    column = table.find(name)
    values = table.numbers(column)
    if (values <= 0).any():
        k = int(np.argmax(values <= 0))
        raise ConfigurationError(
            f"{table.path}:{table.lines[k]}: {table.names[column]}: expected a number above 0, got {values[k]:g}; "
            "remove a row that does not count"
        )
    return values


def _counting(
    key: str, settings: ObservationSettings, times: Array, unit: StudyUnit, fewest: int
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return True for the times that count, as many as ``fewest`` at least; ``key`` says where they stand."""
    since, until = (
        default if value is None else unit.converted(key, value)
        for key, value, default in (("since", settings.since, -math.inf), ("until", settings.until, math.inf))
    )
    if since > until:
        raise ConfigurationError(
            f"since: expected a time before until, got {settings.since} and {settings.until}; exchange them"
        )
    kept: np.ndarray[tuple[int], np.dtype[np.bool_]] = (times >= since) & (times <= until)
    if (count := int(kept.sum())) < fewest:
        raise ConfigurationError(
            f"{key}: expected at least {fewest} values{_between(settings)}, got {count}; measure more, or let more of "
            "them count"
        )
    return kept


def _between(settings: ObservationSettings) -> str:
    ends = {"from": settings.since, "to": settings.until}
    return "".join(f" {word} {value}" for word, value in ends.items() if value is not None)
