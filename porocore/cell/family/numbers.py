"""Numbers of a geometry by their keys: one of them replaced, and those in which two geometries differ."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from porocore.cell.geometry.pore_geometry import PoreGeometry
from porocore.errors import ConfigurationError


def with_number(geometry: PoreGeometry, key: str, number: complex) -> PoreGeometry:
    """Return a geometry with another number, which is not checked and may be complex.

    Parameters
    ----------
    geometry
        The geometry.
    key
        Dotted path of the number in it, such as ``radius``, ``radii.x`` or ``centres.2.0``.
    number
        The new number.

    Raises
    ------
    ConfigurationError
        There is no number under this key.
    """
    changed: PoreGeometry = _replaced(geometry, key.split("."), number, f"cell.geometry.{key}")
    return changed


def _replaced(value: Any, path: list[str], number: complex, key: str) -> Any:
    if not path:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ConfigurationError(
                f"{key}: expected the key of a number of the geometry, got {value!r} there"
            )
        return number
    first, *rest = path
    if isinstance(value, BaseModel) and first in type(value).model_fields:
        fields = dict(value)
        # No copy: that would keep cached properties of the old number.
        return type(value).model_construct(**{**fields, first: _replaced(fields[first], rest, number, key)})
    if isinstance(value, tuple):
        place = (
            "xyz".find(first) if len(first) == 1 and first in "xyz" else int(first) if first.isdigit() else -1
        )
        if 0 <= place < len(value):
            return (*value[:place], _replaced(value[place], rest, number, key), *value[place + 1 :])
    raise ConfigurationError(
        f"{key}: the geometry has no number under this key; give the path of one of its numbers"
    )


def number_at(geometry: PoreGeometry, key: str) -> float:
    """Return the number of a geometry under a key, see :func:`with_number`.

    Raises
    ------
    ConfigurationError
        There is no number under this key.
    """
    with_number(geometry, key, 0.0)
    value: Any = geometry
    for part in key.split("."):
        if isinstance(value, BaseModel):
            value = getattr(value, part)
        else:
            value = value["xyz".index(part) if part in "xyz" else int(part)]
    return float(value)


def changed_numbers(base: PoreGeometry, geometry: PoreGeometry) -> dict[str, tuple[float, float]]:
    """Return the numbers in which two geometries differ by their keys, that of the base first.

    Raises
    ------
    ConfigurationError
        They differ in more than numbers.
    """
    one, other = dict(_leaves(base, "")), dict(_leaves(geometry, ""))
    found = {}
    for key in ["kind", *sorted({*one, *other} - {"kind"})]:
        a, b = one.get(key), other.get(key)
        if a == b:
            continue
        if a is None or b is None or not (_is_number(a) and _is_number(b)):
            raise ConfigurationError(
                f"cell.geometry.{key}: the members of a family differ in numbers only, but this is {a!r} in one and "
                f"{b!r} in another; keep it the same, or make a family of each"
            )
        found[key] = (float(a), float(b))
    return found


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)


def _leaves(value: Any, key: str) -> Iterator[tuple[str, Any]]:
    """Yield all values below a model with their keys."""
    if isinstance(value, BaseModel):
        # The fields alone: a model iterates over its cached properties too.
        parts = [(name, getattr(value, name)) for name in type(value).model_fields]
    elif isinstance(value, tuple):
        parts = [(str(i), part) for i, part in enumerate(value)]
    else:
        yield key, value
        return
    for name, part in parts:
        yield from _leaves(part, f"{key}.{name}" if key else name)
