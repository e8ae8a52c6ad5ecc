"""Reading of an observation (read_curve): columns of a file, their units, the part that counts."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from porocore.commands.calibration.observations import (
    DataFile,
    MeasuredSeries,
    ObservedCurve,
    StudyUnit,
    as_unit,
    is_unit,
    size_of,
)
from porocore.commands.calibration.settings import ObservationSettings, SyntheticTimes
from porocore.commands.calibration.tables import CurveTable, Numbers
from porocore.core.echo import echo, joined
from porocore.core.units import ResultUnits, Scales
from porocore.errors import ConfigurationError
from porocore.states import Array

#: Values that a measured curve has at least, and times that a planned one has.
FEWEST, FEWEST_TIMES = 3, 2
#: Share of the rows that have one time, above which the column may be one of values.
PLATEAU = 0.2
#: Diameter of the disc of an example [m].
DISC = 6e-3
#: Units of a strain in small letters, and headings without a unit that name one.
STRAINS = {"%": 0.01, "percent": 0.01, "mm/mm": 1.0, "m/m": 1.0}
STRAIN = re.compile(r"strain|dehnung|stauchung", re.IGNORECASE)
#: What stands for no unit.
DIMENSIONLESS = ("-", "1")
#: Share of the end of a study by which a last time may lie behind it where it is rounded.
ROUNDED = 1e-3


def read_curve(
    name: str,
    settings: ObservationSettings,
    folder: Path,
    scales: Scales | None,
    end: float,
    *,
    height: float | None = None,
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
    height
        Of the body [L], by which a settlement is made of a strain; None: not known.
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
        curve = _measured(title, name, settings, series, folder / settings.file, scales, end, height)
    if not synthetic and curve.share is not None and curve.measured is not None and not curve.measured.any():
        raise ConfigurationError(
            f"deviation_share: all values that count are 0 in {folder / str(settings.file)}, and so is every share of "
            "the largest one; give 'deviation:' in its place"
        )
    if (last := curve.times[-1]) > end * (1 + 1e-9):
        unit = _unit(curve.time_unit)
        bare = _bare_times(settings, curve.time_unit, scales) or "; "
        raise ConfigurationError(
            f"the last time {last * curve.time_factor:g}{unit} lies behind the end of the study at "
            f"{end * curve.time_factor:g}{unit}{bare}raise its macro.time.end, or give 'until:'"
        )
    return curve


def _bare_times(settings: ObservationSettings, unit: str, scales: Scales | None) -> str:
    """Return that times without a unit are multiples of the study's scale, and what to write; empty with a unit."""
    if unit or scales is None or settings.time_unit is not None:
        return ""
    heading = "" if settings.file is None else f" or a heading such as '{settings.time} [min]'"
    return (
        f", both multiples of the study's scale of time, {ResultUnits(scales).text(1.0, 'time')}, since the times have "
        f"no unit; give 'time_unit:'{heading}, otherwise "
    )


def _unit(name: str) -> str:
    return f" {name}" if name else ""


def _planned(
    title: str, settings: ObservationSettings, series: MeasuredSeries, scales: Scales | None
) -> ObservedCurve:
    """Return a curve without values at the times that the settings list."""
    if settings.times is None:
        raise ConfigurationError("times: missing; synthetic data need a 'file:' with times, or 'times:'")
    if settings.deviation_column or settings.weight_column:
        raise ConfigurationError("file: missing; the columns of deviations or weights stand in it")
    time = StudyUnit.at_key("time_unit", settings.time_unit or "", "time", scales)
    unit = StudyUnit.at_key("unit", settings.unit or "", series.quantity, scales)
    times = planned_times(settings.times, time)
    times = times[_counting("times", settings, times, time, FEWEST_TIMES)]
    return ObservedCurve(
        title, series, times / time.factor, unit.name, time.name, unit.factor, time.factor,
        np.full(len(times), settings.weight), None, _spread(settings, unit), settings.deviation_share,
    )  # fmt: skip


