"""Stability map of a configured cell as a study (map_stability), with its tables and figure."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from porocore.cell.equilibrium.solver import EquilibriumCellSolver
from porocore.cell.stability.line import StabilityLine
from porocore.cell.stability.map import MapPlan, follow_lines, write_tables
from porocore.core.files.atomic import new_folder
from porocore.core.files.plain_data import json_hash
from porocore.core.files.store import ResultStore
from porocore.core.inputs import require_possible, value_text
from porocore.core.units import speaking
from porocore.errors import ConfigurationError, RunFolderError
from porocore.interfaces.cell import CellSolver
from porocore.sampling.execution.solved_store import StoringSolver
from porocore.study.config.config import RunConfig
from porocore.study.notes.checks import find_backends
from porocore.study.stages.stage_files import prepare_cell
from porocore.study.store import chosen_store, solved_states, told

FILE, PICTURE = "stability.h5", "stability.png"


@dataclass(frozen=True)
class MapProgress:
    """Progress of a map after one event.

    Attributes
    ----------
    value
        Input across the lines, on the line under way.
    found
        Description of the state or of the onset.
    done, expected
        Solved states, and all if every line reaches its goal.
    """

    value: float
    found: str
    done: int
    expected: int


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
    resume: bool = False,
    on_event: Callable[[MapProgress], None] = lambda progress: None,
    store: ResultStore | str | Path | bool = True,
    tell: Callable[[str], None] = lambda text: None,
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
    resume
        Continue the map that the folder holds; finished lines are not solved again.
    on_event
        Called after every state and onset.
    store
        Folder of results that studies share; True: that of the user, False: none.
    tell
        Called with what came from the store.

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
    _require_possible(config, plan)
    if (folder / FILE).exists() and not resume:
        raise RunFolderError(
            f"{folder} already holds a map; add --resume to continue it, or choose another --out"
        )
    find_backends(config, ["cell solver"])
    new_folder(folder)
    lines = _solve(config, folder / FILE, plan, on_event, chosen_store(store), tell)
    picture = folder / PICTURE
    with speaking(config.result_units):
        write_pictures(stability_figure(plan, lines), picture)
        return StabilityMap(plan, lines, write_tables(folder, plan, lines), picture)


def _require_possible(config: RunConfig, plan: MapPlan) -> None:
    """Refuse goals at which no cell can be."""
    for value in plan.values:
        _, goal = plan.ends(value)
        where = f"--along and --across: {plan.across} = {value_text(plan.across, value)}"
        require_possible(goal[:9], goal[9], config.cell.modulus, where)


def _solve(
    config: RunConfig,
    path: Path,
    plan: MapPlan,
    on_event: Callable[[MapProgress], None],
    store: ResultStore | None,
    tell: Callable[[str], None],
) -> list[StabilityLine]:
    solver, prepared = prepare_cell(config.fem.backend, config.fem.options, config.cell)
    if not isinstance(solver, EquilibriumCellSolver):
        raise ConfigurationError(
            f"--fem: backend '{config.fem.backend}' gives no access to the tangent of its cell; "
            "choose one that does, such as skfem"
        )
    states = plan.line.steps + 1
    under_way, solved = 0, 0

    def show(line: int, found: str) -> None:
        nonlocal under_way, solved
        under_way, solved = line, (0 if line != under_way else solved) + (not found.startswith("onset"))
        expected = len(plan.values) * states
        on_event(MapProgress(plan.values[line], found, min(expected, line * states + solved), expected))

    described = plan.describe()
    identity = json_hash([config.stages.cell, described])
    provenance = {"config": config.resolved_yaml(), "plan": json.dumps(described)}
    known = solved_states(store, config.fem.backend, config.fem.options, config.cell)
    solves: CellSolver = solver if known is None else StoringSolver(solver, known)
    with told(known, "stability", tell):
        return follow_lines(solves, prepared, plan, path, identity, provenance, show)
