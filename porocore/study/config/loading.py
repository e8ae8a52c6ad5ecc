"""Reading of a configuration from YAML or nested settings; configurations that come with porocore."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import ValidationError, create_model
from pydantic_core import ErrorDetails

from porocore.cell.cell import Cell
from porocore.cell.level_sets.voxels import stated_size
from porocore.core.echo import echo, suggestion
from porocore.core.files.yaml_document import Location, YamlDocument, dotted, leaves
from porocore.core.models.bounds import LARGEST_NUMBER
from porocore.core.models.strict import StrictModel
from porocore.core.units import (
    OutputUnits,
    ResultUnits,
    Scales,
    length_text,
    resolved,
    unit_notes,
    using_units,
)
from porocore.errors import ConfigurationError
from porocore.macro.body.kinds import Axisymmetric, Box, Cylinder, PlaneStrain, QuarterCylinder, Wedge
from porocore.plugins.discovery import Offered
from porocore.plugins.hookspecs import CommandOffer
from porocore.plugins.registry import find_command
from porocore.study.config.config import SAME_LENGTH, Reading, RunConfig, cell_faults, other_lengths
from porocore.study.config.errors import faults, located, refusal, switched, unexpected
from porocore.study.config.laws import law_faults

Section = TypeVar("Section", bound=StrictModel)
#: File of the benchmark of Dehghani & Zilian.
BENCHMARK = "dehghani2022.yaml"
SCHEMA_FILE = "porocore.schema.json"
MODELINE = f"# yaml-language-server: $schema=./{SCHEMA_FILE}"
_HEAD = f"""{MODELINE}
# An editor with a YAML language server completes and checks the keys by this schema; write it beside this file with
#     porocore schema --to {SCHEMA_FILE}
#
"""


@dataclass(frozen=True)
class Example:
    """One configuration to start from.

    Attributes
    ----------
    name
        Name of the kind and of the file.
    title
        What it computes.
    path
        The file.
    """

    name: str
    title: str
    path: Path

    def start(self, to: Path) -> str:
        """Return the text with which a new configuration ``to`` begins."""
        text = self.path.read_text(encoding="utf-8")
        return _HEAD + text.replace(f"examples/{self.path.name}", str(to))


def packaged(name: str) -> Path:
    """Return the path of a configuration in the installed package, or in the repository."""
    package = Path(__file__).parents[2]
    installed = package / "data" / name
    return installed if installed.is_file() else package.parent / "examples" / name


def benchmark_path() -> Path:
    """Return the path of the benchmark of Dehghani & Zilian."""
    return packaged(BENCHMARK)


def as_stated_path() -> Path:
    """Return the path of the benchmark with the channel radius of the paper's text."""
    return packaged("dehghani2022-as-stated.yaml")


def crosscheck_path() -> Path:
    """Return the path of the small case on which backends are compared."""
    return packaged("crosscheck.yaml")


def examples() -> dict[str, Example]:
    """Return the examples by name, the benchmark first."""
    benchmark = benchmark_path()
    found = {}
    for path in (benchmark, *sorted(set(benchmark.parent.glob("*.yaml")) - {benchmark})):
        title = str(yaml.safe_load(path.read_text(encoding="utf-8")).get("title", ""))
        found[path.stem] = Example(path.stem, title, path)
    return found


def example(name: str) -> Example:
    """Return the example of a name.

    Raises
    ------
    ConfigurationError
        There is none of this name.
    """
    known = examples()
    if name not in known:
        raise ConfigurationError(f"no example {echo(name)}; {suggestion(name, known, 'the examples are')}")
    return known[name]


NO_VISCOSITY = (
    "missing; with scales the fluid has no default viscosity: add 'viscosity: 1 mPa s', which is water, under"
)
#: Words for sides of a body whose axis y points up.
SIDES = {"top": "y+", "bottom": "y-", "base": "y-", "left": "x-", "right": "x+", "front": "z+", "back": "z-"}
#: Names of the surfaces of bodies whose kind alone decides them.
SURFACES = {
    "box": Box.surfaces,
    "cylinder": Cylinder.surfaces,
    "quarter-cylinder": QuarterCylinder.surfaces,
    "wedge": Wedge.surfaces,
    "axisymmetric": Axisymmetric.surfaces,
    "plane-strain": PlaneStrain.surfaces,
}
#: Stand for faulty ones while the rest of a document is looked through.
ANY_SCALES = Scales(modulus=1.0, length=1.0, pore=1.0, viscosity=1.0)
#: Faults that are the same with any scales.
OF_NAMES = ("extra_forbidden", "missing", "union_tag_invalid")


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
    alone = cell_only and not document.data.keys() & {"sampling", "macro"}
    return validated(_with_a_study(document) if alone else document, alone=alone)


