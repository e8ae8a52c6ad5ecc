"""Lines on what a study with scales gives without a unit: defaults that it leaves out, names in its formulas."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import BaseModel

from porocore.core.echo import echo
from porocore.core.files.yaml_document import dotted
from porocore.core.formulas.expressions import Expression
from porocore.core.models.walk import Place, walk
from porocore.core.units.dimensions import Dimension, InScales
from porocore.core.units.results import ResultUnits
from porocore.macro.composition.field import COORDINATES
from porocore.macro.problem import MacroSetup


def left_out(macro: MacroSetup, units: ResultUnits) -> Iterator[str]:
    """Yield a line for each section of ``macro`` that leaves out values with a unit; nothing without scales."""
    if not units.given:
        return
    found: dict[str, dict[str, list[str]]] = {}
    for place in walk(MacroSetup, macro):
        dimension = next((extra for extra in place.metadata if isinstance(extra, Dimension)), None)
        value = place.value
        if dimension is None or not isinstance(value, float) or not value:
            continue
        field = _field(place)
        assert field.above is not None
        if field.path[-1] not in field.above.value.model_fields_set:
            values = found.setdefault(".".join(("macro", *field.above.path)), {})
            values.setdefault(str(field.path[-1]), []).append(units.text(value, dimension.quantity))
    for section, keys in found.items():
        said = "; ".join(f"{key} {', '.join(values)}" for key, values in keys.items())
        yield f"not given in {section}, so at the defaults, multiples of the scales: {said}"


def formulas(macro: MacroSetup, units: ResultUnits) -> Iterator[str]:
    """Yield a line for each formula of place or time, with the unit in which each counts; nothing without scales."""
    if not units.given:
        return
    for place in walk(MacroSetup, macro):
        if not isinstance(place.value, str) or InScales() not in place.metadata:
            continue
        used = Expression.parse(place.value, COORDINATES).names
        counts = [
            f"{', '.join(names)} in multiples of {units.text(1.0, quantity)}"
            for names, quantity in (
                ([name for name in "xyz" if name in used], "displacement"),
                ([name for name in "t" if name in used], "time"),
            )
            if names
        ]
        if counts:
            key = dotted(("macro", *place.path))
            yield f"{key}: the formula {echo(place.value)} has {' and '.join(counts)}, the scales of the study"


def _field(place: Place) -> Place:
    """Return the field of a section that holds a value, or the value itself where it is one."""
    while place.above is not None and not isinstance(place.above.value, BaseModel):
        place = place.above
    return place
