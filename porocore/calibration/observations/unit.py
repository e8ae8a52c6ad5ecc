"""Unit of the numbers of one study (StudyUnit): conversion from its dimensionless numbers and from texts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

from porocore.core.echo import comma_advice, echo
from porocore.core.units.quantities import UnitError, has_unit, in_si, unit_in_si
from porocore.core.units.scales import QUANTITIES, Scales
from porocore.core.units.texts import ADD_SCALES, NO_SCALES
from porocore.errors import ConfigurationError

#: Advice on a unit that a key gives: on one of another quantity, and on one in a study without scales.
IN_A_KEY = ("change the key", "leave the key out where the numbers are dimensionless")


def size_of(unit: str, quantity: str) -> Fraction | None:
    """Return one unit in the SI unit of a quantity; None: it is no unit of it."""
    try:
        return unit_in_si(unit, quantity)
    except UnitError:
        return None


def as_unit(text: str, quantity: str) -> str:
    """Return the unit that a machine writes with other capitals, such as Sec or MIN, or else the text itself.

    The text has three letters at least, so that prefixes such as m and M are not confused.
    """
    small = text.lower()
    other = len(text) > 2 and text.isalpha() and size_of(text, quantity) is None
    return small if other and size_of(small, quantity) is not None else text


def is_unit(text: str) -> bool:
    """Return whether a text is a unit of any quantity."""
    return any(size_of(as_unit(text, quantity), quantity) is not None for quantity in QUANTITIES)


@dataclass(frozen=True)
class StudyUnit:
    """Unit of numbers that belong to one study.

    Attributes
    ----------
    name
        Empty: the numbers are dimensionless.
    quantity
        Of :data:`porocore.core.units.scales.QUANTITIES`.
    scales
        Of the study.
    """

    name: str
    quantity: str
    scales: Scales | None

    @classmethod
    def at_key(
        cls, key: str, name: str, quantity: str, scales: Scales | None, advice: tuple[str, str] = IN_A_KEY
    ) -> StudyUnit:
        """Return a unit that a key, or the heading of a file, gives.

        Parameters
        ----------
        key
            Where it stands.
        name, quantity, scales
            See the class.
        advice
            What to do about a unit that is none of the quantity, and, beside adding scales, about one without scales.

        Raises
        ------
        ConfigurationError
            The unit is none of the quantity, or the study has no scales; the message begins with the key.
        """
        if scales is None and name and size_of(name, quantity) is not None:
            raise ConfigurationError(f"{key}: {echo(name)} is a unit, but {ADD_SCALES}, or {advice[1]}")
        unit = cls(name, quantity, scales)
        try:
            _ = unit.factor
        except UnitError as error:
            end = " " if str(error).endswith("?") else "; "
            raise ConfigurationError(f"{key}: {error}{end}{advice[0]}") from None
        return unit

    @property
    def factor(self) -> float:
        """A dimensionless number times it is in this unit.

        Raises
        ------
        UnitError
            The unit is none of the quantity, or the study has no scales.
        """
        if not self.name:
            return 1.0
        size = unit_in_si(self.name, self.quantity)
        if self.scales is None:
            raise UnitError(f"{echo(self.name)} {NO_SCALES}")
        return float(QUANTITIES[self.quantity].factor(self.scales.exact) / size)

    def converted(self, key: str, value: float | str) -> float:
        """Return the number of a key, or its text with a unit, in this unit.

        Raises
        ------
        ConfigurationError
            It is no finite number and no value of the quantity; the message begins with the key.
        """
        try:
            found = self._number(value)
        except UnitError as error:
            raise ConfigurationError(f"{key}: {error}") from None
        if not math.isfinite(found):
            raise ConfigurationError(f"{key}: expected a finite number, got {echo(value)}")
        return found

    def _number(self, value: float | str) -> float:
        if not isinstance(value, str):
            return value
        if not has_unit(value):
            raise UnitError(f"expected a number, or one with a unit, got {echo(value)}{comma_advice(value)}")
        factor = self.factor
        si = in_si(value, self.quantity)
        if self.scales is None:
            raise UnitError(f"{echo(value)} {NO_SCALES}")
        return float(si / QUANTITIES[self.quantity].factor(self.scales.exact)) * factor
