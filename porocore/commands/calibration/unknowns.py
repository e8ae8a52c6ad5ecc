"""Unknowns of a calibration: numbers and control values of fields, where they act, ranges, priors, first values."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from itertools import chain, pairwise, product
from typing import Any, get_args

import numpy as np
from annotated_types import Ge, Gt
from pydantic import ValidationError
from pydantic.fields import FieldInfo

from porocore.cell.family.family import possible_parameters
from porocore.commands.calibration.clouds import FilmComponent
from porocore.commands.calibration.observations import ObservedCurve, StudyUnit
from porocore.commands.calibration.plan import (
    AXES,
    Experiment,
    NumberKind,
    PlannedUnknown,
    StudyNumber,
    with_indenter,
)
from porocore.commands.calibration.problem import NormalPrior, Scale, Unknown
from porocore.commands.calibration.settings import (
    CalibrationSettings,
    CameraSettings,
    Column,
    ControlSettings,
    ObservationSettings,
    PointsSettings,
    PriorSettings,
    SyntheticTimes,
    UnknownSettings,
)
from porocore.core.echo import echo, joined, suggestion
from porocore.core.files.yaml_document import Location, dotted
from porocore.core.formulas import TimeFunction
from porocore.core.models.strict import walk
from porocore.core.units import (
    NO_SCALES,
    QUANTITIES,
    ResultUnits,
    UnitError,
    dimensions,
    in_si,
    length_text,
    number_or_quantity,
    pretty,
    unit_in_si,
    unit_within,
    using_units,
    value_of,
)
from porocore.errors import ConfigurationError
from porocore.interfaces.sensitivities import HatFunction
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.boundary.conditions import boundary_data
from porocore.macro.composition.fields import Points, as_field
from porocore.macro.composition.law_numbers import RELAXATION, is_of_the_law, quantity_of_number
from porocore.macro.laws.charges import BATH, DENSITY
from porocore.macro.problem import body_mesh
from porocore.states import Array
from porocore.study.config.config import MacroSettings, RunConfig
from porocore.study.sweep.plan import quantities_of

#: Numbers with a name of their own, with their quantities.
OWN: dict[NumberKind, str] = {
    "modulus": "stress",
    "viscosity": "viscosity",
    "pore": "pore-size",
    "load": "",
    "time_shift": "time",
}
#: Kinds of numbers of the law of the body beside those of the cell.
OF_THE_LAW: tuple[NumberKind, ...] = ("law", "law_field")
#: Keys of the motion of an indenter, below its name.
MOTIONS = (("displacement",), ("force",))
#: Keys of an unknown and of an observation, with which complaints begin.
_KEYS = {
    *UnknownSettings.model_fields,
    *ObservationSettings.model_fields,
    *PointsSettings.model_fields,
    *(f"camera.{name}" for name in CameraSettings.model_fields),
    *(f"columns.{name}" for name in get_args(Column)),
    *(f"fixed.{name}" for name in AXES),
    *(f"prior.{name}" for name in PriorSettings.model_fields),
    *(f"times.{name}" for name in SyntheticTimes.model_fields),
    *(f"field.{name}" for name in ControlSettings.model_fields),
    *(f"field.grid.{name}" for name in AXES),
}
#: Factors of one number in two experiments that are the same.
SAME = 1e-9
#: Largest weight in the body below which a control value hardly counts.
SLIGHT = 0.05


@contextmanager
def keyed(key: str) -> Iterator[None]:
    """Put a key before every complaint that the block raises; one that begins with a key below it is joined to it."""
    try:
        yield
    except ConfigurationError as error:
        text = str(error)
        raise ConfigurationError(f"{key}{'.' if text.partition(': ')[0] in _KEYS else ': '}{text}") from None


def planned_unknowns(
    settings: CalibrationSettings, experiments: Mapping[str, Experiment], at: Location
) -> list[PlannedUnknown]:
    """Return the unknowns of a calibration; ``at`` is the location of its section.

    Raises
    ------
    ConfigurationError
        A number does not exist, bounds are empty or the first value lies outside, a unit is wrong, or two unknowns are
        one number.
    """
    planned: list[PlannedUnknown] = []
    for name, given in settings.unknowns.items():
        with keyed(dotted((*at, "unknowns", name))):
            found = _planned(name, given, experiments)
            for one, other in product(found, planned):
                _require_apart(one, other)
            planned += found
    return planned


def _require_apart(one: PlannedUnknown, other: PlannedUnknown) -> None:
    """Refuse two unknowns that have one name or are one number."""
    for experiment, number in one.numbers.items():
        if experiment in other.numbers and other.numbers[experiment].name == number.name:
            raise ConfigurationError(
                f"'{other.unknown.name}' is the same number of the study; keep one, or give each 'experiments:' of its "
                "own"
            )
    if one.unknown.name == other.unknown.name:
        raise ConfigurationError(
            f"another unknown has a value that is called '{one.unknown.name}'; rename one"
        )


def _planned(
    name: str, given: UnknownSettings, experiments: Mapping[str, Experiment]
) -> list[PlannedUnknown]:
    """Return an unknown, or those of the control values of a field."""
    for one in given.experiments:
        if one not in experiments:
            advice = suggestion(one, filter(None, experiments), "the experiments are", "there is one alone")
            raise ConfigurationError(f"experiments: no experiment is called {echo(one)}; {advice}")
    numbers: dict[str, StudyNumber] = {}
    text, chosen = given.of or name, {one: experiments[one] for one in given.experiments or experiments}
    for one, experiment in chosen.items():
        with keyed("of") if given.of is not None else nullcontext():
            numbers[one] = (
                study_number(text, experiment.config, experiment.load)
                if given.field is None
                else field_number(text, experiment.config)
            )
    if given.field is None:
        return [_unknown(name, given, numbers, experiments)]
    controls = [control_numbers(numbers[one], given.field, chosen[one].config) for one in numbers]
    return [
        _unknown(f"{name}[{i}]", given, dict(zip(numbers, each, strict=True)), experiments, control=i)
        for i, each in enumerate(zip(*controls, strict=True))
    ]


class _Values:
    """Values of one unknown, in one unit: that of the first value that has one; empty for dimensionless values.

    Raises
    ------
    ConfigurationError
        The unit is none of the quantity, a study has no scales, or plain numbers mean something else in another
        experiment.
    """

    def __init__(
        self,
        given: UnknownSettings,
        numbers: Mapping[str, StudyNumber],
        experiments: Mapping[str, Experiment],
    ) -> None:
        self.given, self.number = given, next(iter(numbers.values()))
        self.config = experiments[next(iter(numbers))].config
        is_logarithmic = self.number.is_scale or _of_a_branch(self.number, "time")
        self.scale: Scale = given.scale or ("log" if is_logarithmic else "linear")
        prior = [] if given.prior is None else [given.prior.mean]
        starts = [given.start] if given.field is None else [given.start, *given.field.start]
        texts = [text for text in (given.lower, given.upper, *starts, *prior) if isinstance(text, str)]
        self.unit = next(filter(None, map(unit_within, texts)), "")
        self._require_a_unit(numbers, experiments)

    def _require_a_unit(
        self, numbers: Mapping[str, StudyNumber], experiments: Mapping[str, Experiment]
    ) -> None:
        quantity = self.number.quantity
        if self.unit and not quantity:
            raise ConfigurationError(f"expected plain numbers, got {echo(self.unit)} as a unit")
        if self.unit:
            try:
                unit_in_si(self.unit, quantity)
            except UnitError as error:
                raise ConfigurationError(f"lower: {error}") from None
        found = {name: experiments[name].config.scales for name in numbers}
        if self.unit and (without := [name for name, scales in found.items() if scales is None]):
            of = f" of the experiment '{without[0]}'" if without[0] else ""
            raise ConfigurationError(f"lower: {echo(self.given.lower)} {NO_SCALES}{of}")
        if self.unit or not quantity:
            return
        factors = {1.0 if s is None else float(QUANTITIES[quantity].factor(s.exact)) for s in found.values()}
        if max(factors) - min(factors) > SAME * max(factors):
            raise ConfigurationError(
                "expected values with a unit, since the experiments have other scales, so that a plain number means "
                "something else in each"
            )

    def read(self, key: str, value: float | str) -> float:
        """Return a value in the unit."""
        try:
            value = number_or_quantity(value)
            if isinstance(value, str):
                return float(in_si(value, self.number.quantity) / unit_in_si(self.unit, self.number.quantity))
        except UnitError as error:
            raise ConfigurationError(f"{key}: {error}") from None
        if self.unit:
            raise ConfigurationError(
                f"{key}: expected a value with a unit, such as {value:g} {self.unit}, got {value:g}"
            )
        return value

    def positive(self, key: str, value: float | str) -> float:
        """Return a value in the unit, which must be above 0."""
        return _positive(key, value, self.read(key, value))

    def deviation(self, key: str, value: float | str) -> float:
        """Return a standard deviation of the coordinate."""
        if self.scale == "linear":
            return self.positive(key, value)
        if isinstance(value, str):
            raise ConfigurationError(
                f"{key}: expected a plain number, that of ln x, such as 0.2, got {echo(value)}"
            )
        return _positive(key, value, float(value))

    def bounds(self) -> tuple[float, float]:
        """Return both bounds.

        Raises
        ------
        ConfigurationError
            They are empty, or the lower one is not above 0 for a number that must be; bounds of a number of the
            boundary hold 0.
        """
        given, number = self.given, self.number
        lower, upper = self.read("lower", given.lower), self.read("upper", given.upper)
        if not lower < upper:
            raise ConfigurationError(
                f"expected lower < upper, got {echo(given.lower)} and {echo(given.upper)}"
            )
        if lower > 0:
            return lower, upper
        is_radius = number.kind == "indenter" and number.path[-1] == "radius"
        if (
            number.is_scale
            or is_radius
            or (number.kind in OF_THE_LAW and (number.name == BATH or _of_a_branch(number, "time")))
            or (number.kind == "cell" and declared_positive(number.name, self.config))
        ):
            raise ConfigurationError(
                f"lower: expected a number above 0, as every value of {echo(number.name)} is, got {echo(given.lower)}; "
                "give the least one that is possible"
            )
        not_negative = number.name == DENSITY or _of_a_branch(number, "strength")
        if number.kind in OF_THE_LAW and not_negative and lower < 0:
            raise ConfigurationError(
                f"lower: expected a number of at least 0, as every value of {echo(number.name)} is, got "
                f"{echo(given.lower)}"
            )
        if number.kind == "boundary" and self.scale == "linear" and not upper < 0:
            raise ConfigurationError(
                f"expected bounds of one sign for {echo(number.name)}, whose derivatives are taken relative to it, got "
                f"{echo(given.lower)} and {echo(given.upper)}; leave out 0"
            )
        if self.scale == "log":
            raise ConfigurationError(
                f"lower: expected a number above 0 for a search in ln x, got {echo(given.lower)}; or scale: linear"
            )
        return lower, upper

    def prior(self) -> NormalPrior | None:
        """Return the prior."""
        if self.given.prior is None:
            return None
        key, mean, logarithmic = "prior.mean", self.given.prior.mean, self.scale == "log"
        found = math.log(self.positive(key, mean)) if logarithmic else self.read(key, mean)
        return NormalPrior(found, self.deviation("prior.deviation", self.given.prior.deviation))

    def start(self, control: int | None) -> tuple[str, float | str | None]:
        """Return the first value as it is given, and its key; None: it is that of the study."""
        field = self.given.field
        if control is None or field is None or not field.start:
            return "start", self.given.start
        if self.given.start is not None:
            raise ConfigurationError("start: the first values stand in field.start too; keep one of the two")
        count = math.prod(map(len, field.lines.values()))
        if len(field.start) != count:
            raise ConfigurationError(
                f"field.start: expected {count} values, one for each coordinate, got {len(field.start)}"
            )
        return "field.start", field.start[control]


def _neighbours(given: UnknownSettings, control: int | None) -> tuple[int, ...]:
    """Return how many control values before one its neighbours stand; the first of all has none."""
    if control is None or given.field is None:
        return ()
    found, stride = [], 1
    for line in given.field.lines.values():
        if control // stride % len(line):
            found.append(stride)
        stride *= len(line)
    return tuple(found)


def _of_a_branch(number: StudyNumber, what: str) -> bool:
    """Return whether a number is the ``strength`` or ``time`` of a branch of the relaxation."""
    parts = number.name.split(".")
    return number.kind == "law" and (parts[0], parts[-1]) == (RELAXATION, what)


def _positive(key: str, value: float | str, number: float) -> float:
    if number <= 0:
        raise ConfigurationError(f"{key}: expected a number above 0, got {echo(value)}")
    return number


def _unknown(
    name: str,
    given: UnknownSettings,
    numbers: dict[str, StudyNumber],
    experiments: Mapping[str, Experiment],
    control: int | None = None,
) -> PlannedUnknown:
    """Return an unknown; ``control`` is the place of a control value in its field."""
    values = _Values(given, numbers, experiments)
    lower, upper = values.bounds()
    prior, smoothing = values.prior(), None if given.field is None else given.field.smoothing
    before = _neighbours(given, control)
    spread = values.deviation("field.smoothing", smoothing) if before and smoothing is not None else None
    resolution = None if given.resolution is None else values.positive("resolution", given.resolution)
    unknown = Unknown(name, lower, lower, upper, values.scale, prior, values.unit, spread, before or (1,))
    found = PlannedUnknown(unknown, numbers, resolution)
    for experiment in numbers:
        if values.number.kind == "indenter":
            _require_outside(found, experiments[experiment])
    key, first = values.start(control)
    if first is not None:
        start = values.read(key, first)
        if not lower <= start <= upper:
            raise ConfigurationError(f"{key}: expected a value within the bounds, got {echo(first)}")
    else:
        start = values.number.value / found.dimensionless(experiments[next(iter(numbers))])
        if not lower < start < upper:
            start = math.sqrt(lower * upper) if values.scale == "log" else (lower + upper) / 2
    return replace(found, unknown=replace(unknown, start=start))


def _require_outside(planned: PlannedUnknown, experiment: Experiment) -> None:
    """Refuse bounds of an indenter's number that its shape excludes, or with which it begins inside the body."""
    number, macro = planned.numbers[experiment.name], experiment.config.macro
    mesh, factor = body_mesh(macro), planned.dimensionless(experiment)
    _, name, key = number.path
    with using_units(experiment.config.result_units):
        try:
            boundary_data(mesh, macro.problem(experiment.load))
        except ConfigurationError:
            return  # a fault of the study, which it is told of by its own
        for bound, value in (("lower", planned.unknown.lower), ("upper", planned.unknown.upper)):
            shape = macro.contact[name].shape
            if key == "radius":
                try:
                    type(shape).model_validate({**shape.model_dump(), "radius": factor * value})
                except ValidationError as error:
                    said = str(error.errors()[0]["msg"]).removeprefix("Value error, ")
                    raise ConfigurationError(f"{bound}: macro.contact.{name}.shape: {said}") from None
            with keyed(bound):
                boundary_data(mesh, with_indenter(macro, number, factor * value).problem(experiment.load))


