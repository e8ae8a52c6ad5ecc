"""Stability map of a configured cell as a study (map_stability), with its tables and figure."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from porocore.cell.cell import Cell
from porocore.cell.equilibrium.solver import PreparedCell
from porocore.cell.stability.map import (
    LineSettings,
    MapPlan,
    StabilityLine,
    follow_line,
    load,
    save,
    write_tables,
)
from porocore.core.console import Console
from porocore.core.files.plain_data import json_hash
from porocore.core.files.store import ResultStore
from porocore.core.inputs import NAMES, require_possible, value_text
from porocore.core.parallel.calls import Tell
from porocore.core.units import using_units
from porocore.errors import ConfigurationError
from porocore.interfaces.cell import CellSolver
from porocore.sampling.execution.solved_store import SolvedStore
from porocore.states import Array
from porocore.study.config.config import FemSettings, RunConfig
from porocore.study.notes.checks import find_backends
from porocore.study.run.composition import prepare_stored
from porocore.study.series import Case, CaseProgress, FromStore, RunSeries, claim_record
from porocore.study.store import chosen_store, taken

FILE, PICTURE = "stability.h5", "stability.png"


@dataclass(frozen=True, eq=False)
class StabilityMap:
    """Lines of a map and the files that show them.

    Attributes
    ----------
    plan
        The map that was asked for.
    lines
        One for each value of the plan.
    tables
        ``states.csv`` and ``onsets.csv``.
    picture
        ``stability.png``.
    """

    plan: MapPlan
    lines: list[StabilityLine]
    tables: tuple[Path, Path]
    picture: Path


def map_stability(
    config: RunConfig,
    folder: Path | str,
    plan: MapPlan,
    *,
    workers: int | None = None,
    resume: bool = False,
    store: ResultStore | str | Path | bool = True,
    progress: bool = False,
) -> StabilityMap:
    """Map where the cell of a configuration creases, touches itself and becomes unstable.

    Parameters
    ----------
    config
        The study; only its cell and finite elements count.
    folder
        Place of ``stability.h5``, ``states.csv``, ``onsets.csv`` and ``stability.png``.
    plan
        Lines of states.
    workers
        Processes; by default as configured for sampling.
    resume
        Continue the map that the folder holds; finished lines are not solved again.
    store
        Folder of results that studies share; True: that of the user, False: none.
    progress
        Show the progress on standard error.

    Raises
    ------
    ConfigurationError
        No cell can be in a state of the plan, or the backend gives no access to its tangent.
    RunFolderError
        The folder cannot be written, or holds a map and ``resume`` is not given.
    DataError
        The folder holds the map of another cell, backend or plan.
    PluginError
        The backend is missing.
    """
    from porocore.report.figures.stability import stability_figure
    from porocore.report.figures.style import write_pictures

    folder = Path(folder)
    for value in plan.values:
        _, goal = plan.ends(value)
        where = f"--along and --across: {plan.across} = {value_text(plan.across, value)}"
        require_possible(goal[:9], goal[9], config.cell.modulus, where)
    find_backends(config, ["cell solver"])
    claim_record(folder / FILE, "map", resume=resume)
    series = StabilitySeries(config, plan, folder / FILE, chosen_store(store))
    workers = config.sampling.worker_count() if workers is None else workers
    with using_units(config.result_units):
        lines = series.run(series.cases(), Console.shown(progress), workers)
        picture = folder / PICTURE
        write_pictures(stability_figure(plan, lines), picture)
        return StabilityMap(plan, lines, write_tables(folder, plan, lines), picture)


def follow(
    tell: Tell,
    solver: CellSolver,
    prepared: PreparedCell,
    known: SolvedStore | None,
    start: Array,
    goal: Array,
    settings: LineSettings,
) -> StabilityLine:
    """Solve one line; ``tell`` takes every state and onset, and what came from the store."""
    solved = 0

    def show(found: str) -> None:
        nonlocal solved
        solved += not found.startswith("onset")
        tell(CaseProgress(found, min(1.0, solved / (settings.steps + 1))))

    with taken(known, lambda count, seconds: tell(FromStore(count, seconds))):
        return follow_line(solver, prepared, start, goal, settings, show)


def prepare(fem: FemSettings, cell: Cell, store: ResultStore | None) -> tuple[Any, ...]:
    """Return the solver, the cell and its states in the store, as :func:`follow` takes them."""
    solver, prepared, known = prepare_stored(store, fem.backend, fem.options, cell)
    if not isinstance(prepared, PreparedCell):
        raise ConfigurationError(
            f"--fem: backend '{fem.backend}' gives no access to the tangent of its cell; "
            "choose one that does, such as skfem"
        )
    return solver, prepared, known


class StabilitySeries(RunSeries[StabilityLine]):
    """Lines of a map, in its file by their numbers.

    Parameters
    ----------
    config, plan
        The study, and the map.
    path
        Its file.
    store
        Results that studies share.
    """

    title, unit = "stability", "states"
    function = follow

    def __init__(self, config: RunConfig, plan: MapPlan, path: Path, store: ResultStore | None) -> None:
        self._plan, self._path, described = plan, path, plan.describe()
        self._identity = json_hash([config.stages.cell, described])
        self._provenance = {"config": config.resolved_yaml(), "plan": json.dumps(described)}
        lines = load(path, self._identity) if path.exists() else []
        across = NAMES.index(plan.across)
        super().__init__(
            {str(plan.values.index(line.start[across])): line for line in lines},
            (prepare, (config.fem, config.cell, store)),
        )

    def cases(self) -> list[Case]:
        """Return the lines as cases."""
        plan = self._plan
        return [
            Case(
                str(i),
                (*plan.ends(value), plan.line),
                f"{plan.across} = {value_text(plan.across, value)}",
                size=plan.line.steps + 1,
            )
            for i, value in enumerate(plan.values)
        ]

    def save(self, case: Case, result: StabilityLine) -> None:
        """Write the file, the lines in the order of the plan."""
        lines = [self.known[key] for key in sorted(self.known, key=int)]
        save(self._path, self._identity, lines, self._provenance)
