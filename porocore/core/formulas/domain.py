"""Places where a formula of one variable has no value: division by zero, roots, overflow."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from porocore.core.formulas.expressions import CONSTANTS, FUNCTIONS, LARGEST_NUMBER, Expression
from porocore.states import Array

ROOT, LOGARITHM = (
    "takes the root of a negative number",
    "takes the logarithm of a number that is not positive",
)
DIVISION, POLE, OVERFLOW = "divides by zero", "has a pole", "becomes too large a number"


def first_fault(expression: Expression, points: Array) -> tuple[int, str] | None:
    """Return where a formula of one variable has no value for the first time, and why; None if it always has one.

    A denominator that changes its sign between two points is zero between them; so is a pole of the tangent found.
    The place is the index of the point, or of the one behind the zero.

    Parameters
    ----------
    expression
        A formula of one name, or of none.
    points : (n,)
        Ascending values of the variable, dense where it may move.
    """
    found = _Faults(len(points))
    functions = {name: _watched(name) for name in FUNCTIONS}
    with np.errstate(all="ignore"):
        value = expression.convert(
            lambda name: _Samples(
                np.full(len(points), CONSTANTS[name]) if name in CONSTANTS else points, found
            ),
            functions,
            lambda number: _Samples(np.full(len(points), float(number)), found),
        )
        found.note(~(np.abs(value.values) <= LARGEST_NUMBER), OVERFLOW)
    return found.first


@dataclass
class _Faults:
    length: int
    first: tuple[int, str] | None = field(default=None)

    def note(self, where: Any, why: str) -> None:
        """Keep the first index of the mask ``where`` if it lies before all others."""
        if where.any() and (self.first is None or where.argmax() < self.first[0]):
            self.first = int(where.argmax()), why


@dataclass(frozen=True, eq=False)
class _Samples:
    """Values of a part of the formula at all points; its operations note where they have no value."""

    values: Array
    faults: _Faults

    def __add__(self, other: _Samples) -> _Samples:
        return _Samples(self.values + other.values, self.faults)

    def __sub__(self, other: _Samples) -> _Samples:
        return _Samples(self.values - other.values, self.faults)

    def __mul__(self, other: _Samples) -> _Samples:
        return _Samples(self.values * other.values, self.faults)

    def __neg__(self) -> _Samples:
        return _Samples(-self.values, self.faults)

    def __truediv__(self, other: _Samples) -> _Samples:
        self.faults.note(_zeros(other.values), DIVISION)
        return _Samples(self.values / other.values, self.faults)

    def __pow__(self, other: _Samples) -> _Samples:
        broken = other.values != np.round(other.values)
        self.faults.note((self.values < 0) & broken, ROOT)
        self.faults.note(_zeros(self.values) & (other.values < 0), DIVISION)
        return _Samples(self.values**other.values, self.faults)


def _watched(name: str) -> Any:
    def call(at: _Samples) -> _Samples:
        if name == "sqrt":
            at.faults.note(at.values < 0, ROOT)
        elif name == "log":
            at.faults.note(at.values <= 0, LOGARITHM)
        elif name == "tan":
            at.faults.note(_zeros(np.cos(at.values)), POLE)
        return _Samples(FUNCTIONS[name](at.values), at.faults)

    return call


def _zeros(values: Array) -> Any:
    """Return the mask of points that are zero, or behind a change of sign."""
    found = values == 0
    found[1:] |= values[1:] * np.sign(values[:-1]) < 0
    return found
