"""Reading a configuration: YAML or nested settings in, validated settings out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from porocore.cell.cell import Cell
from porocore.core.echo import echo, suggestion
from porocore.core.files.yaml_document import Location, YamlDocument, dotted
from porocore.core.models.bounds import LARGEST_NUMBER
from porocore.core.models.strict import StrictModel
from porocore.core.units.results import OutputUnits, ResultUnits, length_text, speaking
from porocore.core.units.scales import Scales
from porocore.core.units.texts import resolved
from porocore.errors import ConfigurationError
from porocore.macro.problem import MacroSetup
from porocore.study.config.config import RunConfig
from porocore.study.config.errors import faults, unexpected
from porocore.study.examples import benchmark_path

#: Keys that are true or false.
SWITCHES = ("drop_grains",)
NO_VISCOSITY = (
    "cell.viscosity: missing; with scales the fluid has no default viscosity: add 'viscosity: 1 mPa s', which is "
    "water, under 'cell:'"
)


#: Largest difference of two lengths of one cell, relative to them.
SAME_LENGTH = 1e-6


class _OnlyScales(StrictModel):
    scales: Scales


class _OnlyCell(StrictModel):
    cell: Cell = Cell()


def load_config(path: Path | str, cell_only: bool = False) -> RunConfig:
    """Read and validate a configuration.

    Parameters
    ----------
    path
        The file.
    cell_only
        Only the cell is used. A file that has neither ``sampling`` nor ``macro`` gets those of the benchmark.

    Raises
    ------
    ConfigurationError
        Lists every fault on a line of its own: file, line, dotted key, expected and given value, advice.
    """
    document = YamlDocument.read(Path(path))
    if cell_only and not document.data.keys() & {"sampling", "macro"}:
        rest = YamlDocument.read(benchmark_path()).data
        document = replace(
            document, data={**document.data, "sampling": rest["sampling"], "macro": rest["macro"]}
        )
    return validated(document)


def cell_from(settings: Mapping[str, Any], folder: Path | str = ".") -> Cell:
    """Validate the settings of a cell alone, nested as in a file; relative paths in them start at ``folder``.

    Raises
    ------
    ConfigurationError
        See :func:`load_config`; faults have dotted keys and no lines.
    """
    return _only_cell(YamlDocument.of({"cell": settings}, Path(folder)))


def _only_cell(document: YamlDocument) -> Cell:
    """Return the cell of a document; of its values only those in SI units may have a unit."""
    data, _ = resolved(_OnlyCell, document.data, None)
    try:
        return _OnlyCell.model_validate(data, context={"folder": document.folder}).cell
    except ValidationError as error:
        raise _refusal(document, faults(document, error.errors(), _OnlyCell)) from error


def validated(document: YamlDocument) -> RunConfig:
    """Return the configuration that a document holds; see :func:`load_config`."""
    scales = _scales(document)
    data, found = resolved(RunConfig, document.data, scales)
    if scales is not None:
        data["scales"].setdefault("pore", scales.pore)
    unread = {at for at, _ in found}
    config: RunConfig | None = None
    try:
        with speaking(_units(data, scales)):
            config = RunConfig.model_validate(data, context={"folder": document.folder})
    except ValidationError as error:
        found += [fault for fault in faults(document, error.errors(), RunConfig) if fault[0] not in unread]
    else:
        for at, value in _leaves(config.model_dump()):
            if isinstance(value, float) and not abs(value) <= LARGEST_NUMBER:
                kind = f"a number up to {LARGEST_NUMBER:g}" if math.isfinite(value) else "a finite number"
                found.append((at, unexpected(at, kind, value)))
        found += _unknown_surfaces(config.macro)
        if scales is not None and "viscosity" not in config.cell.model_fields_set:
            found.append((("cell", "viscosity"), NO_VISCOSITY))
    # pydantic would take 'yes' for 1.
    found += [
        (
            at,
            f"{dotted(at)}: expected a number, got {echo(value)} (so YAML reads yes, no, on and off); write a number",
        )
        for at, value in _leaves(document.data)
        if isinstance(value, bool) and not {"options", *SWITCHES} & {*at} and at not in dict(found)
    ]
    if found or config is None:
        raise _refusal(document, found)
    return config


def _refusal(document: YamlDocument, found: Iterable[tuple[Location, str]]) -> ConfigurationError:
    """Return one error of all faults, in the order of their lines, each once."""
    told = dict.fromkeys((document.line(at), text) for at, text in found)
    lines = sorted(told, key=lambda fault: fault[0])
    return ConfigurationError("\n".join(f"{document.at_line(line)}: {text}" for line, text in lines))


def _scales(document: YamlDocument) -> Scales | None:
    """Return the scales, with which everything else is read; their faults are raised alone.

    A cell that tells its own length needs no ``pore``, and none that differs.
    """
    section = document.data.get("scales")
    if section is None:
        return None
    data, found = resolved(_OnlyScales, {"scales": section}, None)
    length = _length(document)
    if length is not None and isinstance(data["scales"], dict):
        data["scales"].setdefault("pore", length)
    if not found:
        try:
            scales = _OnlyScales.model_validate(data).scales
        except ValidationError as error:
            found += faults(document, error.errors(), RunConfig)
        else:
            if length is None or math.isclose(scales.pore, length, rel_tol=SAME_LENGTH):
                return scales
            found.append((("scales", "pore"), _other_length(length, section["pore"])))
    raise _refusal(document, found)


def _length(document: YamlDocument) -> float | None:
    """Return the length of the cell in metres where its geometry tells it, as an image with ``voxel_size`` does."""
    cell = document.data.get("cell")
    geometry = cell.get("geometry") if isinstance(cell, Mapping) else None
    if not isinstance(geometry, Mapping) or geometry.get("voxel_size") is None:
        return None
    only = replace(document, data={"cell": {"geometry": geometry}})
    return _only_cell(only).geometry.length


def _other_length(length: float, given: Any) -> str:
    return (
        f"scales.pore: expected {length_text(length)}, the length of the cell by cell.geometry.voxel_size (the cube "
        f"root of its volume), got {echo(given)}; leave scales.pore out, or voxel_size"
    )


def _units(data: Any, scales: Scales | None) -> ResultUnits:
    """Return the units of messages about a configuration whose output units may be faulty."""
    try:
        return ResultUnits(scales, OutputUnits.model_validate(data.get("output_units") or {}))
    except ValidationError:
        return ResultUnits(scales)


def _unknown_surfaces(macro: MacroSetup) -> Iterator[tuple[Location, str]]:
    """Yield faults of surfaces of a body whose kind names them; those of a mesh file are known when it is read."""
    known = [*macro.body.surfaces, *macro.surfaces]
    named: list[tuple[Location, str]] = [(("macro", "boundary", name), name) for name in macro.boundary]
    named += [(("macro", "surfaces", name, "of"), patch.of) for name, patch in macro.surfaces.items()]
    for at, name in named if macro.body.surfaces else ():
        if name not in known:
            yield at, f"{dotted(at)}: no such surface; {suggestion(name, known, 'the surfaces are')}"


def _leaves(data: Any, at: Location = ()) -> Iterator[tuple[Location, Any]]:
    """Yield all plain values in nested mappings and lists with their locations."""
    if isinstance(data, Mapping):
        for key, value in data.items():
            yield from _leaves(value, (*at, str(key)))
    elif isinstance(data, list | tuple):
        for i, value in enumerate(data):
            yield from _leaves(value, (*at, str(i)))
    else:
        yield at, data