def holds_cells_alone(document: YamlDocument) -> bool:
    """Tell whether a file describes cells, but no part of a study of them."""
    keys = document.data.keys()
    if not keys & {"cell", "cells"} or keys & {"sampling", "macro"}:
        return False
    return find_command(lambda offer: bool(keys & {offer.section, *offer.file_keys})) is None


def _with_a_study(document: YamlDocument) -> YamlDocument:
    """Return a document of cells alone with what a study needs besides; no result of a cell depends on it."""
    rest = YamlDocument.read(benchmark_path()).data
    added = {"sampling": rest["sampling"], "macro": rest["macro"]}
    if "closure" not in document.data:
        added["closure"] = "potential"  # for every solid
    scales = document.data.get("scales")
    if isinstance(scales, Mapping) and "modulus" in scales:
        added["scales"] = {"length": 1.0, **scales}
    return replace(document, data={**document.data, **added})


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
        raise refusal(document, faults(document, error.errors(), _OnlyCell)) from None


def validated(document: YamlDocument, *, alone: bool = False) -> RunConfig:
    """Return the configuration that a document holds; see :func:`load_config`.

    Cells that stand ``alone`` need no regions of a body.
    """
    whole = document
    document, sections, faulty = _without_sections(document)
    scales, found = _scales(document)
    if found:
        raise refusal(whole, [*found, *faulty, *_beside_the_scales(document)])
    data, found = resolved(RunConfig, document.data, scales)
    if scales is not None:
        data["scales"].setdefault("pore", scales.pore)
    found += faulty
    unread = bool(found)
    with using_units(_units(data, scales)):
        config = _as_model(document, RunConfig, data, found)
    if config is None:
        found += _surfaces_beside(document, found)
    else:
        config._sections = sections
        for at, value in leaves(config.model_dump() | sections):
            if isinstance(value, float) and not abs(value) <= LARGEST_NUMBER:
                kind = f"a number up to {LARGEST_NUMBER:g}" if math.isfinite(value) else "a finite number"
                found.append((at, unexpected(at, kind, value)))
        found += _unknown_surfaces(
            config.macro.body.surfaces,
            config.macro.boundary,
            {name: patch.of for name, patch in config.macro.surfaces.items()},
        )
        with located(document):
            found += other_lengths(config) if alone else (*cell_faults(config), *law_faults(config))
        if scales is not None:
            cells: dict[Location, Cell] = {("cell",): config.cell}
            cells |= {("cells", name): cell for name, cell in config.cells.items()}
            found += _without_viscosity(cells)
    found += [fault for fault in switched(document, RunConfig) if fault[0] not in dict(found)]
    if found or config is None:
        # A unit that cannot be read is a fault itself.
        notes = [] if unread else list(unit_notes(RunConfig, document.data, scales))
        raise refusal(whole, _with_unit_notes(found, notes))
    config._reading = Reading(tuple(unit_notes(RunConfig, document.data, scales)))
    return config


def _with_unit_notes(
    found: Iterable[tuple[Location, str]], notes: Collection[str]
) -> Iterator[tuple[Location, str]]:
    """Yield faults; those of a section with the first of the notes on numbers in it that may have lost their unit."""
    for at, text in found:
        note = next((note for note in notes if at and note.startswith(f"{dotted(at)}.")), "")
        yield at, f"{text}; {note}" if note else text


def _without_sections(
    document: YamlDocument,
) -> tuple[YamlDocument, dict[str, dict[str, Any]], list[tuple[Location, str]]]:
    """Return a document without the sections of commands, these, and faults of those that are none."""
    found: dict[str, dict[str, Any]] = {}
    faulty: list[tuple[Location, str]] = []
    rest = dict(document.data)
    for key in document.data:
        if key in RunConfig.model_fields or (owner := command_of_section(key)) is None:
            continue
        section = rest.pop(key)
        if isinstance(section, dict):
            paths = owner.offer.paths if isinstance(owner.offer, CommandOffer) else ()
            found[key] = _with_absolute_paths(section, document.folder, paths)
        elif section is not None:
            faulty.append(((key,), unexpected((key,), "a section with keys below it", section)))
    return replace(document, data=rest), found, faulty


