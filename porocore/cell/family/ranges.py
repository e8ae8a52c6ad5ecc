"""Ranges in the settings of a cell: ``{range: [lower, upper]}`` in place of a number, its faults, its ends."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import InitErrorDetails

from porocore.cell.family.parameters import (
    CellParameter,
    may_vary,
    number,
    possible_parameters,
    require_known,
)
from porocore.core.echo import echo, joined
from porocore.core.files.yaml_document import Location
from porocore.core.models.walk import RANGE, is_number, walk

if TYPE_CHECKING:
    from porocore.cell.family.family import Family

C = TypeVar("C", bound="Family")
#: Parameters of which all combinations of ends are checked; of more, the ends of each alone.
MOST_TOGETHER = 5


def split_ranges(
    model: type[BaseModel], data: Mapping[str, Any]
) -> tuple[Any, dict[Location, tuple[float, float]]]:
    """Return settings with the middle in place of every range, and the ranges by their paths.

    Raises
    ------
    ValidationError
        A range is no pair of increasing numbers, or stands where none is allowed.
    """
    ranges: dict[Location, tuple[float, float]] = {}
    faults: list[InitErrorDetails] = []
    for place in walk(model, data):
        if not (is_number(place.annotation) and isinstance(place.value, Mapping) and RANGE in place.value):
            continue
        try:
            if not may_vary(place):
                raise ValueError(_not_here(place.path))
            ranges[place.path] = _ends(place.value)
        except ValueError as error:
            faults.append(fault(place.path, str(error), place.value))
    if faults:
        raise ValidationError.from_exception_data(model.__name__, faults)
    if not ranges:
        return data, ranges
    return replaced(data, {path: (low + high) / 2 for path, (low, high) in ranges.items()}), ranges


def _not_here(path: Location) -> str:
    if "directions" in path:
        return (
            "a component of a direction cannot be a range, since only its angle matters; write the direction as "
            "{plane: xy, angle: {range: [lower, upper]}}, in degrees"
        )
    return (
        "a range cannot stand here; numbers of the pores' shape, of materials and the viscosity may have one, sizes of "
        "the mesh and lengths in metres may not"
    )


def _ends(value: Mapping[str, Any]) -> tuple[float, float]:
    """Return the ends of a range; a fault is a ValueError."""
    ends = value[RANGE]
    if more := [str(key) for key in value if key != RANGE]:
        raise ValueError(f"expected {{range: [lower, upper]}} and nothing beside it, got {joined(more)}, too")
    numbers = isinstance(ends, list | tuple) and all(
        isinstance(end, int | float) and not isinstance(end, bool) for end in ends
    )
    if not numbers or len(ends) != 2:
        raise ValueError(f"expected {{range: [lower, upper]}} with two numbers, got {echo(ends)}")
    lower, upper = map(float, ends)
    if not (math.isfinite(lower) and math.isfinite(upper) and lower < upper):
        raise ValueError(f"expected [lower, upper] with lower < upper, got {echo(ends)}")
    return lower, upper


def parameters_of(cell: Family, ranges: Mapping[Location, tuple[float, float]]) -> tuple[CellParameter, ...]:
    """Return the parameters of a cell with these ranges, in the order of its keys."""
    return tuple(
        CellParameter(name, path, *ranges[path], sum(ranges[path]) / 2)
        for path, name in possible_parameters(cell).items()
        if path in ranges
    )


def require_ends(cell: Family, parameters: Sequence[CellParameter]) -> None:
    """Refuse ranges whose ends are no cells.

    Raises
    ------
    ValidationError
        The settings of an end are faulty; each fault stands at its key.
    """
    faults: dict[tuple[int | str, ...], InitErrorDetails] = {}
    for values in _combinations(parameters):
        numbers = dict(zip((parameter.path for parameter in parameters), values, strict=True))
        at = joined(f"{p.name} = {value:g}" for p, value in zip(parameters, values, strict=True))
        for error in member_faults(cell, numbers):
            if error["type"] == "value_error":
                text = f"{error['ctx']['error']} (at {at}, within the given ranges)"
                error = {**error, "ctx": {"error": ValueError(text)}}
            faults.setdefault(tuple(error["loc"]), error)
    if faults:
        raise ValidationError.from_exception_data(type(cell).__name__, list(faults.values()))


def _combinations(parameters: Sequence[CellParameter]) -> Iterator[tuple[float, ...]]:
    ends = [(parameter.lower, parameter.upper) for parameter in parameters]
    if len(ends) <= MOST_TOGETHER:
        yield from itertools.product(*ends)
        return
    base = [parameter.base for parameter in parameters]
    for i, pair in enumerate(ends):
        for end in pair:
            yield (*base[:i], end, *base[i + 1 :])


def member_with(cell: C, values: Mapping[str, float]) -> C:
    """Return the member of a family at some values by name; a number without a range may be named, too.

    Such a number becomes a parameter whose base is the configured number, from which the mesh is moved to the value.

    Raises
    ------
    ConfigurationError
        A range has no value, a name is unknown, or no cell has these values together.
    """
    ranges = {p.name: p for p in cell.parameters}
    names = possible_parameters(cell)
    paths = {name: path for path, name in names.items()}
    require_known(values, [*ranges, *(name for name in paths if name not in ranges)])
    more = {paths[name]: number(name, value) for name, value in values.items() if name not in ranges}
    found = cell if not more else _with_more(cell, names, more)
    return found.at(values) if found.parameters else found


def _with_more(cell: C, names: Mapping[Location, str], more: Mapping[Location, float]) -> C:
    """Return a family with further parameters, each from the number of the cell to a value."""
    own = {p.path: p for p in cell.parameters}
    for place in walk(type(cell), cell):
        if place.path in more:
            base, value = float(place.value), more[place.path]
            own[place.path] = CellParameter(
                names[place.path], place.path, min(base, value), max(base, value), base
            )
    return cell.with_parameters(tuple(own[path] for path in names if path in own))


def member_faults(cell: Family, numbers: Mapping[Location, float]) -> list[InitErrorDetails]:
    """Return the faults of a cell with other numbers, at their locations; empty for a cell that there is."""
    try:
        rebuilt(cell, numbers)
    except ValidationError as error:
        return [
            InitErrorDetails(type=e["type"], loc=e["loc"], input=e["input"], ctx=e.get("ctx", {}))
            for e in error.errors()
        ]
    return []


def rebuilt(cell: C, numbers: Mapping[Location, float]) -> C:
    """Return a cell with other numbers at these paths, validated; sections without one are kept as they are.

    Raises
    ------
    ValidationError
        The cell is faulty; the locations begin below ``cell``.
    """
    sections: dict[str, Any] = {name: getattr(cell, name) for name in type(cell).model_fields}
    for key in {path[0] for path in numbers}:
        own = {path[1:]: number for path, number in numbers.items() if path[0] == key}
        kept = sections[key]
        if isinstance(kept, dict):
            regions = {path[0] for path in own}
            sections[key] = {
                name: _section(
                    part, {path[1:]: n for path, n in own.items() if path[0] == name}, (key, name, "")
                )
                if name in regions
                else part
                for name, part in kept.items()
            }
        else:
            sections[key] = (
                _section(kept, own, (key, getattr(kept, "kind", "")))
                if isinstance(kept, BaseModel)
                else own[()]
            )
    return type(cell).model_validate(sections)


def _section(section: BaseModel, numbers: Mapping[Location, float], at: tuple[str, ...]) -> BaseModel:
    """Return a section with other numbers; the location of a fault begins with ``at``, which ends with the kind."""
    try:
        return type(section).model_validate(replaced(section.model_dump(), numbers))
    except ValidationError as error:
        raise ValidationError.from_exception_data(
            type(section).__name__,
            [
                InitErrorDetails(type=e["type"], loc=(*at, *e["loc"]), input=e["input"], ctx=e.get("ctx", {}))
                for e in error.errors()
            ],
        ) from None


def fault(path: Location, text: str, value: Any) -> InitErrorDetails:
    """Return a fault at a path below ``cell``; behind a key of several kinds stands a part for the kind."""
    depth = {"geometry": 1, "material": 1, "materials": 2}.get(path[0], len(path))
    location = (*path[:depth], "", *path[depth:]) if depth < len(path) else path
    return InitErrorDetails(type="value_error", loc=location, input=value, ctx={"error": ValueError(text)})


def replaced(data: Any, values: Mapping[Location, Any], at: Location = ()) -> Any:
    """Return a copy of nested settings with other values at some paths; keys that are not there are added."""
    if at in values:
        return values[at]
    below = {path[len(at)] for path in values if path[: len(at)] == at}
    if not below:
        return data
    if isinstance(data, Mapping):
        found = {key: replaced(value, values, (*at, str(key))) for key, value in data.items()}
        added = {key: values[(*at, key)] for key in sorted(below - {*map(str, data)}) if (*at, key) in values}
        return {**found, **added}
    if isinstance(data, list | tuple):
        return type(data)(replaced(value, values, (*at, str(i))) for i, value in enumerate(data))
    return data


def refusals(error: ValidationError) -> str:
    """Return the faults of a member in one line."""
    return "; ".join(dict.fromkeys(e["msg"].removeprefix("Value error, ") for e in error.errors()))
