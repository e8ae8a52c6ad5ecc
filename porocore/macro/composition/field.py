"""Fields of a parameter in the configuration: base with its course in time, formula, table along an axis."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from porocore.core.echo import echo
from porocore.core.formulas.expressions import LONGEST, Expression
from porocore.core.formulas.time_function import TimeFunction
from porocore.core.models.bounds import MOST_TIMES
from porocore.core.models.strict import StrictModel
from porocore.core.units.dimensions import Dimension, InScales
from porocore.core.units.results import spoken
from porocore.errors import ConfigurationError
from porocore.states import Array, IntArray

#: Names that a formula of place and time may use.
COORDINATES = ("x", "y", "z", "t")


@dataclass(frozen=True, eq=False)
class Points:
    """Quadrature points at which fields are evaluated, element by element.

    Attributes
    ----------
    places : (n, 3)
        X.
    centres : (elements, 3)
        Centres of the elements, at which files and pictures are read.
    element : (n,)
        Element of each point, by its place in ``centres``.
    """

    places: Array
    centres: Array
    element: IntArray

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, rows: Any) -> Points:
        return Points(self.places[rows], self.centres, self.element[rows])


class ParameterField(StrictModel, ABC):
    """Values of a parameter over the body.

    With ``over`` the parameter goes from ``initial`` to these values: initial + over(t) (value − initial).
    """

    initial: float | None = None
    """Value everywhere where ``over`` is 0."""
    over: TimeFunction | None = None
    """Share of the way from ``initial`` to the field that is gone at a time; null: all of it, always."""

    @model_validator(mode="after")
    def _together(self) -> ParameterField:
        if (self.initial is None) != (self.over is None):
            raise ValueError(
                "initial and over belong together: the value to begin with, and the share of the way from it"
            )
        return self

    @property
    def varies(self) -> bool:
        """True for a field that changes with time."""
        return self.over is not None

    @property
    def by_formula(self) -> bool:
        """True for a field that changes with time by a formula, between whose kinks it may go anywhere."""
        return self.over is not None and self.over.expression is not None

    @property
    def corners(self) -> tuple[float, ...]:
        """Times at which the field has a kink."""
        return () if self.over is None else self.over.corners

    @abstractmethod
    def reached(self, points: Points, time: float, key: str) -> Array:
        """Return the values (n,) to which the field comes.

        Raises
        ------
        ConfigurationError
            It has no value somewhere; the message begins with ``key``.
        """

    def in_time(self, reached: Array, time: float) -> Array:
        """Return the values (n,) at ``time`` of a field that comes to ``reached``."""
        if self.over is None or self.initial is None:
            return reached
        return np.asarray(self.initial + self.over.at(time) * (reached - self.initial))


class FormulaField(ParameterField):
    """A formula of place and time."""

    kind: Literal["formula"] = "formula"
    """A formula of place and time."""
    formula: Annotated[str, Field(max_length=LONGEST), InScales()]
    """A formula of x, y, z and t, such as ``0.2 + 0.01*y``; all are dimensionless, also where there are scales."""

    @field_validator("formula")
    @classmethod
    def _readable(cls, formula: str) -> str:
        require_formula(formula)
        return formula

    @property
    def varies(self) -> bool:
        """True for a formula of t, or with a course in time."""
        return super().varies or "t" in require_formula(self.formula).names

    @property
    def by_formula(self) -> bool:
        """True for a formula of t, or one that is gone to by a formula."""
        return super().by_formula or "t" in require_formula(self.formula).names

    def reached(self, points: Points, time: float, key: str) -> Array:
        """Return the values of the formula."""
        return formula_values(self.formula, points.places, time, key)


class TableField(ParameterField):
    """A table along one axis of the body, linear in between and constant before the first and after the last entry."""

    kind: Literal["table"]
    """A table along one axis of the body."""
    along: Literal["x", "y", "z"]
    """Axis of the coordinate."""
    table: Annotated[
        tuple[tuple[Annotated[float, Dimension("displacement")], float], ...],
        Field(min_length=1, max_length=MOST_TIMES),
    ]
    """[coordinate, value] with ascending coordinates; two equal ones make a step."""

    @field_validator("table")
    @classmethod
    def _ascends(cls, table: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        at = [place for place, _ in table]
        for k, (one, other) in enumerate(pairwise(at), start=1):
            if other < one:
                raise ValueError(
                    f"the coordinates of the table do not ascend: entry {k + 1} lies before entry {k}; sort them"
                )
        if any(at[i] == at[i + 2] for i in range(len(at) - 2)):
            raise ValueError(
                "more than two entries of the table have the same coordinate; keep two, for a step"
            )
        return table

    def reached(self, points: Points, time: float, key: str) -> Array:
        """Return the values of the table."""
        at, values = np.array(self.table).T
        return np.asarray(np.interp(points.places[:, "xyz".index(self.along)], at, values))


def require_formula(text: str) -> Expression:
    """Return the formula of place and time.

    Raises
    ------
    ValueError
        It is none; the message says what and where.
    """
    return Expression.parse(text, COORDINATES)


def formula_values(text: str, places: Array, time: float, key: str) -> Array:
    """Return the values (n,) of a formula at ``places`` (n, 3).

    Raises
    ------
    ConfigurationError
        It has no finite value at one of them; the message begins with ``key``.
    """
    x, y, z = places.T
    values = np.broadcast_to(require_formula(text)(x=x, y=y, z=z, t=time), len(places)).astype(float)
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        at = spoken().texts(places[bad[0]], "displacement")
        raise ConfigurationError(
            f"{key}: {echo(text)} is no finite number at {at}, t = {spoken().text(time, 'time', 6)}, one of {len(bad)} "
            f"of {len(places)} points; in a formula coordinates and time are dimensionless"
        )
    return values