def planned_times(settings: SyntheticTimes, unit: StudyUnit) -> Array:
    """Return the times (m,) of synthetic data, in a unit.

    Raises
    ------
    ConfigurationError
        They are not ascending, or begin at 0 where their spacing is logarithmic.
    """
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
    path: Path,
    scales: Scales | None,
    end: float,
    height: float | None,
) -> ObservedCurve:
    """Return the curve in a file; what was done to its rows is said in its notes."""
    named = (settings.values, settings.deviation_column, settings.weight_column)
    table = CurveTable.read(
        path,
        [settings.time, *(each for each in named if each is not None)],
        encoding=settings.encoding,
        heading_line=settings.heading_line,
        last_line=settings.last_line,
    )
    at = _times_column(table, settings.time)
    column = (
        table.find(settings.values)
        if settings.values is not None
        else _values_column(table, at, name, settings)
    )
    if column == at:
        raise ConfigurationError(
            f"values: expected another column than the times, got {echo(table.names[at])}"
        )
    extra = [None if each is None else table.find(each) for each in named[1:]]
    used = [at, column, *(k for k in extra if k is not None)]
    rows = table.without(settings.missing, used)
    if not rows.rows:
        texts = ", ".join(map(echo, settings.missing)) or "no text"
        raise ConfigurationError(
            f"missing: expected rows with numbers in {joined(echo(table.names[k]) for k in used)}, but every row of "
            f"{path} has {texts} there; name other columns, or change the key"
        )
    timed = rows.with_clock(at, settings.time_unit, scales=scales is not None) or table
    given = settings.time_unit if timed is table else None
    time = _of_column("time_unit", given, timed, at, "time", scales)
    if series.quantity == "displacement" and abs(settings.factor) == 1:
        _require_no_strain(table, column, height, scales)
    unit = _of_column("unit", settings.unit, table, column, series.quantity, scales, factor=settings.factor)
    numbers = dict(zip(used, rows.numbers(used, settings.decimal, clock=at), strict=True))
    deviations, weights = (None if k is None else _positive(rows, k, numbers[k].values) for k in extra)
    since = None if settings.since is None else time.converted("since", settings.since)
    _require_rising(rows, at, numbers[at].values, since, time.name)
    read = _Rows(
        _ended(numbers[at], end * time.factor),
        settings.factor * (numbers[column].values - unit.converted("offset", settings.offset)),
        settings.weight * (np.ones(len(rows.rows)) if weights is None else weights),
        None if deviations is None else abs(settings.factor) * deviations,
    )
    data = read.averaged()
    kept = _counting(str(table.path), settings, data.times, time, FEWEST)
    if data.times[kept][0] > end * time.factor:
        first = int(np.searchsorted(numbers[at].values, data.times[kept][0]))
        bare = _bare_times(settings, time.name, scales)
        raise _all_behind(
            rows, at, first, "" if timed is not table else time.name, end * time.factor, time.name, bare
        )
    return ObservedCurve(
        title, series, data.times[kept] / time.factor, unit.name, time.name, unit.factor, time.factor,
        data.weights[kept], data.values[kept],
        _spread(settings, unit) if data.deviations is None else data.deviations[kept],
        settings.deviation_share,
        (*_notes(table, rows, numbers[at], read, data, time), *_unitless(timed, settings, at, column, scales)),
        DataFile.of(path, str(settings.file), len(table.rows)),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Rows:
    """Times, values, weights and, perhaps, standard deviations of the rows of a file, each (n,), in its units."""

    times: Array
    values: Array
    weights: Array
    deviations: Array | None

    def averaged(self) -> _Rows:
        """Return one row for each time, with the mean of those at that time, which weighs as much as they do."""
        times, place = np.unique(self.times, return_inverse=True)
        if len(times) == len(self.times):
            return self
        of_each = self.weights if self.deviations is None else self.weights / self.deviations**2
        precision, weights = (
            np.asarray(np.bincount(place, each), dtype=float) for each in (of_each, self.weights)
        )
        values = np.bincount(place, of_each * self.values) / precision
        return _Rows(
            times, values, weights, None if self.deviations is None else np.sqrt(weights / precision)
        )


def _ended(times: Numbers, end: float) -> Array:
    """Return times of which those that only rounding puts behind the end of the study are the end.

    That is one unit of the last digit that the file has, and a thousandth of the end at most.
    """
    values = times.values
    rounding = min(times.last_place, ROUNDED * end) * (1 + 1e-9)
    return np.where((values > end) & (values <= end + rounding), end, values)


def _notes(
    table: CurveTable, rows: CurveTable, times: Numbers, read: _Rows, data: _Rows, unit: StudyUnit
) -> Iterator[str]:
    """Yield what was done to the rows of a file."""
    if left := len(table.rows) - len(rows.rows):
        yield f"{left} of {len(table.rows)} rows, which have no number for the curve, were left out"
    if doubled := len(read.times) - len(data.times):
        alike = np.unique(read.times, return_counts=True)[1]
        shared = int((alike > 1).sum())
        said = (
            f"{shared + doubled} rows have {shared} times between them; the mean of the rows at one time counts"
            if shared > 1
            else f"{1 + doubled} rows have the same time; their mean counts"
        )
        # A plateau of the times, over which the values go on rising as times do.
        rising = alike.max() > max(FEWEST, PLATEAU * len(read.times)) and (np.diff(read.values) > 0).all()
        yield said + (
            "; the values rise from row to row, so the two columns may be exchanged" if rising else ""
        )
    if read.times[-1] < times.values[-1] * (1 - 1e-9):
        yield (
            f"the last time, {times.texts[-1]}{_unit(unit.name)}, is rounded and counts as the end of the study, "
            f"{read.times[-1]:.10g}{_unit(unit.name)}"
        )


def _unitless(
    table: CurveTable, settings: ObservationSettings, at: int, column: int, scales: Scales | None
) -> Iterator[str]:
    """Yield that times or values are taken for dimensionless in a study with scales, where nobody said so."""
    if scales is None:
        return
    for key, given, k in (("time_unit", settings.time_unit, at), ("unit", settings.unit, column)):
        if given is None and not table.headings[k].unit:
            yield (
                f"{echo(table.names[k])} has no unit in {table.path.name}, so its numbers are taken as multiples of "
                f"the study's scales; give '{key}:' where they have one, or '{key}: \"\"'"
            )


def _require_rising(table: CurveTable, column: int, times: Array, since: float | None, unit: str) -> None:
    """Refuse times that fall from row to row, or of which some that count lie before zero.

    Parameters
    ----------
    table, column, times
        The rows, and their times (n,), which stand in the column.
    since, unit
        First time that counts, and its unit; None: all count.
    """
    name = table.names[column]
    for k, line in enumerate(table.lines):
        at = f"{table.path}:{line}: {name}"
        if k and times[k] < times[k - 1]:
            end = f", or keep one test in the file, as by 'last_line: {line - 1}'" if k >= FEWEST else ""
            raise ConfigurationError(
                f"{at}: expected increasing times, got {times[k]:g} after {times[k - 1]:g}; sort the rows by their "
                f"times{end}"
            )
        if times[k] < 0 and (since is None or times[k] >= since):
            raise ConfigurationError(
                f"{at}: expected a time from 0, the beginning of the test, got {times[k]:g}; leave out the rows before "
                f"it by 'since: {f'0 {unit}'.strip()}'"
            )


def _all_behind(
    table: CurveTable, column: int, row: int, unit: str, end: float, end_unit: str, bare: str
) -> ConfigurationError:
    """Return the complaint about times that begin behind the end of the study, by the first row that counts.

    ``unit`` is that of the text in the row, empty for a clock time; ``bare`` what is said of times without any.
    """
    text = table.rows[row][column].strip()
    of_day = ":" in text
    looks = ", and look like times of the day" if of_day else ""
    longer = "" if of_day else ", or raise macro.time.end where the test lasts so long"
    return ConfigurationError(
        f"{table.path}:{table.lines[row]}: {table.names[column]}: the times begin at {text}{_unit(unit)}, behind the "
        f"end of the study at {end:g}{_unit(end_unit)}{looks}{bare or '; '}times count from the beginning of the test: "
        f"subtract that of its beginning from all of them{longer}"
    )


def _times_column(table: CurveTable, name: str) -> int:
    """Return the column of the times; where none has its name, the only other with a unit of time is proposed."""
    try:
        return table.find(name)
    except ConfigurationError as error:
        timed = [each.name for each in table.headings if size_of(as_unit(each.unit, "time"), "time")]
        if len(timed) != 1 or name in table.names:
            raise
        raise ConfigurationError(f"{error}; give 'time: {timed[0]}', whose unit is one of time") from None


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
    key: str,
    given: str | None,
    table: CurveTable,
    column: int,
    quantity: str,
    scales: Scales | None,
    *,
    factor: float = 1.0,
) -> StudyUnit:
    """Return the unit of a column: that of the key or of the file, which agree where both are there.

    A ``factor`` may turn one quantity into another, as the area a stress into a force. The key is then the unit of the
    product.
    """
    heading = table.headings[column]
    unit = as_unit(heading.unit, quantity)
    if given is None:
        return StudyUnit.at_key(
            f"{table.path}:{heading.unit_line or table.line}: {heading.name}", unit, quantity, scales,
            (_other_unit(key, unit, quantity), "take the unit out of the file, whose numbers are then dimensionless"),
        )  # fmt: skip
    size, other = size_of(given.strip(), quantity), size_of(unit, quantity)
    # A unit that nobody knows, such as 'Sek', is what the key is for.
    turned = abs(factor) != 1 and other is None
    if (
        given.strip() != unit
        and size is not None
        and not turned
        and (size != other if other else is_unit(unit))
    ):
        raise ConfigurationError(
            f"{key}: expected {echo(heading.unit)}, the unit of {echo(heading.name)} in {table.path}, got "
            f"{echo(given)}; remove one of the two"
        )
    return StudyUnit.at_key(key, given.strip(), quantity, scales)


