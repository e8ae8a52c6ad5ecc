"""Study of the family of cells that ranges of some of its numbers span."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from porocore.cell.cell import Cell
from porocore.cell.family.parameters import possible_parameters, require_known
from porocore.cell.family.ranges import replaced
from porocore.core.files.yaml_document import YamlDocument
from porocore.core.units.texts import dimensions
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
