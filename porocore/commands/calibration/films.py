"""Reading of measured fields (read_film): CSV, VTU and NPZ files, their units, the points that count."""

from __future__ import annotations

import csv
import hashlib
import math
import re
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations
from pathlib import Path
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from porocore.commands.calibration.clouds import EDGE, PRESSURE, FilmComponent, PointCloud, rotation
from porocore.commands.calibration.observations import DataFile, ObservedCurve, StudyUnit
from porocore.commands.calibration.reading import planned_times
from porocore.commands.calibration.settings import Column, PointsSettings
from porocore.commands.calibration.tables import CurveTable, Heading, decoded_text
from porocore.core.echo import echo, joined, suggestion
from porocore.core.files.foreign_mesh import read_point_data
from porocore.core.files.reading import require_ordinary
from porocore.core.units import Scales, number_or_quantity, pretty, units_now
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.body.points import BodyPoints
from porocore.macro.boundary.symmetry import Symmetry
from porocore.macro.problem import MacroSetup, body_mesh
from porocore.states import Array, IntArray

#: Bytes of one file, rows of all files of one film, and values that count, at least.
LARGEST_FILM, MOST_ROWS, FEWEST = 1 << 28, 2_000_000, 3
#: Lines of a CSV file among which its headings are.
HEAD = 1000
#: Texts that mark a missing number in every file.
MISSING = ("", "nan", "na", "n/a", "null", "none", "---")
#: Coordinates, and columns that every point needs.
COORDINATES: tuple[Column, Column, Column] = ("x", "y", "z")
POINT: tuple[Column, ...] = (*COORDINATES, "t")
#: Components of a field, in the order of :data:`porocore.commands.calibration.clouds.COMPONENTS`.
COMPONENTS: tuple[Column, ...] = ("u1", "u2", "u3", "p")
#: Names under which VTU and NPZ files may have vectors of the displacement.
VECTORS = ("u", "displacement", "Displacement")
#: Share of the points outside below which they may well be those at the edges of an image.
FEW = 0.2
#: Share of the body's size within which two places are one, and planes are met.
SAME_PLACE = 1e-9
#: Share of the points that lie in the body in other axes or units, which are then proposed.
FITS = 0.95
#: Share of an edge of the body that places have at least where it is the unit that makes them fit.
LARGE = 0.2
#: Share of the largest edge of the body below which a film is so small that its unit is doubted.
SMALL = 0.02
#: A film that ends before this share of the test is likely to have minutes for seconds, or hours for minutes.
EARLY = 1 / 30
#: Pressures so many times as large as the modulus of the solid are noted.
ABSURD = 10.0
#: Numbers whose commas may stand between groups of three digits.
_GROUPED = re.compile(r"[+-]?[1-9][0-9]{0,2}(,[0-9]{3})+")
_PART = re.compile(r"(?P<name>.+)\[(?P<part>[0-9])\]")


@dataclass(frozen=True, eq=False)
class Film:
    """Columns of one or more files.

    Attributes
    ----------
    path
        File or pattern, for messages.
    columns
        Numbers (n,) by name; NaN where one is missing.
    units
        Units in headings, by name.
    rows
        Where each row stands, for messages: lines of a CSV file; None: numbers from 1.
    """

    path: Path
    columns: Mapping[Column, Array]
    units: Mapping[Column, str] = field(default_factory=dict)
    rows: Array | None = None

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def at(self, row: int, column: str) -> str:
        """Return where a number stands, for messages."""
        if self.rows is None:
            return f"{self.path}: {column}, value {row + 1}"
        return f"{self.path}:{int(self.rows[row])}: {column}"