#: Distance of the ends of an interval with which an unknown part of a camera's place is identifiable: as a share of the
#: largest edge of the body, and in degrees.
OFFSET_SHARE, DEGREES = 0.01, 1.0
#: Unit of angles.
DEGREE = "deg"
#: Largest unknown offset by default, as a share of the same.
OFFSET_BOUND = 0.1


def camera_unknowns(
    name: str,
    settings: PointsSettings,
    curve: ObservedCurve,
    unit: StudyUnit,
    config: RunConfig,
    experiment: str,
) -> list[PlannedUnknown]:
    """Return the unknown parts of the place of a camera, which begin at 0.

    Parameters
    ----------
    name, settings
        The measured field.
    curve
        One of its components.
    unit
        Of its places.
    config, experiment
        The study, and the name of the experiment.

    Raises
    ------
    ConfigurationError
        A part is there twice, or a bound is not above 0.
    """
    series, camera, found = curve.series, settings.camera, []
    assert isinstance(series, FilmComponent)
    if len(set(camera.unknown)) < len(camera.unknown):
        raise ConfigurationError("camera.unknown: a part is there twice; keep it once")
    edge = float(np.ptp(body_mesh(config.macro).points, axis=0).max()) * unit.factor
    bound = OFFSET_BOUND * edge
    if camera.offset_bound is not None:
        bound = unit.converted("camera.offset_bound", camera.offset_bound)
        _positive("camera.offset_bound", camera.offset_bound, bound)
    for part in camera.unknown:
        turned = part.startswith("r")
        most, own = (camera.rotation_bound, DEGREE) if turned else (bound, unit.name)
        called = f"{experiment}: {name}.camera.{part}" if experiment else f"{name}.camera.{part}"
        quantity = "" if turned else "displacement"
        number = StudyNumber("camera", called, quantity, 0.0, (series.cloud.name, part))
        unknown = Unknown(called, 0.0, -most, most, unit=own)
        found.append(
            PlannedUnknown(unknown, {experiment: number}, DEGREES if turned else OFFSET_SHARE * edge)
        )
    return found


