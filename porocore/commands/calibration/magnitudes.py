"""Sizes of measured curves beside those that the study gives, which tell a wrong unit before the fit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from porocore.commands.calibration.observations import ObservedCurve
from porocore.commands.calibration.plan import CalibrationPlan, Experiment
from porocore.commands.calibration.problem import CurveModel
from porocore.commands.calibration.settings import OF_LOAD
from porocore.core.units import pretty
from porocore.errors import PluginError, SolveError
from porocore.interfaces.law import MacroLaw
from porocore.macro.boundary.symmetry import whole_specimen
from porocore.macro.composition.regions import RegionLaw
from porocore.macro.laws.linear import LinearPoroelasticity
from porocore.plugins import registry
from porocore.states import Array
from porocore.study.config.config import RunConfig
from porocore.study.notes.at_rest import MOST_TETRAHEDRA, tetrahedra_solved
from porocore.study.notes.linear_reach import linear_solutions, too_large
from porocore.study.run.reference import undeformed

#: Values so many times as large or as small as those of the study are noted; laws and unknowns explain less.
FAR = 30.0
#: Values so far beyond all that an unknown modulus can make of the study's are noted, where they are FAR from these.
BEYOND = 10.0
#: Quantities whose size hardly depends on when the data were taken.
SIZED = ("force", "displacement", "volume")


def scale_note(curve: ObservedCurve, predicted: Array, least: float, most: float, words: str) -> str | None:
    """Return the note that a curve is far larger or smaller than the study's; None: it is not.

    Parameters
    ----------
    curve
        The measured curve.
    predicted
        Values of the study, in the unit of the curve.
    least, most
        Multiples of these that the unknowns can make of them.
    words
        Where they are from, such as ``by linear poroelasticity``.
    """
    if curve.measured is None or curve.series.quantity not in SIZED:
        return None
    measured, own = float(np.abs(curve.measured).max()), float(np.abs(predicted).max())
    low, high = min(least / BEYOND, 1 / FAR), max(most * BEYOND, FAR)
    if own == 0 or measured == 0 or low * own <= measured <= high * own:
        return None
    unit = f" {pretty(curve.unit)}".rstrip()
    bound = f"at most {most * own:.3g}" if measured > own else f"at least {least * own:.3g}"
    return (
        f"the values reach {measured:.3g}{unit} in size, but those of the study {own:.3g}{unit} {words}, and {bound}"
        f"{unit} between the bounds; check the unit of the values ('unit:' or the heading), 'factor:', and the units "
        "of the study"
    )


def linear_notes(plan: CalibrationPlan) -> Iterator[str]:
    """Yield a note on each curve whose size linear poroelasticity excludes; undeformed cells and bodies are solved.

    Where they are too large for a check, or fail, nothing is noted.
    """
    for experiment in plan.experiments:
        if _is_loaded_by_an_unknown(plan, experiment) or not any(map(_is_sized, experiment.curves)):
            continue
        law = None if too_large(experiment.config.macro) else _linear_law(experiment.config)
        try:
            parts = [] if law is None else linear_solutions(experiment.config, law)
        except SolveError:
            continue
        solutions = [whole_specimen(part, experiment.config.macro) for part in parts]
        for curve in experiment.curves if solutions else ():
            values = np.concatenate([curve.series.values(one) for one in solutions]) * curve.factor
            note = scale_note(curve, values, *_multiples(plan, experiment), "by linear poroelasticity")
            if note:
                yield f"{curve.name}: {note}"


def start_notes(plan: CalibrationPlan, model: CurveModel) -> Iterator[str]:
    """Yield a note on each curve whose size the study does not have at the start values of the unknowns."""
    starts = np.array([one.value(one.coordinate(one.start)) for one in model.unknowns])
    try:
        values = model.curves(starts).values
    except SolveError:  # the fit says so
        return
    parts = iter(np.split(values, np.cumsum([len(curve) for curve in plan.curves])[:-1]))
    for experiment in plan.experiments:
        multiples = _multiples(plan, experiment, of_start=True)
        for curve, part in zip(experiment.curves, parts, strict=False):
            note = scale_note(curve, part, *multiples, "at the start values")
            if note and not _is_loaded_by_an_unknown(plan, experiment):
                yield f"{curve.name}: {note}"


def _is_sized(curve: ObservedCurve) -> bool:
    return curve.measured is not None and curve.series.quantity in SIZED


def _is_loaded_by_an_unknown(plan: CalibrationPlan, experiment: Experiment) -> bool:
    numbers = (each.numbers.get(experiment.name) for each in plan.unknowns)
    return any(number is not None and number.kind in OF_LOAD for number in numbers)


def _multiples(
    plan: CalibrationPlan, experiment: Experiment, *, of_start: bool = False
) -> tuple[float, float]:
    """Return by what an unknown modulus can multiply forces or divide displacements: the least and the most.

    They are multiples of what the study gives with its own modulus, or with that of the start.
    """
    found = [1.0]
    for each in plan.unknowns:
        number = each.numbers.get(experiment.name)
        if number is not None and number.kind == "modulus":
            own = each.unknown.start if of_start else number.value / each.dimensionless(experiment)
            found += [x for end in (each.unknown.lower, each.unknown.upper) for x in (end / own, own / end)]
    return min(found), max(found)


def _linear_law(config: RunConfig) -> MacroLaw | None:
    """Return linear poroelasticity of the body, with the middle of a family; None where a cell is large."""
    found = {name: _linear_law_of_cell(config.of_cell(name)) for name in config.cell_names}
    laws = {name: law for name, law in found.items() if law is not None}
    if len(laws) < len(found):
        return None
    return RegionLaw.by_cell(config.macro.regions, laws[None], {name: laws[name] for name in config.cells})


def _linear_law_of_cell(config: RunConfig) -> MacroLaw | None:
    try:
        registry.get("cell solver", config.fem.backend)
    except PluginError:
        return None
    if tetrahedra_solved(config.cell) > MOST_TETRAHEDRA:
        return None
    reference = undeformed(config.cell, config.fem, config.conductivity, None)
    return LinearPoroelasticity(reference.coefficients(config.cell, config.conductivity))
