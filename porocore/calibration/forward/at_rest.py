"""Undeformed cells of a calibration as functions of its unknowns (CellAtRest), as the families learned them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from porocore.calibration.config.numbers import AXES, StudyNumber
from porocore.calibration.forward.cells import FamilyCells
from porocore.calibration.forward.setup import RelativeScales
from porocore.calibration.plan import CalibrationPlan, Experiment
from porocore.core.units.results import ResultUnits
from porocore.macro.laws.effective import PROPERTIES, EffectiveProperties
from porocore.states import Array
from porocore.study.config.config import RunConfig


@dataclass(frozen=True, eq=False)
class CellAtRest:
    """Undeformed cell of some experiments, as a function of the k unknowns.

    Attributes
    ----------
    experiments
        Names of the experiments.
    place
        Coordinate of the body, such as ``y = 0.5 mm``, where a parameter is fitted as a field; else empty.
    units
        Of the first of the experiments.
    of : (k,) to :class:`EffectiveProperties`
        Dimensionless properties in the units of the study, by the values of the unknowns.
    """

    experiments: tuple[str, ...]
    place: str
    units: ResultUnits
    of: Callable[[Array], EffectiveProperties]


def cells_at_rest(plan: CalibrationPlan, families: Sequence[FamilyCells]) -> tuple[CellAtRest, ...]:
    """Return the undeformed cells of all experiments, those that are the same once.

    A body whose cells differ in another way than by the fitted fields has none.
    """
    found: dict[object, CellAtRest] = {}
    for k, family in enumerate(families):
        properties = family.at_rest()
        for experiment in plan.experiments:
            if experiment.name in family.experiments and properties is not None:
                for key, cell in _cells(plan, experiment, properties):
                    key = (k, experiment.config.scales, experiment.config.output_units, *key)
                    known = found.get(key, replace(cell, experiments=()))
                    found[key] = replace(known, experiments=(*known.experiments, experiment.name))
    return tuple(found.values())


def _cells(
    plan: CalibrationPlan, experiment: Experiment, properties: Callable[[Array], EffectiveProperties]
) -> Iterator[tuple[tuple[object, ...], CellAtRest]]:
    """Yield the cells of one experiment, each with what tells it from others of the same family."""
    config = experiment.config
    numbers = {
        j: (each.numbers[experiment.name], each.dimensionless(experiment))
        for j, each in enumerate(plan.unknowns)
        if experiment.name in each.numbers
    }
    hats = {number.hat for number, _ in numbers.values() if number.hat is not None}
    lines = {(hat.axis, hat.places) for hat in hats}
    if len(lines) > 1 or any(
        not _is_one_value(config, each.name, numbers) for each in config.cell.parameters
    ):
        return
    for place in range(len(next(iter(lines))[1])) if lines else (None,):
        here = {
            j: (number, factor)
            for j, (number, factor) in numbers.items()
            if number.hat is None or number.hat.index == place
        }
        of = _at_values(config, here, properties)
        text = ""
        if place is not None:
            ((axis, places),) = lines
            text = f"{AXES[axis]} = {config.result_units.text(places[place], 'displacement')}"
        kinds = ("cell", "modulus", "viscosity", "pore")
        same = tuple((j, number.name) for j, (number, _) in here.items() if number.kind in kinds)
        fixed = tuple(sorted((name, str(value)) for name, value in config.macro.fields.items()))
        yield (text, same, fixed), CellAtRest((), text, config.result_units, of)


def _is_one_value(config: RunConfig, name: str, numbers: dict[int, tuple[StudyNumber, float]]) -> bool:
    """Tell whether a parameter is fitted, or a number that holds in the whole body."""
    fitted = any(number.kind == "cell" and number.name == name for number, _ in numbers.values())
    inside = any(name in region.fields for region in config.macro.regions.values())
    return not inside and (fitted or isinstance(config.macro.fields.get(name), float | int))


def _at_values(
    config: RunConfig,
    numbers: dict[int, tuple[StudyNumber, float]],
    properties: Callable[[Array], EffectiveProperties],
) -> Callable[[Array], EffectiveProperties]:
    """Return the function that gives the properties at values of the unknowns."""

    def of(values: Array) -> EffectiveProperties:
        given = {name: value for name, value in config.macro.fields.items() if isinstance(value, float | int)}
        scales = RelativeScales()
        for j, (number, factor) in numbers.items():
            value = float(values[j]) * factor
            if number.kind == "cell":
                given[number.name] = value
            elif number.kind in ("modulus", "viscosity", "pore"):
                scales = replace(scales, **{number.kind: value / number.value})
        found = properties(np.array([given[each.name] for each in config.cell.parameters], dtype=float))
        scaled = {
            name: getattr(found, name) * scales.factor(quantity)
            for name, quantity in PROPERTIES.items()
            if quantity
        }
        return replace(found, **scaled)

    return of