def bounds_notes(planned: PlannedUnknown, experiments: Mapping[str, Experiment]) -> Iterator[str]:
    """Yield notes on bounds that leave out the number of the study, and on those without a unit in scales."""
    one, unit = planned.unknown, pretty(planned.unknown.unit)
    for name, number in planned.numbers.items():
        experiment = experiments[name]
        of = f" of the experiment '{name}'" if name else ""
        own, slack = number.value / planned.dimensionless(experiment), SAME * abs(one.upper - one.lower)
        if number.kind != "time_shift" and not one.lower - slack <= own <= one.upper + slack:
            said, value = f"{one.lower:.5g} to {one.upper:.5g} {unit}".rstrip(), f"{own:.4g} {unit}".rstrip()
            yield (
                f"unknown {one.name}: the bounds, {said}, leave out the value of the study{of}, {value}; check the "
                "bounds and their unit"
            )
        units = experiment.config.result_units
        if units.given and number.quantity and not one.unit:
            low, high, scale = (
                _in_units(value, number.quantity, units) for value in (one.lower, one.upper, 1.0)
            )
            yield (
                f"unknown {one.name}: its values have no unit, so they are multiples of {scale}{of}, with bounds at "
                f"{low} and {high}; write them with their unit"
            )


def _in_units(value: float, quantity: str, units: ResultUnits) -> str:
    """Return a dimensionless value in the units of a study; that of a pore in the one that suits it."""
    if quantity == "pore-size":
        return length_text(value * units.factor(quantity))
    return units.text(value, quantity)


