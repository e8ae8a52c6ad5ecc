"""The HDF5 file of a sensitivity study.

Layout: attributes ``format``, ``version``, ``identity``, ``plan`` (JSON), ``law`` (of the flux); ``provenance/*``
(texts); ``conductivity`` (3, 3); ``rest/*`` and ``lines/<load><sign>/*`` with ``values``, ``seconds``, ``status`` (n)
and ``response/*`` as in :data:`porocore.states.CELL_FIELDS`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, cast

import h5py
import numpy as np

from porocore.closures.pull_back import CONDUCTIVITY_LAWS, ConductivityLaw
from porocore.errors import ConfigurationError, DataError
from porocore.hdf5 import atomic_hdf5
from porocore.records import build_response, flatten_response
from porocore.sensitivity.line import HalfLine
from porocore.sensitivity.plan import StudyPlan
from porocore.sensitivity.results import Sensitivity
from porocore.states import CellResponse

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
    try:
        with h5py.File(path) as file:
            if file.attrs.get("format") != FORMAT or file.attrs.get("version") != VERSION:
                raise DataError(
                    f"{path}: expected a sensitivity study of version {VERSION}; choose another --out"
                )
            plan = StudyPlan.of_description(json.loads(file.attrs["plan"]))
            return Sensitivity(
                plan=plan,
                identity=str(file.attrs["identity"]),
                rest=_read_response(file["rest"]),
                conductivity=np.asarray(file["conductivity"]),
                lines={name: _read_line(name, group) for name, group in file.get("lines", {}).items()},
                law=_read_law(file),
                provenance={name: text.asstr()[()] for name, text in file.get("provenance", {}).items()},
            )
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, ConfigurationError) as error:
        raise DataError(
            f"{path}: not a complete sensitivity study ({error}); delete it and study again"
        ) from error


def _read_law(file: Any) -> ConductivityLaw:
    """Return the law of the flux; a file that names none was written when there was only the paper's."""
    law = str(file.attrs.get("law", "piola-unrotated"))
    if law not in CONDUCTIVITY_LAWS:
        raise ValueError(f"law '{law}'")
    return cast(ConductivityLaw, law)


def _write_response(group: Any, response: CellResponse) -> None:
    arrays: dict[str, Any] = {"status": response.status}
    arrays |= {f"response/{name}": array for name, array in flatten_response(response).items()}
    for name, array in arrays.items():
        group.create_dataset(name, data=array, fletcher32=True)


def _read_response(group: Any) -> CellResponse:
    arrays: dict[str, Any] = {}
    group["response"].visititems(
        lambda name, node: arrays.update({name: node[()]}) if isinstance(node, h5py.Dataset) else None
    )
    return build_response(group["status"][()], arrays)


def _read_line(name: str, group: Any) -> HalfLine:
    values, response = np.asarray(group["values"]), _read_response(group)
    if len(values) != len(response):
        raise ValueError(f"{name}: {len(values)} values but {len(response)} responses")
    return HalfLine(
        name[:-1], 1 if name.endswith("+") else -1, values, response, np.asarray(group["seconds"])
    )
