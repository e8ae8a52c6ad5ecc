"""Family of cells by the values of parameters (Family): which numbers are ranges, members, faults."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, TypeVar, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ModelWrapValidatorHandler, PrivateAttr, ValidationError, model_validator
from pydantic_core import InitErrorDetails

from porocore.cell.geometry.pore_geometry import PoreGeometry
from porocore.cell.materials.prony import RELAXATION
from porocore.core.echo import cut, echo, joined, suggestion
from porocore.core.files.yaml_document import Location, dotted, leaves
from porocore.core.inputs import NAMES
from porocore.core.models.strict import RANGE, Place, StrictModel, bounds, copied, fault_text, is_number, walk
from porocore.core.units import Dimension, has_unit
from porocore.errors import ConfigurationError, MemberError
from porocore.states import Array

if TYPE_CHECKING:
    import numpy.typing as npt


#: Keys of a cell below which a number may be a parameter.
SECTIONS = ("geometry", "material", "materials", "viscosity")
#: Slack of a range for round-off, relative to its width.
SLACK = 1e-9


@dataclass(frozen=True)
class CellParameter:
    """A number of a cell that varies between two ends.

    Attributes
    ----------
    name
        Last part of its key, with the region before it where there are several solids: ``core.poisson_ratio``;
        ``radii.x`` for one of three axes; ``terms.0.mu`` in a list.
    path
        Keys and indices that lead to it, below ``cell``.
    lower, upper
        Ends of the range, closed.
    base
        Value of the cell whose mesh is moved to the other values, by default the middle of the range.
    """

    name: str
    path: Location
    lower: float
    upper: float
    base: float

    @property
    def key(self) -> str:
        """Key in the configuration, such as ``cell.geometry.radius``."""
        return dotted(("cell", *self.path))

    @property
    def shape(self) -> bool:
        """True where the pores depend on it, so that the mesh moves."""
        return self.path[0] == "geometry"

    @property
    def region(self) -> str | None:
        """Region of the solid whose material has it; None for a cell of one material, and for all others."""
        return self.path[1] if self.path[0] == "materials" else None

    @property
    def solid_key(self) -> Location | None:
        """Keys that ``parameter_slopes`` of the solid takes; None for pores and viscosity."""
        return self.path[1:] if self.path[0] in ("material", "materials") else None

    def require_inside(self, value: float) -> None:
        """Refuse a value outside the range.

        Raises
        ------
        ConfigurationError
            It lies outside by more than round-off, or is not finite.
        """
        slack = SLACK * (self.upper - self.lower)
        if not self.lower - slack <= value <= self.upper + slack:
            raise ConfigurationError(
                f"{self.name}: expected a number from {self.lower:g} to {self.upper:g}, the range of {self.key}, got "
                f"{echo(value)}"
            )


def possible_parameters(cell: Family) -> dict[Location, str]:
    """Return the names of all numbers of a cell that may be parameters, by their paths below ``cell``."""
    places = [place for place in walk(type(cell), cell) if place.value is not None and may_vary(place)]
    several = len(getattr(cell, "materials", None) or ()) > 1
    short = {place.path: _short_name(place, several) for place in places}
    counts = Counter([*short.values(), *NAMES])
    return {path: name if counts[name] == 1 else ".".join(path) for path, name in short.items()}


def parameter_quantities(cell: Family) -> dict[str, str]:
    """Return the quantity of each parameter of a cell, by its name, such as stress; '' is a plain number."""
    places = {place.path: place for place in walk(type(cell), cell)}
    return {each.name: _quantity(places[each.path]) for each in cell.parameters}


def _quantity(place: Place) -> str:
    """Return the quantity of a number: that which it, or the mapping or list that holds it, is declared to have."""
    declared, at = "", place
    while True:
        if not declared:
            found = (extra.quantity for extra in at.metadata if isinstance(extra, Dimension))
            declared = next(found, "")
        if isinstance(at.value, StrictModel):
            return at.value.quantity_of(place.path[len(at.path) :], declared)
        if at.above is None:
            return declared
        at = at.above


def may_vary(place: Place) -> bool:
    """Return whether a number of a cell may be a parameter: of pores, materials or fluid, and no length in metres.

    A component of a direction is none, since a direction has no length; its angle is one. A relaxation is none of the
    cell's, whose problems do not depend on it.
    """
    fixed = any(isinstance(extra, Dimension) and extra.si for extra in place.metadata)
    of_a_direction = "directions" in place.path and place.path[-1].isdigit()
    of_a_relaxation = place.path[:1] + place.path[2 if place.path[:1] == ("materials",) else 1 :][:1] in (
        ("material", RELAXATION),
        ("materials", RELAXATION),
    )
    return (
        bool(place.path)
        and place.path[0] in SECTIONS
        and is_number(place.annotation)
        and not fixed
        and not of_a_direction
        and not of_a_relaxation
    )


def _short_name(place: Place, several: bool) -> str:
    """Return the name of a parameter, from the last list in its path or else its last part."""
    path = list(place.path)
    region = path[1] if path[0] == "materials" else ""
    below = path[2:] if region else path
    first = next((i - 1 for i, part in enumerate(below) if part.isdigit()), len(below) - 1)
    if below[-1].isdigit() and place.above is not None and _of_axes(place.above.annotation):
        below[-1] = "xyz"[int(below[-1])]
    name = ".".join(below[first:])
    return f"{region}.{name}" if region and several else name


def _of_axes(annotation: Any) -> bool:
    """Return whether a declared type is that of three numbers, one for each axis."""
    arguments = get_args(annotation)
    return get_origin(annotation) is tuple and len(arguments) == 3 and Ellipsis not in arguments


def values_in_order(
    parameters: Sequence[CellParameter], values: Mapping[str, float] | npt.ArrayLike
) -> tuple[float, ...]:
    """Return the values of parameters in their order, given by name or in this order, (m,).

    Raises
    ------
    ConfigurationError
        A name is unknown, a value is missing, no number or outside its range.
    """
    names = [parameter.name for parameter in parameters]
    if not isinstance(values, Mapping) and np.size(values) == 0:
        values = {}
    if isinstance(values, Mapping):
        given = _all_of(names, values)
    else:
        given = list(np.atleast_1d(np.asarray(values, dtype=object)))
        if len(given) != len(names) or np.ndim(np.asarray(values, dtype=object)) > 1:
            raise ConfigurationError(
                f"expected {len(names)} values, of {', '.join(names) or 'no parameter'}, got {echo(_plain(values))}"
            )
    found = tuple(number(name, value) for name, value in zip(names, given, strict=True))
    for parameter, value in zip(parameters, found, strict=True):
        parameter.require_inside(value)
    return found


def values_of_states(
    names: Sequence[str], values: Mapping[str, npt.ArrayLike] | npt.ArrayLike, n: int
) -> Array:
    """Return the values of parameters for n states, (n, m), given by name or in their order.

    Parameters
    ----------
    names
        Of the m parameters.
    values
        By name a number or (n,); or all of them in their order, (m,) or (n, m).
    n
        Number of states.

    Raises
    ------
    ConfigurationError
        A name is unknown, or a value is missing, no finite number or of another shape.
    """
    if not isinstance(values, Mapping):
        found = np.asarray(values, dtype=object)
        if found.shape not in ((len(names),), (1, len(names)), (n, len(names))):
            raise ConfigurationError(
                f"parameters: expected values of {', '.join(names) or 'no parameter'}, shape ({len(names)},) or "
                f"({n}, {len(names)}), got shape {found.shape}"
            )
        values = dict(zip(names, np.atleast_2d(found).T, strict=True))
    columns = [_of_states(name, given, n) for name, given in zip(names, _all_of(names, values), strict=True)]
    return np.stack(columns, axis=1) if columns else np.zeros((n, 0))


def _all_of(names: Sequence[str], values: Mapping[str, Any]) -> list[Any]:
    """Return the values of all parameters in their order; refuse other names, and missing ones."""
    require_known(values, names)
    if lacking := [name for name in names if name not in values]:
        raise ConfigurationError(
            f"{lacking[0]}: no value is given for this parameter of the cell; the parameters are {joined(names)}"
        )
    return [values[name] for name in names]


def _of_states(name: str, values: npt.ArrayLike, n: int) -> Array:
    """Return the values (n,) of one parameter for n states, given as one number or as n."""
    try:
        found = np.array(values, dtype=float)
    except (TypeError, ValueError):
        found = np.array([np.nan])
    if found.shape not in ((), (1,), (n,)) or not np.isfinite(found).all():
        raise ConfigurationError(
            f"{name}: expected a finite number, or one for each of the n = {n} states, got {echo(_plain(values))}"
        )
    return np.broadcast_to(found, n)


def require_known(
    given: Iterable[str], names: Sequence[str], bound: Mapping[str, float] | None = None
) -> None:
    """Refuse names that are no parameters, or are bound to a value.

    Raises
    ------
    ConfigurationError
        A name is unknown, for which similar ones are proposed, or ``bound``.
    """
    for name in given:
        if bound and name in bound:
            raise ConfigurationError(
                f"{cut(str(name))}: it is bound to {bound[name]:g} already; bind another value from the law that has "
                "it open"
            )
        if name not in names:
            advice = suggestion(str(name), names, "the parameters are", "the cell has no parameters")
            raise ConfigurationError(f"{cut(str(name))}: no parameter of the cell has this name; {advice}")


def _plain(values: Any) -> Any:
    return values.tolist() if isinstance(values, np.ndarray) else values


def number(name: str, value: Any) -> float:
    """Return the value of a parameter as a finite number.

    Raises
    ------
    ConfigurationError
        It is none.
    """
    try:
        if isinstance(value, bool | str):
            raise TypeError
        found = float(value)
    except (TypeError, ValueError):
        raise ConfigurationError(f"{name}: expected a number, got {echo(value)}") from None
    if not math.isfinite(found):
        raise ConfigurationError(f"{name}: expected a finite number, got {echo(found)}")
    return found


def base_values(parameters: Sequence[CellParameter]) -> Array:
    """Return the values at which the mesh of the family is made, (m,)."""
    return np.array([parameter.base for parameter in parameters], dtype=np.float64)


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
        "a range cannot stand here; numbers of the pores' shape, of materials and the viscosity may have one, those of "
        "a relaxation, sizes of the mesh and lengths in metres may not"
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
        bare = (
            " without units" if any(has_unit(end) for _, end in leaves(ends) if isinstance(end, str)) else ""
        )
        raise ValueError(f"expected {{range: [lower, upper]}} with two numbers{bare}, got {echo(ends)}")
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
    sections = {name: getattr(cell, name) for name in type(cell).model_fields}
    return type(cell).model_validate(replaced(sections, numbers))


def fault(path: Location, text: str, value: Any) -> InitErrorDetails:
    """Return a fault at a path below ``cell``; behind a key of several kinds stands a part for the kind."""
    depth = {"geometry": 1, "material": 1, "materials": 2}.get(path[0], len(path))
    location = (*path[:depth], "", *path[depth:]) if depth < len(path) else path
    return InitErrorDetails(type="value_error", loc=location, input=value, ctx={"error": ValueError(text)})


def replaced(data: Any, values: Mapping[Location, Any], at: Location = ()) -> Any:
    """Return a copy of nested settings with other values at some paths; keys that are not there are added.

    A section on the way becomes a mapping, to be validated again; others stay as they are.
    """
    if at in values:
        return values[at]
    below = {path[len(at)] for path in values if path[: len(at)] == at}
    if not below:
        return data
    if isinstance(data, BaseModel):
        data = data.model_dump()
    if isinstance(data, Mapping):
        found = {key: replaced(value, values, (*at, str(key))) for key, value in data.items()}
        added = {key: values[(*at, key)] for key in sorted(below - {*map(str, data)}) if (*at, key) in values}
        return {**found, **added}
    if isinstance(data, list | tuple):
        return type(data)(replaced(value, values, (*at, str(i))) for i, value in enumerate(data))
    return data


def refusals(cell: Family, error: ValidationError) -> str:
    """Return the faults of a member of a family in one line, in the words for a value of the configuration."""
    declared = {place.path: place.metadata for place in walk(type(cell), cell)}
    told = []
    for fault in error.errors():
        text = fault_text(fault)
        for parameter in cell.parameters:
            if fault["type"] != "value_error" and all(part in fault["loc"] for part in parameter.path):
                expected = bounds(parameter.path[-1], declared.get(parameter.path, ()))
                text = f"expected {expected}, got {echo(fault['input'])}" if expected else text
                text = f"{parameter.key}: {text}"
        told.append(text)
    return "; ".join(dict.fromkeys(told))


class Family(StrictModel):
    """Settings of a cell whose numbers may be ranges: a family of cells, or one member of it.

    A family has the numbers of its base, the middles of the ranges. A member has numbers of its own and the same
    :attr:`parameters`. Settings without ranges are neither.
    """

    _parameters: tuple[CellParameter, ...] = PrivateAttr(default=())
    #: Values of the parameters of a member; None for a family, whose numbers are those of its base.
    _values: tuple[float, ...] | None = PrivateAttr(default=None)

    @model_validator(mode="wrap")
    @classmethod
    def _read_ranges(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        if not isinstance(data, Mapping):
            return handler(data)
        numbers, ranges = split_ranges(cls, data)
        cell = handler(numbers)
        if ranges:
            cell._parameters = parameters_of(cell, ranges)
            require_ends(cell, cell._parameters)
        return cell

    def _with_ranges(self, data: dict[str, Any]) -> dict[str, Any]:
        """Return dumped settings with the ranges of a family in place of its numbers."""
        if self._values is not None:
            return data
        ranges = {p.path: {"range": [p.lower, p.upper]} for p in self._parameters}
        found: dict[str, Any] = replaced(data, ranges)
        return found

    @property
    def parameters(self) -> tuple[CellParameter, ...]:
        """Parameters of the family that the cell is or belongs to, in the order of its keys; empty without ranges."""
        return self._parameters

    @property
    def parameter_values(self) -> Array | None:
        """Values of the parameters of a member, (m,); None for a family, and for a cell without parameters."""
        return None if self._values is None else np.array(self._values)

    @property
    def is_family(self) -> bool:
        """True where the parameters have no values, so that :meth:`at` has to choose a member."""
        return bool(self._parameters) and self._values is None

    def at(self, values: Mapping[str, float] | npt.ArrayLike = (), /) -> Self:
        """Return the member of the family at some values of the parameters.

        Its mesh is that of the family, moved from the base values; it is never made anew.

        Parameters
        ----------
        values : mapping or (m,)
            Values by name, or in the order of :attr:`parameters`.

        Raises
        ------
        MemberError
            No cell has these values together.
        ConfigurationError
            A name is unknown, or a value is missing or outside its range.
        """
        numbers = values_in_order(self._parameters, values)
        if not self._parameters:
            return self
        return self._member(numbers)

    def with_parameters(self, parameters: tuple[CellParameter, ...]) -> Self:
        """Return the family of the cell with these parameters, whose base has the numbers of this one."""
        family = copied(self)
        family._parameters, family._values = parameters, None
        return family

    def fixed(self, names: Collection[str]) -> Self:
        """Return the family or the member without the named parameters, which keep the numbers that they have."""
        kept = [k for k, parameter in enumerate(self._parameters) if parameter.name not in names]
        found = self.with_parameters(tuple(self._parameters[k] for k in kept))
        if self._values is not None and kept:
            found._values = tuple(self._values[k] for k in kept)
        return found

    def _member(self, numbers: tuple[float, ...]) -> Self:
        paths = [parameter.path for parameter in self._parameters]
        try:
            found = rebuilt(self, dict(zip(paths, numbers, strict=True)))
        except ValidationError as error:
            at = ", ".join(f"{p.name} = {x:g}" for p, x in zip(self._parameters, numbers, strict=True))
            raise MemberError(f"no cell has {at}: {refusals(self, error)}") from None
        found._parameters, found._values = self._parameters, numbers
        return found

    @property
    def moved_from(self) -> dict[str, float]:
        """Base values by key from which the mesh of a member was moved; empty where it is that of its own numbers."""
        return {
            p.key: p.base
            for p, value in zip(self._parameters, self._values or (), strict=False)
            if p.shape and value != p.base
        }

    def base_section(self, key: str) -> Any:
        """Return a section with the base values in place of those of a member."""
        numbers = {p.path[1:]: p.base for p in self._parameters if p.path[0] == key}
        section = getattr(self, key)
        return type(section).model_validate(replaced(section, numbers)) if numbers else section

    @property
    def _generic(self) -> Self:
        """Member near the base of a family, without a symmetry by chance; a member is its own."""
        # What is kept must not be the cell itself, else two equal ones are compared without end.
        return self._generic_member if self.is_family else self

    @cached_property
    def _generic_member(self) -> Self:
        shares = 1e-3 * np.sqrt(np.arange(2, 2 + len(self._parameters)))
        widths = [parameter.upper - parameter.lower for parameter in self._parameters]
        return self._member(tuple((base_values(self._parameters) + shares * widths).tolist()))

    def require_member(self, advice: str = "give one number instead of the range") -> None:
        """Refuse a family where one cell is needed.

        Raises
        ------
        ConfigurationError
            A parameter has no value.
        """
        if self.is_family:
            first = self._parameters[0]
            raise ConfigurationError(
                f"{first.key}: expected one number, got the range from {first.lower:g} to {first.upper:g}; {advice}"
            )


def changed_numbers(base: PoreGeometry, geometry: PoreGeometry) -> dict[str, tuple[float, float]]:
    """Return the numbers in which two geometries differ by their keys, that of the base first.

    Raises
    ------
    ConfigurationError
        They differ in more than numbers.
    """
    one, other = _leaves(base), _leaves(geometry)
    found = {}
    for key in ["kind", *sorted({*one, *other} - {"kind"})]:
        a: Any = one.get(key)
        b: Any = other.get(key)
        if a == b:
            continue
        if not all(isinstance(x, float | int) and not isinstance(x, bool) for x in (a, b)):
            raise ConfigurationError(
                f"cell.geometry.{key}: the members of a family differ in numbers only, but this is {a!r} in one and "
                f"{b!r} in another; keep it the same, or make a family of each"
            )
        found[key] = (float(a), float(b))
    return found


def _leaves(geometry: PoreGeometry) -> dict[str, Any]:
    """Return all values of a geometry by their keys."""
    places = walk(type(geometry), geometry)
    return {
        dotted(place.path): place.value for place in places if not isinstance(place.value, BaseModel | tuple)
    }
