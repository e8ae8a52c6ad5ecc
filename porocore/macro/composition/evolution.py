"""Configuration of parameters of the cell that evolve (Evolution): a formula of their rate, or a named one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from porocore.core.echo import echo, joined, suggestion
from porocore.core.formulas import LONGEST
from porocore.core.models.strict import StrictModel
from porocore.core.units import ByKey, Dimension, InScales
from porocore.errors import ConfigurationError
from porocore.macro.laws.rates import NAMED_RATES, Rate

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