def study_number(text: str, config: RunConfig, load: float) -> StudyNumber:
    """Return the number of a study that a text names.

    Parameters
    ----------
    text
        Such as ``radius``, ``modulus``, ``load``, ``boundary.y+.pressure`` or ``relaxation.1.time``.
    config, load
        The study and its load.

    Raises
    ------
    ConfigurationError
        There is no such number; similar ones are proposed.
    """
    cell = _cell_numbers(config)
    own = {
        "modulus": 1.0,
        "viscosity": config.cell.viscosity,
        "pore": 1.0,
        "load": load,
        "time_shift": 0.0,
    }
    boundary = {**_boundary_numbers(config.macro), **_indenter_numbers(config.macro), **_law_numbers(config)}
    for kind, quantity in OWN.items():
        if text == kind and not (kind == "viscosity" and _is_range(config, kind)):
            return StudyNumber(kind, text, quantity, own[kind])
    if text in cell:
        _require_one_value(text, config)
        return cell[text]
    if text in boundary:
        return boundary[text]
    names = [*(name for name in cell if name not in own), *own, *boundary]
    raise ConfigurationError(
        f"expected a number of the study, got {echo(text)}; {suggestion(text, names, 'the numbers are')}"
    )


def field_number(text: str, config: RunConfig) -> StudyNumber:
    """Return the parameter of the cell that a text names, which may differ within the body.

    Raises
    ------
    ConfigurationError
        There is no such parameter, or a region has its own value.
    """
    cell = _cell_numbers(config)
    if text not in cell:
        raise ConfigurationError(
            f"expected a parameter of the cell, which alone may be a field over the body, got {echo(text)}; "
            f"{suggestion(text, cell, 'the parameters are')}"
        )
    _require_no_regions(text, config)
    return cell[text]


