"""Law of a solid that relaxes against the cell with the history of its points, along paths (CellPath)."""

from __future__ import annotations

import csv
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.equilibrium.relaxation import require_path
from porocore.cell.materials.prony import Relaxation
from porocore.commands.backends import attempt, find_backends
from porocore.commands.crosscheck.comparison import Comparison
from porocore.core.console import Console
from porocore.core.echo import echo, reason, suggestion
from porocore.core.fields import provided
from porocore.core.files.reading import read_text
from porocore.core.inputs import NAMES
from porocore.errors import ConfigurationError, DataError
from porocore.interfaces.cell import CellField, CellSolver
from porocore.interfaces.law import CellLaw, Interval
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.laws.relaxation import RelaxingLaw
from porocore.plugins.border import relaxed_solution_of, solution_of
from porocore.plugins.registry import registry
from porocore.states import Array, CellResponse, MacroState, Status
from porocore.study.config.config import RunConfig

#: A path along which the law is farther from the cell than this is flagged.
FLAGGED = 1e-2
#: Change of φ by a load of 1, in which errors of φ are measured where it changes less, as under shear.
ORDINARY = 0.1
#: Steps of a ramp and of a hold of the packaged paths.
RAMP, HOLD = 6, 5
#: Name of the law in the lines.
LAW = "law"


@dataclass(frozen=True, eq=False)
class CellPath:
    """Path of a cell.

    Attributes
    ----------
    name
        In words.
    states
        n states.
    times : (n,)
        Their times, in the unit of the times of the relaxation.
    """

    name: str
    states: MacroState
    times: Array


def load_and_reload(name: str, H: Array, p: float, relaxation: Relaxation) -> CellPath:
    """Return a ramp to half of (H, p), a hold, a ramp to all of it, and a hold.

    A ramp takes a tenth of the shortest time of the relaxation, a hold four times the longest one.
    """
    taus = [branch.time for branch in relaxation.branches]
    short, long = 0.1 * min(taus), 4 * max(taus)
    ramp, hold = short * np.linspace(0, 1, RAMP + 1)[1:], long * np.linspace(0, 1, HOLD + 1)[1:] ** 2
    times = [np.zeros(1)]
    for part in (ramp, hold, ramp, hold):
        times.append(times[-1][-1] + part)
    at = np.concatenate(times)
    share = np.interp(at, [0, short, short + long, 2 * short + long], [0, 0.5, 0.5, 1])
    return CellPath(name, MacroState(share[:, None, None] * H, share * p), at)


def ramp_and_hold(name: str, H: Array, p: float, relaxation: Relaxation) -> CellPath:
    """Return the first half of :func:`load_and_reload`, to all of (H, p)."""
    whole = load_and_reload(name, 2 * H, 2 * p, relaxation)
    half = slice(0, 1 + RAMP + HOLD)
    return CellPath(name, whole.states[half], whole.times[half])


def packaged_paths(relaxation: Relaxation) -> list[CellPath]:
    """Return the paths that are followed where the user gives none."""
    pressed: Array = np.diag([0.0, -0.1, 0.0])
    shear: Array = np.zeros((3, 3))
    shear[0, 1], shear[1, 1] = 0.1, -0.05
    return [
        ramp_and_hold("H₂₂ = −0.1, held", pressed, 0.0, relaxation),
        ramp_and_hold("H₂₂ = −0.1, p = 0.1, held", pressed, 0.1, relaxation),
        load_and_reload("H₂₂ = −0.1, in two ramps", pressed, 0.0, relaxation),
        load_and_reload("H₂₂ = −0.1, p = 0.1, in two ramps", pressed, 0.1, relaxation),
        ramp_and_hold("H₂₂ = −0.2, held", np.diag([0.0, -0.2, 0.0]), 0.0, relaxation),
        ramp_and_hold("H₁₂ = 0.1, H₂₂ = −0.05, p = 0.05, held", shear, 0.05, relaxation),
    ]