def command_of_section(key: str) -> Offered | None:
    """Return the offer of the command to which a section belongs; None without one."""
    return find_command(lambda offer: offer.section == key)


def _with_absolute_paths(section: Any, folder: Path, keys: Collection[str]) -> Any:
    """Return a part of a section in which the values of ``keys`` are absolute paths, if relative from a folder."""
    if isinstance(section, list):
        return [_with_absolute_paths(value, folder, keys) for value in section]
    if not isinstance(section, dict):
        return section
    return {
        key: str((folder / value).absolute())
        if key in keys and isinstance(value, str) and value
        else _with_absolute_paths(value, folder, keys)
        for key, value in section.items()
    }


def command_of_file(document: YamlDocument) -> Offered | None:
    """Return the offer of the command to which a file belongs that is no study; None for a study."""
    keys = document.data.keys()
    if "cell" in keys:
        return None
    return find_command(lambda offer: offer.section not in keys and bool(keys & set(offer.file_keys)))


def section_settings(
    document: YamlDocument, key: str, model: type[Section], scales: Scales | None
) -> Section:
    """Return the section of a command as its model has it, dimensionless by the scales of the study.

    Raises
    ------
    ConfigurationError
        Lists every fault on a line of its own, as :func:`load_config`; or the section is missing and has no defaults.
    """
    root: Any = create_model("Section", __base__=StrictModel, **{key: (model, ...)})  # type: ignore[call-overload]
    section: Section = getattr(
        read_settings(replace(document, data={key: document.data.get(key) or {}}), root, scales), key
    )
    return section


def read_settings(document: YamlDocument, root: type[Section], scales: Scales | None = None) -> Section:
    """Return the data of a document as a model has them.

    Raises
    ------
    ConfigurationError
        Lists every fault on a line of its own, as :func:`load_config`.
    """
    data, found = resolved(root, document.data, scales)
    read = _as_model(document, root, data, found)
    found += [fault for fault in switched(document, root) if fault[0] not in dict(found)]
    if found or read is None:
        raise refusal(document, found)
    return read


def _as_model(
    document: YamlDocument,
    model: type[Section],
    data: Any,
    found: list[tuple[Location, str]],
    of: Callable[[ErrorDetails], bool] = lambda error: True,
    root: type[StrictModel] | None = None,
) -> Section | None:
    """Return data as a model has them; None where it does not take them, with its faults added to ``found``.

    A value that could not be read is a fault already. ``of`` chooses the errors that count, and
    the advice is on the keys of ``root``, by default the model.
    """
    unread = {at for at, _ in found}
    try:
        return model.model_validate(data, context={"folder": document.folder})
    except ValidationError as error:
        complaints = faults(document, filter(of, error.errors()), root or model)
        found += [fault for fault in complaints if fault[0] not in unread]
        return None


def _without_viscosity(cells: Mapping[Location, Cell]) -> Iterator[tuple[Location, str]]:
    """Yield faults of cells whose fluid has no viscosity."""
    for at, cell in cells.items():
        if "viscosity" not in cell.model_fields_set:
            yield (*at, "viscosity"), f"{dotted(at)}.viscosity: {NO_VISCOSITY} '{dotted(at)}:'"


def _scales(document: YamlDocument) -> tuple[Scales | None, list[tuple[Location, str]]]:
    """Return the scales, with which everything else is read, and their faults.

    A cell that has a length of its own needs no ``pore``, and none that differs.
    """
    section = document.data.get("scales")
    if section is None:
        return None, []
    data, found = resolved(_OnlyScales, {"scales": section}, None)
    length, refused = _length(document)
    found += refused
    if isinstance(data["scales"], dict) and (length is not None or refused):
        data["scales"].setdefault("pore", length or 1.0)
    read = _as_model(document, _OnlyScales, data, found, root=RunConfig)
    if read is None:
        return None, [(at, _with_voxel_size(document, at, text)) for at, text in found]
    scales = read.scales
    if not found and length is not None and not math.isclose(scales.pore, length, rel_tol=SAME_LENGTH):
        edges = document.value(("cell", "geometry", "voxel_size"))
        found.append((("scales", "pore"), _other_length(length, section["pore"], edges)))
    return scales, found


