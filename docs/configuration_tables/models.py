"""The keys of the configuration, as the pydantic models have them."""

from __future__ import annotations

import types
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from configuration_tables.words import codes, default_words, is_field, type_words
from porocore.core.formulas import TimeFunction
from porocore.core.units import MULTIPLES, ByKey
from porocore.plugins.registry import own
from porocore.study.config.config import RunConfig
from porocore.study.config.schema import field_docstrings, unit_of, with_sections

#: What stands for the keys of a mapping in a dotted key.
ANY_KEY = {
    "materials": "REGION",
    "inputs": "NAME",
    "boundary": "SURFACE",
    "contact": "INDENTER",
    "surfaces": "PART",
    "scenarios": "NAME",
    "regions": "REGION",
    "fields": "PARAMETER",
    "evolution": "PARAMETER",
    "cells": "CELL",
    "unknowns": "NAME",
    "observations": "NAME",
    "points": "NAME",
    "experiments": "NAME",
}


@dataclass(frozen=True)
class Key:
    """One line of a table.

    Attributes
    ----------
    name
        Dotted, or of an option alone.
    type, default, unit, meaning
        As Markdown; the unit is empty where there is none.
    """

    name: str
    type: str
    default: str
    unit: str
    meaning: str


def sections_of(annotation: Any) -> tuple[list[type[BaseModel]], str]:
    """The models that may stand at a key, several where there are kinds, and whether as ``mapping`` or ``list``."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return sections_of(arguments[0])
    if is_field(annotation):  # the page has one table for all fields
        return [], ""
    if origin in (Union, types.UnionType):
        found = [sections_of(argument) for argument in arguments]
        return [model for models, _ in found for model in models], next((how for _, how in found if how), "")
    if origin is dict:
        return sections_of(arguments[1])[0], "mapping"
    if origin is tuple and arguments[-1] is Ellipsis:
        return sections_of(arguments[0])[0], "list"
    if annotation is TimeFunction:  # the page has one table for all values
        return [], ""
    return (
        ([annotation], "") if isinstance(annotation, type) and issubclass(annotation, BaseModel) else ([], "")
    )


def own_key(model: type[BaseModel], name: str, above: str = "", carried: str = "") -> Key:
    """Of one field, without what is below it."""
    field = model.model_fields[name]
    meaning = field_docstrings(model).get(name, "").removesuffix(".")
    unit = unit_of(field.annotation, field.metadata, carried)
    return Key(f"{above}{name}", type_words(field, name), default_words(field.default), unit, meaning)


def keys_of(
    model: type[BaseModel], above: str = "", carried: str = "", seen: dict[Any, str] | None = None
) -> Iterator[Key]:
    """Of a section and of all below it; of several kinds those of the default one.

    Parameters
    ----------
    above
        What its dotted keys begin with.
    carried
        The unit of the value that the section belongs to.
    seen
        Where sections stand that had their turn; a mapping of such ones refers to there.
    """
    seen = {} if seen is None else seen
    for name, field in model.model_fields.items():
        models, how = sections_of(field.annotation)
        key = f"{above}{name}"
        if not models or how:
            own = own_key(model, name, above, carried)
            where = seen.get(tuple(models))
            yield own if where is None else replace(own, type=f"mapping of names to sections as `{where}`")
            if where is not None:
                continue
        if not models:
            continue
        seen[tuple(models)] = key
        below = {"": key, "mapping": f"{key}.{ANY_KEY.get(name)}", "list": f"{key}[]"}[how]
        chosen = next((kind for kind in models if _is_default(kind)), models[0])
        for found in keys_of(chosen, f"{below}.", _carried(field.metadata), seen):
            if found.name == f"{key}.kind" and len(models) > 1:
                yield _of_kinds(found, field_docstrings(model).get(name, ""))
            else:
                yield found


def all_keys() -> list[Key]:
    """Of a whole configuration."""
    return list(keys_of(with_sections(own().offers)))


def kinds_at(key: str) -> dict[str, type[BaseModel]]:
    """The models that may stand at a dotted key, by their kind."""
    annotation: Any = RunConfig
    for name in key.split("."):
        (model,) = sections_of(annotation)[0]
        annotation = model.model_fields[name].annotation
    return {get_args(model.model_fields["kind"].annotation)[0]: model for model in sections_of(annotation)[0]}


def keys_by_kind(key: str) -> list[tuple[list[str], Key]]:
    """The keys of the kinds at a dotted key besides the default one, each with the kinds that have it alike."""
    found: dict[Key, list[str]] = {}
    for kind, model in kinds_at(key).items():
        if not _is_default(model):
            for own in keys_of(model):
                if own.name != "kind":
                    found.setdefault(own, []).append(kind)
    groups: dict[tuple[str, ...], list[Key]] = {}
    for own, kinds in found.items():
        groups.setdefault(tuple(kinds), []).append(own)
    return [(list(kinds), own) for kinds, group in groups.items() for own in _required_first(group)]


def _required_first(keys: list[Key]) -> list[Key]:
    """In the order of the models else; what is below a list stays behind it."""
    optional = {key.name: key.default != "required" for key in keys}
    # The list itself stands in another group where the kinds do not have it alike.
    return sorted(keys, key=lambda key: optional.get(key.name.partition("[]")[0], optional[key.name]))


def _is_default(model: type[BaseModel]) -> bool:
    field = model.model_fields.get("kind")
    return field is None or field.default is not PydanticUndefined


def _of_kinds(kind: Key, meaning: str) -> Key:
    """The key ``kind`` of a section with several kinds, which means what the section does."""
    words = f"{codes([kind.default.strip('`')])}, or another kind below"
    return replace(kind, type=words, meaning=meaning.removesuffix("."))


def _carried(metadata: list[Any]) -> str:
    """The unit that the values of a mapping hand on to the keys below them, where it depends on their own key."""
    by_key = next((extra.dimensions for extra in metadata if isinstance(extra, ByKey)), {})
    units = [f"{name}: {MULTIPLES[dimension.quantity]}" for name, dimension in by_key.items()]
    return ", ".join([*units, "else –"]) if units else ""
