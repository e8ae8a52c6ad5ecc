"""Conversion of texts with units in a configuration to dimensionless numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, get_args

from pydantic import BaseModel

from porocore.core.echo import comma_advice, echo
from porocore.core.files.yaml_document import Location, dotted
from porocore.core.models.walk import Place, bare, is_section, walk
from porocore.core.units.dimensions import ByKey, Carried, Dimension
from porocore.core.units.quantities import EXAMPLES, UnitError, has_unit, in_si
from porocore.core.units.scales import QUANTITIES, Scales

ADD_SCALES = (
    "the configuration has no scales to make it dimensionless; add 'scales:' with length, pore and modulus at the top "
    "level"
)
NO_SCALES = f"has a unit, but {ADD_SCALES}, or write a dimensionless number"


def resolved(
    model: type[BaseModel], data: Any, scales: Scales | None
) -> tuple[Any, list[tuple[Location, str]]]:
    """Return a copy of ``data``, to be validated as ``model``, with numbers for texts with units, and the faults.

    Parameters
    ----------
    model
        Whose fields carry :class:`~porocore.core.units.dimensions.Dimension`.
    data
        As it was read; left alone.
    scales
        By which values become dimensionless; None: only values in SI units can have a unit.

    Returns
    -------
    data, faults
        At each faulty place the text is left as it is.
    """
    found: dict[Location, float] = {}
    faults: list[tuple[Location, str]] = []
    for place, dimension in dimensions(model, data):
        if not isinstance(place.value, str):
            continue
        dimension = dimension or _of_a_member(place.annotation)
        if dimension is not None and has_unit(place.value):
            try:
                found[place.path] = _number(place.value, dimension, scales)
            except UnitError as error:
                faults.append((place.path, f"{dotted(place.path)}: {error}"))
    return _replaced(data, found, ()), faults


def dimensions(model: type[BaseModel], data: Any) -> Iterator[tuple[Place, Dimension | None]]:
    """Yield every declared value in a section with its dimension; see :func:`~porocore.core.models.walk.walk`."""
    #: By place, the dimension of its value, and that of the value to which its section belongs.
    known: dict[Location, tuple[Dimension | None, Dimension | None]] = {}
    for place in walk(model, data):
        dimension, _ = known[place.path] = _dimension(place, known)
        yield place, dimension


def _dimension(
    place: Place, known: Mapping[Location, tuple[Dimension | None, Dimension | None]]
) -> tuple[Dimension | None, Dimension | None]:
    """Return the dimension of a value, and that of the value to which its section belongs.

    Entries of a mapping or list have the dimension of the whole unless their own metadata say otherwise.
    """
    dimension = carried = None
    if (above := place.above) is not None:
        dimension, carried = known[above.path]
        if is_section(above.annotation):
            dimension, carried = None, dimension
        for extra in above.metadata:
            if isinstance(extra, ByKey):
                dimension = extra.dimensions.get(place.path[-1], dimension)
    for extra in place.metadata:
        if isinstance(extra, Dimension):
            dimension = extra
        elif isinstance(extra, Carried):
            dimension = carried
    return dimension, carried


def value_of(text: str, quantity: str, scales: Scales | None) -> float:
    """Return the dimensionless number of a text such as ``0.2`` or ``1 kPa``.

    Raises
    ------
    UnitError
        It is no number and no value of that quantity, or has a unit without scales.
    """
    return _number(text, Dimension(quantity), scales) if has_unit(text) else _plain(text, quantity)


def _plain(text: str, quantity: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise UnitError(
            f"expected a number, or {EXAMPLES[quantity]}, got {echo(text)}{comma_advice(text)}"
        ) from None


def _number(text: str, dimension: Dimension, scales: Scales | None) -> float:
    if not dimension.si and scales is None:
        raise UnitError(f"{echo(text)} {NO_SCALES}")
    value = in_si(text, dimension.quantity)
    if scales is not None and not dimension.si:
        value /= QUANTITIES[dimension.quantity].factor(scales.exact)
    try:
        return float(value)
    except OverflowError:
        raise UnitError(f"{echo(text)} is too large a number") from None


def _replaced(data: Any, numbers: Mapping[Location, float], at: Location) -> Any:
    """Return a copy of nested data with numbers at some places."""
    if at in numbers:
        return numbers[at]
    if isinstance(data, Mapping):
        return {key: _replaced(value, numbers, (*at, str(key))) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return type(data)(_replaced(value, numbers, (*at, str(i))) for i, value in enumerate(data))
    return data


def _of_a_member(annotation: Any) -> Dimension | None:
    """Return the dimension of a member of a union that has one."""
    extras = (extra for member in get_args(annotation) for extra in bare(member)[1])
    return next((extra for extra in extras if isinstance(extra, Dimension)), None)
