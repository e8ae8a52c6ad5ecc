"""JSON schema of the configuration for editors; descriptions and units of its keys."""

from __future__ import annotations

import ast
import inspect
import json
import textwrap
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel, Field, create_model
from pydantic.fields import FieldInfo
from pydantic.json_schema import GenerateJsonSchema

from porocore.cell.cell import Cell
from porocore.cell.materials.prony import Relaxation
from porocore.core.models.strict import bare, is_section
from porocore.core.units import MULTIPLES, QUANTITIES, Carried, Dimension, Unit
from porocore.errors import PluginError
from porocore.plugins.discovery import Offered
from porocore.plugins.hookspecs import CommandOffer
from porocore.plugins.registry import make_command, registry
from porocore.study.config.config import RunConfig

DIALECT = "https://json-schema.org/draft/2020-12/schema"


class _WithDescriptions(GenerateJsonSchema):
    """Generator that describes a field by the docstring below it and its unit, and a section by its first paragraph."""

    def model_schema(self, schema: Any) -> dict[str, Any]:
        found = super().model_schema(schema)
        model: type[BaseModel] = schema["cls"]
        if "description" in found:
            found["description"] = _plain(found["description"].partition("\n\n")[0])
        for name, text in field_docstrings(model).items():
            if name in found.get("properties", {}):
                field = model.model_fields[name]
                unit = unit_of(field.annotation, field.metadata, carried="that of the key above")
                said = f"{text} Unit: {unit}." if unit else text
                found["properties"][name].setdefault("description", said)
        for name, field in model.model_fields.items():
            if name in found.get("properties", {}) and may_have_range(model, name, field):
                found["properties"][name] = _with_range(found["properties"][name])
        return found


def configuration_schema() -> dict[str, Any]:
    """Return the JSON schema of a configuration, draft 2020-12.

    It knows keys, types, bounds and choices, and the keys that take a text with a unit, with their ``x-dimension``.
    Only :func:`porocore.load_config` and ``porocore check`` find faults between several keys, and those of a mesh.
    """
    found = with_sections(registry().offers).model_json_schema(schema_generator=_WithDescriptions)
    return {"$schema": DIALECT, **found, "title": "Configuration of a porocore study"}


def with_sections(offers: Iterable[Offered]) -> type[RunConfig]:
    """Return the model of a configuration with the sections of the commands among ``offers``."""
    found: dict[str, Any] = {}
    for offered in offers:
        if isinstance(offered.offer, CommandOffer) and (key := offered.offer.section):
            with suppress(PluginError):  # 'porocore plugins' lists a broken one
                model = make_command(offered).section()
                said = f"Section of `porocore {offered.offer.name}`; other commands leave it alone."
                found[key] = (Annotated[model | None, Field(description=said)], None)
    whole: type[RunConfig] = create_model("RunConfig", __base__=RunConfig, __doc__=RunConfig.__doc__, **found)
    return whole


def may_have_range(model: type[BaseModel], name: str, field: FieldInfo) -> bool:
    """Return whether the numbers of a field may be ranges, since a cell may have them as parameters."""
    if model is Cell:
        return name == "viscosity"
    fixed = any(isinstance(extra, Dimension) and extra.si for extra in field.metadata)
    return model in _sections_of_the_cell() and name != "directions" and not fixed


@cache
def _sections_of_the_cell() -> frozenset[type[BaseModel]]:
    """Return the sections of pores and materials, with those in them, but not the relaxation."""
    found: set[type[BaseModel]] = set()

    def visit(annotation: Any) -> None:
        annotation, _ = bare(annotation)
        if annotation is Relaxation:
            return
        if is_section(annotation) and annotation not in found:
            found.add(annotation)
            for field in annotation.model_fields.values():
                visit(field.annotation)
        elif not is_section(annotation) and get_origin(annotation) is not Literal:
            for part in get_args(annotation):
                visit(part)

    for name in ("geometry", "material"):
        visit(Cell.model_fields[name].annotation)
    return frozenset(found)


