"""Numbers as text for a reader: significant digits, a dash for what is not defined, per cent, durations."""

from __future__ import annotations

import math

from porocore.core import console
from porocore.core.units import MULTIPLES, units_now

NONE = "–"
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float | None, digits: int = 4) -> str:
    """``digits`` significant digits, without an exponent where that is readable."""
    if value is None or not math.isfinite(value):
        return NONE
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if -4 <= exponent < 6:
        return f"{value:.{max(0, digits - 1 - exponent)}f}".replace("-", "−")
    mantissa, power = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa} · 10{str(int(power)).translate(SUPERSCRIPT)}".replace("-", "−")


def in_unit(value: float | None, quantity: str, digits: int = 4) -> str:
    """Return a dimensionless result in the study's unit, which stands elsewhere."""
    return number(None if value is None else value * units_now().factor(quantity), digits)


def measured(value: float | None, quantity: str, digits: int = 4) -> str:
    """Return a dimensionless result with the study's unit, such as ``1.2 kPa``; the number alone without scales."""
    text, units = in_unit(value, quantity, digits), units_now()
    return f"{text} {units.name(quantity)}" if units.given and quantity and text != NONE else text


def multiple(value: float | None, quantity: str, digits: int = 4) -> str:
    """Return a result as :func:`measured`, and without scales with what it is a multiple of, such as ``0.4 E``."""
    text = measured(value, quantity, digits)
    return (
        text if units_now().given or not quantity or text in (NONE, "0") else f"{text} {MULTIPLES[quantity]}"
    )


def unit(quantity: str) -> str:
    """Return the unit of a column, `` [kPa]``; empty without scales."""
    units = units_now()
    return f" [{units.name(quantity)}]" if units.given and quantity else ""


def plain(value: float) -> str:
    """Return a chosen number in its shortest form."""
    return f"{value:g}".replace("-", "−")


def percent(share: float | None, decimals: int = 1) -> str:
    """Return a share in per cent."""
    if share is None or not math.isfinite(share):
        return NONE
    return f"{100 * share:.{decimals}f} %".replace("-", "−")


def difference(ratio: float | None, less: str = "smaller", more: str = "larger") -> str:
    """Return a ratio in words, such as ``19.8 % smaller``."""
    if ratio is None or not math.isfinite(ratio):
        return NONE
    if abs(ratio - 1) < 5e-4:
        return "the same to 0.05 %"
    return f"{100 * abs(ratio - 1):.1f} % {less if ratio < 1 else more}"


def duration(seconds: float) -> str:
    """Return a duration in a readable unit."""
    if seconds < 0.0995:
        return f"{1000 * seconds:.3g} ms"
    if seconds < 99.5:
        return f"{seconds:.3g} s"
    return console.duration(seconds)
