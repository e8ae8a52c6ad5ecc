"""Plan, solution and HDF5 file of a stability map; its tables states.csv and onsets.csv."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from porocore.cell.stability.line import EVENTS, LineSettings, StabilityLine
from porocore.cell.stability.modes import WAVES
from porocore.core.echo import echo
from porocore.core.field_check import known_statuses
from porocore.core.files.plain_data import write_csv
from porocore.core.hdf5 import Contents, Kind, atomic_hdf5, numbered, opened
from porocore.core.inputs import NAMES, input_meant
from porocore.core.models.bounds import MOST_LINES
from porocore.core.units import spoken
from porocore.errors import ConfigurationError, DataError
from porocore.states import Array, Status

FORMAT, VERSION = "porocore-stability", 1
#: Shapes of the fields of a line in a file.
LINE_SHAPES: dict[str, tuple[int | str, ...]] = {
    "start": (10,),
    "goal": (10,),
    "share": ("n",),
    "status": ("n",),
    "contact_share": ("n",),
    "min_gap": ("n",),
    "stress": ("n", 3, 3),
    "pivots": ("n", len(WAVES)),
    "eigenvalues": ("n", len(WAVES)),
    "acoustic": ("n",),
    "direction": ("n", 3),
    "onsets": (len(EVENTS), 2),
}


@dataclass(frozen=True)
class MapPlan:
    """Lines along some inputs, one for each value of another.

    Attributes
    ----------
    along
        Inputs that run together from zero to these values.
    across
        Input that is constant on each line.
    values
        Its values, one for each line.
    line
        Settings of each line.
    """

    along: Mapping[str, float]
    across: str
    values: tuple[float, ...]
    line: LineSettings = field(default_factory=LineSettings)

    def __post_init__(self) -> None:
        names = ("H11", "H22", "H33", "p")
        for name in (*self.along, self.across):
            if name not in names:
                meant = "" if name in NAMES else input_meant(name)
                raise ConfigurationError(
                    f"unknown input {echo(name)} of a stability map; expected one of {', '.join(names)}: its states "
                    f"keep the mirror planes of the cell{meant and f'; {meant}'}"
                )
        if self.across in self.along:
            raise ConfigurationError(
                f"input '{self.across}' runs both along the lines and across them; choose one"
            )
        if not any(self.along.values()):
            raise ConfigurationError(
                "the lines of a stability map go nowhere; give an input along them, not 0"
            )
        if len(self.values) > MOST_LINES:
            raise ConfigurationError(
                f"{len(self.values)} lines of a stability map; at most {MOST_LINES} are followed"
            )
        if not self.values or len(set(self.values)) < len(self.values):
            raise ConfigurationError(f"expected different values of {self.across}, got {list(self.values)}")

    def ends(self, value: float) -> tuple[Array, Array]:
        """Return start and goal (10,) of the line at one value."""
        start = np.zeros(10)
        start[NAMES.index(self.across)] = value
        goal = start.copy()
        for name, end in self.along.items():
            goal[NAMES.index(name)] = end
        return start, goal

    @property
    def leading(self) -> str:
        """Input along the lines that changes most."""
        return max(self.along, key=lambda name: abs(self.along[name]))

    def describe(self) -> dict[str, Any]:
        """Return the plan as plain data; the lines depend on nothing else."""
        return {
            "along": dict(self.along),
            "across": self.across,
            "values": list(self.values),
            **asdict(self.line),
        }


def save(path: Path, identity: str, lines: Sequence[StabilityLine], provenance: Mapping[str, str]) -> None:
    """Write finished lines to an HDF5 file, atomically."""
    with atomic_hdf5(path) as file:
        file.attrs.update(format=FORMAT, version=VERSION, identity=identity, **provenance)
        file.attrs["waves"], file.attrs["events"] = list(WAVES), list(EVENTS)
        for i, line in enumerate(lines):
            for f in fields(line):
                file[f"lines/{i}/{f.name}"] = getattr(line, f.name)


def load(path: Path, identity: str | None = None) -> list[StabilityLine]:
    """Read what :func:`save` wrote.

    Raises
    ------
    DataError
        The file is damaged, or belongs to another map.
    """
    with opened(path, "stability map", "map again") as file:
        if not file.is_of(FORMAT, VERSION):
            raise DataError(f"{path}: expected a stability map of version {VERSION}; choose another --out")
        found = file.attribute("identity", str)
        lines = [_read_line(file, group) for group in numbered(file, "lines")]
    if identity is not None and found != identity:
        raise DataError(
            f"{path}: holds the map of another cell, backend or plan; choose another --out, or move it elsewhere"
        )
    return lines


def _read_line(file: Contents, group: str) -> StabilityLine:
    arrays = {}
    for name, (length, *shape) in LINE_SHAPES.items():
        symbol = f"{group} {length}" if isinstance(length, str) else length
        kind: Kind = "int" if name in ("status", "pivots") else "float"
        finite = name in ("start", "goal", "share")
        arrays[name] = file.array(f"{group}/{name}", symbol, *shape, kind=kind, finite=finite)
    if not known_statuses(arrays["status"]).all():
        raise ValueError(f"'{group}/status' holds codes that are no status")
    return StabilityLine(**arrays)


def write_tables(folder: Path, plan: MapPlan, lines: Sequence[StabilityLine]) -> tuple[Path, Path]:
    """Write states.csv, a row for each state, and onsets.csv, a row for each line; return their paths.

    Values are in the units of the study, which stand in the names of the columns.
    """
    units = spoken()
    inputs = (*plan.along, plan.across)
    columns = [NAMES.index(name) for name in inputs]
    header = [*(input_titled(name) for name in inputs), "status", "contact_share", "min_gap"]
    header += [units.titled("acoustic", "stress"), *(f"negative_pivots_{wave}" for wave in WAVES)]
    header += [eigenvalue_titled(f"eigenvalue_{wave}") for wave in WAVES]
    factors, stress = np.array([input_factor(name) for name in inputs]), units.factor("stress")
    rows: list[list[Any]] = []
    for line in lines:
        for k, theta in enumerate(line.states()):
            row: list[Any] = [*theta[columns] * factors, Status(int(line.status[k])).name]
            row += [line.contact_share[k], line.min_gap[k], line.acoustic[k] * stress]
            rows.append([*row, *line.pivots[k], *line.eigenvalues[k] * stress])
    states = write_csv(folder / "states.csv", header, rows)
    leading, across = NAMES.index(plan.leading), NAMES.index(plan.across)
    header = [input_titled(plan.across)]
    header += [input_titled(plan.leading, f"_{event}_{side}") for event in EVENTS for side in ("from", "to")]
    of_line, factor = input_factor(plan.across), input_factor(plan.leading)
    rows = []
    for line in lines:
        span = line.goal[leading] - line.start[leading]
        onsets = (line.start[leading] + line.onsets * span) * factor
        rows.append([line.start[across] * of_line, *onsets.ravel()])
    return states, write_csv(folder / "onsets.csv", header, rows)


def input_titled(name: str, ending: str = "") -> str:
    """Return an input as the title of a column, with its unit."""
    return spoken().titled(name + ending, _quantity(name))


def input_factor(name: str) -> float:
    """Return the factor of the values of an input in the units of the study."""
    return spoken().factor(_quantity(name))


def eigenvalue_titled(name: str, edge: str = "d²") -> str:
    """Return an eigenvalue as a title, with scales in stress per squared edge d of the cell."""
    return f"{name} [{spoken().name('stress')}/{edge}]" if spoken().given else name


def _quantity(name: str) -> str:
    return "pressure" if name == "p" else ""