def _is_range(config: RunConfig, name: str) -> bool:
    return any(parameter.name == name for parameter in config.cell.parameters)


def _cell_numbers(config: RunConfig) -> dict[str, StudyNumber]:
    """Return the numbers of the cell that may be parameters, with the values that the body has."""
    quantities = quantities_of(config.cell)
    base = {parameter.name: parameter.base for parameter in config.cell.parameters}
    own = {place.path: place.value for place in walk(type(config.cell), config.cell)}
    found = {}
    for path, name in possible_parameters(config.cell).items():
        given = config.macro.fields.get(name)
        value = float(given) if isinstance(given, float | int) else base.get(name, own[path])
        found[name] = StudyNumber("cell", name, quantities.get(name, ""), value)
    return found


def declared_positive(name: str, config: RunConfig) -> bool:
    """Return whether a parameter of the cell is declared to be above 0, as a radius is and a Poisson's ratio is not."""
    paths = {own: path for path, own in possible_parameters(config.cell).items()}
    place = next(each for each in walk(type(config.cell), config.cell) if each.path == paths[name])
    declared = [each.metadata if isinstance(each, FieldInfo) else [each] for each in place.metadata]
    zero: Any = 0.0  # the package declares no type of its limits that compares with a number
    return any(
        (isinstance(each, Gt) and each.gt >= zero) or (isinstance(each, Ge) and each.ge > zero)
        for each in chain.from_iterable(declared)
    )


