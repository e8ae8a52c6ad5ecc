"""Plan of a sweep (SweepPlan): the family of cells that its values span, and its study."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.family.family import number, possible_parameters, replaced, require_known
from porocore.core.echo import echo, joined
from porocore.core.files.atomic import file_stem
from porocore.core.files.yaml_document import YamlDocument
from porocore.core.units import dimensions
from porocore.errors import ConfigurationError
from porocore.study.config.config import RunConfig
from porocore.study.config.loading import validated

#: Digits to which values are rounded, so that those of equal steps have short names.
DIGITS = 12
#: Sampler that varies no parameters, and the design that samples the family of a study that has it.
WITHOUT_PARAMETERS, DESIGN = "density-sweep", {"count": 64, "corners": True}


def family_over(
    config: RunConfig, ranges: Mapping[str, tuple[float, float]]
) -> tuple[RunConfig, tuple[str, ...]]:
    """Return the study of a family of cells, and notes on settings that it cannot have.

    A number of the cell becomes a range, with its middle in ``macro.fields`` where that has no value; a range that is
    there already stays, and both are sampled as a whole. Where the sampler of a study without ranges varies no
    parameters, a design samples the family.

    Parameters
    ----------
    config
        The study.
    ranges
        Ends of the range of each parameter, by name.

    Raises
    ------
    ConfigurationError
        A name is unknown, an end lies outside the range that is there, or no cell has these numbers.
    """
    paths = {name: path for path, name in possible_parameters(config.cell).items()}
    require_known(ranges, [*paths])
    known = {parameter.name: parameter for parameter in config.cell.parameters}
    for name in ranges.keys() & known.keys():
        for value in ranges[name]:
            known[name].require_inside(value)
    new = {paths[name]: {"range": [*ends]} for name, ends in ranges.items() if name not in known}
    data = config.model_dump(mode="json")
    data["cell"] = replaced(data["cell"], new)
    if ranges:
        data["sampling"]["parameters"] = "ranges"
    for name, ends in ranges.items():
        middle = known[name].base if name in known else (ends[0] + ends[1]) / 2
        data["macro"]["fields"].setdefault(name, rounded(middle))
    notes = () if config.cell.parameters or not ranges else _sampled_by_a_design(data["sampling"])
    return (config if data == config.model_dump(mode="json") else _validated(data)), notes


def _sampled_by_a_design(sampling: dict[str, Any]) -> tuple[str, ...]:
    """Put a design in the place of a sampler that varies no parameters; return a note where that is so."""
    if sampling["sampler"] != WITHOUT_PARAMETERS:
        return ()
    inputs = {name: {**swept, "step": None} for name, swept in sampling["inputs"].items()}
    sampling |= {"sampler": "sobol", "options": dict(DESIGN), "inputs": inputs, "tolerance": None}
    return (
        f"sampling: {WITHOUT_PARAMETERS} varies no parameters of the cell; sobol samples the family with "
        f"{DESIGN['count']} states",
    )


def _validated(data: dict[str, Any]) -> RunConfig:
    """Return the configuration of settings; its faults have keys and no place."""
    try:
        return validated(YamlDocument.of(data, Path.cwd()))
    except ConfigurationError as error:
        lines = (line.removeprefix("settings: ") for line in str(error).splitlines())
        raise ConfigurationError("\n".join(lines)) from None


def quantities_of(cell: Cell) -> dict[str, str]:
    """Return the quantity of every number of a cell that may be a parameter, by name; '' for a plain number."""
    names = possible_parameters(cell)
    return {
        names[place.path]: "" if dimension is None else dimension.quantity
        for place, dimension in dimensions(type(cell), cell)
        if place.path in names
    }


def rounded(value: float) -> float:
    """Return a number with :data:`DIGITS` digits."""
    return float(f"{value:.{DIGITS}g}")


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
