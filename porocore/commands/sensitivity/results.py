"""Half lines of a sensitivity study put together by load; their table and HDF5 file.

Layout: attributes ``format``, ``version``, ``identity``, ``plan`` (JSON), ``law`` (of the flux); ``provenance/*``
(texts); ``conductivity`` (3, 3); ``rest/*`` and ``lines/<load><sign>/*`` with ``values``, ``seconds``, ``status`` (n)
and ``response/*`` as in :data:`porocore.states.CELL_FIELDS`.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import h5py
import numpy as np

from porocore.commands.sensitivity.plan import (
    LOADS,
    HalfLine,
    StudyPlan,
    load_quantity,
    quantities,
    quantity_of,
    states_of,
)
from porocore.core.field_check import response_fault
from porocore.core.files.plain_data import write_csv
from porocore.core.hdf5 import Contents, atomic_hdf5, opened
from porocore.core.units import units_now
from porocore.errors import DataError
from porocore.interfaces.records import flatten_response
from porocore.macro.laws.closure import CONDUCTIVITY_LAWS, ConductivityLaw
from porocore.sampling.datasets.dataset import read_response
from porocore.states import Array, CellResponse, IntArray, Status


def line_name(load: str, sign: int) -> str:
    """``shear+`` or ``shear-``."""
    return f"{load}{'+' if sign > 0 else '-'}"


@dataclass(frozen=True, eq=False)
class LoadResponses:
    """Both half lines of one load, n states by ascending value, the undeformed one once.

    Attributes
    ----------
    load
        Its name.
    values : (n,)
        Of the load.
    status : (n,)
        See :class:`~porocore.states.Status`.
    seconds : (n,)
        Wall time of each solve.
    quantities
        Name → (n,), see :func:`porocore.commands.sensitivity.plan.quantities`.
    """

    load: str
    values: Array
    status: IntArray
    seconds: Array
    quantities: dict[str, Array]


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Results of a study, complete or with the finished half lines only.

    Attributes
    ----------
    plan
        What was asked for.
    identity
        Of cell, backend and plan.
    rest
        Response of the undeformed cell, one row with tangent.
    conductivity : (3, 3)
        K of the undeformed cell.
    lines
        By their names, such as ``shear+``.
    provenance
        Texts.
    law
        Law of K_t.
    """

    plan: StudyPlan
    identity: str
    rest: CellResponse
    conductivity: Array
    lines: dict[str, HalfLine]
    provenance: dict[str, str]
    law: ConductivityLaw = "piola-unrotated"

    @property
    def porosity(self) -> float:
        """φ_f of the undeformed cell."""
        assert self.rest.fluid_volume is not None
        return float(self.rest.fluid_volume[0])

    @property
    def complete(self) -> bool:
        """True if every half line of the plan is solved."""
        return all(line_name(name, sign) in self.lines for name, sign, _ in self.plan.half_lines())

    @cached_property
    def loads(self) -> dict[str, LoadResponses]:
        """Every load of the plan with what its half lines hold; ask when the study is complete."""
        return {name: self._along(name) for name in LOADS if name in self.plan.sweeps}

    def _along(self, load: str) -> LoadResponses:
        values, responses, seconds = [np.zeros(1)], [self.rest], [np.zeros(1)]
        for sign in (1, -1):
            line = self.lines.get(line_name(load, sign))
            if line is not None:
                values.append(line.values[1:])
                responses.append(line.response[1:])
                seconds.append(line.seconds[1:])
        at = np.concatenate(values)
        order = np.argsort(at)
        response = CellResponse.concatenate(responses)[order]
        found = quantities(states_of(load, at[order]), response, self.porosity, self.conductivity, self.law)
        return LoadResponses(load, at[order], response.status, np.concatenate(seconds)[order], found)


def write_table(folder: Path, study: Sensitivity) -> Path:
    """Write ``sensitivity.csv``, a row for each state, load by load, in the units of the study; returns its path.

    With scales the unit of a load stands beside its value, those of the quantities in their names.

    Raises
    ------
    RunFolderError
        The file cannot be written.
    """
    names = list(next(iter(study.loads.values())).quantities)
    units, kinds = units_now(), [quantity_of(name) for name in names]
    rows = []
    for name, along in study.loads.items():
        of_load = load_quantity(name)
        unit = [units.name(of_load) if of_load else "-"] if units.given else []
        for k, value in enumerate(along.values):
            given = [name, float(value * units.factor(of_load)), *unit]
            given += [Status(int(along.status[k])).name, float(along.seconds[k])]
            found = (
                along.quantities[each][k] * units.factor(kind)
                for each, kind in zip(names, kinds, strict=True)
            )
            rows.append([*given, *map(float, found)])
    head = ["load", "value", *(["unit"] if units.given else []), "status", "seconds"]
    head += [units.titled(each, kind) for each, kind in zip(names, kinds, strict=True)]
    return write_csv(folder / "sensitivity.csv", head, rows)


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
        # A file that names no law was written when there was only the paper's.
        law = file.attribute("law", str) if "law" in file.attributes else "piola-unrotated"
        if law not in CONDUCTIVITY_LAWS:
            raise ValueError(f"law '{law[:40]}'")
        return Sensitivity(
            plan=StudyPlan.from_description(json.loads(file.attribute("plan", str))),
            identity=file.attribute("identity", str),
            rest=_sound_response(file, "rest"),
            conductivity=file.array("conductivity", 3, 3),
            lines={name: _read_line(file, name) for name in file.members("lines")},
            law=cast(ConductivityLaw, law),
            provenance={name: file.text(f"provenance/{name}") for name in file.members("provenance")},
        )


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