def read_film(
    name: str,
    settings: PointsSettings,
    folder: Path,
    macro: MacroSetup,
    scales: Scales | None,
    *,
    experiment: str = "",
    synthetic: bool = False,
) -> tuple[list[ObservedCurve], StudyUnit]:
    """Return the curves of a measured field, one for each component, and the unit of its places.

    Parameters
    ----------
    name
        Of the observation.
    settings
        Files, units, deviations, place of the camera.
    folder
        Where a relative path starts.
    macro, scales
        Of the study.
    experiment
        Name of the experiment, where there are several.
    synthetic
        Values will be made up: a file is not needed, and its values do not count.

    Raises
    ------
    ConfigurationError
        A file or a column is missing, an entry is no number, a unit is wrong, times lie outside the study, or too many
        points lie outside the body. The message begins with a key below that of the observation, and a colon, where it
        is about one.
    """
    mesh = body_mesh(macro)
    files: DataFile | None = None
    if settings.file is None:
        if settings.grid is None or not synthetic:
            raise ConfigurationError(
                "file: missing; add the file of the measured field, or plan the experiment with --synthetic, 'grid:' "
                "and 'times:'"
            )
        film = _planned(settings, mesh, scales)
    else:
        film, files = _measured(settings, folder, scales)
    units = _Units.chosen(settings, film, scales)
    film = _with_fixed(film, settings, mesh, units.place)
    notes: list[str] = list(units.notes(settings, film, scales))
    components = _components(settings, film)
    camera = _Camera.given(settings, units.place)
    if camera.sees_plane(settings, mesh):
        components, said = _of_plane(components, settings, film)
        notes += said
    rows, said = _counting(settings, film, units, macro.time.end)
    notes += said
    if settings.file is not None:
        rows, said = _without_copies(film, rows)
        notes += said
    elif not settings.quantities:
        made_up = joined(COMPONENTS[each] for each in components)
        notes.append(f"{made_up} are made up, and no p; name other components in 'quantities:'")
    places = np.stack([film.columns[c][rows] for c in COORDINATES], axis=1) / units.place.factor
    times = film.columns["t"][rows] / units.time.factor
    if settings.file is not None:
        places = places @ camera.turn.T + camera.offset
    notes += _small_notes(places, mesh, units.place.name)
    if settings.file is not None:
        notes += _early_notes(times, macro.time.end, units.time)
    signs = np.ones((len(rows), 3))
    if camera.is_plain and not settings.camera.unknown:
        places, signs, said = _mirrored(places, macro, mesh)
        notes += said
    order = np.argsort(times, kind="stable")
    rows, signs = rows[order], signs[order]
    axes = None if camera.is_plain else camera.turn
    title = f"{experiment}: {name}" if experiment else name
    origin = camera.offset if settings.file is not None else np.zeros(3)
    whole = PointCloud(
        title, places[order], times[order], settings.place, axes, settings.outside, origin,
        bool(settings.camera.unknown),
    )  # fmt: skip
    if settings.place == "reference":
        kept, said = _inside(whole, mesh, film, units.place)
        notes += said
        rows, signs, whole = rows[kept], signs[kept], whole.kept(kept)
    elif settings.file is not None:
        moved = [np.nan_to_num(film.columns.get(c, np.zeros(len(film)))[rows]) for c in COMPONENTS[:PRESSURE]]
        u = np.stack(moved, axis=1) * signs / units.displacement.factor @ camera.turn.T
        notes += _deformed_notes(whole, u, mesh, film, units.place)
    cloud, sets, said = _without_twins(whole, mesh)
    notes += said
    curves = []
    for component in components:
        curve = _curve(settings, film, units, cloud, sets, rows, signs, component, synthetic, files)
        own = (*notes, *curve.notes, *_value_notes(curve))
        curves.append(replace(curve, notes=tuple(dict.fromkeys(own))))
        notes = []
    return curves, units.place


@dataclass(frozen=True)
class _Units:
    """Units of the places, times, displacements and pressures of a film."""

    place: StudyUnit
    time: StudyUnit
    displacement: StudyUnit
    pressure: StudyUnit

    @classmethod
    def chosen(cls, settings: PointsSettings, film: Film, scales: Scales | None) -> _Units:
        """Return the units of keys, else those of the headings."""

        def of(key: str, given: str | None, quantity: str, columns: Sequence[Column]) -> StudyUnit:
            found = {film.units[c] for c in columns if film.units.get(c)}
            if given is None and len(found) > 1:
                raise ConfigurationError(
                    f"{key}: expected one unit in the headings of {joined(columns)}, got {joined(sorted(found))}; "
                    "write the columns in one unit"
                )
            inside = next(iter(found), "")
            if given is not None and inside and given.strip() != inside:
                raise ConfigurationError(
                    f"{key}: expected {echo(inside)}, the unit in the headings of {film.path}, got {echo(given)}; "
                    "remove one of the two"
                )
            return StudyUnit.at_key(key, (inside if given is None else given).strip(), quantity, scales)

        place = of("unit", settings.unit, "displacement", [c for c in COORDINATES if c in film.columns])
        own = of("displacement_unit", settings.displacement_unit, "displacement", ("u1", "u2", "u3"))
        bare = settings.displacement_unit is None and not own.name
        return cls(
            place,
            of("time_unit", settings.time_unit, "time", ("t",)),
            place if bare else own,
            of("pressure_unit", settings.pressure_unit, "pressure", ("p",)),
        )

    def of(self, component: int) -> StudyUnit:
        """Return the unit of a component."""
        return self.pressure if component == PRESSURE else self.displacement

    def notes(self, settings: PointsSettings, film: Film, scales: Scales | None) -> Iterator[str]:
        """Yield that numbers are taken for dimensionless in a study with scales."""
        if scales is None:
            return
        made_up = settings.file is None
        planned = () if settings.times is None else (settings.times.first, settings.times.last)
        times, lengths = (planned if made_up else settings.frames), settings.fixed.values()
        of_file = not made_up and any(c in film.columns and c not in settings.fixed for c in COORDINATES)
        bare = {
            "unit": of_file or any(map(_is_bare, lengths)),
            "time_unit": not times or any(map(_is_bare, times)),
            "pressure_unit": "p" in film.columns and (not made_up or _is_bare(settings.pressure_deviation)),
        }
        shown = {"unit": ("places", self.place), "time_unit": ("times", self.time)}
        shown["pressure_unit"] = ("pressures", self.pressure)
        keys = [key for key, (_, unit) in shown.items() if bare[key] and not unit.name]
        if keys:
            named = " or ".join(f"'{key}:'" for key in keys)
            yield (
                f"the {joined(shown[key][0] for key in keys)} of {film.path.name} have no unit, so they are taken as "
                f"multiples of the study's scales; give {named} where they have one"
            )


def _is_bare(value: float | str | None) -> bool:
    """Return True for a number without a unit."""
    return value is not None and not isinstance(number_or_quantity(value), str)


