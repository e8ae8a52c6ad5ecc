"""Columns of a solution against time: history, probes, forces, inflows; their CSV table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

from porocore.core.files.plain_data import write_csv
from porocore.core.units import ResultUnits
from porocore.interfaces.solution import History, MacroSolution
from porocore.states import Array

#: Words for each reason of :class:`~porocore.Doubt`.
DOUBTS = {
    "outside": "beyond the sampled states",
    "error": "estimated error beyond the tolerance",
    "unstable": "unstable cell",
    "closed": "next to states whose pore walls touch",
    "not_sampled": "a component moves that was not sampled",
}
#: Of the fields of a history: the quantity ('' is a plain number), and in words.
HISTORY = {
    "time": ("time", "time"),
    "ramp": ("", "share of the load"),
    "settlement": ("displacement", "largest settlement max(-u_2)"),
    "pressure_max": ("pressure", "largest pore pressure"),
    "drained": ("volume", "drained volume, what has left through the boundary"),
    "drained_paper": ("volume", "the paper's measure of the drained volume"),
    "flagged": ("", "share of the body that is flagged"),
    "stress_spread": ("stress", "largest deviation of P_E,22 from its mean over the body"),
    "iterations": ("", "Newton iterations of the step"),
    "heave": ("displacement", "largest displacement along +y, max(u_2)"),
    "pressure_min": ("pressure", "least pore pressure"),
    "displacement": ("displacement", "largest size of the displacement max|u|"),
    **{f"flagged_{name}": ("", f"share that is flagged: {words}") for name, words in DOUBTS.items()},
}
#: Of the components of a probe.
PROBE = (("u_1", "displacement"), ("u_2", "displacement"), ("u_3", "displacement"), ("p", "pressure"))


@dataclass(frozen=True, eq=False)
class Series:
    """Column of a table against time.

    Attributes
    ----------
    name
        Such as ``settlement``, ``tip: u_2``, ``plate: force 2`` or ``top: inflow``.
    quantity
        Of :data:`porocore.core.units.QUANTITIES`; '' is a plain number.
    long_name
        In words.
    values : (steps,)
        Dimensionless.
    sign
        What a positive value means; empty where that is plain.
    """

    name: str
    quantity: str
    long_name: str
    values: Array
    sign: str = ""

    @property
    def column(self) -> str:
        """Name with its sign convention, such as ``plate: force 2 (+ along y)``."""
        return f"{self.name} ({self.sign})" if self.sign else self.name


def all_series(solution: MacroSolution) -> Iterator[Series]:
    """Yield the history, then probes, forces and inflows; time comes first."""
    for field in fields(History):
        quantity, words = HISTORY[field.name]
        yield Series(field.name, quantity, words, getattr(solution.history, field.name))
    for name, values in solution.probes.items():
        for i, (component, quantity) in enumerate(PROBE):
            yield Series(f"{name}: {component}", quantity, f"{component} at the probe {name}", values[:, i])
    for name, values in solution.compression.items():
        words = f"compressive force on the surface {name}"
        yield Series(f"{name}: compressive force", "force", words, values, "+ in compression")
    for name, values in solution.reactions.items():
        for i, axis in enumerate("xyz"):
            words = f"force on the body at the surface {name}, component {i + 1}"
            yield Series(f"{name}: force {i + 1}", "force", words, values[:, i], f"+ along {axis}")
    for name, values in solution.inflow.items():
        images = " and its images in the whole body" if solution.copies > 1 else ""
        words = f"fluid that enters through the surface {name}{images}"
        yield Series(f"{name}: inflow", "flow", words, values, "+ into the body")


def write_series(path: Path, solution: MacroSolution, units: ResultUnits) -> Path:
    """Write all series as one CSV table, a row for each step; sign convention and unit stand behind each name.

    Raises
    ------
    RunFolderError
        The file cannot be written.
    """
    columns = list(all_series(solution))
    header = [
        f"{c.column} [{units.name(c.quantity) if c.quantity and units.given else '-'}]" for c in columns
    ]
    values = [c.values * units.factor(c.quantity) for c in columns]
    return write_csv(path, header, ([float(x) for x in row] for row in zip(*values, strict=True)))
