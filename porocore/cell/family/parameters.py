"""Parameters of a cell (CellParameter): numbers that may be one, their names, values by name or in order."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, get_args, get_origin

import numpy as np

from porocore.core.echo import cut, echo, joined, suggestion
from porocore.core.files.yaml_document import Location, dotted
from porocore.core.inputs.input_space import NAMES
from porocore.core.models.strict import StrictModel
from porocore.core.models.walk import Place, is_number, walk
from porocore.core.units.dimensions import Dimension
from porocore.errors import ConfigurationError
from porocore.states import Array

if TYPE_CHECKING:
    import numpy.typing as npt

    from porocore.cell.family.family import Family

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

    A component of a direction is none, since a direction has no length; its angle is one.
    """
    fixed = any(isinstance(extra, Dimension) and extra.si for extra in place.metadata)
    of_a_direction = "directions" in place.path and place.path[-1].isdigit()
    return (
        bool(place.path)
        and place.path[0] in SECTIONS
        and is_number(place.annotation)
        and not fixed
        and not of_a_direction
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
        require_known(values, names)
        if lacking := [name for name in names if name not in values]:
            raise ConfigurationError(
                f"{lacking[0]}: no value is given for this parameter of the cell; the parameters are {joined(names)}"
            )
        given = [values[name] for name in names]
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
    require_known(values, names)
    if lacking := [name for name in names if name not in values]:
        raise ConfigurationError(
            f"{lacking[0]}: no value is given for this parameter of the cell; the parameters are {joined(names)}"
        )
    columns = [_of_states(name, values[name], n) for name in names]
    return np.stack(columns, axis=1) if columns else np.zeros((n, 0))


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
