"""Units of results (ResultUnits, OutputUnits): factors and names; units within messages."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field

from pydantic import ValidationInfo, field_validator

from porocore.core.models.strict import StrictModel
from porocore.core.units.quantities import UnitError, pretty, unit_in_si
from porocore.core.units.scales import QUANTITIES, Scales, quantity_name

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


_SPOKEN: ContextVar[ResultUnits | None] = ContextVar("units of messages", default=None)


@contextmanager
def speaking(units: ResultUnits) -> Iterator[None]:
    """Let messages within the block have the units of a study; see :func:`spoken`."""
    token = _SPOKEN.set(units)
    try:
        yield
    finally:
        _SPOKEN.reset(token)


def spoken() -> ResultUnits:
    """Return the units in which a message of the study that is worked on gives its values."""
    return _SPOKEN.get() or ResultUnits()


def length_text(*metres: float) -> str:
    """Return small lengths in the unit that suits the largest of them, such as ``192 x 192 x 384 µm``."""
    unit, factor = length_unit(max(metres))
    return f"{' x '.join(f'{length * factor:.4g}' for length in metres)} {unit}"


def length_unit(metres: float) -> tuple[str, float]:
    """Return the unit that suits a small length, and the factor of metres."""
    units = {"m": 1.0, "mm": 1e3, "µm": 1e6, "nm": 1e9}
    return next(((unit, factor) for unit, factor in units.items() if metres * factor >= 1), ("nm", 1e9))
