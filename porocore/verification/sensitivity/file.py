"""HDF5 file of a sensitivity study: save and load.

Layout: attributes ``format``, ``version``, ``identity``, ``plan`` (JSON), ``law`` (of the flux); ``provenance/*``
(texts); ``conductivity`` (3, 3); ``rest/*`` and ``lines/<load><sign>/*`` with ``values``, ``seconds``, ``status`` (n)
and ``response/*`` as in :data:`porocore.states.CELL_FIELDS`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, cast

import h5py

from porocore.core.fields.check import response_fault
from porocore.core.hdf5 import Contents, atomic_hdf5, opened
from porocore.errors import DataError
from porocore.interfaces.records import flatten_response
from porocore.macro.laws.pull_back import CONDUCTIVITY_LAWS, ConductivityLaw
from porocore.sampling.datasets.layout import read_response
from porocore.states import CellResponse
from porocore.verification.sensitivity.line import HalfLine
from porocore.verification.sensitivity.plan import LOADS, StudyPlan
from porocore.verification.sensitivity.results import Sensitivity

FORMAT, VERSION = "porocore-sensitivity", 1
TEXT = h5py.string_dtype()


def save(path: Path, study: Sensitivity) -> None:
    """Write what is known, atomically.

    Raises
    ------
    RunFolderError
        The disk is full or read-only.
    """
    with atomic_hdf5(path) as file:
        file.attrs.update(format=FORMAT, version=VERSION, identity=study.identity, law=study.law)
        file.attrs["plan"] = json.dumps(study.plan.describe())
        for name, text in study.provenance.items():
            file.create_dataset(f"provenance/{name}", data=text, dtype=TEXT)
        file["conductivity"] = study.conductivity
        _write_response(file.create_group("rest"), study.rest)
        for name, line in study.lines.items():
            group = file.create_group(f"lines/{name}")
            group["values"], group["seconds"] = line.values, line.seconds
            _write_response(group, line.response)


def load(path: Path) -> Sensitivity:
    """Read what :func:`save` wrote.

    Raises
    ------
    DataError
        The file is missing, damaged or something else.
    """
    with opened(path, "sensitivity study", "study again") as file:
        if not file.is_of(FORMAT, VERSION):
            raise DataError(
                f"{path}: expected a sensitivity study of version {VERSION}; choose another --out"
            )
        return Sensitivity(
            plan=StudyPlan.from_description(json.loads(file.attribute("plan", str))),
            identity=file.attribute("identity", str),
            rest=_sound_response(file, "rest"),
            conductivity=file.array("conductivity", 3, 3),
            lines={name: _read_line(file, name) for name in file.members("lines")},
            law=_read_law(file),
            provenance={name: file.text(f"provenance/{name}") for name in file.members("provenance")},
        )


def _read_law(file: Contents) -> ConductivityLaw:
    """Return the law of the flux; a file that names none was written when there was only the paper's."""
    law = file.attribute("law", str) if "law" in file.attributes else "piola-unrotated"
    if law not in CONDUCTIVITY_LAWS:
        raise ValueError(f"law '{law[:40]}'")
    return cast(ConductivityLaw, law)


def _write_response(group: Any, response: CellResponse) -> None:
    arrays: dict[str, Any] = {"status": response.status}
    arrays |= {f"response/{name}": array for name, array in flatten_response(response).items()}
    for name, array in arrays.items():
        group.create_dataset(name, data=array, fletcher32=True)


def _sound_response(file: Contents, group: str) -> CellResponse:
    response = read_response(file, group)
    if fault := response_fault(response, len(response)):
        raise ValueError(f"{group}: {fault}")
    return response


def _read_line(file: Contents, name: str) -> HalfLine:
    group, sign = f"lines/{name}", {"+": 1, "-": -1}.get(name[-1:])
    if sign is None or name[:-1] not in LOADS:
        raise ValueError(f"'{group}' is no line of a load")
    response, count = _sound_response(file, group), f"{group}/n"
    values, seconds = file.array(f"{group}/values", count), file.array(f"{group}/seconds", count)
    return HalfLine(name[:-1], sign, values, response, seconds)
