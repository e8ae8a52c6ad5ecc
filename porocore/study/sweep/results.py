"""Results of a sweep (ParameterSweep): figures of each value, paths of table and picture, solutions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from porocore.cell.family.family import number, require_known
from porocore.core.echo import joined
from porocore.core.files.atomic import file_stem
from porocore.core.units import ResultUnits
from porocore.errors import ConfigurationError
from porocore.interfaces.solution import MacroSolution
from porocore.interfaces.surrogate import Surrogate
from porocore.report.context import LoadingMode, contacts, reactions
from porocore.report.dimensional import FIGURES
from porocore.report.metrics import solution_metrics, time_within
from porocore.report.words.results import ROUND_OFF
from porocore.states import Array
from porocore.study.api.solved import LawsSolved, Solutions, Solved
from porocore.study.run.folder import RunFolder
from porocore.study.run.results import load_solution, load_surrogate
from porocore.study.sweep.plan import FOLDER, SweepPlan, SweepPoint

TABLE, PICTURES = "sweep.csv", ("sweep.png", "sweep.svg")
#: Figures of a settlement that is a result, of every solution, and of the force on a surface that is moved.
OF_SETTLEMENT = ("final_settlement", "time_to_50_percent", "time_to_95_percent", "largest_heave")
#: Figure of every displacement that is a result, whatever its direction.
OF_DISPLACEMENT = "largest_displacement"
OF_ALL = ("max_pressure", "time_of_max_pressure", "drained", "flagged_largest")
OF_FORCES = ("peak", "final", "relaxed_50_percent", "relaxed_95_percent")
#: Further ones of an indenter.
OF_INDENTERS = ("largest_displacement", "largest_radius")
#: Quantities of the results of the cell.
OF_CELL = {"porosity": "", **dict.fromkeys(("K_11", "K_22", "K_33"), "conductivity")}


@dataclass(frozen=True, eq=False)
class ParameterSweep:
    """Results of a body for each value of one or two parameters of its cell.

    Attributes
    ----------
    plan
        Parameters, values and the study of the family.
    folder
        Run folder of the family.
    laws
        Names of the laws, the surrogate's first.
    failed
        Names of the points without solution.
    """

    plan: SweepPlan
    folder: RunFolder
    laws: tuple[str, ...]
    failed: frozenset[str] = frozenset()

    def __repr__(self) -> str:
        counts = " × ".join(str(len(each.values)) for each in self.plan.swept)
        return f"<sweep over {' and '.join(self.names)}: {counts} values in {self.folder.path}>"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(each.name for each in self.plan.swept)

    @cached_property
    def values(self) -> Array:
        """Dimensionless values (n, k) of the k parameters at the n points, in the order of the table."""
        return np.array([[point.values[name] for name in self.names] for point in self.plan.points])

    @property
    def units(self) -> ResultUnits:
        """Units of the study."""
        return self.plan.family.result_units

    @cached_property
    def figures(self) -> dict[str, Array]:
        """Results (n,) at the points by their names in the table, in its units; NaN where there is none."""
        return {
            name: np.array([self.units.value(x, self.quantity(name)) for x in column])
            for name, column in self._columns.items()
        }

    @staticmethod
    def quantity(name: str) -> str:
        """Return the quantity of a result by its name, '' for a plain number."""
        last = name.rpartition(": ")[2]
        return OF_CELL.get(last, "") or FIGURES.get(last, "")

    def named(self, figure: str, law: str = "", load: float | None = None) -> str:
        """Return the name in the table of a result under a load, by default the largest, with a law."""
        loads, law = self.plan.family.macro.loads, law or self.laws[0]
        parts = [f"load {self.largest_load if load is None else load:g}"] if len(loads) > 1 else []
        return ": ".join([*parts, *([] if law == self.laws[0] else [law]), figure])

    @property
    def largest_load(self) -> float:
        """Load that is largest in size."""
        return max(self.plan.family.macro.loads, key=abs)

    @property
    def flagged(self) -> Array:
        """True (n,) for points at which the surrogate's body is flagged somewhere at some time, under any load."""
        found = [
            self.figures[self.named("flagged_largest", load=load)] for load in self.plan.family.macro.loads
        ]
        return np.asarray(np.max(found, axis=0) > 0)

    @property
    def loading_mode(self) -> LoadingMode:
        """Loading by stresses or displacements."""
        return LoadingMode.from_setup(self.plan.family.macro)

    @property
    def moves_along_y(self) -> bool:
        """True if some body has a settlement or a heave under the largest load."""
        return self.named("final_settlement") in self.figures

    @property
    def heaves_alone(self) -> bool:
        """True if no body settles and some rise, as solids do that swell."""
        if not self.loading_mode.settles:
            return False
        if not self.moves_along_y:
            return False
        settled, risen = (
            np.abs(
                self.figures[self.named(name)][[point.name not in self.failed for point in self.plan.points]]
            )
            for name in ("final_settlement", "largest_heave")
        )
        return bool(risen.max(initial=0.0) > 0 and settled.max(initial=0.0) <= ROUND_OFF * risen.max())

    def solutions(self, values: Mapping[str, float] | None = None, /, **named: float) -> Solutions:
        """Return the solutions at one point by load, then by law.

        Parameters
        ----------
        values, **named
            Value of each parameter of the sweep, such as ``radius=0.22``.

        Raises
        ------
        ConfigurationError
            It is no point of the sweep, or has no solution.
        """
        given = {**(values or {}), **named}
        require_known(given, self.names)
        if lacking := [name for name in self.names if name not in given]:
            raise ConfigurationError(
                f"{lacking[0]}: no value is given; the sweep is over {joined(self.names)}"
            )
        row = np.array([number(name, given[name]) for name in self.names])
        near = np.isclose(self.values, row, rtol=1e-9, atol=0).all(axis=1)
        if not near.any():
            there = "; ".join(
                f"{each.name} {', '.join(f'{x:g}' for x in each.values)}" for each in self.plan.swept
            )
            raise ConfigurationError(
                f"the sweep has no point at {', '.join(f'{x:g}' for x in row)}; it has {there}"
            )
        point = self.plan.points[int(near.argmax())]
        if point.name in self.failed:
            raise ConfigurationError(f"{point.name}: the body could not be solved")
        return Solutions(
            {
                load: LawsSolved(
                    {law: Solved(self.solution(point, law, load), self.units) for law in self.laws}
                )
                for load in self.plan.family.macro.loads
            }
        )

    def solution(self, point: SweepPoint, law: str, load: float) -> MacroSolution:
        """Return the solution at a point."""
        return load_solution(point_files(self.folder, self.plan, point), law, load)

    @property
    def solved(self) -> list[SweepPoint]:
        """Points with a solution."""
        return [point for point in self.plan.points if point.name not in self.failed]

    @property
    def table(self) -> Path:
        """The table, ``sweep.csv``."""
        return self.folder.path / TABLE

    @property
    def pictures(self) -> tuple[Path, ...]:
        """The picture, ``sweep.png`` and ``sweep.svg``."""
        return tuple(self.folder.path / name for name in PICTURES)

    @cached_property
    def _columns(self) -> dict[str, list[float]]:
        """Dimensionless results by name."""
        surrogate = load_surrogate(self.folder)
        rows = [dict(self._results(point, surrogate)) for point in self.plan.points]
        names = dict.fromkeys(name for row in rows for name in row)
        return {name: [row.get(name, np.nan) for row in rows] for name in names}

    def _results(self, point: SweepPoint, surrogate: Surrogate) -> Iterator[tuple[str, float]]:
        """Yield the results at a point that are defined."""
        yield from _of_the_cell(self.plan.member(point), surrogate)
        if point.name in self.failed:
            return
        for load in self.plan.family.macro.loads:
            for law in self.laws:
                solution = self.solution(point, law, load)
                figures = _of_the_body(solution, self.loading_mode) | _of_indenters(solution)
                for name, value in figures.items():
                    if name == "flagged_largest" and law != self.laws[0]:
                        continue
                    yield self.named(name, law, load), np.nan if value is None else value