def _require_one_value(name: str, config: RunConfig) -> None:
    """Refuse a parameter of the cell that differs within the body.

    Raises
    ------
    ConfigurationError
        It is a field, or has values of their own in regions.
    """
    given = config.macro.fields.get(name)
    if given is not None and not isinstance(given, float | int):
        raise ConfigurationError(
            f"{echo(name)} is a field over the body, which is no number; give a number in macro.fields.{name}, or "
            "'field:' with the coordinates of its control values"
        )
    _require_no_regions(name, config)


def _require_no_regions(name: str, config: RunConfig) -> None:
    """Refuse a parameter of the cell that has values of its own in regions."""
    for region, settings in config.macro.regions.items():
        if name in settings.fields:
            raise ConfigurationError(
                f"{echo(name)} has a value of its own in the region '{region}'; remove it there to fit that of the body"
            )


def _boundary_numbers(macro: MacroSettings) -> Mapping[str, StudyNumber]:
    """Return the prescribed numbers other than 0 by names such as ``boundary.y+.traction.y``, of indenters too."""
    found = {}
    for place, dimension in dimensions(type(macro), macro):
        value, path = place.value, place.path
        is_given = path[:1] == ("boundary",) or (path[:1] == ("contact",) and path[2:3] in MOTIONS)
        if not is_given or isinstance(value, bool) or not isinstance(value, float) or value == 0:
            continue
        if place.above is not None and isinstance(place.above.value, TimeFunction) and path[-1] != "ramp":
            continue
        if "table" in path:
            continue
        quantity = "" if dimension is None else dimension.quantity
        words = [AXES[int(part)] if part.isdigit() and part in "012" else part for part in path[2:]]
        name = ".".join((*path[:2], *words))
        found[name] = StudyNumber("boundary", name, quantity, value, path)
    return found


