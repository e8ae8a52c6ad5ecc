"""Numbers with their first derivatives by names (Dual); values and exact derivatives of a formula."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from porocore.core.formulas import CONSTANTS, FUNCTIONS, Expression
from porocore.states import Array

#: Of each function of a formula, its derivative at x, where it has the value f.
_SLOPES: dict[str, Callable[[Array, Array], Any]] = {
    "sin": lambda x, f: np.cos(x),
    "cos": lambda x, f: -np.sin(x),
    "tan": lambda x, f: 1 + f * f,
    "exp": lambda x, f: f,
    "log": lambda x, f: 1 / x,
    "sqrt": lambda x, f: 0.5 / f,
    "sinh": lambda x, f: np.cosh(x),
    "cosh": lambda x, f: np.sinh(x),
    "tanh": lambda x, f: 1 - f * f,
    "abs": lambda x, f: np.sign(x),
}


@dataclass(frozen=True, eq=False)
class Dual:
    """Numbers (n,), or one, with their derivatives by some names, in an algebra with + − * / **.

    A name whose own derivative is zero adds nothing to a slope that is infinite, as that of sqrt(x) at x = 0.
    """

    value: Any
    slopes: Mapping[str, Any] = field(default_factory=dict)

    def _with(self, value: Any, own: Any, other: Dual | None = None, others: Any = 0.0) -> Dual:
        """Return a result, given its derivatives by this number and by the other one."""
        slopes = {name: _times(own, slope) for name, slope in self.slopes.items()}
        for name, slope in (other.slopes if other else {}).items():
            slopes[name] = slopes.get(name, 0.0) + _times(others, slope)
        return Dual(value, slopes)

    def __neg__(self) -> Dual:
        return self._with(-self.value, -1.0)

    def __add__(self, other: Dual) -> Dual:
        return self._with(self.value + other.value, 1.0, other, 1.0)

    def __sub__(self, other: Dual) -> Dual:
        return self._with(self.value - other.value, 1.0, other, -1.0)

    def __mul__(self, other: Dual) -> Dual:
        return self._with(self.value * other.value, other.value, other, self.value)

    def __truediv__(self, other: Dual) -> Dual:
        quotient = self.value / other.value
        return self._with(quotient, 1 / other.value, other, -quotient / other.value)

    def __pow__(self, other: Dual) -> Dual:
        a, b = self.value, other.value
        power = a**b
        by_base = np.where(b == 0, 0.0, b * a ** (b - 1))
        return self._with(power, by_base, other, np.where(power == 0, 0.0, power * np.log(a)))

    def through(self, function: str) -> Dual:
        """Return the value of one of :data:`~porocore.core.formulas.FUNCTIONS`."""
        value = FUNCTIONS[function](self.value)
        return self._with(value, _SLOPES[function](self.value, value))


def _times(factor: Any, slope: Any) -> Any:
    """Return the product, zero where the slope is."""
    return np.where(slope == 0, 0.0, factor * slope)


_FUNCTIONS: dict[str, Callable[[Dual], Dual]] = {
    name: lambda x, name=name: x.through(name)  # type: ignore[misc]
    for name in FUNCTIONS
}


def value_and_slopes(expression: Expression, values: Mapping[str, Array]) -> tuple[Array, dict[str, Array]]:
    """Return the values (n,) of a formula and its derivatives by the names that occur, (n,) each.

    Values are NaN or infinite where the formula has none. The derivative of abs(x) at x = 0 is 0.

    Parameters
    ----------
    expression
        The formula.
    values
        Values (n,) of all its names.
    """

    def named(name: str) -> Dual:
        if name in values:
            return Dual(values[name], {name: np.float64(1.0)})
        return Dual(np.float64(CONSTANTS[name]))

    with np.errstate(all="ignore"):
        found: Dual = expression.convert(named, _FUNCTIONS, lambda number: Dual(np.float64(number)))
    shape = np.broadcast_shapes((), *(np.shape(values[name]) for name in expression.names))
    slopes = {name: np.broadcast_to(slope, shape) for name, slope in found.slopes.items()}
    return np.broadcast_to(found.value, shape), slopes