def read_path(file: Path) -> CellPath:
    """Read a path from a table with the columns ``time`` and any of H11 … H33 and p; the others are 0.

    Raises
    ------
    DataError
        The file cannot be read, a column is unknown or missing, an entry is no number, or no cell can follow the path.
    """
    try:
        text = read_text(file)
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{file}: {reason(error)}") from None
    rows = list(csv.reader(text.splitlines()))
    columns = [name.strip() for name in rows[0]] if rows else []
    allowed = ("time", *NAMES)
    if "time" not in columns or len(columns) < 2 or len(set(columns)) < len(columns):
        raise DataError(
            f"{file}: expected the columns time and some of {', '.join(NAMES)}, got {echo(columns)}"
        )
    for name in columns:
        if name not in allowed:
            raise DataError(
                f"{file}: unknown column {echo(name)}; {suggestion(name, allowed, 'the columns are')}"
            )
    values = {name: np.zeros(len(rows) - 1) for name in allowed}
    for k, row in enumerate(rows[1:]):
        if len(row) != len(columns):
            raise DataError(f"{file}, line {k + 2}: expected {len(columns)} entries, got {len(row)}")
        for name, text in zip(columns, row, strict=True):
            try:
                values[name][k] = float(text)
            except ValueError:
                raise DataError(
                    f"{file}, line {k + 2}, {name}: expected a number, got {echo(text)}"
                ) from None
    H = np.stack([values[name] for name in NAMES if name != "p"], axis=1).reshape(-1, 3, 3)
    path = CellPath(file.name, MacroState(H, values["p"]), values["time"])
    try:
        require_path(path.states, path.times)
    except ConfigurationError as error:
        raise DataError(f"{file}: {error}") from None
    return path


class _SolvedCells(CellLaw):
    """Cell law that solves each state from the equilibrium before, and keeps the statuses."""

    def __init__(self, solver: CellSolver, prepared: Any, identity: str) -> None:
        self.identity, self._solver, self._prepared = identity, solver, prepared
        self._start: CellField | None = None
        self.statuses: list[Status] = []

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return the responses of n states, one after the other."""
        rows = []
        for k in range(len(states)):
            state = replace(states[k : k + 1], parameters=None)
            how = {"start": [self._start], "tangent": tangent, "fields": True}
            found = solution_of(self._solver, self._prepared, state, **how)
            self._start = (found.fields or [None])[0] or self._start
            self.statuses.append(Status(int(found.response.status[0])))
            rows.append(replace(found.response, extrema=None, slopes=None))
        return CellResponse.concatenate(rows)


@dataclass(frozen=True, eq=False)
class PathRun:
    """Responses of the relaxing cell and of the law along one path.

    Attributes
    ----------
    backend
        Name of the cell solver.
    path
        States and times.
    cell
        Responses of the cell, with the history of each of its points.
    stress, fluid_volume : (n, 3, 3), (n,)
        Those of the law, which asks the same cell in equilibrium.
    statuses
        How the solutions of the law's cells ended.
    seconds
        By what was solved.
    """

    backend: str
    path: CellPath
    cell: CellResponse
    stress: Array
    fluid_volume: Array
    statuses: tuple[Status, ...]
    seconds: dict[str, float]

    @property
    def stress_error(self) -> float:
        """Largest difference of a component of P_E, of the largest along the path; NaN where a state has no values."""
        P = provided(self.cell.stress)
        return float(np.abs(self.stress - P).max() / max(np.abs(P).max(), 1e-300))

    @property
    def fluid_error(self) -> float:
        """Largest difference of φ, of its change or of :data:`ORDINARY` times the largest component of H or p."""
        phi, states = provided(self.cell.fluid_volume), self.path.states
        load = max(float(np.abs(states.grad_u).max()), float(np.abs(states.p).max()))
        return float(np.abs(self.fluid_volume - phi).max() / max(np.ptp(phi), ORDINARY * load, 1e-300))

    def has(self, status: Status) -> bool:
        """Return whether any state has a status, in the cell or in the law."""
        return status in self.statuses or int(status) in self.cell.status

    def comparisons(self) -> list[Comparison]:
        """Return the lines of stress and fluid volume; what is unstable is not compared."""
        case = f"{self.path.name}, walls in contact" if self.has(Status.contact) else self.path.name
        for who, statuses in ((self.backend, self.cell.status), (LAW, self.statuses)):
            lost = [Status(int(one)) for one in statuses if not Status(int(one)).has_values]
            if lost:
                why = f"a state of the path has no values ({lost[0].name})"
                return [Comparison.failure("relaxation", case, "P_E", who, why)]
        if self.has(Status.unstable):
            why = "the cell is in an unstable equilibrium, of which there are others"
            return [Comparison.left_out("relaxation", case, "P_E", self.backend, why, other=LAW)]
        errors = {"P_E": self.stress_error, "φ": self.fluid_error}
        return [
            Comparison("relaxation", case, quantity, self.backend, LAW, error, FLAGGED)
            for quantity, error in errors.items()
        ]


def follow_law(law: RelaxingLaw, path: CellPath, relaxation: Relaxation) -> tuple[Array, Array]:
    """Return stress (n, 3, 3) and fluid volume (n,) of a law along a path, whose first state has stood for long."""
    numbers = np.array(
        [[value for branch in relaxation.branches for value in (branch.strength, branch.time)]]
    )
    states = path.states.with_parameters(np.repeat(numbers, len(path.states), axis=0))
    memory, still = law.initial_at(states[:1]), np.zeros((1, 3))
    stress, fluid = [], []
    for k in range(len(states)):
        step = Interval(float(path.times[k - 1]), float(path.times[k])) if k else None
        response = law.respond(states[k : k + 1], still, memory, step=step, tangent=False)
        memory = response.memory
        stress.append(response.stress[0])
        fluid.append(memory.fluid_volume[0])
    return np.array(stress), np.array(fluid)


def run_path(
    solver: CellSolver, prepared: Any, cell: Cell, path: CellPath, relaxation: Relaxation, backend: str
) -> PathRun:
    """Follow a path of the cell and of the law over the same cell in equilibrium.

    Raises
    ------
    ConfigurationError
        The path cannot be followed.
    """
    began = time.perf_counter()
    found = relaxed_solution_of(solver, prepared, path.states, path.times, relaxation).response
    followed = time.perf_counter()
    cells = _SolvedCells(solver, prepared, cell.identity)
    at_rest = solution_of(solver, prepared, MacroState.zeros(1), tangent=False).response
    # No flux is compared, so the conductivity does not matter.
    solid_fraction = 1 - float(provided(at_rest.fluid_volume)[0])
    closure = make_closure("potential", solid_fraction, cell.solid, np.zeros((3, 3)))
    law = RelaxingLaw(ClosedLaw(cells, closure), len(relaxation.branches))
    stress, fluid = follow_law(law, path, relaxation)
    seconds = {"with its history": followed - began, "in equilibrium": time.perf_counter() - followed}
    return PathRun(backend, path, found, stress, fluid, tuple(cells.statuses), seconds)


def select_cell_solvers(config: RunConfig, named: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the named cell solvers, or the configured one.

    Raises
    ------
    PluginError
        A name is unknown or cannot be used.
    """
    return find_backends({("cell solver",): named or (config.fem.backend,)}).names["cell solver"]


