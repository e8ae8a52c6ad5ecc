"""Changes of a macro run under the unknowns of a calibration, with the factors of the chain rule."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

from porocore.calibration.config.numbers import StudyNumber
from porocore.calibration.forward.setup import BodyAtValues
from porocore.interfaces.sensitivities import (
    BoundaryChange,
    BoundaryQuantity,
    CellParameterChange,
    LoadChange,
    MacroChange,
    ModulusChange,
    ViscosityChange,
)
from porocore.macro.problem import MacroSetup

_COMPONENTS = "012"


@dataclass(frozen=True)
class UnknownEffect:
    """Change of a run under an unknown, and the factor by which its derivative is that by the dimensionless value."""

    change: MacroChange
    factor: float


def effect_of(number: StudyNumber, value: float, body: BodyAtValues) -> UnknownEffect | None:
    """Return the effect of a number of a study with this dimensionless value; None for a time shift."""
    if number.kind == "cell":
        return UnknownEffect(CellParameterChange(number.name, weight=number.hat), 1.0)
    if number.kind == "modulus":
        return UnknownEffect(ModulusChange(), 1 / value)
    if number.kind == "viscosity":
        return UnknownEffect(ViscosityChange(), 1 / value)
    if number.kind == "pore":
        # The conductivity goes with d²/μ_f.
        return UnknownEffect(ViscosityChange(), -2 / value)
    if number.kind == "load":
        return UnknownEffect(LoadChange(), 1.0)
    if number.kind == "boundary":
        return _of_boundary(number, value, body)
    return None


def _of_boundary(number: StudyNumber, value: float, body: BodyAtValues) -> UnknownEffect:
    _, surface, key, *rest = number.path
    quantity = next(each for each in get_args(BoundaryQuantity) if each == key)
    component = next((int(part) for part in rest if part in _COMPONENTS), 0)
    change = BoundaryChange(surface, quantity, component)
    if rest and rest[-1] == "ramp":
        # The derivative is by the factor of the function of time.
        return UnknownEffect(change, 1 / value)
    part = _at(body.problem, number)
    return UnknownEffect(change, part / value)


def _at(setup: MacroSetup, number: StudyNumber) -> float:
    """Return the number in the part of a symmetric body that is solved, in the units of the run."""
    _, surface, key, *rest = number.path
    found = dict(setup.boundary[surface])[key]
    for each in rest:
        found = found[int(each)]
    return float(found)