@dataclass(frozen=True, eq=False)
class _Camera:
    """Known place of a camera: its offset (3,), dimensionless, and its axes (3, 3) as columns."""

    offset: Array
    turn: Array

    @classmethod
    def given(cls, settings: PointsSettings, unit: StudyUnit) -> _Camera:
        """Return the place that the settings give."""
        camera = settings.camera
        offset = [unit.converted("camera.offset", value) for value in camera.offset]
        return cls(np.array(offset) / unit.factor, rotation(np.deg2rad(np.array(camera.rotation))))

    @property
    def is_plain(self) -> bool:
        """True where its axes are those of the body."""
        return bool((self.turn == np.eye(3)).all())

    def sees_plane(self, settings: PointsSettings, mesh: BodyMesh) -> bool:
        """Return True where the third axis is that across a body of two dimensions."""
        across = 1 - abs(float(self.turn[2, 2])) < SAME_PLACE
        return across and not np.ptp(mesh.points[:, 2]) and not {"rx", "ry"} & {*settings.camera.unknown}


def _components(settings: PointsSettings, film: Film) -> list[int]:
    """Return the components that are fitted."""
    known = [c for c in get_args(Column) if c in film.columns and c in COMPONENTS]
    for each in settings.quantities:
        if each not in known:
            raise ConfigurationError(
                f"quantities: {film.path} has no {echo(each)}; it has {joined(known) or 'none'}; name its column in "
                "'columns:'"
            )
    found = settings.quantities or tuple(known)
    if not found:
        raise ConfigurationError(
            f"columns: {film.path} has no u1, u2, u3 or p; name the column of one, such as 'columns: {{u1: NAME}}'"
        )
    return [COMPONENTS.index(each) for each in found]


def _of_plane(components: list[int], settings: PointsSettings, film: Film) -> tuple[list[int], list[str]]:
    """Return the components without u3, which a body of two dimensions does not have, and a note.

    Its zeros would be fitted exactly, and make the reduced χ² smaller.

    Raises
    ------
    ConfigurationError
        It is named, and not 0, or nothing else is left.
    """
    across = COMPONENTS.index("u3")
    if across not in components:
        return components, []
    left = [each for each in components if each != across]
    moved = bool(np.nan_to_num(film.columns["u3"]).any())
    if not left or (moved and "u3" in settings.quantities):
        raise ConfigurationError(
            "quantities: u3 is the displacement out of the plane of a body in two dimensions, which cannot move that "
            f"way; {'leave u3 out' if left else 'name other components'}, or solve a body in three dimensions"
        )
    if settings.file is None and not settings.quantities:
        return left, []
    return left, ["u3 is left out, since a body in two dimensions does not move out of its plane"]


def _counting(settings: PointsSettings, film: Film, units: _Units, end: float) -> tuple[IntArray, list[str]]:
    """Return the rows that have a place and a time that count, and what was left out."""
    missing = [c for c in POINT if c not in film.columns]
    if missing:
        raise ConfigurationError(_lacking(missing, film))
    bare = np.stack([film.columns[c] for c in POINT])
    sound = np.isfinite(bare).all(axis=0)
    times = np.where(sound, film.columns["t"], 0.0)
    since = -math.inf if settings.since is None else units.time.converted("since", settings.since)
    until = math.inf if settings.until is None else units.time.converted("until", settings.until)
    if since > until:
        raise ConfigurationError(
            f"since: expected a time before until, got {settings.since} and {settings.until}; exchange them"
        )
    wanted = sound & (times >= since) & (times <= until)
    if not wanted.any():
        raise ConfigurationError(
            f"file: no row of {film.path} has a finite place and a time that counts; check its columns, 'since:' and "
            "'until:'"
        )
    unit = f" {units.time.name}" if units.time.name else ""
    early = np.flatnonzero(wanted & (times < 0))
    if len(early):
        raise ConfigurationError(
            f"{film.at(int(early[0]), 't')}: expected a time from 0, the beginning of the test, got "
            f"{times[early[0]]:g}{unit}; leave out earlier rows by 'since:'"
        )
    last = end * units.time.factor
    late = np.flatnonzero(wanted & (times > last * (1 + 1e-9)))
    if len(late):
        raise ConfigurationError(
            f"{film.at(int(late[0]), 't')}: the time {times[late[0]]:g}{unit} lies behind the end of the study at "
            f"{last:g}{unit}; raise its macro.time.end, or give 'until:'"
        )
    rows = np.flatnonzero(wanted)
    if len(rows) > MOST_ROWS:
        raise ConfigurationError(
            f"file: expected at most {MOST_ROWS} rows that count, got {len(rows)}; leave some out"
        )
    lost = int((~sound).sum())
    said = f"{lost} of {len(film)} rows have no place or no time, and were left out"
    return rows, [said] if lost else []


def _without_copies(film: Film, rows: IntArray) -> tuple[IntArray, list[str]]:
    """Return the rows without exact copies of earlier ones, which are no further measurements, and a note."""
    whole = np.stack([each[rows] for each in film.columns.values()], axis=1)
    # Without the sign of a zero, and with one NaN.
    whole = np.ascontiguousarray(np.where(np.isnan(whole), np.nan, whole + 0.0))
    _, first = np.unique(whole.view(f"V{whole.itemsize * whole.shape[1]}").ravel(), return_index=True)
    copies = len(rows) - len(first)
    if not copies:
        return rows, []
    return rows[np.sort(first)], [f"{copies} rows are exact copies of others, and were left out"]


def _early_notes(times: Array, end: float, unit: StudyUnit) -> Iterator[str]:
    """Yield that a film ends long before the test, as with minutes that are taken for seconds."""
    last = float(times.max(initial=0.0))
    if 0 < last < EARLY * end:
        words = pretty(unit.name)
        yield (
            f"the film ends at {f'{last * unit.factor:.4g} {words}'.rstrip()}, and the test at "
            f"{f'{end * unit.factor:.4g} {words}'.rstrip()}; check the unit of the times, 'time_unit:' or the heading"
        )


