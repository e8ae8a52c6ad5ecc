"""Functions of time in the configuration (TimeFunction): table, ramp or expression; corners, values."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from porocore.core.echo import echo
from porocore.core.formulas.expressions import LONGEST, Expression
from porocore.core.models.bounds import MOST_TIMES
from porocore.core.models.strict import StrictModel
from porocore.core.units.dimensions import Carried, Dimension, InScales
from porocore.errors import ConfigurationError

Positive = Annotated[float, Field(gt=0)]


def require_later(times: Sequence[float], of: str) -> None:
    """Refuse times of which one is not after that before it.

    Raises
    ------
    ValueError
        There is one; the message has the place in the list, since times have no unit yet.
    """
    for k, (one, other) in enumerate(pairwise(times), start=1):
        if other <= one:
            raise ValueError(
                f"the times of {of} do not ascend: entry {k + 1} is not after entry {k}; sort them"
            )


class TimeFunction(StrictModel):
    """A function of time of its own, instead of the common ramp: one of ``table``, ``ramp``, ``expression``."""

    table: Annotated[
        tuple[tuple[Annotated[float, Field(ge=0), Dimension("time")], Annotated[float, Carried()]], ...],
        Field(max_length=MOST_TIMES),
    ] = ()
    """[time, value] with ascending times, linear in between, constant before the first and after the last."""
    ramp: Annotated[float | None, Carried()] = None
    """From 0 at t = 0 linearly to this value at ``until``, and constant from then on."""
    until: Annotated[Positive | None, Dimension("time")] = None
    """End of the ramp."""
    expression: Annotated[str, Field(max_length=LONGEST), InScales()] | None = None
    """A formula of t such as ``0.1*sin(2*pi*t)``; t and the result are dimensionless, also where there are scales."""

    @model_validator(mode="after")
    def _one_of_them(self) -> TimeFunction:
        given = [bool(self.table), self.ramp is not None, self.expression is not None]
        if sum(given) != 1:
            raise ValueError("expected exactly one of table, ramp (with until) and expression")
        if (self.ramp is None) != (self.until is None):
            raise ValueError("ramp and until belong together: the value, and the time at which it is reached")
        times = [time for time, _ in self.table]
        require_later(times, "the table")
        if self.expression is not None:
            Expression.parse(self.expression, ("t",))
        return self

    @property
    def corners(self) -> tuple[float, ...]:
        """Times at which the slope changes, which a time step should hit."""
        return (self.until,) if self.until is not None else tuple(time for time, _ in self.table)

    def at(self, time: float) -> float:
        """Return its value.

        Raises
        ------
        ConfigurationError
            The expression has no value at this time; :mod:`porocore.study.preflight` finds that before a run.
        """
        if self.ramp is not None and self.until is not None:
            return self.ramp * min(1.0, time / self.until)
        if self.table:
            times, values = zip(*self.table, strict=True)
            return float(np.interp(time, times, values))
        assert self.expression is not None
        value = float(Expression.parse(self.expression, ("t",))(t=time))
        if not np.isfinite(value):
            raise ConfigurationError(f"{echo(self.expression)} is no finite number at t = {time:g}")
        return value


def _form(value: Any) -> str:
    return "course" if isinstance(value, dict | TimeFunction) else "number"


#: A number follows the common ramp of the time plan; a course has its own.
Value = Annotated[
    Annotated[float, Tag("number")] | Annotated[TimeFunction, Tag("course")], Discriminator(_form)
]
