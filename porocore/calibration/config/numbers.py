"""Numbers of a study that may be unknown (StudyNumber): of cell, scales and boundary, load, time shift."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from porocore.cell.family.parameters import possible_parameters
from porocore.core.echo import echo, suggestion
from porocore.core.files.yaml_document import Location
from porocore.core.formulas.time_function import TimeFunction
from porocore.core.models.walk import walk
from porocore.core.units.texts import dimensions
from porocore.errors import ConfigurationError
from porocore.interfaces.sensitivities import HatFunction
from porocore.study.config.config import RunConfig
from porocore.study.config.sections import MacroSettings
from porocore.study.sweep.family import quantities_of

NumberKind = Literal["cell", "modulus", "viscosity", "pore", "load", "boundary", "time_shift"]
#: Numbers with a name of their own, with their quantities.
OWN: dict[NumberKind, str] = {
    "modulus": "stress",
    "viscosity": "viscosity",
    "pore": "pore-size",
    "load": "",
    "time_shift": "time",
}
#: Those whose search is in ln x unless something else is said.
LOGARITHMIC: tuple[NumberKind, ...] = ("modulus", "viscosity", "pore")
#: Names of the coordinates, in order.
AXES: tuple[Literal["x"], Literal["y"], Literal["z"]] = ("x", "y", "z")


@dataclass(frozen=True)
class StudyNumber:
    """A number of a study.

    Attributes
    ----------
    kind
        What it is.
    name
        Name of a parameter of the cell, or ``boundary.SURFACE.KEY``; else the kind.
    quantity
        Of :data:`porocore.core.units.scales.QUANTITIES`; empty for a plain number.
    value
        That of the study, dimensionless.
    path
        Keys below ``macro`` of a value on the boundary.
    hat
        Of a control value of a parameter's field; None: the number holds everywhere.
    """

    kind: NumberKind
    name: str
    quantity: str
    value: float
    path: Location = ()
    hat: HatFunction | None = None

    @property
    def searched_in_logarithms(self) -> bool:
        """True where the search is in ln x unless something else is said."""
        return self.kind in LOGARITHMIC


def study_number(text: str, config: RunConfig, load: float) -> StudyNumber:
    """Return the number of a study that a text names.

    Parameters
    ----------
    text
        Such as ``radius``, ``modulus``, ``load`` or ``boundary.y+.pressure``.
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
    boundary = _boundary_numbers(config.macro)
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
    """Return the prescribed numbers other than 0 by names such as ``boundary.y+.traction.y``."""
    found = {}
    for place, dimension in dimensions(type(macro), macro):
        value, path = place.value, place.path
        if path[:1] != ("boundary",) or isinstance(value, bool) or not isinstance(value, float) or value == 0:
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
