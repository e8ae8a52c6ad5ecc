"""Units: dimension of a key, numbers with units from text, characteristic scales (Scales), units of results.

``Annotated[float, Dimension("time")]`` is a plain number for pydantic. :mod:`porocore.core.units` finds the
declaration where a text such as ``5 s`` stands, and the JSON schema allows such a text there.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache, cached_property, lru_cache
from math import prod
from typing import Annotated, Any, Self, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from porocore.core.echo import comma_advice, cut, echo
from porocore.core.files.yaml_document import Location, dotted
from porocore.core.models.bounds import LARGEST_NUMBER
from porocore.core.models.strict import Place, StrictModel, bare, is_number, is_section, walk
from porocore.errors import ConfigurationError

#: A number and what may be a unit, in the regular expressions of Python and of JSON schema alike.
NUMBER = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?"
WITH_UNIT = rf"^\s*{NUMBER}\s*[^\s\d.,+\-].*$"

JsonSchema = dict[str, Any]
_OF_THE_KEY = ("default", "title", "description")
#: By quantity, what a dimensionless number is a multiple of; see :mod:`porocore.core.units`.
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
    "rate": "1/time",
    "concentration": "E/(R · 1 K)",
}


@dataclass(frozen=True)
class Dimension:
    """Dimension of every number in the annotated value.

    Attributes
    ----------
    quantity
        A key of :data:`porocore.core.units.QUANTITIES`.
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
    # A text with a unit is also one of the texts that a choice between a number and a formula has.
    if any(part.get("type") == "number" for part in schema.get("oneOf", ())):
        widened["anyOf"] = widened.pop("oneOf")
    return widened


#: Products of their powers stay finite.
SMALLEST, LARGEST = 1e-30, 1e30
Positive = Annotated[float, Field(ge=SMALLEST, le=LARGEST, allow_inf_nan=False)]


@dataclass(frozen=True)
class ExactScales:
    """Stress E [Pa], length L [m], pore size d [m] and viscosity μ_c [Pa s], as the decimal numbers that were given."""

    stress: Fraction
    length: Fraction
    pore: Fraction
    viscosity: Fraction

    @property
    def force(self) -> Fraction:
        """Force f_c = E L² [N]."""
        return self.stress * self.length**2

    @property
    def velocity(self) -> Fraction:
        """Velocity of the fluid, f_c d²/(L³ μ_c) [m/s]."""
        return self.stress * self.pore**2 / (self.length * self.viscosity)

    @property
    def time(self) -> Fraction:
        """Time L⁴ μ_c/(f_c d²) [s]."""
        return self.length / self.velocity


class Scales(StrictModel):
    """Length L, pore size d, viscosity μ_c and either Young's modulus E of the solid or the force f_c = E L².

    Plain numbers are in SI units. Dimensionless results are for E = 1.

    References
    ----------
    Dehghani & Zilian (2022), the section on non-dimensionalisation and the end of the numerical example.
    """

    # An editor is not to ask for a pore size beside the size of a voxel.
    model_config = ConfigDict(json_schema_extra={"required": ["length"]})

    force: Annotated[Positive, Dimension("force", si=True)] | None = None
    """f_c = E L², as in the paper; this or ``modulus``."""
    modulus: Annotated[Positive, Dimension("stress", si=True)] | None = None
    """E, Young's modulus of the solid, or the reference modulus of another material; this or ``force``."""
    pore: Annotated[Positive, Dimension("displacement", si=True)]
    """d, the edge of a cubic cell, of a box the cube root of its volume; not needed with ``voxel_size`` of an image."""
    viscosity: Annotated[Positive, Dimension("viscosity", si=True)] = 1.0
    """μ_c; ``cell.viscosity`` is relative to it."""
    length: Annotated[Positive, Dimension("displacement", si=True)]
    """L, the length of the body that is 1."""

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.force is None) == (self.modulus is None):
            raise ValueError("expected either modulus, which is E, or force, which is E L²; give one of them")
        return self

    @cached_property
    def exact(self) -> ExactScales:
        """Scales without rounding: a value with a unit and its dimensionless number agree to the last bit."""
        length, pore, viscosity = map(as_written, (self.length, self.pore, self.viscosity))
        if self.modulus is not None:
            return ExactScales(as_written(self.modulus), length, pore, viscosity)
        assert self.force is not None
        return ExactScales(as_written(self.force) / length**2, length, pore, viscosity)

    def factor(self, quantity: str) -> float:
        """Return one dimensionless unit of a quantity in the unit of :data:`QUANTITIES`.

        Raises
        ------
        ConfigurationError
            The quantity is unknown.
        """
        return float(known_quantity(quantity).factor(self.exact))


