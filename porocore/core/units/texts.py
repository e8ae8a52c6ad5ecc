"""Conversion of texts with units in a configuration to numbers, at the keys that have a dimension."""

from __future__ import annotations

import types
from collections.abc import Mapping
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, Discriminator, Tag

from porocore.core.echo import echo
from porocore.core.files.yaml_document import Location, dotted
from porocore.core.units.dimensions import ByKey, Carried, Dimension
from porocore.core.units.quantities import UnitError, has_unit, in_si
from porocore.core.units.scales import QUANTITIES, Scales

NO_SCALES = (
    "has a unit, but the configuration has no scales to make it dimensionless; add 'scales:' with length, pore and "
    "modulus at the top level, or write a dimensionless number"
)


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
    reader = _Reader(scales)
    return reader.section(model, data, (), None), reader.faults


class _Reader:
    def __init__(self, scales: Scales | None) -> None:
        self.scales = scales
        self.faults: list[tuple[Location, str]] = []

    def section(self, model: type[BaseModel], data: Any, at: Location, carried: Dimension | None) -> Any:
        if not isinstance(data, Mapping):
            return data
        found = dict(data)
        for key, value in data.items():
            if isinstance(key, str) and (field := model.model_fields.get(key)) is not None:
                found[key] = self._value(field.annotation, field.metadata, value, (*at, key), None, carried)
        return found

    def _value(
        self,
        annotation: Any,
        metadata: list[Any],
        data: Any,
        at: Location,
        dimension: Dimension | None,
        carried: Dimension | None,
    ) -> Any:
        """Convert one value; ``dimension`` is that of the enclosing value, unless its own metadata says otherwise."""
        while get_origin(annotation) is Annotated:
            annotation, *more = get_args(annotation)
            metadata = [*metadata, *more]
        by_key: Mapping[str, Dimension] = {}
        for extra in metadata:
            if isinstance(extra, Dimension):
                dimension = extra
            elif isinstance(extra, Carried):
                dimension = carried
            elif isinstance(extra, ByKey):
                by_key = extra.dimensions
        union = get_origin(annotation) in (Union, types.UnionType)
        if isinstance(data, str):
            inner = _of_a_branch(annotation) if union and dimension is None else None
            return self._text(data, at, inner or dimension)
        if union:
            branch = _branch(annotation, metadata, data)
            return data if branch is None else self._value(branch, [], data, at, dimension, carried)
        arguments = get_args(annotation)
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            return self.section(annotation, data, at, dimension)
        if get_origin(annotation) is dict and isinstance(data, Mapping):
            return {
                key: self._value(
                    arguments[1], [], value, (*at, str(key)), by_key.get(str(key), dimension), carried
                )
                for key, value in data.items()
            }
        if get_origin(annotation) is tuple and isinstance(data, list | tuple):
            same = arguments[-1] is Ellipsis
            parts = [arguments[0 if same else min(i, len(arguments) - 1)] for i in range(len(data))]
            return [
                self._value(part, [], value, (*at, str(i)), dimension, carried)
                for i, (part, value) in enumerate(zip(parts, data, strict=True))
            ]
        return data

    def _text(self, text: str, at: Location, dimension: Dimension | None) -> Any:
        if dimension is None or not has_unit(text):
            return text
        key = dotted(at)
        if not dimension.si and self.scales is None:
            self.faults.append((at, f"{key}: {echo(text)} {NO_SCALES}"))
            return text
        try:
            value = in_si(text, dimension.quantity)
        except UnitError as error:
            self.faults.append((at, f"{key}: {error}"))
            return text
        if not dimension.si:
            assert self.scales is not None
            value /= QUANTITIES[dimension.quantity].factor(self.scales.exact)
        try:
            return float(value)
        except OverflowError:
            self.faults.append((at, f"{key}: {echo(text)} is too large a number"))
            return text


def _branch(annotation: Any, metadata: list[Any], data: Any) -> Any:
    """Return the member of a union that a value other than a text belongs to; None if none matters."""
    chooser = next((extra for extra in metadata if isinstance(extra, Discriminator)), None)
    for branch in get_args(annotation):
        extras = get_args(branch)[1:] if get_origin(branch) is Annotated else ()
        tag = next((extra.tag for extra in extras if isinstance(extra, Tag)), None)
        if chooser is not None:
            if callable(chooser.discriminator) and tag == chooser.discriminator(data):
                return branch
        elif _may_hold(branch, data):
            return branch
    return None


def _of_a_branch(annotation: Any) -> Dimension | None:
    """Return the dimension of a member of a union that has one."""
    extras = (extra for branch in get_args(annotation) for extra in get_args(branch)[1:])
    return next((extra for extra in extras if isinstance(extra, Dimension)), None)


def _may_hold(branch: Any, data: Any) -> bool:
    """Return whether a branch is a container for data of this type."""
    while get_origin(branch) is Annotated:
        branch = get_args(branch)[0]
    if get_origin(branch) in (Union, types.UnionType):
        return any(_may_hold(part, data) for part in get_args(branch))
    if isinstance(data, Mapping):
        return get_origin(branch) is dict or (isinstance(branch, type) and issubclass(branch, BaseModel))
    return get_origin(branch) is tuple and isinstance(data, list | tuple)