def _value_notes(curve: ObservedCurve) -> Iterator[str]:
    """Yield what is to be doubted in the values of a component before anything is computed."""
    measured = curve.measured
    if measured is None:
        return
    deviation, largest, unit = (
        float(curve.deviations.min()),
        float(np.abs(measured).max()),
        pretty(curve.unit),
    )
    if not largest:
        yield "all values are 0; check the column, or leave it out of 'quantities:'"
    elif deviation > largest:
        key = "pressure_deviation" if curve.series.quantity == "pressure" else "deviation"
        yield (
            f"the deviation of {f'{deviation:.4g} {unit}'.rstrip()} is larger than all values, which reach "
            f"{f'{largest:.4g} {unit}'.rstrip()}; check '{key}:' and the unit of the values, "
            f"'{curve.unit_key}:' or the heading"
        )
    if curve.series.quantity == "pressure" and largest > ABSURD * curve.factor:
        yield (
            f"the pressures reach {f'{largest:.4g} {unit}'.rstrip()}, {largest / curve.factor:.3g} times the modulus "
            "of the solid; check their unit, 'pressure_unit:' or the heading"
        )


def _lacking(missing: Sequence[str], film: Film) -> str:
    """Return the complaint about columns that are not there."""
    first = missing[0]
    if first == "t":
        return (
            f"columns: {film.path} has no column of times, 't'; name it in 'columns:', or give a pattern of files and "
            "their times in 'frames:'"
        )
    return (
        f"columns: {film.path} has no column {echo(first)} of places; name it in 'columns:', or give the coordinate "
        f"that all points have, such as 'fixed: {{{first}: 0}}'"
    )


def _mirrored(places: Array, macro: MacroSetup, mesh: BodyMesh) -> tuple[Array, Array, list[str]]:
    """Return places in the part of a symmetric body that is solved, signs (n, 3) of displacements there, and notes.

    Planes across an axis alone count, and in a meridian the axis of revolution.
    """
    signs, places, turned = np.ones_like(places), places.copy(), np.zeros(len(places), dtype=bool)
    size = float(np.ptp(mesh.points, axis=0).max())
    planes = [
        (axis, float(np.sign(normal[axis])))
        for normal in Symmetry.of(macro).normals.values()
        if abs(normal[axis := int(np.abs(normal).argmax())]) >= 1 - SAME_PLACE
    ]
    if mesh.revolved:
        planes.append((0, -1.0))
    for axis, side in planes:
        at = 0.0 if mesh.revolved and axis == 0 else float((side * mesh.points[:, axis]).max())
        beyond = side * places[:, axis] > at + SAME_PLACE * size
        places[beyond, axis] = side * 2 * at - places[beyond, axis]
        signs[beyond, axis] *= -1
        turned |= beyond
    count = int(turned.sum())
    beyond_what = "the axis of revolution" if mesh.revolved else "a symmetry plane"
    said = [f"{count} of {len(places)} values lie beyond {beyond_what} and count as their mirror images"]
    return places, signs, said if count else []


def _inside(cloud: PointCloud, mesh: BodyMesh, film: Film, unit: StudyUnit) -> tuple[IntArray, list[str]]:
    """Return the points whose places lie in the body, and a note on the others.

    Raises
    ------
    ConfigurationError
        The share of the others is too large.
    """
    distinct, of = np.unique(cloud.places, axis=0, return_inverse=True)
    inside = (BodyPoints.at(mesh, distinct).beyond <= EDGE)[of.reshape(-1)]
    count = int((~inside).sum())
    if not count:
        return np.flatnonzero(inside), []
    require_few_outside(cloud, ~inside, mesh, film.path.name, unit.name)
    return np.flatnonzero(inside), [outside_note(count, cloud)]


def outside_note(count: int, cloud: PointCloud) -> str:
    """Return the note on points of a cloud outside the body."""
    where = " at the given place of the camera" * cloud.unknown
    return f"{count} of {len(cloud)} values lie outside the body{where} and were left out"


def require_few_outside(
    cloud: PointCloud, outside: npt.NDArray[np.bool_], mesh: BodyMesh, name: str, unit: str
) -> None:
    """Refuse a film many of whose points lie outside the body, with the likely reason.

    Raises
    ------
    ConfigurationError
        More than the share that may do, those that are ``outside`` (n,).
    """
    if told := _complaint(cloud, outside, mesh, name, unit):
        raise ConfigurationError(f"outside: {told}")


def _complaint(
    cloud: PointCloud, outside: npt.NDArray[np.bool_], mesh: BodyMesh, name: str, unit: str
) -> str:
    """Return how many points lie outside the body, and the likely reason; empty where as many may."""
    count, places = int(outside.sum()), cloud.places
    if count <= cloud.outside * len(places):
        return ""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)

    def texts(point: Array) -> str:
        return units_now().texts(point, "displacement", 4)

    advice = _likely(places, low, high, unit, cloud.hindrance)
    if cloud.unknown or count < FEW * len(places):
        advice += f"; where the others count, raise 'outside:', which is {cloud.outside:g}"
    return (
        f"{count} of {len(places)} values of {name} lie outside the body, more than the share {cloud.outside:g}: the "
        f"points reach from {texts(places.min(axis=0))} to {texts(places.max(axis=0))}, the body from {texts(low)} to "
        f"{texts(high)}; {advice}"
    )