def as_written(number: float) -> Fraction:
    """Return the shortest decimal number that equals this one to the last bit, as it was written."""
    return Fraction(repr(float(number)))


#: Gas constant R [J/(mol K)], exact since 2019.
GAS_CONSTANT = Fraction("8.31446261815324")


@dataclass(frozen=True)
class Quantity:
    """A kind of value: its SI unit and its scale."""

    unit: str
    formula: str
    factor: Callable[[ExactScales], Fraction]


QUANTITIES: dict[str, Quantity] = {
    "displacement": Quantity("m", "L", lambda s: s.length),
    "area": Quantity("m²", "L²", lambda s: s.length**2),
    "volume": Quantity("m³", "L³", lambda s: s.length**3),
    "time": Quantity("s", "L⁴ μ_c/(f_c d²)", lambda s: s.time),
    "pressure": Quantity("Pa", "f_c/L²", lambda s: s.stress),
    "stress": Quantity("Pa", "f_c/L²", lambda s: s.stress),
    "force": Quantity("N", "f_c", lambda s: s.force),
    "body-force": Quantity("N/m³", "f_c/L³", lambda s: s.stress / s.length),
    "energy-density": Quantity("J/m³", "f_c/L²", lambda s: s.stress),
    "velocity": Quantity("m/s", "f_c d²/(L³ μ_c)", lambda s: s.velocity),
    "flow": Quantity("m³/s", "f_c d²/(L μ_c)", lambda s: s.velocity * s.length**2),
    "viscosity": Quantity("Pa s", "μ_c", lambda s: s.viscosity),
    "conductivity": Quantity("m²/(Pa s)", "d²/μ_c", lambda s: s.pore**2 / s.viscosity),
    "permeability": Quantity("m²", "d²", lambda s: s.pore**2),
    "diffusivity": Quantity("m²/s", "f_c d²/(L² μ_c)", lambda s: s.length**2 / s.time),
    "compliance": Quantity("1/Pa", "L²/f_c", lambda s: 1 / s.stress),
    "pore-size": Quantity("m", "d", lambda s: s.pore),
    "rate": Quantity("1/s", "f_c d²/(L⁴ μ_c)", lambda s: 1 / s.time),
    "concentration": Quantity("mol/m³", "f_c/(L² R · 1 K)", lambda s: s.stress / GAS_CONSTANT),
    "temperature": Quantity("K", "1 K", lambda s: Fraction(1)),
}

#: Names that configurations and states have for some quantities.
OTHER_NAMES = {"length": "displacement", "p": "pressure"}

#: The two of the paper.
SCENARIOS: dict[str, Scales] = {
    "brain-tissue": Scales(force=1e-3, pore=2e-6, viscosity=1.0, length=1e-3),
    "soil": Scales(force=1.5e6, pore=2e-4, viscosity=1.0, length=1.0),
}


def quantity_name(name: str) -> str:
    """Return the name of a quantity in :data:`QUANTITIES`, given this or another name of it.

    Raises
    ------
    ConfigurationError
        It is unknown.
    """
    known = OTHER_NAMES.get(name, name)
    if known not in QUANTITIES:
        raise ConfigurationError(f"unknown quantity {echo(name)}; expected one of {', '.join(QUANTITIES)}")
    return known