def _with_range(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema that accepts ``{range: [lower, upper]}`` wherever it accepts a real number."""
    said: dict[str, Any] = {
        key: schema[key] for key in ("default", "title", "description", "x-dimension") if key in schema
    }
    plain = {key: value for key, value in schema.items() if key not in said}
    if schema.get("type") == "number":
        return {**said, "anyOf": [plain, _range_of(plain)]}
    found = dict(schema)
    if any(part.get("type") == "number" for part in schema.get("anyOf", ())):
        numbers = [part for part in schema["anyOf"] if part.get("type") in ("number", "string")]
        return {
            **found,
            "anyOf": [*schema["anyOf"], _range_of({"anyOf": numbers} if numbers[1:] else numbers[0])],
        }
    for key in ("items", "additionalProperties"):
        if isinstance(schema.get(key), dict):
            found[key] = _with_range(schema[key])
    for key in ("anyOf", "oneOf", "prefixItems"):
        if key in schema:
            found[key] = [_with_range(part) for part in schema[key]]
    return found


def _range_of(end: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a range by that of its ends."""
    ends = {"type": "array", "items": end, "minItems": 2, "maxItems": 2}
    return {
        "type": "object",
        "description": "A parameter of the cell: it varies between the two ends.",
        "properties": {"range": ends},
        "required": ["range"],
        "additionalProperties": False,
    }


def schema_text() -> str:
    """Return the schema as the text of a file."""
    return json.dumps(configuration_schema(), indent=1, ensure_ascii=False) + "\n"


@cache
def field_docstrings(model: type[BaseModel]) -> dict[str, str]:
    """Return by field the docstring below it, in the class or in one that it derives; code in single backquotes."""
    found: dict[str, str] = {}
    for cls in reversed(model.__mro__):
        if not issubclass(cls, BaseModel) or cls is BaseModel or cls.__module__ == __name__:
            continue  # that of with_sections has no source
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
        assert isinstance(tree, ast.ClassDef)
        for field, below in zip(tree.body, tree.body[1:], strict=False):
            if (
                isinstance(field, ast.AnnAssign)
                and isinstance(field.target, ast.Name)
                and isinstance(below, ast.Expr)
                and isinstance(below.value, ast.Constant)
                and isinstance(below.value.value, str)
            ):
                found[field.target.id] = _plain(inspect.cleandoc(below.value.value))
    return found


def _plain(text: str) -> str:
    """Return a docstring in one line, with code as in Markdown."""
    return " ".join(text.split()).replace("``", "`")


def unit_of(annotation: Any, metadata: Iterable[Any] = (), carried: str = "") -> str:
    """Return the units of the numbers of a field, separated by commas if they differ; empty without units.

    Parameters
    ----------
    annotation, metadata
        Annotation and metadata of the field; other sections in it are left out.
    carried
        Text for the unit of the value that the section belongs to.
    """
    found = list(dict.fromkeys(_units(annotation, metadata, carried)))
    return ", ".join(unit or "–" for unit in found) if any(found) else ""


def _units(annotation: Any, metadata: Iterable[Any], carried: str) -> Iterator[str]:
    """Yield the unit of every number in a value, empty for a number without."""
    for extra in metadata:
        if isinstance(extra, Unit):
            yield extra.name
            return
        if isinstance(extra, Dimension):
            yield QUANTITIES[extra.quantity].unit if extra.si else MULTIPLES[extra.quantity]
            return
        if isinstance(extra, Carried):
            yield carried
            return
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        yield from _units(arguments[0], arguments[1:], carried)
    elif origin is dict:
        yield from _units(arguments[1], (), carried)
    elif arguments and origin is not Literal:
        for argument in arguments:
            if argument not in (type(None), Ellipsis):
                yield from _units(argument, (), carried)
    elif not is_section(annotation):
        yield ""