def _deformed_notes(
    cloud: PointCloud, u: Array, mesh: BodyMesh, film: Film, unit: StudyUnit
) -> Iterator[str]:
    """Yield that too many places less measured displacements (n, 3), small ones, lie outside the undeformed body."""
    if np.abs(u).max() > SMALL * float(np.ptp(mesh.points, axis=0).max()):
        return
    outside = BodyPoints.at(mesh, cloud.places - u).beyond > EDGE
    if told := _complaint(cloud, outside, mesh, film.path.name, unit.name):
        yield f"{told}; this is so by the measured displacements, and is refused if it is so at the start values"


def _fits(points: Array, low: Array, high: Array) -> bool:
    """Return True for points that lie in the box of a body, and extend over a part of it."""
    margin = 0.02 * float((high - low).max())
    inside = ((points >= low - margin) & (points <= high + margin)).all(axis=1)
    return bool(inside.mean() >= FITS) and bool((np.ptp(points, axis=0) > LARGE * (high - low)).any())


def _likely(places: Array, low: Array, high: Array, unit: str, hindrance: str) -> str:
    """Return the advice on places outside the box of a body; ``hindrance`` is that of mirror images."""
    extent, margin = np.ptp(places, axis=0), 0.02 * float((high - low).max())
    small = bool((extent <= high - low + margin).all())
    offset = "'camera.offset:', the origin of their axes in the body"

    def fits(points: Array) -> bool:
        return _fits(points, low, high)

    if fits(places):
        return f"most of them fit: check {offset}"
    for power in (-3, 3, -6, 6):
        if fits(places * 10.0**power):
            told = f"got {echo(unit)}" if unit else "which is not given"
            return (
                f"they would fit if they were {10.0**power:g} times as large: check the unit of the places, 'unit:', "
                f"{told}"
            )
    for order in permutations(range(3)):
        if order != (0, 1, 2) and fits(places[:, order]):
            axes = ", ".join(f"{a}: {'xyz'[b]}" for a, b in zip("xyz", order, strict=True))
            return (
                f"they would fit with other axes: check the columns, such as 'columns: {{{axes}}}', or "
                "'camera.rotation:'"
            )
    for axis in range(3):
        for side, plane in (("-", low), ("+", high)):
            mirrored = places.copy()
            beyond = places[:, axis] < low[axis] if side == "-" else places[:, axis] > high[axis]
            mirrored[beyond, axis] = 2 * plane[axis] - places[beyond, axis]
            if high[axis] > low[axis] and fits(mirrored):
                where = f"beyond {'xyz'[axis]}{side}"
                other = f", or give {offset}" * small
                if hindrance:
                    return (
                        f"they would fit as mirror images {where}, which do not count with a camera that is "
                        f"{hindrance}: keep one side{other}"
                    )
                return (
                    f"they would fit if the body had its mirror image {where}: name that symmetry plane in "
                    f"'macro.body.symmetry: [{'xyz'[axis]}{side}]', or keep one side{other}"
                )
    if small:
        return f"they would fit at another place: give {offset}"
    return "check 'unit:', the columns of the places, and 'camera:'"


def _small_notes(places: Array, mesh: BodyMesh, unit: str) -> Iterator[str]:
    """Yield that the places of a film are next to one point of the body, as in a wrong unit."""
    size, edge = float(np.ptp(places, axis=0).max()), float(np.ptp(mesh.points, axis=0).max())
    if len(places) > 1 and size < SMALL * edge:
        units = units_now()
        low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
        powers = [p for p in (3, 6) if size and _fits(places * 10.0**p, low, high)]
        yield (
            f"the points extend over {units.text(size, 'displacement', 3)}, and the body over "
            f"{units.text(edge, 'displacement', 3)}; "
            + (f"they would span it if they were {10 ** powers[0]} times as large; " if powers else "")
            + f"check the unit of the places, 'unit:' or the heading, got {echo(unit) if unit else 'none'}"
        )


def _without_twins(cloud: PointCloud, mesh: BodyMesh) -> tuple[PointCloud, IntArray, list[str]]:
    """Return the cloud with each place at a time once, the point of each row (n,), and a note."""
    size = float(np.ptp(mesh.points, axis=0).max())
    key = np.column_stack([cloud.times, np.rint(cloud.places / (SAME_PLACE * size))])
    _, first, of = np.unique(key, axis=0, return_index=True, return_inverse=True)
    of = of.reshape(-1)
    # In the order of the rows, in which the times ascend.
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    twins = len(cloud) - len(first)
    said = f"{twins} values have the place and the time of another one; the means of such values count"
    return cloud.kept(np.sort(first)), rank[of], [said] * (twins > 0)