def known_quantity(name: str) -> Quantity:
    """Return a quantity by name.

    Raises
    ------
    ConfigurationError
        It is unknown.
    """
    return QUANTITIES[quantity_name(name)]


def known_scenario(name: str) -> Scales:
    """Return a scenario by name.

    Raises
    ------
    ConfigurationError
        It is unknown.
    """
    if name not in SCENARIOS:
        raise ConfigurationError(
            f"unknown scenario {echo(name)}; expected one of {', '.join(SCENARIOS)}, or give the characteristic values "
            "with --force, --pore, --viscosity and --length"
        )
    return SCENARIOS[name]


#: How a value of each quantity may be written, for messages.
EXAMPLES = {
    "displacement": "a length, such as 5 mm",
    "pore-size": "a length, such as 2 um",
    "time": "a time, such as 30 s",
    "stress": "a stress, such as 2 kPa",
    "pressure": "a pressure, such as 2 kPa",
    "force": "a force, such as 10 mN",
    "body-force": "a force per volume, such as 9.8 kN/m**3",
    "velocity": "a velocity, such as 0.1 mm/s",
    "viscosity": "a viscosity, such as 1 mPa*s",
    "area": "an area, such as 1 mm**2",
    "volume": "a volume, such as 1 mm**3",
    "flow": "a volume per time, such as 1 mm**3/s",
    "energy-density": "an energy per volume, such as 1 J/m**3",
    "conductivity": "a length squared by a pressure and a time, such as 1 mm**2/(kPa*s)",
    "permeability": "an area, such as 1 um**2",
    "diffusivity": "an area per time, such as 1 mm**2/s",
    "compliance": "one by a pressure, such as 1 1/kPa",
    "rate": "one by a time, such as 0.1 1/h",
    "concentration": "a concentration, such as 0.15 mol/l",
    "temperature": "a temperature, such as 310 K or 37 °C",
}
#: Units that are proposed for those that are not known.
COMMON = (
    *("m", "cm", "mm", "um", "nm", "s", "min", "h", "day", "Pa", "kPa", "MPa", "GPa", "bar", "mmHg", "psi"),
    *("N", "mN", "kN", "Pa*s", "mPa*s", "cP", "mol/l", "mmol/l", "mEq/l", "mEq/ml", "mM", "K"),
)
#: Units as machines in German and French write them.
FOREIGN = {
    **dict.fromkeys(("sek", "sekunde", "sekunden", "seconde", "secondes"), "s"),
    **dict.fromkeys(("min", "minuten"), "min"),
    **dict.fromkeys(("std", "stunde", "stunden", "heure", "heures"), "h"),
    **dict.fromkeys(("tag", "tage", "jour", "jours"), "day"),
    **dict.fromkeys(("kp", "kilopond"), "kgf"),
    "kelvin": "K",
}
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Units of temperatures that are counted from that of melting ice, 273.15 K.
CELSIUS, ZERO_CELSIUS = ("°c", "degc", "celsius"), Fraction("273.15")
#: Units of mass, of which those of the weight end in f.
_MASS = re.compile(r"\b([mk]?g|lb|t)\b")
_PIXELS = re.compile(r"(?<![^\W\d])(css_)?(px|pixels?|voxels?)(?![^\W\d])", re.IGNORECASE)
#: At most so many letters are missing where kP, kilopoise, stands for kPa.
CUT = 2
#: Characters of a value with its unit.
LONGEST = 120
#: No number beyond two digits, which could take forever.
_UNIT = re.compile(r"(?=.{1,60}$)(?!.*\d{3})[\w\s*/^.()·µ°%-]+")
#: A power of a number, or an exponent that has to be worked out: towers of powers.
_TOWER = re.compile(r"\d\s*(\*\*|\^)|(\*\*|\^)\s*\((?!\s*-?\d+(\s*/\s*\d+)?\s*\))")
_EXPONENT = re.compile(r"(?:\*\*|\^)\s*\(?\s*-?\s*(\d+)")
#: What all exponents of a unit multiply to, at most.
LARGEST_POWER = 1000
_DIGITS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_PLAIN = re.compile(rf"\s*{NUMBER}\s*")
_NUMBER_AND_UNIT = re.compile(rf"\s*(?P<number>{NUMBER})\s*(?P<unit>\S.*?)\s*")