def _indenter_numbers(macro: MacroSettings) -> Mapping[str, StudyNumber]:
    """Return radius and offset of each indenter by names such as ``contact.ball.radius``."""
    found = {}
    for indenter, settings in macro.contact.items():
        numbers = {"offset": 0.0}
        if settings.shape.has_radius:
            numbers["radius"] = float(settings.shape.radius)  # type: ignore[union-attr]
        for key, value in numbers.items():
            name = f"contact.{indenter}.{key}"
            found[name] = StudyNumber("indenter", name, "displacement", value, ("contact", indenter, key))
    return found


def _law_numbers(config: RunConfig) -> Mapping[str, StudyNumber]:
    """Return the numbers of the law of the body beside those of the cell, by their names as parameters of the law.

    Of a field of place or time the number is its factor.
    """
    found, fields = {}, dict[str, Any](config.problem(1.0).fields)
    if config.macro.charges is not None:
        fields[BATH] = config.macro.charges.bath
    for name, given in fields.items():
        if not is_of_the_law(name):
            continue
        quantity = quantity_of_number(name, config.macro.evolution)
        found[name] = (
            StudyNumber("law", name, quantity, given)
            if isinstance(given, float)
            else StudyNumber("law_field", name, "", 1.0)
        )
    return found


def control_numbers(number: StudyNumber, given: ControlSettings, config: RunConfig) -> list[StudyNumber]:
    """Return the control values of a field as numbers of a study, with the values that the study has there.

    Parameters
    ----------
    number
        The parameter of the cell.
    given
        Axis and coordinates.
    config
        The study.

    Raises
    ------
    ConfigurationError
        The coordinates do not ascend, a control value concerns no point of the body, or the field of the study changes
        with time.
    """
    lines, mesh = _lines(given, config), body_mesh(config.macro)
    hats = HatFunction.grid(lines)
    _require_points(given, hats, mesh, config)
    values = _values_of_study(number, hats, mesh, config)
    return [replace(number, hat=hat, value=float(value)) for hat, value in zip(hats, values, strict=True)]


def _key_of_line(given: ControlSettings, axis: str) -> str:
    return "field.at" if given.along is not None else f"field.grid.{axis}"


def _lines(given: ControlSettings, config: RunConfig) -> dict[int, tuple[float, ...]]:
    """Return the coordinates of the control values, dimensionless, by the numbers of their axes."""
    return {
        AXES.index(axis): _places(_key_of_line(given, axis), at, config) for axis, at in given.lines.items()
    }


def _places(key: str, at: Sequence[float | str], config: RunConfig) -> tuple[float, ...]:
    """Return the coordinates along one axis, dimensionless."""
    try:
        found = tuple(
            value_of(each, "displacement", config.scales) if isinstance(each, str) else each for each in at
        )
    except UnitError as error:
        raise ConfigurationError(f"{key}: {error}") from None
    for k, (one, other) in enumerate(pairwise(found)):
        if not one < other:
            raise ConfigurationError(
                f"{key}: expected ascending coordinates, got {_text(at[k])} before {_text(at[k + 1])}"
            )
    return found


