"""Body of an experiment at values of the unknowns (BodyAtValues), in units of its modulus then.

With a modulus E, a viscosity μ_f and a cell of the edge d that are m, v and s times those of the study, the body is
the same in units of E and of the time μ_f L²/(E d²): its prescribed stresses are divided by m, its times by v/(m s²),
and so on, and its results are multiplied by these. So one surrogate serves all of them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, partial

from porocore.calibration.config.numbers import AXES, StudyNumber
from porocore.core.models.walk import with_number
from porocore.core.units.scales import QUANTITIES, ExactScales
from porocore.core.units.texts import dimensions
from porocore.errors import ConfigurationError
from porocore.macro.composition.field import TableField
from porocore.macro.problem import MacroProblem
from porocore.study.config.config import RunConfig
from porocore.study.config.sections import MacroSettings

#: Sections of the body whose numbers depend on modulus, viscosity and pore size; lengths do not.
SCALED = ("boundary", "body_force", "initial")


@dataclass(frozen=True)
class RelativeScales:
    """Modulus, viscosity and edge of the cell, as multiples of those of the study."""

    modulus: float = 1.0
    viscosity: float = 1.0
    pore: float = 1.0

    def factor(self, quantity: str) -> float:
        """Return the factor from a number in the units of these scales to that of the study."""
        if not quantity:
            return 1.0
        modulus, viscosity, pore = map(Fraction, (self.modulus, self.viscosity, self.pore))
        return float(QUANTITIES[quantity].factor(ExactScales(modulus, Fraction(1), pore, viscosity)))


@dataclass(frozen=True, eq=False)
class BodyAtValues:
    """Body of an experiment with certain values of its unknown numbers.

    Attributes
    ----------
    config
        The study in its own units.
    macro
        The body in the units of :attr:`scales`.
    load
        Its load.
    scales
        Modulus, viscosity and pore size.
    """

    config: RunConfig
    macro: MacroSettings
    load: float
    scales: RelativeScales

    @classmethod
    def of_values(cls, config: RunConfig, load: float, values: Mapping[StudyNumber, float]) -> BodyAtValues:
        """Return the body with dimensionless values in place of the numbers of a study."""
        macro, fields, relative = config.macro, dict(config.macro.fields), RelativeScales()
        fields |= table_fields(values)
        for number, value in values.items():
            if number.kind == "cell" and number.hat is None:
                fields[number.name] = value
            elif number.kind == "load":
                load = value
            elif number.kind == "boundary":
                macro = with_number(macro, number.path, partial(_constant, value))
            elif number.kind in ("modulus", "viscosity", "pore"):
                relative = replace(relative, **{number.kind: value / number.value})
        macro = macro.model_copy(update={"fields": fields, "loads": (load,)})
        return cls(config, _scaled(macro, relative), load, relative)

    @cached_property
    def problem(self) -> MacroProblem:
        """Problem of the part of a symmetric body that is solved."""
        return self.macro.problem(self.load)


def table_fields(values: Mapping[StudyNumber, float]) -> dict[str, TableField]:
    """Return the fields whose control values are among the values of numbers, by the names of the parameters."""
    tables: dict[str, list[tuple[float, float]]] = {}
    axes = {}
    for number, value in values.items():
        if number.hat is not None:
            tables.setdefault(number.name, []).append((number.hat.places[number.hat.index], value))
            axes[number.name] = AXES[number.hat.axis]
    return {
        name: TableField(kind="table", along=axes[name], table=tuple(sorted(table)))
        for name, table in tables.items()
    }


def _constant(value: float, _: float) -> float:
    return value


def _divided(factor: float, number: float) -> float:
    return number / factor


def _scaled(macro: MacroSettings, scales: RelativeScales) -> MacroSettings:
    """Return a body in the units of other scales."""
    if scales == RelativeScales():
        return macro
    scaled = macro
    for place, dimension in dimensions(type(macro), macro):
        value = place.value
        if place.path[:1] and place.path[0] in SCALED and dimension is not None and isinstance(value, float):
            factor = scales.factor(dimension.quantity)
            if value != 0 and factor != 1:
                scaled = with_number(scaled, place.path, partial(_divided, factor))
    time, factor = macro.time, scales.factor("time")
    plain = {name: getattr(time, name) / factor for name in ("end", "step", "ramp_step", "smallest_step")}
    lists = {
        "profiles": tuple(t / factor for t in time.profiles),
        "load_curve": tuple((t / factor, share) for t, share in time.load_curve),
    }
    return scaled.model_copy(update={"time": time.model_copy(update={**plain, **lists})})


def require_scalable(config: RunConfig, unknown: str) -> None:
    """Refuse formulas of a dimensionless time where the scale of time is unknown.

    Raises
    ------
    ConfigurationError
        A prescribed value or a parameter is a formula of t.
    """
    formulas = [f for f in config.macro.time_functions if f.expression is not None]
    entries = [*config.macro.fields.values()]
    entries += [entry for region in config.macro.regions.values() for entry in region.fields.values()]
    texts = [entry for entry in entries if isinstance(entry, str) and _of_time(entry)]
    if formulas or texts:
        told = formulas[0].expression if formulas else texts[0]
        raise ConfigurationError(
            f"macro: the formula '{told}' goes by a dimensionless time, whose unit changes with the unknown "
            f"'{unknown}'; give a table or a ramp in its place"
        )


def _of_time(formula: str) -> bool:
    return re.search(r"\bt\b", formula) is not None