class UnitError(ValueError):
    """A unit is unknown, or not one of the quantity."""


def has_unit(text: str) -> bool:
    """Return whether a text is a number followed by a possible unit, which no decimal comma begins."""
    return (
        len(text) <= LONGEST
        and _NUMBER_AND_UNIT.fullmatch(text) is not None
        and not _PLAIN.fullmatch(text)
        and not comma_advice(text)
    )


def number_or_quantity(value: float | str) -> float | str:
    """Return a number, also of a text such as ``5e-4``, which YAML takes for none, or a text with a unit as it is.

    Raises
    ------
    UnitError
        It is neither.
    """
    if not isinstance(value, str) or has_unit(value):
        return value
    if len(value) <= LONGEST and _PLAIN.fullmatch(value):
        return float(value)
    raise UnitError(f"expected a number, or one with a unit, got {echo(value)}{comma_advice(value)}")


def unit_within(text: str) -> str:
    """Return the unit of a text such as ``5 mm``; empty where there is none."""
    match = _NUMBER_AND_UNIT.fullmatch(text) if has_unit(text) else None
    return "" if match is None else match["unit"]


def in_si(text: str, quantity: str) -> Fraction:
    """Return the value of a text such as ``5 mm`` in the SI unit of a quantity, without rounding.

    Raises
    ------
    UnitError
        It is no number with a unit, the unit is unknown, or it is one of another quantity; the message says what was
        expected and what came.
    """
    match = _NUMBER_AND_UNIT.fullmatch(text) if has_unit(text) else None
    if match is None:
        raise UnitError(f"expected {EXAMPLES[quantity]}, got {echo(text)}{comma_advice(text)}")
    if quantity == "temperature" and _word(match["unit"]) in CELSIUS:
        return Fraction(match["number"]) + ZERO_CELSIUS
    return Fraction(match["number"]) * unit_in_si(match["unit"], quantity, text)


def unit_in_si(unit: str, quantity: str, text: str = "") -> Fraction:
    """Return one ``unit`` in the SI unit of a quantity.

    Raises
    ------
    UnitError
        It is unknown, or one of another quantity; the message quotes ``text``.
    """
    text = text or unit
    if _PIXELS.search(unit):  # pint takes px for 1/96 inch
        raise UnitError(
            f"expected {EXAMPLES[quantity]}, got {echo(text)}; a pixel is no unit of length: write how large one voxel "
            "of the image is, such as 12 um"
        )
    factor, dimensions = _measured(unit)
    if dimensions is None:
        near = _near(unit)
        question = f"; did you mean '{near}'?" if near else ""
        raise UnitError(
            f"expected {EXAMPLES[quantity]}, got {echo(text)}; the unit {echo(unit)} is not known{question}"
        )
    if dimensions != _measured(QUANTITIES[quantity].unit)[1]:
        raise UnitError(
            f"expected {EXAMPLES[quantity]}, got {echo(text)}{_instead(dimensions)}{_begun(unit, quantity)}"
        )
    if not factor:
        raise UnitError(f"expected {EXAMPLES[quantity]}, got {echo(text)}, which has no fixed factor")
    return factor


def pretty(unit: str) -> str:
    """Return a unit as it is written in tables and on axes, such as ``mm³/s``."""
    powers = re.sub(
        r"\s*(?:\*\*|\^)\s*(-?\d+)", lambda power: power[1].translate(_SUPERSCRIPTS), unit.strip()
    )
    return re.sub(r"\bu(?=[A-Za-z])", "µ", re.sub(r"\s*\*\s*", " ", powers))


def _word(unit: str) -> str:
    """Return a unit without blanks, capitals and the point of an abbreviation."""
    return re.sub("[µμ]", "u", unit.replace(" ", "").rstrip(".")).casefold()


