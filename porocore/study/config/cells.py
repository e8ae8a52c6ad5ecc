"""Several cells in one study: their names, the study of one of them, faults of cells and regions."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from porocore.cell.cell import Cell
from porocore.core.echo import echo, suggestion
from porocore.core.files.yaml_document import Location, dotted
from porocore.core.units.results import length_text
from porocore.errors import ConfigurationError
from porocore.macro.composition.axes import AXES
from porocore.macro.composition.body_fields import CellRanges

if TYPE_CHECKING:
    from porocore.study.config.config import RunConfig
    from porocore.study.config.sections import MacroSettings

#: Name of a cell, which is that of a folder too.
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}")
#: Largest difference of two lengths of one cell, relative to them.
SAME_LENGTH = 1e-6
NO_REST = (
    "cell: missing; with 'cells:' the rest of the body needs a cell too: give one of the cells here, at the top level, "
    "and leave 'cell:' of its regions out"
)


def well_named(cells: dict[str, Cell]) -> dict[str, Cell]:
    """Return the cells after a check of their names.

    Raises
    ------
    ValueError
        A name is none of a folder, or the same as another but for capitals.
    """
    known: dict[str, str] = {}
    for name in cells:
        if not _NAME.fullmatch(name):
            raise ValueError(
                "expected names of up to 40 letters, digits, '-' and '_', which are folders of the run, got "
                + echo(name)
            )
        other = known.setdefault(name.lower(), name)
        if other != name:
            raise ValueError(f"the cells '{other}' and '{name}' differ by capitals alone; rename one")
    return cells


def cell_faults(config: RunConfig) -> Iterator[tuple[Location, str]]:
    """Yield the faults of cells and regions that name one another."""
    cells = config.cells
    if cells and "cell" not in config.model_fields_set:
        yield ("cell",), NO_REST
    named: list[tuple[Location, str]] = [
        (("macro", "regions", name, "cell"), region.cell)
        for name, region in config.macro.regions.items()
        if region.cell is not None
    ]
    used = {cell for _, cell in named}
    named += [(("sampling", "cells", name), name) for name in config.sampling.cells]
    for at, cell in named:
        if cell not in cells:
            known = suggestion(cell, cells, "the cells are", "there are none; add it under 'cells:'")
            yield at, f"{dotted(at)}: there is no cell {echo(cell)}; {known}"
    for name in cells if used <= cells.keys() else ():  # else one of them may be meant
        if name not in used:
            at = ("cells", name)
            yield (
                at,
                f"{dotted(at)}: no region has this cell; write 'cell: {name}' under a region of macro.regions, or "
                "remove it",
            )
    yield from other_lengths(config)


def other_lengths(config: RunConfig) -> Iterator[tuple[Location, str]]:
    """Yield faults of images whose edge is not that of the other cells, in multiples of which all of them are."""
    edge = config.cell.geometry.length if config.scales is None else config.scales.pore
    for name, cell in config.cells.items():
        own = cell.geometry.length
        if own is not None and edge is not None and not math.isclose(own, edge, rel_tol=SAME_LENGTH):
            at = ("cells", name, "geometry", "voxel_size")
            yield (
                at,
                f"{dotted(at)}: expected a cell of {length_text(edge)}, which is the edge of the others, got "
                f"{length_text(own)}; all cells of a study have one edge",
            )


def of_one_cell(config: RunConfig, name: str | None) -> RunConfig:
    """Return the study of a body of one cell, with its own inputs; None names the cell of the rest of the body."""
    if not config.cells:
        return config
    own = None if name is None else config.sampling.cells.get(name)
    sampling = {"cells": {}, "inputs": config.sampling.inputs | ({} if own is None else own.inputs)}
    macro = with_fields_of(config, name)
    regions = {
        region: settings.model_copy(update={"cell": None})
        for region, settings in macro.regions.items()
        if settings.cell == name
    }
    part = config.model_copy(
        update={
            "cell": cell_of(config, name),
            "cells": {},
            "sampling": config.sampling.model_copy(update=sampling),
            "macro": macro.model_copy(update={"regions": regions}),
        }
    )
    part._part_of = config, name
    return part


def cell_of(config: RunConfig, name: str | None) -> Cell:
    """Return the cell of this name; None names that of the rest of the body."""
    return config.cell if name is None else config.cells[name]


def cell_ranges(config: RunConfig) -> CellRanges:
    """Return the ranges of the parameters of the cell of each region."""
    ranges = {
        name: {each.name: (each.lower, each.upper) for each in cell_of(config, name).parameters}
        for name in config.cell_names
    }
    return CellRanges([ranges[None], *(ranges[region.cell] for region in config.macro.regions.values())])


def with_fields_of(config: RunConfig, name: str | None) -> MacroSettings:
    """Return the body with fields of the parameters of one cell alone, and with all material axes."""
    macro = config.macro
    known = {AXES, *(parameter.name for parameter in cell_of(config, name).parameters)}
    regions = {
        region: settings.model_copy(
            update={"fields": _known(settings.fields, known if settings.cell == name else {AXES})}
        )
        for region, settings in macro.regions.items()
    }
    return macro.model_copy(update={"regions": regions, "fields": _known(macro.fields, known)})


def _known(fields: Mapping[str, Any], names: set[str]) -> dict[str, Any]:
    return {name: field for name, field in fields.items() if name in names}


@contextmanager
def keys_of(config: RunConfig, name: str | None) -> Iterator[None]:
    """Name the keys of a cell where the block complains about those of a study of this cell alone.

    ``config`` is the whole study, and ``name`` that of the cell; None: the cell of the rest of the body.
    """
    try:
        yield
    except ConfigurationError as error:
        if name is None:
            raise
        keys = {"cell.": f"cells.{name}.", "cell:": f"cells.{name}:"}
        if name in config.sampling.cells:
            own = config.sampling.cells[name].inputs
            keys |= {f"sampling.inputs.{each}.": f"sampling.cells.{name}.inputs.{each}." for each in own}
            keys["sampling.inputs:"] = f"sampling.cells.{name}.inputs:"
        raise ConfigurationError(
            "\n".join(_renamed(line, keys) for line in str(error).splitlines())
        ) from None


def _renamed(line: str, keys: Mapping[str, str]) -> str:
    for key, other in keys.items():
        if line.startswith(key):
            return other + line.removeprefix(key)
    return line


def lines_of_cell(name: str | None, lines: Iterable[str]) -> Iterator[str]:
    """Yield lines with the name of the cell that they are about, where it has one."""
    for line in lines:
        head = next(head for head in ("note: ", "  ", "") if line.startswith(head))
        yield line if name is None else f"{head}cell {name}: {line.removeprefix(head)}"