def _curve(
    settings: PointsSettings,
    film: Film,
    units: _Units,
    cloud: PointCloud,
    sets: IntArray,
    rows: IntArray,
    signs: Array,
    component: int,
    synthetic: bool,
    files: DataFile | None,
) -> ObservedCurve:
    """Return the curve of one component; ``sets`` has the point of each row."""
    name, unit, count = COMPONENTS[component], units.of(component), len(cloud)
    deviations = _deviations(settings, film, unit, component)[rows]
    values = film.columns[name][rows]
    values = values * signs[:, component] if component < PRESSURE else values
    known = np.isfinite(deviations) & (np.isfinite(values) | synthetic)
    precision = np.bincount(sets[known], 1 / deviations[known] ** 2, count)
    times_there = np.bincount(sets[known], minlength=count)
    picked = np.flatnonzero(times_there)
    if len(picked) < FEWEST:
        raise ConfigurationError(
            f"file: expected at least {FEWEST} values of {name} that count, got {len(picked)} in {film.path}; check "
            "its columns"
        )
    measured = None
    if not (synthetic and settings.file is None):
        sums = np.bincount(sets[known], np.where(known, values, 0.0)[known] / deviations[known] ** 2, count)
        measured = sums[picked] / precision[picked]
    lost = int((~known).sum())
    every = None if len(picked) == count else picked
    series = FilmComponent(cloud, component, every)
    title = f"{cloud.name}: {name}"
    return ObservedCurve(
        title,
        series,
        series.of_points(cloud.times),
        unit.name,
        units.time.name,
        unit.factor,
        units.time.factor,
        np.full(len(picked), settings.weight),
        measured,
        # The mean of values at one place is as certain as all of them.
        1 / np.sqrt(precision[picked]),
        None,
        (f"{lost} of {len(rows)} values of {name} are missing, and were left out",) * (lost > 0),
        files,
    )


def _deviations(settings: PointsSettings, film: Film, unit: StudyUnit, component: int) -> Array:
    """Return the standard deviations (rows,) of a component, in its unit."""
    name = COMPONENTS[component]
    column: Any = f"{name}_deviation"
    key = "pressure_deviation" if component == PRESSURE else "deviation"
    given = settings.pressure_deviation if component == PRESSURE else settings.deviation
    if column in film.columns:
        if given is not None:
            raise ConfigurationError(
                f"{key}: {film.path} has a column of the standard deviations of {name}; remove the key or the column"
            )
        found = film.columns[column]
        bad = np.flatnonzero(np.isfinite(found) & (found <= 0))
        if len(bad):
            raise ConfigurationError(
                f"{film.at(int(bad[0]), column)}: expected a number above 0, got {found[bad[0]]:g}; remove a row that "
                "does not count"
            )
        return found
    if given is None:
        raise ConfigurationError(
            f"{key}: missing; give the standard deviation of {name}, or a column '{column}' of the file"
        )
    one = unit.converted(key, given)
    if one <= 0:
        raise ConfigurationError(f"{key}: expected a number above 0, got {echo(given)}")
    return np.full(len(film), one)


def _planned(settings: PointsSettings, mesh: BodyMesh, scales: Scales | None) -> Film:
    """Return places and times of a film that has no file, with values that are not known."""
    assert settings.grid is not None
    assert settings.times is not None
    time = StudyUnit.at_key("time_unit", settings.time_unit or "", "time", scales)
    unit = StudyUnit.at_key("unit", settings.unit or "", "displacement", scales)
    times = planned_times(settings.times, time)
    low, high = mesh.points.min(axis=0) * unit.factor, mesh.points.max(axis=0) * unit.factor
    lines = [
        a + (b - a) * (np.arange(n if b > a else 1) + 0.5) / n
        for a, b, n in zip(low, high, settings.grid, strict=True)
    ]
    for axis, value in settings.fixed.items():
        lines["xyz".index(axis)] = np.array([unit.converted(f"fixed.{axis}", value)])
    grid = np.stack([part.ravel() for part in np.meshgrid(*lines, indexing="ij")], axis=1)
    grid = grid[BodyPoints.at(mesh, grid / unit.factor).inside]
    if not len(grid) or len(grid) * len(times) > MOST_ROWS:
        raise ConfigurationError(
            f"grid: expected 1 to {MOST_ROWS} values at points within the body, got {len(grid) * len(times)}; change "
            "the numbers"
        )
    every = np.tile(grid, (len(times), 1))
    columns: dict[Column, Array] = dict(zip(COORDINATES, every.T, strict=True))
    columns["t"] = np.repeat(times, len(grid))
    for name in settings.quantities or ("u1", "u2", "u3"):
        columns[name] = np.zeros(len(every))
    return Film(Path("the synthetic film"), columns)


def _measured(settings: PointsSettings, folder: Path, scales: Scales | None) -> tuple[Film, DataFile]:
    """Return the columns of the file, or of all files of a pattern, and a record of these."""
    assert settings.file is not None
    path = folder / settings.file
    if not re.search(r"[*?\[]", settings.file):
        (film,) = _with_frames([_read(path, settings)], [path], settings, scales)
        return film, DataFile.of(path, settings.file, len(film))
    paths = sorted(folder.glob(settings.file), key=_natural)
    if not paths:
        raise ConfigurationError(
            f"file: no file is called {echo(settings.file)} in {folder}; check the pattern"
        )
    films = _with_frames([_read(each, settings) for each in paths], paths, settings, scales)
    names = set(films[0].columns)
    for film, each in zip(films, paths, strict=True):
        if set(film.columns) != names or dict(film.units) != dict(films[0].units):
            raise ConfigurationError(
                f"{each}: expected the columns and units of {paths[0].name}, {joined(sorted(names))}, got "
                f"{joined(sorted(film.columns))}; write all files alike"
            )
    columns = {name: np.concatenate([film.columns[name] for film in films]) for name in films[0].columns}
    total = hashlib.sha256(b"".join(hashlib.sha256(each.read_bytes()).digest() for each in paths))
    film = Film(path, columns, films[0].units)
    size = sum(each.stat().st_size for each in paths)
    return film, DataFile(settings.file, len(film), size, total.hexdigest())