def _near(unit: str) -> str:
    """Return the unit that an unknown one is but for capitals, language and the sign of a power; empty: none."""
    powers = re.sub(r"([A-Za-zµμ])(\d)", r"\1^\2", unit)
    if powers != unit and _measured(powers)[1] is not None:
        return powers
    word = _word(unit)
    return FOREIGN.get(word) or next((known for known in COMMON if known.casefold() == word), "")


def _begun(unit: str, quantity: str) -> str:
    """Return the question whether a unit of the quantity is meant: in other capitals, or only its beginning."""
    dimensions = _measured(QUANTITIES[quantity].unit)[1]
    word = _near(unit)
    if (
        word and _measured(word)[1] == dimensions
    ):  # Min. would be a million inches, and µM is a concentration.
        return f"; did you mean '{word}'?"
    for known in COMMON:
        if known == "mmHg" and quantity != "pressure":  # nobody measures stresses in mm of mercury
            continue
        if 0 < len(known) - len(unit) <= CUT and known.startswith(unit) and _measured(known)[1] == dimensions:
            return f"; did you mean '{known}'?"
    weight = _MASS.sub(r"\1f", unit)
    if weight != unit and _measured(weight)[1] == dimensions:
        return f"; did you mean '{weight}', the weight of that mass, 9.80665 N for 1 kg?"
    return ""


def _instead(dimensions: frozenset[tuple[str, Any]]) -> str:
    for quantity in QUANTITIES:
        if _measured(QUANTITIES[quantity].unit)[1] == dimensions:
            return f", which is {EXAMPLES[quantity].partition(',')[0]}"
    return ", which is a mass" if dict(dimensions) == {"[mass]": 1} else ""


@cache
def _registry() -> Any:
    import pint  # takes some tenths of a second

    registry = pint.UnitRegistry(non_int_type=Fraction)
    registry.define("equivalent = mole = Eq")  # of charges, as those of a salt of two single ions
    return registry


