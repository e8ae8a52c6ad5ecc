"""Half lines of a sensitivity study put together by load, and the table sensitivity.csv."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from porocore.core.files.plain_data import write_csv
from porocore.core.units.results import spoken
from porocore.macro.laws.pull_back import ConductivityLaw
from porocore.states import Array, CellResponse, IntArray, Status
from porocore.verification.sensitivity.line import HalfLine
from porocore.verification.sensitivity.plan import LOADS, StudyPlan, load_quantity, states_of
from porocore.verification.sensitivity.quantities import quantities, quantity_of


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
        Name → (n,), see :func:`porocore.verification.sensitivity.quantities.quantities`.
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
    units, kinds = spoken(), [quantity_of(name) for name in names]
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
