"""Unknowns from their settings: numbers of the studies, units, bounds, first values, priors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from porocore.calibration.config.numbers import StudyNumber, study_number
from porocore.calibration.config.settings import (
    CalibrationSettings,
    ObservationSettings,
    PriorSettings,
    SyntheticTimes,
    UnknownSettings,
)
from porocore.calibration.plan import Experiment, PlannedUnknown
from porocore.calibration.problem import NormalPrior, Scale, Unknown
from porocore.core.echo import echo, suggestion
from porocore.core.files.yaml_document import Location, dotted
from porocore.core.units.quantities import UnitError, has_unit, in_si, unit_in_si, unit_within
from porocore.core.units.scales import QUANTITIES
from porocore.core.units.texts import NO_SCALES
from porocore.errors import ConfigurationError

#: Keys of an unknown and of an observation, with which complaints begin.
_KEYS = {
    *UnknownSettings.model_fields,
    *ObservationSettings.model_fields,
    *(f"prior.{name}" for name in PriorSettings.model_fields),
    *(f"times.{name}" for name in SyntheticTimes.model_fields),
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
        raise ConfigurationError(f"{key}{'.' if text.partition(': ')[0] in _KEYS else ': '}{text}") from error


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
            one = _planned(name, given, experiments)
            for other in planned:
                for experiment, number in one.numbers.items():
                    if experiment in other.numbers and other.numbers[experiment].name == number.name:
                        raise ConfigurationError(
                            f"'{other.unknown.name}' is the same number of the study; keep one, or give each "
                            "'experiments:' of its own"
                        )
            planned.append(one)
    return planned


def _planned(name: str, given: UnknownSettings, experiments: Mapping[str, Experiment]) -> PlannedUnknown:
    for one in given.experiments:
        if one not in experiments:
            advice = (
                suggestion(one, experiments, "the experiments are")
                if any(experiments)
                else "there is one alone"
            )
            raise ConfigurationError(f"experiments: no experiment is called {echo(one)}; {advice}")
    numbers = {}
    for one in given.experiments or experiments:
        with keyed("of") if given.of is not None else _as_it_is():
            numbers[one] = study_number(given.of or name, experiments[one].config, experiments[one].load)
    first = next(iter(numbers))
    unit = _unit(given, numbers[first])
    _require_one_meaning(given, unit, numbers, experiments)
    scale: Scale = given.scale or ("log" if numbers[first].searched_in_logarithms else "linear")
    number = numbers[first]
    lower, upper = (
        _number(key, value, unit, number) for key, value in (("lower", given.lower), ("upper", given.upper))
    )
    if not lower < upper:
        raise ConfigurationError(f"expected lower < upper, got {echo(given.lower)} and {echo(given.upper)}")
    if scale == "log" and lower <= 0:
        raise ConfigurationError(
            f"lower: expected a number above 0 for a search in ln x, got {echo(given.lower)}; or scale: linear"
        )
    start = _start(given, unit, number, lower, upper, scale, experiments[first])
    return PlannedUnknown(
        Unknown(name, start, lower, upper, scale, _prior(given, unit, number, scale), unit), numbers
    )


@contextmanager
def _as_it_is() -> Iterator[None]:
    yield


def _texts(given: UnknownSettings) -> list[float | str]:
    prior = [] if given.prior is None else [given.prior.mean]
    return [each for each in (given.lower, given.upper, given.start, *prior) if each is not None]


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
    if not isinstance(value, str):
        if unit:
            raise ConfigurationError(
                f"{key}: expected a value with a unit, such as {value:g} {unit}, got {value:g}"
            )
        return value
    if not has_unit(value):
        raise ConfigurationError(f"{key}: expected a number, or one with a unit, got {echo(value)}")
    try:
        return float(in_si(value, number.quantity) / unit_in_si(unit, number.quantity))
    except UnitError as error:
        raise ConfigurationError(f"{key}: {error}") from None


def _start(
    given: UnknownSettings,
    unit: str,
    number: StudyNumber,
    lower: float,
    upper: float,
    scale: Scale,
    experiment: Experiment,
) -> float:
    if given.start is not None:
        start = _number("start", given.start, unit, number)
        if not lower <= start <= upper:
            raise ConfigurationError(f"start: expected a value within the bounds, got {echo(given.start)}")
        return start
    probe = PlannedUnknown(Unknown("", 0.0, lower, upper, scale, None, unit), {experiment.name: number})
    own = number.value / probe.dimensionless(experiment)
    if lower < own < upper:
        return own
    return math.sqrt(lower * upper) if scale == "log" else (lower + upper) / 2


def _prior(given: UnknownSettings, unit: str, number: StudyNumber, scale: Scale) -> NormalPrior | None:
    if given.prior is None:
        return None
    mean, said = _number("prior.mean", given.prior.mean, unit, number), given.prior.deviation
    if scale == "log" and mean <= 0:
        raise ConfigurationError(f"prior.mean: expected a number above 0, got {echo(given.prior.mean)}")
    if scale == "log" and isinstance(said, str):
        raise ConfigurationError(
            f"prior.deviation: expected a plain number, that of ln x, such as 0.2, got {echo(said)}"
        )
    deviation = float(said) if scale == "log" else _number("prior.deviation", said, unit, number)
    if deviation <= 0:
        raise ConfigurationError(f"prior.deviation: expected a number above 0, got {echo(said)}")
    return NormalPrior(math.log(mean) if scale == "log" else mean, deviation)