@lru_cache(maxsize=256)
def _measured(unit: str) -> tuple[Fraction, frozenset[tuple[str, Any]] | None]:
    """Return the factor to base units and the dimensions; None where there is no such unit."""
    import pint

    written = re.sub("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda power: f"**{power[0].translate(_DIGITS)}", unit)
    if (
        not _UNIT.fullmatch(written)
        or _TOWER.search(written)
        or prod(map(int, _EXPONENT.findall(written))) > LARGEST_POWER
    ):
        return Fraction(0), None
    registry = _registry()
    try:
        # From 0.26 on pint takes no points, those of a product and of an abbreviation.
        known = registry.parse_units(re.sub(r"\.(?=[^\W\d])", "*", unit).rstrip("."))
        quantity = registry.Quantity(Fraction(1), known).to_base_units()
        offset = registry.Quantity(Fraction(0), known).to_base_units().magnitude
    except (
        pint.PintError,
        ValueError,
        LookupError,
        TypeError,
        AttributeError,
        ArithmeticError,
        AssertionError,
    ):
        return Fraction(0), None
    if not isinstance(quantity.magnitude, Fraction | int):
        return Fraction(0), None
    if offset:  # A temperature, which has no factor; no quantity is one.
        return Fraction(0), frozenset(quantity.dimensionality.items())
    return Fraction(quantity.magnitude), frozenset(quantity.dimensionality.items())


#: Of :class:`OutputUnits`, the quantities that each field stands for; the first is the field's own.
MEANS = {
    "length": ("displacement",),
    "time": ("time",),
    "stress": ("stress", "pressure", "energy-density"),
    "force": ("force",),
    "volume": ("volume",),
    "velocity": ("velocity",),
    "flow": ("flow",),
    "conductivity": ("conductivity",),
}
#: Digits that survive a value, its factor and their product, each rounded to the nearest float.
KNOWN_DIGITS = 15
_FIELD = {quantity: name for name, quantities in MEANS.items() for quantity in quantities}


class OutputUnits(StrictModel):
    """A unit for each kind of result."""

    length: str = "m"
    """Unit of displacements and places, such as mm."""
    time: str = "s"
    """Unit of times, such as h or day."""
    stress: str = "Pa"
    """Unit of stresses and pressures, such as kPa."""
    force: str = "N"
    """Unit of reactions, such as mN."""
    volume: str | None = None
    """Unit of drained fluid; null: that of the length, cubed."""
    velocity: str | None = None
    """Unit of the Darcy flux, the volume of fluid that passes the solid by area and time; null: length by time."""
    flow: str | None = None
    """Unit of inflows through a surface; null: volume by time."""
    conductivity: str | None = None
    """Unit of the conductivity K of the pores; null: length squared by stress and time."""

    @field_validator("*")
    @classmethod
    def _of_its_kind(cls, unit: str | None, info: ValidationInfo) -> str | None:
        if unit is None:
            return None
        try:
            unit_in_si(unit, MEANS[str(info.field_name)][0])
        except UnitError as error:
            wanted = str(error).replace("such as ", "in a unit such as that of ", 1)
            raise ValueError(wanted) from None
        return unit

    def of(self, quantity: str) -> str:
        """Return the unit of a quantity."""
        name = _FIELD.get(quantity, quantity)
        given = getattr(self, name, None)
        if given is not None:
            return str(given)
        volume = self.volume or _power(self.length, 3)
        return {
            "area": _power(self.length, 2),
            "volume": volume,
            "velocity": f"{self.length}/{_group(self.time)}",
            "flow": f"{volume}/{_group(self.time)}",
            "conductivity": f"{_power(self.length, 2)}/({self.stress}*{self.time})",
            "diffusivity": f"{_power(self.length, 2)}/{_group(self.time)}",
            "compliance": f"1/{_group(self.stress)}",
            "body-force": f"{_group(self.stress)}/{_group(self.length)}",
        }.get(name) or QUANTITIES[name].unit


def _group(unit: str) -> str:
    return unit if unit.isalpha() else f"({unit})"


def _power(unit: str, exponent: int) -> str:
    return f"{_group(unit)}**{exponent}"


@dataclass(frozen=True)
class ResultUnits:
    """Factors and names of units for results; without scales everything stays dimensionless.

    A dimensionless result times ``factor`` of its quantity is in the unit ``name``; a value in this unit by the factor
    is dimensionless. Quantities are those that ``porocore units`` lists, such as stress, conductivity and length.

    Attributes
    ----------
    scales
        Of the study; None: there are none.
    units
        What was asked for.
    """

    scales: Scales | None = None
    units: OutputUnits = field(default_factory=OutputUnits)

    @classmethod
    def from_text(cls, text: str) -> ResultUnits:
        """Return the units of a text that :meth:`as_text` made.

        Raises
        ------
        ValueError
            It is another text.
        """
        found = json.loads(text)
        if not isinstance(found, dict) or found.keys() != {"scales", "output_units"}:
            raise ValueError("expected the scales and output_units of a study")
        return cls(Scales.model_validate(found["scales"]), OutputUnits.model_validate(found["output_units"]))

    def as_text(self) -> str:
        """Return scales and units as JSON; empty without scales."""
        if self.scales is None:
            return ""
        return json.dumps({"scales": self.scales.model_dump(), "output_units": self.units.model_dump()})

    @property
    def given(self) -> bool:
        """True where results have units."""
        return self.scales is not None

    def factor(self, quantity: str) -> float:
        """Return the factor of a dimensionless result; 1 without scales or for a plain number, whose name is ''.

        Raises
        ------
        ConfigurationError
            There is no such quantity; ``porocore units`` lists them.
        """
        quantity = quantity and quantity_name(quantity)
        if self.scales is None or not quantity:
            return 1.0
        unit = unit_in_si(self.units.of(quantity), quantity)
        return float(QUANTITIES[quantity].factor(self.scales.exact) / unit)

    def value(self, value: float, quantity: str) -> float:
        """Return a dimensionless result in its unit, 2 rather than 1.9999999999999998; without scales as it is."""
        if not self.given or not quantity:
            return value
        return float(f"{value * self.factor(quantity):.{KNOWN_DIGITS}g}")

    def name(self, quantity: str) -> str:
        """Return the name of the unit, such as ``mm``; a dash without scales or for a plain number."""
        quantity = quantity and quantity_name(quantity)
        if self.scales is None or not quantity:
            return "–"
        return pretty(self.units.of(quantity))

    def titled(self, name: str, quantity: str) -> str:
        """Return the name of a result with its unit, such as ``u [mm]``; the name alone without scales."""
        return f"{name} [{self.name(quantity)}]" if self.given and quantity else name

    def text(self, value: float, quantity: str, digits: int = 4) -> str:
        """Return a dimensionless result with its unit, such as ``1.2 kPa``; the number alone without scales."""
        number = significant(value * self.factor(quantity), digits)
        return f"{number} {self.name(quantity)}" if self.given and quantity and value else number

    def texts(self, values: Iterable[float], quantity: str, digits: int = 4) -> str:
        """Return several results in brackets, with their unit once, such as ``(1, 2.5) mm``."""
        inner = ", ".join(significant(value * self.factor(quantity), digits) for value in values)
        return f"({inner}) {self.name(quantity)}" if self.given and quantity else f"({inner})"


def significant(value: float, digits: int) -> str:
    """Return a number with so many digits, without an exponent below a million."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e6 else text


_UNITS_NOW: ContextVar[ResultUnits | None] = ContextVar("units of messages", default=None)


@contextmanager
def using_units(units: ResultUnits) -> Iterator[None]:
    """Let messages within the block have the units of a study; see :func:`units_now`."""
    token = _UNITS_NOW.set(units)
    try:
        yield
    finally:
        _UNITS_NOW.reset(token)


def units_now() -> ResultUnits:
    """Return the units in which a message of the study that is worked on gives its values."""
    return _UNITS_NOW.get() or ResultUnits()


def length_text(*metres: float) -> str:
    """Return small lengths in the unit that suits the largest of them, such as ``192 x 192 x 384 µm``."""
    unit, factor = length_unit(max(metres))
    return f"{' x '.join(f'{length * factor:.4g}' for length in metres)} {unit}"


def length_unit(metres: float) -> tuple[str, float]:
    """Return the unit that suits a small length, and the factor of metres."""
    units = {"m": 1.0, "mm": 1e3, "µm": 1e6, "nm": 1e9}
    return next(((unit, factor) for unit, factor in units.items() if metres * factor >= 1), ("nm", 1e9))


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
        Whose fields carry :class:`~porocore.core.units.Dimension`.
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
    #: By list and dimension, its first entry with a unit, and its first number without one that is not 0.
    given: dict[tuple[Location, Dimension], str] = {}
    plain: dict[tuple[Location, Dimension], Place] = {}
    for place, dimension in dimensions(model, data):
        if not isinstance(place.value, str | int | float) or isinstance(place.value, bool):
            continue
        dimension = dimension or _of_a_member(place.annotation)
        if dimension is None:
            continue
        entries = (place.path[:-1], dimension)
        if not isinstance(place.value, str):
            if place.value and place.path[-1].isdigit():
                plain.setdefault(entries, place)
        elif has_unit(place.value) and not _is_formula(place):
            given.setdefault(entries, place.value)
            try:
                found[place.path] = _number(place.value, dimension, scales)
            except UnitError as error:
                faults.append((place.path, f"{dotted(place.path)}: {error}"))
    for (at, dimension), place in plain.items():
        # The ends of a range are one with its step.
        section = at[:-1] if at[-1] == "range" else at
        beside = given.get((at, dimension)) or given.get((section, dimension))
        if beside is not None:
            faults.append((at, f"{dotted(at)}: {_without_unit(place, beside, dimension)}"))
    return _replaced(data, found, ()), faults


def _is_formula(place: Place) -> bool:
    """Return True for a text where a formula may stand, and whose first number is followed by an operator."""
    return any(isinstance(extra, InScales) for extra in place.metadata) and (
        unit_within(place.value)[:1] in ("+", "-", "*", "/")
    )


def _without_unit(place: Place, beside: str, dimension: Dimension) -> str:
    """Return the complaint about a number without a unit in a list in which another one has a unit."""
    assert place.above is not None
    unit, entries = cut(unit_within(beside)), place.above.value
    whole = ", ".join(
        f"{echo(v)} {unit}" if isinstance(v, int | float) and v else str(v or 0) for v in entries
    )
    kind = f"in {QUANTITIES[dimension.quantity].unit}" if dimension.si else "a multiple of its scale"
    return (
        f"expected a unit with each number of the list, got {echo(place.value)} without one beside {echo(beside)}; "
        f"write [{cut(whole)}] (a number without a unit is {kind})"
    )


def unit_notes(model: type[BaseModel], data: Any, scales: Scales | None) -> Iterator[str]:
    """Yield a note on each number without a unit beside a value of its dimension that has one.

    Values are beside each other in one part of a study, such as ``macro.time`` or ``macro.boundary``; all times of a
    study are. Lists are noted once.

    Parameters
    ----------
    model, data, scales
        As for :func:`resolved`.
    """
    if scales is None:
        return
    given = dict[tuple[Location, str, bool], Place]()
    plain = dict[Location, tuple[tuple[Location, str, bool], Place, Dimension]]()
    for place, dimension in dimensions(model, data):
        dimension, value = dimension or _of_a_member(place.annotation), place.value
        if (
            dimension is None
            or not isinstance(value, str | int | float)
            or isinstance(value, bool)
            or not value
            or (not isinstance(value, str) and not abs(value) <= LARGEST_NUMBER)
        ):
            continue
        part = () if dimension.quantity == "time" else place.path[:-1][:2]
        if part in (("macro", "fields"), ("macro", "regions")) and dimension.quantity == "displacement":
            part = ("macro", "body")  # its coordinates
        group = part, QUANTITIES[dimension.quantity].unit, dimension.si
        if isinstance(value, str):
            if has_unit(value) and not _is_formula(place):
                given.setdefault(group, place)
        elif not _is_named_freely(place):
            key = place.path
            while key[-1].isdigit():
                key = key[:-1]
            plain.setdefault(key, (group, place, dimension))
    for key, (group, place, dimension) in plain.items():
        if group in given:
            yield f"{dotted(key)}: {_taken_as(place.value, dimension, scales, given[group])}"


def _is_named_freely(place: Place) -> bool:
    """Return True for a number of a mapping whose keys a user chooses: it may be a plain one, such as an exponent."""
    above = place.above
    while above is not None and not is_section(above.annotation):
        if get_origin(above.annotation) is dict and is_number(get_args(above.annotation)[1]):
            return True
        above = above.above
    return False


def _taken_as(value: float, dimension: Dimension, scales: Scales, beside: Place) -> str:
    """Return what a number without a unit counts as, and what to write, by a value that has a unit."""
    unit, quantity = unit_within(beside.value), QUANTITIES[dimension.quantity]
    there = f"{echo(value)} has no unit beside {dotted(beside.path)}: {cut(beside.value)}"
    size = Fraction(1) if dimension.si else quantity.factor(scales.exact)
    found = f"{significant(float(as_written(value) * size / unit_in_si(unit, dimension.quantity)), 4)} {pretty(unit)}"
    kind = f"in {quantity.unit}" if dimension.si else "a multiple of its scale"
    return f"{there}, so it is {kind}, {found}; write '{echo(value)} {cut(unit)}' if that is meant"


def dimensions(model: type[BaseModel], data: Any) -> Iterator[tuple[Place, Dimension | None]]:
    """Yield every declared value in a section with its dimension; see :func:`~porocore.core.models.strict.walk`."""
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
