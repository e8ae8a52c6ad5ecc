"""What may stand at a key, in words: types with their bounds, and defaults as YAML."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import yaml
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from porocore.core.formulas import TimeFunction
from porocore.core.models.strict import bare, is_section, is_union
from porocore.macro.composition.fields import AxesField, FormulaField

COUNTS, TOGETHER = {2: "two", 3: "three"}, {2: "pairs", 3: "triples"}
NOUNS = {float: "number", int: "whole number", str: "text", TimeFunction: "value"}


def type_words(field: FieldInfo, name: str) -> str:
    """What a key of this name takes; that it may be null is left to its default."""
    metadata = list(field.metadata)
    if isinstance(field.json_schema_extra, dict) and "enum" in field.json_schema_extra:
        return codes(field.json_schema_extra["enum"])
    return _words(_without_null(field.annotation, metadata), metadata, name)


def default_words(default: Any) -> str:
    """A default as it would stand in the file."""
    if default is PydanticUndefined:
        return "required"
    plain = json.loads(json.dumps(default))  # lists for tuples, and none of them twice the same
    text = yaml.safe_dump(plain, default_flow_style=True, width=1000).strip().removesuffix("...").strip()
    return f"`{text}`"


def codes(texts: Iterable[Any]) -> str:
    """Allowed texts, one beside the other."""
    return ", ".join(f"`{text}`" for text in texts)


def bounded(noun: str, name: str, low: float | None, high: float | None, closed: tuple[bool, bool]) -> str:
    """A noun with its bounds, which belong to the set where ``closed`` says so."""
    above, below = "≤" if closed[0] else "<", "≤" if closed[1] else "<"
    if low is None and high is None:
        return noun
    if high is None:
        return f"{noun} {'≥' if closed[0] else '>'} {_number(low)}"
    if low is None:
        return f"{noun} {below} {_number(high)}"
    if all(closed):
        return f"{noun}, {_number(low)} to {_number(high)}"
    return f"{noun}, {_number(low)} {above} {name} {below} {_number(high)}"


def _words(annotation: Any, metadata: Iterable[Any], name: str, plural: bool = False) -> str:
    while get_origin(annotation) is Annotated:
        annotation, *more = get_args(annotation)
        metadata = [*metadata, *more]
    origin, arguments = get_origin(annotation), get_args(annotation)
    limits = _limits(metadata)
    if is_union(annotation):
        return _union(arguments, metadata, name, plural)
    if origin is Literal:
        return codes(arguments)
    if origin is dict:
        return _mapping(arguments[1], limits)
    if origin is tuple and arguments[-1] is Ellipsis:
        return _list(arguments[0], limits, name)
    if origin is tuple:
        return _fixed(arguments, plural)
    if annotation is bool:
        return "true, false"
    if annotation is str and (choice := re.fullmatch(r"\^\(([\w|]+)\)\$", limits.get("pattern", ""))):
        return codes(choice[1].split("|"))
    if annotation is str and "max_length" in limits:
        return f"text, at most {limits['max_length']:,} characters"
    if is_section(annotation) and annotation is not TimeFunction:
        return f"`{{{', '.join(annotation.model_fields)}}}`"
    low, high = limits.get("gt", limits.get("ge")), limits.get("lt", limits.get("le"))
    noun = NOUNS[annotation] + ("s" if plural else "")
    return bounded(noun, "each" if plural else name, low, high, ("ge" in limits, "le" in limits))


def is_field(annotation: Any) -> bool:
    """Whether a value is a number or a field over the body."""
    members = (
        [bare(part)[0] for part in get_args(bare(annotation)[0])] if is_union(bare(annotation)[0]) else []
    )
    inner = [part for part in members if is_union(part)]
    return (FormulaField in members and AxesField not in members) or any(map(is_field, inner))


def _union(arguments: tuple[Any, ...], metadata: Iterable[Any], name: str, plural: bool) -> str:
    given = [part for part in arguments if part is not type(None)]
    if is_field(Union[tuple(given)]):  # noqa: UP007
        return "number, formula or field"
    if any(bare(part)[0] is TimeFunction for part in given):  # a number, or a course in time of its own
        given = [TimeFunction, *(part for part in given if get_origin(bare(part)[0]) is dict)]
    found = " or ".join(_words(part, metadata, name, plural) for part in given)
    return f"{found}, any of them null" if len(given) < len(arguments) and type(None) in arguments else found


def _mapping(value: Any, limits: dict[str, Any]) -> str:
    least = ", not empty" if limits.get("min_length") else ""
    plain = value is Any or is_section(bare(value)[0]) or is_union(bare(value)[0])
    return f"mapping{least}" if plain else f"mapping of names to {_words(value, (), 'each', plural=True)}"


def _list(part: Any, limits: dict[str, Any], name: str) -> str:
    least, most = limits.get("min_length"), limits.get("max_length")
    number = f"{least} to {most} " if least and most else f"at most {most} " if most else ""
    end = ", not empty" if least and not most else ""
    return f"list of {number}{_words(part, (), name, plural=True)}{end}"


def _fixed(parts: tuple[Any, ...], plural: bool) -> str:
    """A list of a fixed length: ``three numbers``, ``triples of numbers``, ``3 × 3 numbers``, ``[number, text]``."""
    inner = get_args(bare(parts[0])[0]) if get_origin(bare(parts[0])[0]) is tuple else ()
    if inner:
        return f"{len(parts)} × {len(inner)} {_words(inner[0], (), 'each', plural=True)}"
    if len(set(parts)) > 1:
        return f"[{', '.join(_words(part, (), 'each') for part in parts)}]"
    number = f"{TOGETHER[len(parts)]} of" if plural else COUNTS[len(parts)]
    return f"{number} {_words(parts[0], (), 'each', plural=True)}"


def _without_null(annotation: Any, metadata: list[Any]) -> Any:
    """The annotation of a field that may be null, without that."""
    arguments = get_args(annotation)
    if not is_union(annotation) or type(None) not in arguments:
        return annotation
    rest = [part for part in arguments if part is not type(None)]
    return rest[0] if len(rest) == 1 else Union[tuple(rest)]  # noqa: UP007


def _limits(metadata: Iterable[Any]) -> dict[str, Any]:
    """Bounds, lengths and patterns by their names in pydantic."""
    found = {}
    for extra in _flat(metadata):
        for limit in ("gt", "ge", "lt", "le", "min_length", "max_length", "pattern"):
            if (value := getattr(extra, limit, None)) is not None:
                found[limit] = value
    return found


def _flat(metadata: Iterable[Any]) -> Iterator[Any]:
    for extra in metadata:
        yield from extra.metadata if isinstance(extra, FieldInfo) else (extra,)


def _number(value: float | None) -> str:
    """A bound, as a fraction where it is no short decimal number."""
    assert value is not None
    text = f"{value:g}" if float(f"{value:g}") == value else str(Fraction(value).limit_denominator(100))
    return text.replace("-", "−")