def point_files(folder: RunFolder, plan: SweepPlan, point: SweepPoint) -> RunFolder:
    """Return the files of the run with the solutions of one point."""
    return folder.with_config(plan.at(point), f"{FOLDER}/{file_stem(point.name)}")


def _of_the_cell(member: Array | None, surrogate: Surrogate) -> Iterator[tuple[str, float]]:
    """Yield porosity and conductivity of the undeformed member; nothing where the body has several."""
    cells = None if member is None else surrogate.undeformed(member)
    if cells is not None:
        yield "porosity", float(cells.porosity[0])
        for i in range(3):
            yield f"K_{i + 1}{i + 1}", float(cells.conductivity[0, i, i])


def _of_the_body(solution: MacroSolution, mode: LoadingMode) -> dict[str, float | None]:
    """Return the figures of one solution."""
    history = solution.history
    found = solution_metrics(solution)
    found["time_to_50_percent"] = time_within(history.time, history.settlement, 0.5)
    names = [*([OF_DISPLACEMENT] if mode.settles else ()), *OF_ALL]
    if mode.settles and found["moves_along_y"]:
        names = [*OF_SETTLEMENT, *names]
    figures: dict[str, float | None] = {name: found[name] for name in names}
    forces = reactions(solution)
    for surface in mode.displaced:
        figures |= {f"{surface}: {name}": forces[surface][name] for name in OF_FORCES if surface in forces}
    return figures


def _of_indenters(solution: MacroSolution) -> dict[str, float | None]:
    """Return the figures of the indenters of one solution."""
    return {
        f"{name}: {figure}": found[figure]
        for name, found in contacts(solution).items()
        for figure in (*OF_FORCES, *OF_INDENTERS)
        if figure in found
    }