def _with_voxel_size(document: YamlDocument, at: Location, text: str) -> str:
    """Return a complaint about scales, for an image without their pore with the key that gives it."""
    geometry = ("cell", "geometry")
    missing = at == ("scales", "pore") and at not in document
    if not missing or (*geometry, "kind") not in document or document.value((*geometry, "kind")) != "voxels":
        return text
    path = document.value((*geometry, "path")) if (*geometry, "path") in document else None
    size = stated_size(document.folder / path) if isinstance(path, str) else ""
    if size:
        return f"{text}, or under 'cell.geometry:' what the image file states, 'voxel_size: {size}'"
    return f"{text}, or 'voxel_size:' under 'cell.geometry:'"


def _beside_the_scales(document: YamlDocument) -> list[tuple[Location, str]]:
    """Return the faults of a document with faulty scales that other scales would not mend.

    With any scales, keys that are unknown or missing, and units of another quantity, are the same. Bounds are not.
    """
    data, found = resolved(RunConfig, document.data, ANY_SCALES)
    found = [fault for fault in found if fault[0][0] != "scales"]
    data = {**data, "scales": ANY_SCALES.model_dump(exclude_none=True)}
    _as_model(document, RunConfig, data, found, lambda error: error["type"] in OF_NAMES)
    return [*found, *_surfaces_beside(document, found)]


def _length(document: YamlDocument) -> tuple[float | None, list[tuple[Location, str]]]:
    """Return the length of the cell in metres where its geometry has it, as an image with ``voxel_size`` does.

    And the faults of such a geometry, with which the length is not known.
    """
    cell = document.data.get("cell")
    geometry = cell.get("geometry") if isinstance(cell, Mapping) else None
    if not isinstance(geometry, Mapping) or geometry.get("voxel_size") is None:
        return None, []
    data, found = resolved(_OnlyCell, {"cell": {"geometry": geometry}}, None)
    read = _as_model(document, _OnlyCell, data, found)
    if read is None:
        return None, found
    with located(document):
        return read.cell.geometry.length, found


def _other_length(length: float, given: Any, edges: Any) -> str:
    bare = [edge for _, edge in leaves(edges) if not isinstance(edge, str)]
    read = f"; voxel_size {echo(bare[0])} has no unit and was read in metres: write the unit" if bare else ""
    return (
        f"scales.pore: expected {length_text(length)}, the length of the cell by cell.geometry.voxel_size (the cube "
        f"root of its volume), got {echo(given)}{read}; leave scales.pore out, or voxel_size"
    )


def _units(data: Any, scales: Scales | None) -> ResultUnits:
    """Return the units of messages about a configuration whose output units may be faulty."""
    try:
        return ResultUnits(scales, OutputUnits.model_validate(data.get("output_units") or {}))
    except ValidationError:
        return ResultUnits(scales)


def _surfaces_beside(
    document: YamlDocument, found: Iterable[tuple[Location, str]]
) -> Iterator[tuple[Location, str]]:
    """Yield faults of surfaces of a macroscale that has other faults, as far as its sections can be read."""
    macro = document.data.get("macro")
    if not isinstance(macro, Mapping):
        return
    body, boundary, patches = (macro.get(key) or {} for key in ("body", "boundary", "surfaces"))
    if not all(isinstance(section, Mapping) for section in (body, boundary, patches)):
        return
    of = {str(name): patch.get("of") for name, patch in patches.items() if isinstance(patch, Mapping)}
    known, own = {at for at, _ in found}, SURFACES.get(str(body.get("kind")), ())
    yield from (fault for fault in _unknown_surfaces(own, map(str, boundary), of) if fault[0] not in known)


def _unknown_surfaces(
    own: tuple[str, ...], boundary: Iterable[str], of: Mapping[str, Any]
) -> Iterator[tuple[Location, str]]:
    """Yield faults of surfaces of a body whose kind names its ``own``; those of a file are known when it is read."""
    known = [*own, *of]
    named: list[tuple[Location, Any]] = [(("macro", "boundary", name), name) for name in boundary]
    named += [(("macro", "surfaces", name, "of"), face) for name, face in of.items()]
    for at, name in named if own else ():
        if isinstance(name, str) and name not in known:
            meant = SIDES.get(name.lower(), "")
            asked = f"did you mean '{meant}'? " if meant in known else ""
            yield at, f"{dotted(at)}: no such surface; {asked}{suggestion(name, known, 'the surfaces are')}"
