"""Record of a study of sub-volumes in a JSON file: what is solved, and what it belongs to."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from porocore.core.echo import reason
from porocore.core.files.plain_data import json_hash, write_json
from porocore.core.files.reading import read_json, set_aside
from porocore.errors import DataError
from porocore.study.config.config import RunConfig
from porocore.verification.representative.scan import Scan
from porocore.verification.representative.subvolume import LOST, Subvolume

FILE = "rev.json"
FORMAT, VERSION = "porocore-representative-volume", 1


def identity_of(config: RunConfig, scan: Scan) -> str:
    """Return the hash of all that the sub-volumes have in common: image, making of cells, elements, backend."""
    cell = {
        **config.cell.specification(),
        "mesh": {**config.cell.mesh.model_dump(), "size": 0, "fluid_size": 0},
    }
    geometry = {**cell["geometry"], "crop": None}
    parts = [{**cell, "geometry": geometry}, scan.elements, config.fem.model_dump()]
    return json_hash(parts, sort_keys=True, default=str)


def holds_results(path: Path) -> bool:
    """Return whether a record is there that must not be replaced: any but one of the porosity alone."""
    if not path.exists():
        return False
    try:
        return bool(read_json(path)["subvolumes"])
    except (OSError, ValueError, KeyError, TypeError):
        return True


def load(path: Path, identity: str) -> dict[str, Subvolume]:
    """Return the sub-volumes of a record by the identities of their cells, but those that were lost.

    Raises
    ------
    DataError
        The file is damaged, or of another image, way to make cells, or backend.
    """
    advice = "choose another --out, or move it elsewhere"
    try:
        document = read_json(path)
        if (document["format"], document["version"]) != (FORMAT, VERSION):
            raise DataError(f"{path}: expected {FORMAT} version {VERSION}; {advice}")
        if document["identity"] != identity:
            raise DataError(
                f"{path}: holds sub-volumes of another image, cell, element size or backend; {advice}"
            )
        known = [Subvolume.from_data(each) for each in document["subvolumes"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(
            f"{path}: not a complete record of sub-volumes ({reason(error)}); {set_aside(path, 'start again')}"
        ) from error
    return {each.cell: each for each in known if each.status != LOST}


def save(path: Path, identity: str, subvolumes: Iterable[Subvolume], **more: Any) -> None:
    """Write the record, dimensionless: permeability in voxels², moduli in E.

    Raises
    ------
    RunFolderError
        The disk is full or read-only.
    """
    document = {"format": FORMAT, "version": VERSION, "identity": identity, **more}
    write_json(path, {**document, "subvolumes": [each.as_data() for each in subvolumes]}, allow_nan=False)