def _require_no_strain(table: CurveTable, column: int, height: float | None, scales: Scales | None) -> None:
    """Refuse a strain in the place of a displacement, which is the strain times the height of the body."""
    heading = table.headings[column]
    size = STRAINS.get(heading.unit.strip().lower())
    bare = heading.unit.strip() in ("", *DIMENSIONLESS)
    if size is None and not (bare and STRAIN.search(heading.name)):
        return
    share = (size or 1) * (height or 1) * (1 if scales is None else float(scales.exact.length))
    # A factor of 1 would be none.
    unit, times = ("mm", 1e3) if scales is not None and not math.isclose(1e3 * share, 1) else ("m", 1.0)
    number = (
        "the height" + ("/100" if size == STRAINS["%"] else "") if height is None else f"{times * share:.6g}"
    )
    of = "" if height is None or scales is None else f" of {times * share / (size or 1):.6g} {unit}"
    given = f"'factor: {number}'" if scales is None else f"'unit: {unit}' and 'factor: {number}'"
    alone = " and take the unit out of the file" if scales is None and size else ""
    what = f"got {echo(heading.unit)}, a strain" if size else "got a strain"
    raise ConfigurationError(
        f"{table.path}:{heading.unit_line or table.line}: {heading.name}: expected a length, such as 5 mm, {what}; a "
        f"settlement is the strain times the height{of}: give {given}{alone}"
    )


