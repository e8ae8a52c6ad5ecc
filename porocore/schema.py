"""The JSON schema of the configuration, by which editors complete and check it."""

from __future__ import annotations

import ast
import inspect
import json
import textwrap
from functools import cache
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from porocore.config import RunConfig

DIALECT = "https://json-schema.org/draft/2020-12/schema"


class _WithDescriptions(GenerateJsonSchema):
    """The docstring below a field is its description."""

    def model_schema(self, schema: Any) -> dict[str, Any]:
        found = super().model_schema(schema)
        for name, text in field_docstrings(schema["cls"]).items():
            if name in found.get("properties", {}):
                found["properties"][name].setdefault("description", text)
        return found


def configuration_schema() -> dict[str, Any]:
    """Of what :func:`porocore.load_config` reads, in the draft 2020-12.

    It knows keys, types, bounds and choices, and where a text with a unit may stand, with its ``x-dimension``. What one
    key means for another, and what depends on a mesh, only :func:`porocore.load_config` and ``porocore check`` tell.
    """
    found = RunConfig.model_json_schema(schema_generator=_WithDescriptions)
    return {"$schema": DIALECT, **found, "title": "Configuration of a porocore study"}


def schema_text() -> str:
    """The same as a file."""
    return json.dumps(configuration_schema(), indent=1, ensure_ascii=False) + "\n"


@cache
def field_docstrings(model: type[BaseModel]) -> dict[str, str]:
    """Field → the docstring that stands below it, in the class or in one that it derives."""
    found: dict[str, str] = {}
    for cls in reversed(model.__mro__):
        if not issubclass(cls, BaseModel) or cls is BaseModel:
            continue
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
                found[field.target.id] = " ".join(inspect.cleandoc(below.value.value).split())
    return found
