"""Configuration of parameters of the cell that evolve (Evolution): a formula of their rate, or a named one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from porocore.core.echo import echo, joined, suggestion
from porocore.core.formulas import LONGEST
from porocore.core.models.strict import StrictModel
from porocore.core.units import ByKey, Dimension, InScales, units_now
from porocore.errors import ConfigurationError
from porocore.macro.laws.rates import NAMED_RATES, Rate
from porocore.states import Array

#: Quantities of the units of constants.
_QUANTITIES = {"1/time": "rate", "stress": "stress"}
#: Dimensions of the constants of named rates, by their names.
_DIMENSIONS = {
    name: Dimension(_QUANTITIES[constant.unit])
    for rate in NAMED_RATES.values()
    for name, constant in rate.constants.items()
    if constant.unit in _QUANTITIES
}


def _known_law(law: str) -> str:
    if law not in NAMED_RATES:
        raise ValueError(
            f"no law of evolution is called {echo(law)}; {suggestion(law, NAMED_RATES, 'the laws are')}"
        )
    return law


class Evolution(StrictModel):
    """Rate of a parameter of the cell, either a formula or a named law; its value in ``macro.fields`` is the first one.

    The parameter stays within the range that the cell has: it stops at the end, and the points are flagged.
    """

    rate: Annotated[str, Field(max_length=LONGEST), InScales()] | None = None
    """Formula of the rate, such as ``-k*flux*radius``, of quantities of the point, parameters of the cell and the
    ``constants``; all are dimensionless, also where there are scales."""
    law: (
        Annotated[str, AfterValidator(_known_law), Field(json_schema_extra={"enum": list(NAMED_RATES)})]
        | None
    ) = None
    """Named law in place of a formula: ``clogging``, ``growth``, ``degradation`` or ``creep``."""
    constants: Annotated[dict[str, float], ByKey(_DIMENSIONS)] = Field(default={})
    """Numbers of the formula by name; those of a named law with a dimension may have a unit."""

    @model_validator(mode="after")
    def _one_of_them(self) -> Evolution:
        if self.rate is not None and self.law is not None:
            raise ValueError("expected either rate, a formula, or law, a named one, got both; keep one")
        if self.rate is None and self.law is None:
            raise ValueError(
                f"expected rate, a formula, or law, one of {joined(NAMED_RATES)}, got neither; add one"
            )
        if self.law is not None:
            needed = NAMED_RATES[self.law].constants
            if more := [name for name in self.constants if name not in needed]:
                advice = suggestion(more[0], needed, "its constants are")
                raise ValueError(f"the law '{self.law}' has no constant {echo(more[0])}; {advice}")
            if lacking := [name for name in needed if name not in self.constants]:
                meant = needed[lacking[0]].meaning
                raise ValueError(
                    f"the law '{self.law}' needs the constant '{lacking[0]}', the {meant}; add '{lacking[0]}:' under "
                    "'constants:'"
                )
        return self

    def rate_of(self, parameter: str, parameters: Sequence[str]) -> Rate:
        """Return the rate of one of the ``parameters`` of a cell.

        Raises
        ------
        ConfigurationError
            The formula cannot be read, or names what is neither a quantity, nor a parameter or constant; or a constant
            has the name of another of these. The message begins with the key.
        """
        key = f"macro.evolution.{parameter}.{'rate' if self.law is None else 'law'}"
        try:
            if self.law is not None:
                return NAMED_RATES[self.law].of(parameter, parameters)
            assert self.rate is not None
            return Rate(self.rate, parameters, tuple(self.constants))
        except ConfigurationError as error:
            raise ConfigurationError(f"{key}: {error}") from None


#: Steps between two times at which parameters that evolve are looked at.
STEPS = 8


class EvolutionCourse:
    """Course of the parameters of a cell at n points, some of which evolve by rates that do not follow the state.

    Parameters
    ----------
    evolutions
        Those of the parameters by name.
    ranges
        Ranges of all m parameters of the cell, in their order.
    places : (n, 3)
        X.
    """

    def __init__(
        self, evolutions: Mapping[str, Evolution], ranges: Mapping[str, tuple[float, float]], places: Array
    ) -> None:
        self._names = names = list(ranges)
        rates = {name: each.rate_of(name, names) for name, each in evolutions.items() if name in ranges}
        self._rates = [
            (names.index(name), rate, np.array([evolutions[name].constants[c] for c in rate.constants]))
            for name, rate in rates.items()
        ]
        #: Whether all rates are known without the state of the body.
        self.is_known = not any(rate.follows_state for rate in rates.values())
        self.evolves = bool(rates)
        self._low, self._high = np.array(list(ranges.values())).T
        self._places = places

    def after(self, values: Array, begin: float, given: Array, end: float) -> Array:
        """Return the parameters (n, m) at ``end`` from ``values`` at ``begin``; those that do not evolve are ``given``.

        Rates are integrated by the classical method of Runge and Kutta and stop at the ends of the ranges.

        Raises
        ------
        ConfigurationError
            A rate has no value somewhere.
        """
        columns = [k for k, _, _ in self._rates]
        h, fixed = (end - begin) / STEPS, given - values
        fixed[:, columns] = 0.0
        for step in range(STEPS):
            t, found = begin + step * h, [np.zeros_like(values)]
            for share in (0.0, 0.5, 0.5, 1.0):
                found.append(
                    self._slope(t + share * h, values + share * h * found[-1], fixed / (end - begin))
                )
            moved = values + h * (found[1] + 2 * found[2] + 2 * found[3] + found[4]) / 6
            values = np.clip(moved, self._low, self._high)
        return values

    def _slope(self, time: float, values: Array, fixed: Array) -> Array:
        slope, inside = fixed.copy(), np.clip(values, self._low, self._high)
        for k, rate, constants in self._rates:
            slope[:, k] = rate.alone(time, inside, constants, self._places)
            if (bad := ~np.isfinite(slope[:, k])).any():
                at = units_now().texts(self._places[bad.argmax()], "displacement")
                raise ConfigurationError(
                    f"macro.evolution.{self._names[k]}: the rate {echo(rate.formula)} is no finite number at {at}, t = "
                    f"{units_now().text(time, 'time', 6)}"
                )
        return slope