def _other_unit(key: str, unit: str, quantity: str) -> str:
    """Return the advice on a unit in a file that is none of the quantity of its column."""
    if not is_unit(unit):
        return f"correct it in the file, or name a known one by '{key}:'"
    if quantity == "force" and (pascal := size_of(unit, "stress")):
        area = math.pi * DISC**2 / 4
        return (
            "a force is the stress times the area of the whole specimen: give 'unit: N' and as 'factor:' this area in "
            f"m² times {float(pascal):g}, such as {area * float(pascal):.4g} for a disc of {1e3 * DISC:g} mm"
        )
    return "correct it in the file"


def _spread(settings: ObservationSettings, unit: StudyUnit) -> float | None:
    """Return the deviation of the quantity; one without a unit is multiplied by the factor, as the column is."""
    if settings.deviation is None:
        return None
    found = unit.converted("deviation", settings.deviation)
    if found <= 0:
        raise ConfigurationError(f"deviation: expected a number above 0, got {echo(settings.deviation)}")
    return found if isinstance(settings.deviation, str) else abs(settings.factor) * found


def _positive(table: CurveTable, column: int, values: Array) -> Array:
    """Return the numbers of a column, which are above zero."""
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
    if len(times) < fewest:
        raise ConfigurationError(
            f"{key}: expected at least {fewest} rows with different times, got {len(times)}; measure at more times"
        )
    if (count := int(kept.sum())) < fewest:
        at = "until" if settings.since is None else "since"
        raise ConfigurationError(
            f"{at}: expected at least {fewest} times{_between(settings)}, got {count} of the {len(times)} of {key}, "
            f"which go from {times[0]:g} to {times[-1]:g}{_unit(unit.name)}; move it"
        )
    return kept


def _between(settings: ObservationSettings) -> str:
    ends = {"from": settings.since, "to": settings.until}
    return "".join(
        f" {word} {value:g}" if isinstance(value, float) else f" {word} {value}"
        for word, value in ends.items()
        if value is not None
    )
