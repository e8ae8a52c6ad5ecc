"""Walk over a configuration: every value with its place and its declaration."""

from __future__ import annotations

import types
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, TypeGuard, Union, get_args, get_origin

from pydantic import BaseModel, Discriminator, Tag

from porocore.core.files.yaml_document import Location

#: Key of the ends of a range in place of a number.
RANGE = "range"


@dataclass(frozen=True)
class Place:
    """One value of a configuration.

    Attributes
    ----------
    path
        Keys and indices that lead to the value.
    value
        Read data or a validated value.
    annotation
        Declared type without its metadata; of a union the section, mapping or list that holds the value.
    metadata
        Declared metadata, followed by those of that member.
    above
        Place of the section, mapping or list that holds the value; None for the root.
    """

    path: Location
    value: Any
    annotation: Any
    metadata: tuple[Any, ...]
    above: Place | None = None


def walk(model: type[BaseModel], value: Any) -> Iterator[Place]:
    """Yield every declared value in a section, depth first, each after the one that holds it.

    Parameters
    ----------
    model
        Declares the section.
    value
        An instance of the model, or a mapping that is still to be validated as one; undeclared keys are passed over.
    """
    yield from _walk(Place((), value, model, ()))


def _walk(place: Place) -> Iterator[Place]:
    annotation, metadata, value = place.annotation, place.metadata, place.value
    while is_union(annotation) and (member := _member(annotation, metadata, value)) is not None:
        annotation, more = bare(member)
        metadata += more
    place = replace(place, annotation=annotation, metadata=metadata)
    yield place
    for key, part, given, child in _parts(annotation, value):
        declared, more = bare(part)
        yield from _walk(Place((*place.path, key), child, declared, (*given, *more), place))


def _parts(annotation: Any, value: Any) -> Iterator[tuple[str, Any, tuple[Any, ...], Any]]:
    """Yield key, annotation, metadata and value of everything that a value holds directly."""
    arguments = get_args(annotation)
    if is_section(annotation):
        given = value if isinstance(value, Mapping) else dict(value) if isinstance(value, annotation) else {}
        for key, child in given.items():
            field = annotation.model_fields.get(key) if isinstance(key, str) else None
            if field is not None:
                yield str(key), field.annotation, tuple(field.metadata), child
    elif get_origin(annotation) is dict and isinstance(value, Mapping):
        for key, child in value.items():
            yield str(key), arguments[1], (), child
    elif is_number(annotation) and isinstance(value, Mapping) and isinstance(value.get(RANGE), list | tuple):
        # The ends of a range in place of a number are declared like the number.
        yield RANGE, types.GenericAlias(tuple, (annotation, ...)), (), value[RANGE]
    elif get_origin(annotation) is tuple and isinstance(value, list | tuple):
        same = arguments[-1] is Ellipsis
        for i, child in enumerate(value):
            yield str(i), arguments[0 if same else min(i, len(arguments) - 1)], (), child


def with_number(value: Any, path: Location, change: Callable[[float], Any]) -> Any:
    """Return a copy of a section, mapping or list with a changed number at a path; nothing is validated."""
    if not path:
        return change(value)
    key, below = path[0], path[1:]
    if isinstance(value, BaseModel):
        return value.model_copy(update={key: with_number(getattr(value, key), below, change)})
    if isinstance(value, Mapping):
        return {name: with_number(v, below, change) if str(name) == key else v for name, v in value.items()}
    return type(value)(with_number(v, below, change) if str(i) == key else v for i, v in enumerate(value))


def bare(annotation: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return an annotation without its metadata, and these."""
    metadata: tuple[Any, ...] = ()
    while get_origin(annotation) is Annotated:
        annotation, *more = get_args(annotation)
        metadata += tuple(more)
    return annotation, metadata


def is_number(annotation: Any) -> bool:
    """Return True for a real number, and for one that may be left out."""
    annotation, _ = bare(annotation)
    if is_union(annotation):
        return any(is_number(member) for member in get_args(annotation))
    return annotation is float


def is_section(annotation: Any) -> TypeGuard[type[BaseModel]]:
    """Return True for a model of a section."""
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def is_union(annotation: Any) -> bool:
    """Return True for a union of types."""
    return get_origin(annotation) in (Union, types.UnionType)


def _member(union: Any, metadata: tuple[Any, ...], value: Any) -> Any:
    """Return the member of a union that holds a value; None without a section, mapping, list or text for it."""
    chooser = next((extra for extra in metadata if isinstance(extra, Discriminator)), None)
    for member in get_args(union):
        tag = next((extra.tag for extra in bare(member)[1] if isinstance(extra, Tag)), None)
        if chooser is None:
            if _may_hold(member, value):
                return member
        elif callable(chooser.discriminator) and tag == chooser.discriminator(value):
            return member
    return None


def _may_hold(annotation: Any, value: Any) -> bool:
    """Return True if an annotation is a container for values of this type, or a text and the value is one."""
    annotation, _ = bare(annotation)
    if is_union(annotation):
        return any(_may_hold(part, value) for part in get_args(annotation))
    if isinstance(value, str):
        return annotation is str
    if isinstance(value, BaseModel):
        return is_section(annotation) and isinstance(value, annotation)
    if isinstance(value, Mapping):
        return get_origin(annotation) is dict or is_section(annotation)
    return get_origin(annotation) is tuple and isinstance(value, list | tuple)