def check_relaxation(
    config: RunConfig, names: Sequence[str], paths: Sequence[CellPath], console: Console
) -> tuple[list[PathRun], list[Comparison]]:
    """Return the runs of each cell solver along each path, and the lines.

    A backend that fails is a line.

    Raises
    ------
    ConfigurationError
        The solid of the cell does not relax, or a parameter of the cell has no value.
    """
    relaxation = config.cell.relaxation
    if relaxation is None:
        raise ConfigurationError(
            "cell.material.relaxation: expected the branches of a solid that relaxes, got none; give "
            "'relaxation: {branches: [{strength: 1, time: 10}]}' or leave out '--what relaxation'"
        )
    config.cell.require_member()
    cell = config.cell.in_equilibrium
    chosen = paths or packaged_paths(relaxation)
    runs: list[PathRun] = []
    lines: list[Comparison] = []
    for name in names:
        solver = registry().get("cell solver", name)(**config.with_backends(fem=name).fem.options)
        if not solver.relaxes:
            why = f"{name} follows no cell whose solid relaxes"
            lines.append(Comparison.left_out("relaxation", "", "P_E", name, why, other=LAW))
            continue
        prepared = solver.prepare(cell)
        with console.task(f"relaxing cell, {name}", "paths") as task:
            for done, path in enumerate(chosen):
                task.update(done, len(chosen), detail=path.name)
                outcome = attempt(run_path, solver, prepared, cell, path, relaxation, name)
                if outcome.value is None:
                    lines.append(Comparison.failure("relaxation", path.name, "P_E", name, outcome.reason))
                    continue
                runs.append(outcome.value)
                lines += outcome.value.comparisons()
            task.update(len(chosen), len(chosen))
    return runs, lines