def _with_frames(
    films: list[Film], paths: Sequence[Path], settings: PointsSettings, scales: Scales | None
) -> list[Film]:
    """Return the columns of files with the time that the settings give for each."""
    if not settings.frames:
        return films
    if len(settings.frames) != len(paths):
        named = f"each file from {paths[0].name} to {paths[-1].name}" if len(paths) > 1 else paths[0].name
        raise ConfigurationError(
            f"frames: expected {len(paths)} time{'s, one' * (len(paths) > 1)} for {named}, got {len(settings.frames)}"
        )
    if "t" in films[0].columns:
        raise ConfigurationError(
            f"frames: {paths[0].name} has a column of times; remove the key or the column"
        )
    unit = StudyUnit.at_key("time_unit", settings.time_unit or "", "time", scales)
    times = [unit.converted("frames", value) for value in settings.frames]
    return [
        replace(film, columns={**film.columns, "t": np.full(len(film), time)})
        for film, time in zip(films, times, strict=True)
    ]


def _natural(path: Path) -> list[tuple[int, int | str]]:
    """Return a key that puts frame 2 before frame 10."""
    parts = re.split(r"([0-9]+)", path.name)
    return [(0, int(part)) if part.isdecimal() else (1, part) for part in parts]


def _with_fixed(film: Film, settings: PointsSettings, mesh: BodyMesh, unit: StudyUnit) -> Film:
    """Return the film with the coordinates that all points have."""
    columns = dict(film.columns)
    for axis, value in settings.fixed.items():
        if axis in columns and settings.file is not None:
            raise ConfigurationError(
                f"fixed.{axis}: {film.path} has a column of this coordinate; remove the key or rename the column"
            )
        columns[axis] = np.full(len(film), unit.converted(f"fixed.{axis}", value))
    if "z" not in columns and not np.ptp(mesh.points[:, 2]):
        columns["z"] = np.zeros(len(film))
    return replace(film, columns=columns)


def _read(path: Path, settings: PointsSettings) -> Film:
    """Return the columns of one file."""
    try:
        require_ordinary(path, LARGEST_FILM)
    except OSError as error:
        raise ConfigurationError(
            f"file: {path} cannot be read: {error.strerror or error}; give the file of the field"
        ) from None
    suffix = path.suffix.lower()
    if suffix == ".npz":
        return _read_npz(path, settings)
    if suffix in (".vtu", ".vtk", ".xdmf"):
        return _read_mesh(path, settings)
    return _read_csv(path, settings)


def _read_csv(path: Path, settings: PointsSettings) -> Film:
    text, guess = decoded_text(path, settings.encoding, LARGEST_FILM)
    lines = text.splitlines()
    wanted = {c: settings.columns.get(c, c) for c in get_args(Column)}
    head = CurveTable.of_text(path, "\n".join(lines[:HEAD]), guess, list(wanted.values()), has_keys=False)
    at: dict[Column, int] = {}
    for column, name in wanted.items():
        if column in settings.columns or any(each.is_called(name) for each in head.headings):
            at[column] = head.find(name)
    missing = {*MISSING, *(each.strip().casefold() for each in settings.missing)}
    first = head.lines[0]
    rows, numbers = [], []
    for k, row in enumerate(csv.reader(lines[first - 1 :], delimiter=head.separator), start=first):
        if not any(map(str.strip, row)) or row[0].lstrip().startswith("#"):
            continue
        if len(row) <= max(at.values()):
            raise ConfigurationError(
                f"{path}:{k}: expected {len(head.headings)} entries, one for each heading in line {head.line}, got "
                f"{len(row)}; remove the line"
            )
        rows.append(row)
        numbers.append(k)
    if len(rows) > MOST_ROWS:
        raise ConfigurationError(f"{path}: expected at most {MOST_ROWS} rows, got {len(rows)}; keep fewer")
    comma = _has_commas(path, head.names, rows, numbers, at.values())
    columns = {
        column: _numbers(path, head.names[k], [row[k] for row in rows], numbers, missing, comma)
        for column, k in at.items()
    }
    units = {column: head.headings[k].unit for column, k in at.items()}
    return Film(path, columns, units, np.array(numbers))


def _has_commas(
    path: Path, names: Sequence[str], rows: Sequence[Sequence[str]], lines: Sequence[int], read: Iterable[int]
) -> bool:
    """Return True for a file with decimal commas.

    Raises
    ------
    ConfigurationError
        It has decimal points, too, or all commas may stand between groups of three digits.
    """
    read = list(read)
    marked = {
        mark: next(
            ((i, k) for i, row in enumerate(rows) for k in read if mark in row[k] and _is_number(row[k])),
            None,
        )
        for mark in ",."
    }
    (comma, point), at = (marked[","], marked["."]), f"{path}:"
    if comma is None:
        return False
    i, k = comma
    if point is not None:
        # The mark of fewer numbers is the odd one; a number with both is no example of the other.
        many, few = sorted(
            ".,", key=lambda m: -sum(m in row[c] for row in rows for c in read if _is_number(row[c]))
        )
        (i, k), wanted = (comma, "points") if few == "," else (point, "commas")
        every = ((j, c) for j, row in enumerate(rows) for c in read if many in row[c] and few not in row[c])
        others = ((rows[j][c].strip(), lines[j]) for j, c in every if _is_number(rows[j][c]))
        example = next((f", as in {echo(text)} in line {line}" for text, line in others), "")
        raise ConfigurationError(
            f"{at}{lines[i]}: {names[k]}: expected decimal {wanted}{example}, got {echo(rows[i][k].strip())}; write "
            "all numbers of the file with points, or all with commas, and none between groups of digits"
        )
    if all(_GROUPED.fullmatch(row[c].strip()) for row in rows for c in read if "," in row[c]):
        raise ConfigurationError(
            f"{at}{lines[i]}: {names[k]}: {echo(rows[i][k].strip())} may have a decimal comma or one between groups of "
            "digits, and no number of the file decides it; write decimal points"
        )
    return True