def _text(coordinate: float | str) -> str:
    return echo(coordinate) if isinstance(coordinate, str) else f"{coordinate:g}"


def _require_points(
    given: ControlSettings, hats: list[HatFunction], mesh: BodyMesh, config: RunConfig
) -> None:
    """Refuse a control value that holds at no point of the body."""
    points = mesh.quadrature_points.reshape(-1, 3)
    for hat in hats:
        if hat.values(points).any():
            continue
        rows = [(AXES[axis], given.lines[AXES[axis]][i]) for axis, i in zip(hat.axes, hat.index, strict=True)]
        named = [(axis, at if isinstance(at, str) else f"{at:g}") for axis, at in rows]
        place = named[0][1] if len(named) == 1 else ", ".join(f"{axis} = {at}" for axis, at in named)
        key = _key_of_line(given, rows[0][0]) if len(rows) == 1 else "field.grid"
        flat = [AXES[axis] for axis in hat.axes if not np.ptp(mesh.points[:, axis])]
        advice = (
            f"the body reaches {_reach(mesh, hat.axes, rows, config)}, and each value needs an element beside it; "
            "give fewer coordinates, or others"
        )
        if flat:
            advice = f"the body has no extent along {flat[0]}; leave out this axis"
        raise ConfigurationError(f"{key}: no point of the body has the value at {place}; {advice}")


def _reach(
    mesh: BodyMesh, axes: Sequence[int], rows: Sequence[tuple[str, float | str]], config: RunConfig
) -> str:
    """Return from where to where a body reaches along some axes, in units where coordinates have one."""
    in_units = any(isinstance(number_or_quantity(at), str) for _, at in rows)

    def text(value: float) -> str:
        return config.result_units.text(value, "displacement", 6) if in_units else f"{value:.6g}"

    ends = [(mesh.points[:, axis].min(), mesh.points[:, axis].max(), AXES[axis]) for axis in axes]
    found = ", ".join(f"from {text(low)} to {text(high)} along {axis}" for low, high, axis in ends)
    return found if in_units else f"{found}, dimensionless"


def reach_notes(planned: Sequence[PlannedUnknown], experiments: Mapping[str, Experiment]) -> Iterator[str]:
    """Yield notes on control values that hardly count anywhere in the body, since they stand far outside it."""
    for name, experiment in experiments.items():
        hats = {each.unknown.name: each.numbers[name].hat for each in planned if name in each.numbers}
        if not any(hats.values()):
            continue
        mesh = body_mesh(experiment.config.macro)
        points = np.concatenate([mesh.points, mesh.quadrature_points.reshape(-1, 3)])
        few = [one for one, hat in hats.items() if hat is not None and hat.values(points).max() < SLIGHT]
        if few:
            of = f" of the experiment '{name}'" if name else ""
            values = "control values" if len(few) > 1 else "control value"
            yield (
                f"{values} {joined(few)}: less than {100 * SLIGHT:g} % of the weight at every "
                f"point of the body{of}; check the coordinates of the field and their unit"
            )


def _values_of_study(
    number: StudyNumber, hats: list[HatFunction], mesh: BodyMesh, config: RunConfig
) -> Array:
    """Return the values at the control places, of a field of the study those at the body's middle along other axes."""
    own = config.macro.fields.get(number.name)
    if own is None or isinstance(own, float | int):
        return np.full(len(hats), number.value)
    key, field = f"macro.fields.{number.name}", as_field(own)
    if field.varies:
        raise ConfigurationError(
            f"field: {key} changes with time, which the fitted field would not; remove it, or give numbers"
        )
    middle = (mesh.points.min(axis=0) + mesh.points.max(axis=0)) / 2
    line = np.tile(middle, (len(hats), 1))
    for row, hat in zip(line, hats, strict=True):
        for axis, place in hat.node.items():
            row[axis] = place
    return field.reached(Points(line, line, np.arange(len(line))), 0.0, key)
