"""Declaration of the dimension or unit of a configuration key, beside the key.

``Annotated[float, Dimension("time")]`` is a plain number for pydantic. :mod:`porocore.core.units.texts` finds the
declaration where a text such as ``5 s`` stands, and the JSON schema allows such a text there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

#: A number and what may be a unit, in the regular expressions of Python and of JSON schema alike.
NUMBER = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?"
WITH_UNIT = rf"^\s*{NUMBER}\s*[^\s\d.,+\-].*$"

JsonSchema = dict[str, Any]
_OF_THE_KEY = ("default", "title", "description")
#: By quantity, what a dimensionless number is a multiple of; see :mod:`porocore.core.units.scales`.
MULTIPLES = {
    "displacement": "length",
    "time": "time",
    "stress": "E",
    "pressure": "E",
    "force": "E × area",
    "body-force": "E / length",
    "velocity": "velocity",
    "viscosity": "μ_c",
    "compliance": "1/E",
    "energy-density": "E",
    "permeability": "d²",
    "conductivity": "d²/μ_c",
    "diffusivity": "E d²/μ_c",
}


@dataclass(frozen=True)
class Dimension:
    """Dimension of every number in the annotated value.

    Attributes
    ----------
    quantity
        A key of :data:`porocore.core.units.scales.QUANTITIES`.
    si
        Whether the number itself is in SI units; else it is a multiple of the quantity's scale.
    """

    quantity: str
    si: bool = False

    def __get_pydantic_json_schema__(self, core: Any, handler: Callable[[Any], JsonSchema]) -> JsonSchema:
        return {**_with_texts(handler(core)), "x-dimension": self.quantity}


@dataclass(frozen=True)
class Unit:
    """Unit of a number that always has it, and so is written without it.

    Attributes
    ----------
    name
        For readers, such as ``cell``, the edge length of the cell.
    """

    name: str


@dataclass(frozen=True)
class Carried:
    """The dimension of the value that the section with this key belongs to, such as that of a course's values."""

    def __get_pydantic_json_schema__(self, core: Any, handler: Callable[[Any], JsonSchema]) -> JsonSchema:
        return _with_texts(handler(core))


@dataclass(frozen=True)
class InScales:
    """Metadata of the text of a formula, in which coordinates and times are multiples of their scales."""


@dataclass(frozen=True)
class ByKey:
    """Dimensions of the values of a mapping by their keys; the others are plain numbers."""

    dimensions: Mapping[str, Dimension]


def _with_texts(schema: JsonSchema) -> JsonSchema:
    """Return the schema that accepts a text with a unit wherever it accepts a number; references are unchanged."""
    if schema.get("type") in ("number", "integer"):
        text = {"type": "string", "pattern": WITH_UNIT}
        outside: JsonSchema = {name: schema[name] for name in _OF_THE_KEY if name in schema}
        number: JsonSchema = {name: value for name, value in schema.items() if name not in outside}
        return {**outside, "anyOf": [number, text]}
    widened = dict(schema)
    for name in ("items", "additionalProperties"):
        if isinstance(schema.get(name), dict):
            widened[name] = _with_texts(schema[name])
    for name in ("anyOf", "oneOf", "prefixItems"):
        if name in schema:
            widened[name] = [_with_texts(part) for part in schema[name]]
    return widened