def _is_number(text: str) -> bool:
    """Return True for a number with points and commas of any meaning."""
    try:
        float(text.replace(",", "").replace(".", ""))
    except ValueError:
        return False
    return True


def _numbers(
    path: Path, name: str, texts: Sequence[str], lines: Sequence[int], missing: set[str], comma: bool
) -> Array:
    """Return the numbers of a column, NaN where one is missing."""
    found = np.empty(len(texts))
    for k, text in enumerate(texts):
        plain = text.strip()
        if plain.casefold() in missing:
            found[k] = np.nan
            continue
        try:
            found[k] = float(plain.replace(",", ".") if comma else plain)
            sound = math.isfinite(found[k])
        except ValueError:
            sound = False
        if not sound:
            advice = f"leave out such values by 'missing: [{plain!r}]', or remove the row"
            if Heading.read(plain).name.casefold() == name.casefold():
                advice = "keep one table in the file"
            raise ConfigurationError(
                f"{path}:{lines[k]}: {name}: expected a finite number, got {echo(text)}; {advice}"
            )
    return found


def _read_npz(path: Path, settings: PointsSettings) -> Film:
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(each.file_size for each in archive.infolist())
        if size > LARGEST_FILM:
            raise ValueError(f"it holds {size} bytes, and at most {LARGEST_FILM} are read")
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in file.files}
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError) as error:
        raise ConfigurationError(
            f"file: {path} is no readable NPZ file of plain arrays: {error}; write it with numpy.savez"
        ) from None
    found = _picked(path, arrays, settings)
    if "t" in found and found["t"].ndim == 1:
        times = found["t"]
        for column, values in found.items():
            # Times come first, before the axes of an image correlation's grid.
            if column != "t" and values.ndim > 1 and values.shape[0] == len(times):
                found["t"] = times.reshape(-1, *[1] * (values.ndim - 1))
                break
    try:
        shape = np.broadcast_shapes(*(values.shape for values in found.values()))
    except ValueError:
        shapes = joined(f"{column} {values.shape}" for column, values in found.items())
        raise ConfigurationError(
            f"file: expected arrays of {path} that have one shape, or times first, got {shapes}"
        ) from None
    if math.prod(shape) > MOST_ROWS:
        raise ConfigurationError(
            f"file: expected at most {MOST_ROWS} values in {path}, got {math.prod(shape)}"
        )
    whole: dict[Column, Array] = {}
    for column, values in found.items():
        whole[column] = np.broadcast_to(values, shape).ravel()
    return Film(path, whole)


def _read_mesh(path: Path, settings: PointsSettings) -> Film:
    points, arrays = read_point_data(path)
    for column, values in zip(COORDINATES, points.T, strict=False):
        arrays.setdefault(column, values)
    found = _picked(path, arrays, settings)
    for column, values in found.items():
        if values.shape != (len(points),):
            raise ConfigurationError(
                f"columns: expected one number at each of the {len(points)} points of {path} for {echo(column)}, got "
                f"the shape {values.shape}; name a component, such as 'NAME[0]'"
            )
    return Film(path, found)


def _picked(path: Path, arrays: Mapping[str, Any], settings: PointsSettings) -> dict[Column, Array]:
    """Return the arrays that columns name, components of vectors among them."""
    named: dict[Column, str] = {}
    for column in get_args(Column):
        if column in settings.columns:
            named[column] = settings.columns[column]
        elif column in arrays:
            named[column] = column
    vector = next((each for each in VECTORS if each in arrays), None)
    if vector is not None and not any(c in named for c in ("u1", "u2", "u3")):
        width = min(np.shape(arrays[vector])[-1] if np.ndim(arrays[vector]) > 1 else 0, 3)
        named |= {column: f"{vector}[{i}]" for i, column in enumerate(COMPONENTS[:width])}
    found: dict[Column, Array] = {}
    for column, name in named.items():
        part = None if name in arrays else _PART.fullmatch(name)
        of = name if part is None else part["name"]
        if of not in arrays:
            raise ConfigurationError(
                f"columns.{column}: {path} has no data {echo(of)}; {suggestion(of, arrays, 'there are')}"
            )
        values = arrays[of]
        if part is not None:
            if values.ndim < 2 or int(part["part"]) >= values.shape[-1]:
                raise ConfigurationError(
                    f"columns.{column}: {echo(of)} in {path} has the shape {values.shape}, and no component "
                    f"{part['part']}"
                )
            values = values[..., int(part["part"])]
        if values.dtype.kind not in "fiu":
            raise ConfigurationError(
                f"columns.{column}: expected numbers in {echo(of)} of {path}, got {values.dtype}"
            )
        if np.isinf(values).any():
            raise ConfigurationError(
                f"columns.{column}: expected finite numbers in {echo(of)} of {path}, and NaN where one is missing, got "
                f"infinity in value {int(np.flatnonzero(np.isinf(values))[0]) + 1}; write NaN there"
            )
        found[column] = values.astype(float)
    if not found:
        raise ConfigurationError(
            f"columns: {path} has none of the columns {joined(POINT)}, u1, u2, u3 and p; it has "
            f"{joined(sorted(arrays)) or 'none'}"
        )
    return found
