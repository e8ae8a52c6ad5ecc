"""Numbers with units from text, such as ``5 mm``, into SI units by pint; errors of unknown units."""

from __future__ import annotations

import re
from fractions import Fraction
from functools import cache, lru_cache
from math import prod
from typing import Any

from porocore.core.echo import comma_advice, echo
from porocore.core.units.dimensions import NUMBER
from porocore.core.units.scales import QUANTITIES

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
    "volume": "a volume, such as 1 mm**3",
    "flow": "a volume per time, such as 1 mm**3/s",
    "energy-density": "an energy per volume, such as 1 J/m**3",
    "conductivity": "a length squared by a pressure and a time, such as 1 mm**2/(kPa*s)",
    "permeability": "an area, such as 1 um**2",
    "diffusivity": "an area per time, such as 1 mm**2/s",
    "compliance": "one by a pressure, such as 1 1/kPa",
}
#: Units that are proposed for those that are not known.
COMMON = (
    *("m", "cm", "mm", "um", "nm", "s", "min", "h", "day", "Pa", "kPa", "MPa", "GPa", "bar", "mmHg", "psi"),
    *("N", "mN", "kN", "Pa*s", "mPa*s", "cP"),
)
#: Units as machines in German and French write them.
FOREIGN = {
    **dict.fromkeys(("sek", "sekunde", "sekunden", "seconde", "secondes"), "s"),
    **dict.fromkeys(("min", "minuten"), "min"),
    **dict.fromkeys(("std", "stunde", "stunden", "heure", "heures"), "h"),
    **dict.fromkeys(("tag", "tage", "jour", "jours"), "day"),
}
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
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
    return Fraction(match["number"]) * unit_in_si(match["unit"], quantity, text)


def unit_in_si(unit: str, quantity: str, text: str = "") -> Fraction:
    """Return one ``unit`` in the SI unit of a quantity.

    Raises
    ------
    UnitError
        It is unknown, or one of another quantity; the message quotes ``text``.
    """
    text = text or unit
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
    return factor


def pretty(unit: str) -> str:
    """Return a unit as it is written in tables and on axes, such as ``mm³/s``."""
    powers = re.sub(
        r"\s*(?:\*\*|\^)\s*(-?\d+)", lambda power: power[1].translate(_SUPERSCRIPTS), unit.strip()
    )
    return re.sub(r"\bu(?=[A-Za-z])", "µ", re.sub(r"\s*\*\s*", " ", powers))


def _word(unit: str) -> str:
    """Return a unit without blanks, capitals and the point of an abbreviation."""
    return unit.replace(" ", "").rstrip(".").casefold()


def _near(unit: str) -> str:
    """Return the common unit that an unknown one is but for capitals and language; empty where there is none."""
    word = _word(unit)
    return FOREIGN.get(word) or next((known for known in COMMON if known.casefold() == word), "")


def _begun(unit: str, quantity: str) -> str:
    """Return the question whether a unit of the quantity is meant of which only the beginning stands there."""
    dimensions = _measured(QUANTITIES[quantity].unit)[1]
    word = FOREIGN.get(_word(unit))
    if word is not None and _measured(word)[1] == dimensions:  # Min. would be a million inches.
        return f"; did you mean '{word}'?"
    for known in COMMON:
        if 0 < len(known) - len(unit) <= CUT and known.startswith(unit) and _measured(known)[1] == dimensions:
            return f"; did you mean '{known}'?"
    return ""


def _instead(dimensions: frozenset[tuple[str, Any]]) -> str:
    for quantity in QUANTITIES:
        if _measured(QUANTITIES[quantity].unit)[1] == dimensions:
            return f", which is {EXAMPLES[quantity].partition(',')[0]}"
    return ", which is a temperature" if dict(dimensions) == {"[temperature]": 1} else ""


@cache
def _registry() -> Any:
    import pint  # takes some tenths of a second

    return pint.UnitRegistry(non_int_type=Fraction)


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
        known = registry.parse_units(unit)
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
