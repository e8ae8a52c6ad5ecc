"""Unknowns of a calibration and their ranges, as the section `calibration:` gives them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from itertools import product

from porocore.commands.calibration.plan import Experiment, PlannedUnknown
from porocore.commands.calibration.problem import NormalPrior, Scale, Unknown
from porocore.commands.calibration.settings import (
    CalibrationSettings,
    ControlSettings,
    ObservationSettings,
    PriorSettings,
    StudyNumber,
    SyntheticTimes,
    UnknownSettings,
    control_numbers,
    declared_positive,
    field_number,
    study_number,
)
from porocore.core.echo import echo, suggestion
from porocore.core.files.yaml_document import Location, dotted
from porocore.core.units import (
    NO_SCALES,
    QUANTITIES,
    ResultUnits,
    UnitError,
    in_si,
    length_text,
    number_or_quantity,
    pretty,
    unit_in_si,
    unit_within,
)
from porocore.errors import ConfigurationError

#: Keys of an unknown and of an observation, with which complaints begin.
_KEYS = {
    *UnknownSettings.model_fields,
    *ObservationSettings.model_fields,
    *(f"prior.{name}" for name in PriorSettings.model_fields),
    *(f"times.{name}" for name in SyntheticTimes.model_fields),
    *(f"field.{name}" for name in ControlSettings.model_fields),
}
#: Factors of one number in two experiments that are the same.
SAME = 1e-9


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


def _unknown(
    name: str,
    given: UnknownSettings,
    numbers: dict[str, StudyNumber],
    experiments: Mapping[str, Experiment],
    control: int | None = None,
) -> PlannedUnknown:
    """Return an unknown; ``control`` is the place of a control value in its field."""
    first = next(iter(numbers))
    unit = _unit(given, numbers[first])
    _require_one_meaning(given, unit, numbers, experiments)
    scale: Scale = given.scale or ("log" if numbers[first].is_positive else "linear")
    number = numbers[first]
    lower, upper = (
        _number(key, value, unit, number) for key, value in (("lower", given.lower), ("upper", given.upper))
    )
    if not lower < upper:
        raise ConfigurationError(f"expected lower < upper, got {echo(given.lower)} and {echo(given.upper)}")
    if lower <= 0:
        _require_sign(given, upper, scale, numbers, experiments)
    prior, smoothing = _prior(given, unit, number, scale), _smoothing(given, unit, number, scale, control)
    resolution = None if given.resolution is None else _number("resolution", given.resolution, unit, number)
    if resolution is not None and resolution <= 0:
        raise ConfigurationError(f"resolution: expected a number above 0, got {echo(given.resolution)}")
    unknown = Unknown(name, lower, lower, upper, scale, prior, unit, smoothing)
    found = PlannedUnknown(unknown, numbers, resolution)
    start = _start(given, found, experiments[first], control)
    return replace(found, unknown=replace(found.unknown, start=start))


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


def _require_sign(
    given: UnknownSettings,
    upper: float,
    scale: Scale,
    numbers: Mapping[str, StudyNumber],
    experiments: Mapping[str, Experiment],
) -> None:
    """Refuse a lower bound, not above 0, of a number that must be; of one of the boundary whose bounds hold 0."""
    number, config = next((each, experiments[name].config) for name, each in numbers.items())
    if number.is_positive or (number.kind == "cell" and declared_positive(number.name, config)):
        raise ConfigurationError(
            f"lower: expected a number above 0, as every value of {echo(number.name)} is, got {echo(given.lower)}; "
            "give the least one that is possible"
        )
    if number.kind == "boundary" and scale == "linear" and not upper < 0:
        raise ConfigurationError(
            f"expected bounds of one sign for {echo(number.name)}, whose derivatives are taken relative to it, got "
            f"{echo(given.lower)} and {echo(given.upper)}; leave out 0"
        )
    if scale == "log":
        raise ConfigurationError(
            f"lower: expected a number above 0 for a search in ln x, got {echo(given.lower)}; or scale: linear"
        )


def _texts(given: UnknownSettings) -> list[float | str]:
    prior = [] if given.prior is None else [given.prior.mean]
    starts = [given.start] if given.field is None else [given.start, *given.field.start]
    return [each for each in (given.lower, given.upper, *starts, *prior) if each is not None]


def _unit(given: UnknownSettings, number: StudyNumber) -> str:
    """Return the unit of an unknown, that of the first of its values that has one; empty for a dimensionless one."""
    units = [unit_within(text) for text in _texts(given) if isinstance(text, str)]
    unit = next((each for each in units if each), "")
    if unit and not number.quantity:
        raise ConfigurationError(f"expected plain numbers, got {echo(next(filter(None, units)))} as a unit")
    if unit:
        try:
            unit_in_si(unit, number.quantity)
        except UnitError as error:
            raise ConfigurationError(f"lower: {error}") from None
    return unit


def _require_one_meaning(
    given: UnknownSettings,
    unit: str,
    numbers: Mapping[str, StudyNumber],
    experiments: Mapping[str, Experiment],
) -> None:
    """Refuse a unit in a study without scales, and plain numbers that mean something else in another experiment."""
    quantity = next(iter(numbers.values())).quantity
    found = {name: experiments[name].config.scales for name in numbers}
    if unit and (without := [name for name, scales in found.items() if scales is None]):
        of = f" of the experiment '{without[0]}'" if without[0] else ""
        raise ConfigurationError(f"lower: {echo(given.lower)} {NO_SCALES}{of}")
    if unit or not quantity:
        return
    factors = {1.0 if s is None else float(QUANTITIES[quantity].factor(s.exact)) for s in found.values()}
    if max(factors) - min(factors) > SAME * max(factors):
        raise ConfigurationError(
            "expected values with a unit, since the experiments have other scales, so that a plain number means "
            "something else in each"
        )


def _number(key: str, value: float | str, unit: str, number: StudyNumber) -> float:
    """Return a value of an unknown in its unit."""
    try:
        value = number_or_quantity(value)
        if isinstance(value, str):
            return float(in_si(value, number.quantity) / unit_in_si(unit, number.quantity))
    except UnitError as error:
        raise ConfigurationError(f"{key}: {error}") from None
    if unit:
        raise ConfigurationError(
            f"{key}: expected a value with a unit, such as {value:g} {unit}, got {value:g}"
        )
    return value


def _start(
    given: UnknownSettings, found: PlannedUnknown, experiment: Experiment, control: int | None
) -> float:
    """Return the first value, of the settings or of the study."""
    one, number = found.unknown, found.numbers[experiment.name]
    key, told = "start", given.start
    if control is not None and given.field is not None and given.field.start:
        if given.start is not None:
            raise ConfigurationError("start: the first values stand in field.start too; keep one of the two")
        if len(given.field.start) != len(given.field.at):
            raise ConfigurationError(
                f"field.start: expected {len(given.field.at)} values, one for each coordinate, got "
                f"{len(given.field.start)}"
            )
        key, told = "field.start", given.field.start[control]
    if told is not None:
        start = _number(key, told, one.unit, number)
        if not one.lower <= start <= one.upper:
            raise ConfigurationError(f"{key}: expected a value within the bounds, got {echo(told)}")
        return start
    own = number.value / found.dimensionless(experiment)
    if one.lower < own < one.upper:
        return own
    return math.sqrt(one.lower * one.upper) if one.scale == "log" else (one.lower + one.upper) / 2


def _prior(given: UnknownSettings, unit: str, number: StudyNumber, scale: Scale) -> NormalPrior | None:
    if given.prior is None:
        return None
    mean = _number("prior.mean", given.prior.mean, unit, number)
    if scale == "log" and mean <= 0:
        raise ConfigurationError(f"prior.mean: expected a number above 0, got {echo(given.prior.mean)}")
    deviation = _deviation("prior.deviation", given.prior.deviation, unit, number, scale)
    return NormalPrior(math.log(mean) if scale == "log" else mean, deviation)


def _smoothing(
    given: UnknownSettings, unit: str, number: StudyNumber, scale: Scale, control: int | None
) -> float | None:
    """Return the deviation of the difference from the control value before; None: there is none, or no smoothing."""
    if not control or given.field is None or given.field.smoothing is None:
        return None
    return _deviation("field.smoothing", given.field.smoothing, unit, number, scale)


def _deviation(key: str, said: float | str, unit: str, number: StudyNumber, scale: Scale) -> float:
    """Return a standard deviation of a coordinate."""
    if scale == "log" and isinstance(said, str):
        raise ConfigurationError(
            f"{key}: expected a plain number, that of ln x, such as 0.2, got {echo(said)}"
        )
    deviation = float(said) if scale == "log" else _number(key, said, unit, number)
    if deviation <= 0:
        raise ConfigurationError(f"{key}: expected a number above 0, got {echo(said)}")
    return deviation
