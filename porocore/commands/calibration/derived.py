"""Physical numbers that follow from a calibration, such as H_A and the permeability (DerivedCell)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from porocore.commands.calibration.cells import FamilyCells
from porocore.commands.calibration.experiment import relative_scales
from porocore.commands.calibration.infer import Inference
from porocore.commands.calibration.plan import AXES, CalibrationPlan, Experiment, Occurrence, occurrences
from porocore.commands.calibration.problem import values_at
from porocore.commands.calibration.profiles import ROOT_95, ConfidenceInterval, IntervalEnd
from porocore.core.units import ResultUnits, pretty
from porocore.macro.laws.linear import PROPERTIES, SAME, EffectiveProperties
from porocore.states import Array
from porocore.study.config.config import RunConfig

#: How the intervals are found, for reports and files.
METHOD = (
    "delta method: the covariance of the fit, priors counted, and the slopes of the learned cell at rest by the "
    "unknowns; in the logarithm, but for porosity and Poisson's ratios"
)
#: A conductivity below this share of the largest along another axis is none.
NONE = 1e-9
#: Step of the differences that give slopes, as a share of the range of the search.
STEP = 1e-4
#: An end is none where the data allow values so many times as far away, along a profile without end.
MOST = 1.1
#: Differences that are round-off.
ROUND_OFF = 1e-9
#: SI units of quantities whose values papers print in these.
_SI = {"conductivity": "m⁴/(N s)", "permeability": "m²", "diffusivity": "m²/s"}
_PLANES = ("yz", "xz", "xy")
_PAIRS = tuple((i, j) for i in range(3) for j in range(3) if i != j)
#: Numbers by their keys: words, quantity, names of the axes, planes or pairs, and the value for each of these.
_NUMBERS: dict[str, tuple[str, str, tuple[str, ...], Callable[[EffectiveProperties], Array]]] = {
    "porosity": ("porosity φ_f", "", ("",), lambda p: np.array([p.porosity])),
    "aggregate_modulus": ("aggregate modulus H_A", "stress", AXES, lambda p: p.confined_moduli),
    "young_modulus": ("Young’s modulus E, drained", "stress", AXES, lambda p: p.young_moduli),
    "poisson_ratio": (
        "Poisson’s ratio ν, drained",
        "",
        tuple(AXES[i] + AXES[j] for i, j in _PAIRS),
        lambda p: np.array([p.poisson_ratios[pair] for pair in _PAIRS]),
    ),
    "shear_modulus": ("shear modulus G", "stress", _PLANES, lambda p: p.shear_moduli),
    "hydraulic_permeability": (
        "hydraulic permeability K",
        "conductivity",
        AXES,
        lambda p: np.diag(p.conductivity),
    ),
    "intrinsic_permeability": (
        "intrinsic permeability k = K μ_f",
        "permeability",
        AXES,
        lambda p: np.diag(p.permeability),
    ),
    "consolidation_coefficient": (
        "consolidation coefficient c_v",
        "diffusivity",
        AXES,
        lambda p: p.consolidation_coefficients,
    ),
    "aggregate_modulus_times_permeability": (
        "H_A K, which is c_v if solid and fluid are incompressible",
        "diffusivity",
        AXES,
        lambda p: p.confined_moduli * np.diag(p.conductivity),
    ),
}
#: Returns dimensionless properties, in the units of the study, by the values of some numbers.
Properties = Callable[[Array], EffectiveProperties]


@dataclass(frozen=True, eq=False)
class DerivedNumber:
    """A number that follows from the unknowns, at the best point.

    Attributes
    ----------
    name
        Key in files, such as ``aggregate_modulus``, with ``_x`` where it differs from axis to axis.
    words
        Name for a reader.
    unit
        Of the numbers; empty for a dimensionless one.
    value
        At the best point.
    interval
        Its 95 % interval.
    """

    name: str
    words: str
    unit: str
    value: float
    interval: ConfidenceInterval


@dataclass(frozen=True, eq=False)
class DerivedCell:
    """Numbers of the fitted undeformed cell of some experiments.

    Attributes
    ----------
    experiments
        Their names; the only one of a study has none.
    place
        Coordinate of the body where a parameter is fitted as a field; else empty.
    numbers
        The numbers.
    """

    experiments: tuple[str, ...]
    place: str
    numbers: tuple[DerivedNumber, ...]

    @property
    def values(self) -> dict[str, float]:
        """Values by name."""
        return {each.name: each.value for each in self.numbers}

    @property
    def intervals(self) -> dict[str, tuple[float | None, float | None]]:
        """95 % intervals by name; None where the data set no end."""
        return {each.name: each.interval.values for each in self.numbers}

    @property
    def title(self) -> str:
        """Experiments and place in words; empty where there is one cell alone."""
        return ", ".join(text for text in (" and ".join(filter(None, self.experiments)), self.place) if text)

    def entries(self) -> dict[str, Any]:
        """Return what a JSON file holds."""
        numbers = {
            each.name: {
                "value": each.value,
                "unit": each.unit,
                "interval95": each.interval.values,
                "open_ends": each.interval.open_ends,
            }
            for each in self.numbers
        }
        return {"experiments": list(filter(None, self.experiments)), "place": self.place, "numbers": numbers}


def derived_cells(
    inference: Inference, plan: CalibrationPlan, families: Sequence[FamilyCells]
) -> tuple[DerivedCell, ...]:
    """Return the derived numbers of the undeformed cells of all experiments, those of the same cell once.

    A body whose cells differ in another way than by the fitted fields has none.
    """
    found: dict[object, tuple[list[str], str, ResultUnits, Properties]] = {}
    for k, family in enumerate(families):
        properties = family.at_rest()
        for experiment in plan.experiments:
            if experiment.name in family.experiments and properties is not None:
                config = experiment.config
                for place, same, of in _cells(plan, experiment, properties):
                    key = (k, config.scales, config.output_units, place, *same)
                    names, *_ = found.setdefault(key, ([], place, config.result_units, of))
                    names.append(experiment.name)
    return tuple(
        DerivedCell(tuple(names), place, _numbers(inference, units, of))
        for names, place, units, of in found.values()
    )


def _cells(
    plan: CalibrationPlan, experiment: Experiment, properties: Properties
) -> Iterator[tuple[str, tuple[object, ...], Properties]]:
    """Yield place, distinction from other cells of the family, and properties by the unknowns, of each cell."""
    config, numbers = experiment.config, occurrences(plan.unknowns, experiment)
    hats = {each.number.hat for each in numbers if each.number.hat is not None}
    grids = {(hat.axes, hat.places) for hat in hats}
    if len(grids) > 1 or not all(_is_one_value(config, p.name, numbers) for p in config.cell.parameters):
        return
    nodes = {hat.index: hat.node for hat in hats}
    for place in sorted(nodes, key=lambda index: index[::-1]) if nodes else (None,):
        here = [each for each in numbers if each.number.hat is None or each.number.hat.index == place]
        text = ", ".join(
            f"{AXES[axis]} = {config.result_units.text(at, 'displacement')}"
            for axis, at in (nodes[place].items() if place is not None else ())
        )
        same = tuple(
            (each.index, each.number.name)
            for each in here
            if each.number.kind == "cell" or each.number.is_scale
        )
        fixed = tuple(sorted((name, str(value)) for name, value in config.macro.fields.items()))
        yield text, (same, fixed), _at_values(config, here, properties)


def _is_one_value(config: RunConfig, name: str, numbers: Sequence[Occurrence]) -> bool:
    """Return whether a parameter is fitted, or a number that holds in the whole body."""
    fitted = any(each.number.kind == "cell" and each.number.name == name for each in numbers)
    inside = any(name in region.fields for region in config.macro.regions.values())
    return not inside and (fitted or isinstance(config.macro.fields.get(name), float | int))


def _at_values(config: RunConfig, numbers: Sequence[Occurrence], properties: Properties) -> Properties:
    """Return the function that gives the properties at values of the unknowns."""

    def of(values: Array) -> EffectiveProperties:
        fitted = {each.number: each.value(values) for each in numbers}
        given = {name: value for name, value in config.macro.fields.items() if isinstance(value, float | int)}
        given |= {number.name: value for number, value in fitted.items() if number.kind == "cell"}
        scales = relative_scales(fitted)
        found = properties(np.array([given[each.name] for each in config.cell.parameters], dtype=float))
        scaled = {
            name: getattr(found, name) * scales.factor(quantity)
            for name, quantity in PROPERTIES.items()
            if quantity
        }
        return replace(found, **scaled)

    return of


def _numbers(inference: Inference, units: ResultUnits, of: Properties) -> tuple[DerivedNumber, ...]:
    """Return the numbers of one cell in their units; those that are the same along all axes once."""
    best, shown = of(inference.values), dict[str, tuple[str, str]]()
    places: dict[str, tuple[Callable[[EffectiveProperties], Array], int, float]] = {}
    for key, (words, quantity, along, values_of) in _NUMBERS.items():
        values, (unit, factor) = values_of(best), _unit(units, quantity)
        largest = float(np.abs(values).max())
        one = float(np.ptp(values)) <= SAME * largest
        for i, where in enumerate(along[:1] if one else along):
            if quantity and abs(values[i]) <= NONE * largest:
                continue
            name = key if one else f"{key}_{where}"
            shown[name] = words if one else f"{words}, {where}", unit
            places[name] = values_of, i, factor

    def numbers(values: Array) -> dict[str, float]:
        found = of(values)
        return {name: factor * float(values_of(found)[i]) for name, (values_of, i, factor) in places.items()}

    found = derived_intervals(inference, numbers, _is_plain)
    return tuple(DerivedNumber(name, words, unit, *found[name]) for name, (words, unit) in shown.items())


def _is_plain(name: str) -> bool:
    """Return whether a number need not be positive, or is a share."""
    return name.startswith(("porosity", "poisson_ratio"))


def _unit(units: ResultUnits, quantity: str) -> tuple[str, float]:
    """Return the unit of a quantity and the factor of dimensionless numbers."""
    if not quantity or units.scales is None:
        return "", 1.0
    if quantity in _SI:
        return _SI[quantity], units.scales.factor(quantity)
    return pretty(units.name(quantity)), units.factor(quantity)


def derived_intervals(
    inference: Inference, numbers: Callable[[Array], Mapping[str, float]], linear: Callable[[str], bool]
) -> dict[str, tuple[float, ConfidenceInterval]]:
    """Return value and 95 % interval of each number, by the covariance of the fit (delta method).

    The intervals hold the values of exact curves, too, where those of the unknowns do. An end is None where the data do
    not determine the number, where on the way to it an unknown meets a bound of the search, or where the profile of an
    unknown without end leads beyond it.

    Parameters
    ----------
    inference
        Of the fit.
    numbers
        Numbers by name as a function of the values (k,) of the unknowns.
    linear
        True for a name whose interval is symmetric; those of other numbers, which are positive, are in the logarithm.
    """
    unknowns, x = inference.unknowns, inference.best.coordinates
    spans = np.array([one.coordinate(one.upper) - one.coordinate(one.lower) for one in unknowns])

    def at(coordinates: Array) -> Mapping[str, float]:
        return numbers(values_at(unknowns, coordinates))

    best = at(x)
    moved = [(at(x + step), at(x - step)) for step in np.diag(STEP * spans)]
    open_paths = [(name, [at(c) for c in path]) for name, path in _open_paths(inference)]
    found = {}
    for name, value in best.items():
        form, back = (np.asarray, np.asarray) if linear(name) else (np.log, np.exp)
        slopes = np.array([form(up[name]) - form(down[name]) for up, down in moved]) / (2 * STEP * spans)
        allowed = [(words, form([each[name] for each in path])) for words, path in open_paths]
        ends = _ends(inference, slopes, float(form(value)), allowed)
        low, high = (
            IntervalEnd(None if end.value is None else float(back(end.value)), end.reason) for end in ends
        )
        found[name] = value, ConfidenceInterval(low, high)
    return found


def _open_paths(inference: Inference) -> Iterator[tuple[str, Array]]:
    """Yield the part (n, k) of each profile towards an end that is none, with words for it; the data allow it all."""
    for i, (one, interval) in enumerate(zip(inference.unknowns, inference.intervals, strict=True)):
        away = interval.coordinates[:, i] - inference.best.coordinates[i]
        for end, side, which in ((interval.low, away < 0, "lower"), (interval.high, away > 0, "upper")):
            if end.value is None:
                yield f"{one.name}, which has no {which} end", interval.coordinates[side]


def _ends(
    inference: Inference, slopes: Array, value: float, allowed: Sequence[tuple[str, Array]]
) -> tuple[IntervalEnd, IntervalEnd]:
    """Return both ends of a number with slopes (k,) by the coordinates, and ``allowed`` values along open profiles."""
    covariances, deviation = inference.with_priors.moves_with(slopes)
    if not np.isfinite(deviation):
        end = IntervalEnd(None, "the data do not determine it")
        return end, end
    error = inference.systematic
    systematic = float(slopes @ error.shift) if error is not None and error.counted else 0.0
    ends = []
    for side in (-1.0, 1.0):
        steps = side * ROOT_95 * covariances / deviation if deviation else 0 * covariances
        reached, room = inference.best.coordinates + steps, side * ROOT_95 * deviation
        beyond = [
            words
            for words, values in allowed
            if (side * (values - value) > MOST * abs(room) + ROUND_OFF).any()
        ]
        bounded = [
            one.name
            for one, x in zip(inference.unknowns, reached, strict=True)
            if not one.coordinate(one.lower) <= x <= one.coordinate(one.upper)
        ]
        if bounded:
            ends.append(IntervalEnd(None, f"{bounded[0]} meets a bound of the search"))
        elif beyond:
            ends.append(IntervalEnd(None, f"it moves with {beyond[0]}"))
        else:
            ends.append(IntervalEnd(value + room + side * max(side * systematic, 0.0)))
    return ends[0], ends[1]
