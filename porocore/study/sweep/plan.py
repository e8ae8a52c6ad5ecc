"""Plan of a sweep (SweepPlan): the family of cells that its values span, and the body at each of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from typing import Any

import numpy as np

from porocore.cell.family.parameters import number, possible_parameters, require_known
from porocore.core.echo import echo, joined
from porocore.core.files.atomic import file_stem
from porocore.errors import ConfigurationError
from porocore.study.config.config import RunConfig
from porocore.study.sweep.family import family_over, quantities_of, rounded

#: Values of a sweep at most, of two parameters together.
MOST_VALUES = 10_000
#: Folder of the values below that of the run.
FOLDER = "sweep"


@dataclass(frozen=True)
class SweptParameter:
    """A parameter of a sweep.

    Attributes
    ----------
    name
        Name of the parameter, as of ``Cell.parameters``.
    values
        Its values, ascending.
    quantity
        Quantity that it is, '' for a plain number.
    """

    name: str
    values: tuple[float, ...]
    quantity: str = ""


@dataclass(frozen=True)
class SweepPoint:
    """Values of a sweep's parameters, by name."""

    values: Mapping[str, float]

    @property
    def name(self) -> str:
        """Name of the point and of its folder, such as ``radius=0.22,poisson_ratio=0.3``."""
        return ",".join(f"{name}={value!r}" for name, value in self.values.items())


@dataclass(frozen=True, eq=False)
class SweepPlan:
    """Values of one or two parameters, and the study of the family of cells that they span.

    Attributes
    ----------
    family
        Configuration of the run that samples and learns the family.
    swept
        The parameters with their values.
    notes
        Settings of the study that a family cannot have, and what stands in their place.
    """

    family: RunConfig
    swept: tuple[SweptParameter, ...]
    notes: tuple[str, ...] = ()

    @classmethod
    def over(cls, config: RunConfig, values: Mapping[str, Sequence[float]]) -> SweepPlan:
        """Return the plan of a sweep of a study.

        A number of the cell becomes a range between the ends of its values; a range that is there already stays. Where
        the sampler of a study without ranges varies no parameters, a design samples the family.

        Parameters
        ----------
        config
            The study.
        values
            Values of one or two parameters of the cell, by name.

        Raises
        ------
        ConfigurationError
            A name is unknown, values are too few or too many, twice there or outside the range, or no cell has them.
        """
        if not 1 <= len(values) <= 2:
            raise ConfigurationError(
                f"expected one or two parameters, got {joined(map(str, values)) if values else 'none'}"
            )
        require_known(values, [*possible_parameters(config.cell).values()])
        found = {name: _values(name, given) for name, given in values.items()}
        if (count := math.prod(map(len, found.values()))) > MOST_VALUES:
            raise ConfigurationError(f"expected at most {MOST_VALUES} values in all, got {count}")
        for parameter in config.cell.parameters:
            for value in found.get(parameter.name, ()):
                parameter.require_inside(value)
        family, notes = family_over(config, {name: (min(v), max(v)) for name, v in found.items()})
        quantities = quantities_of(config.cell)
        swept = tuple(SweptParameter(name, v, quantities[name]) for name, v in found.items())
        return cls(family, swept, notes)

    @property
    def suffix(self) -> str:
        """End of the name of the family's folder, behind that of the study, such as ``-over-radius``."""
        return f"-over-{'-'.join(file_stem(each.name) for each in self.swept)}"

    @cached_property
    def points(self) -> tuple[SweepPoint, ...]:
        """All points, the values of the first parameter outermost."""
        names = [each.name for each in self.swept]
        return tuple(
            SweepPoint(dict(zip(names, values, strict=True)))
            for values in product(*(each.values for each in self.swept))
        )

    def at(self, point: SweepPoint) -> RunConfig:
        """Return the study of the body whose cell has the values of a point everywhere."""
        fields = {**self.family.macro.fields, **point.values}
        return self.family.model_copy(
            update={"macro": self.family.macro.model_copy(update={"fields": fields})}
        )

    def member(self, point: SweepPoint) -> np.ndarray[Any, np.dtype[np.float64]] | None:
        """Return the values (1, m) of all parameters of the one cell of the body; None where it has several."""
        macro = self.at(point).macro
        names = [parameter.name for parameter in self.family.cell.parameters]
        values = [macro.fields.get(name) for name in names]
        regions = macro.regions.values()
        if any(region.cell is not None or any(name in region.fields for name in names) for region in regions):
            return None
        if not all(isinstance(value, float | int) for value in values):
            return None
        return np.array([values], dtype=float)


def _values(name: str, given: Sequence[float]) -> tuple[float, ...]:
    """Return the values of a parameter in ascending order.

    Raises
    ------
    ConfigurationError
        They are no sequence of two different finite numbers or more.
    """
    try:
        if isinstance(given, str | Mapping):
            raise TypeError
        values = sorted(rounded(number(name, value)) for value in given)
    except TypeError:
        raise ConfigurationError(f"{name}: expected a sequence of values, got {echo(given)}") from None
    if len(values) < 2:
        raise ConfigurationError(f"{name}: expected at least two values, got {echo(values)}")
    for one, other in pairwise(values):
        if one == other:
            raise ConfigurationError(f"{name}: the value {one:g} is there twice; keep one")
    return tuple(values)
