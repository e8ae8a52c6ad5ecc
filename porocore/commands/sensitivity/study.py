"""The sensitivity study as a whole: half lines solved side by side, each kept when finished."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.stability.map import walk
from porocore.commands.sensitivity.plan import LOADS, HalfLine, StudyPlan, states_of, step_count
from porocore.commands.sensitivity.results import Sensitivity, line_name, load, save, write_table
from porocore.core.console import Console
from porocore.core.files.plain_data import json_hash
from porocore.core.files.store import ResultStore
from porocore.core.inputs import require_possible, value_text
from porocore.core.parallel.calls import ProcessEnded, Tell
from porocore.core.units import using_units
from porocore.interfaces.cell import CellSolver
from porocore.interfaces.records import failed_response
from porocore.macro.laws.closure import ConductivityLaw
from porocore.macro.reference import CellReference
from porocore.plugins.border import solution_of
from porocore.sampling.execution import FinishedSolve
from porocore.sampling.execution.solved_store import SolvedStore
from porocore.states import CellResponse, Status
from porocore.study.config.config import FemSettings, RunConfig
from porocore.study.notes.checks import find_backends
from porocore.study.run.composition import prepare_stored
from porocore.study.series import Case, CaseProgress, FromStore, RunSeries, claim_record, require_own
from porocore.study.store import chosen_store, taken

FILE = "sensitivity.h5"


@dataclass(frozen=True, eq=False)
class SensitivityFiles:
    """Results of a study and the files that show them.

    Attributes
    ----------
    study
        All responses.
    table
        ``sensitivity.csv``.
    pictures
        Figures by name.
    """

    study: Sensitivity
    table: Path
    pictures: dict[str, Path]


def study_sensitivity(
    config: RunConfig,
    folder: Path | str,
    plan: StudyPlan | None = None,
    *,
    workers: int | None = None,
    resume: bool = False,
    store: ResultStore | str | Path | bool = True,
    progress: bool = False,
) -> SensitivityFiles:
    """Study the cell of a configuration under one load at a time, as far as it can be solved.

    Parameters
    ----------
    config
        The study; only its cell, finite elements and conductivity count.
    folder
        Place of ``sensitivity.h5``, ``sensitivity.csv`` and the figures.
    plan
        Loads; by default all of the paper.
    workers
        Processes; by default as configured for sampling.
    resume
        Continue the study that the folder holds.
    store
        Folder of results that studies share; True: that of the user, False: none. A state that it holds is not solved.
    progress
        Show the progress on standard error.

    Raises
    ------
    ConfigurationError
        No cell can be in a state of the plan.
    RunFolderError
        The folder cannot be written, or holds a study and ``resume`` is not given.
    DataError, PluginError, PorocoreError
        See ``run_study``.
    """
    from porocore.commands.sensitivity.figures import write_figures

    folder, plan = Path(folder), StudyPlan() if plan is None else plan
    for name, _, goal in plan.half_lines():
        state, where = states_of(name, goal), f"--loads: {name} = {value_text(LOADS[name][0], goal)}"
        require_possible(state.grad_u[0], float(state.p[0]), config.cell.modulus, where)
    find_backends(config, ["cell solver"])
    claim_record(folder / FILE, "study", resume=resume)
    with using_units(config.result_units):
        study = run_study(
            config.cell, config.fem, folder, plan, conductivity=config.conductivity,
            workers=config.sampling.worker_count() if workers is None else workers,
            provenance={"config": config.resolved_yaml()}, store=chosen_store(store),
            console=Console.shown(progress),
        )  # fmt: skip
        return SensitivityFiles(study, write_table(folder, study), write_figures(folder, study))


def run_study(
    cell: Cell,
    fem: FemSettings,
    folder: Path,
    plan: StudyPlan | None = None,
    *,
    conductivity: ConductivityLaw = "piola-unrotated",
    workers: int = 1,
    provenance: Mapping[str, str] | None = None,
    store: ResultStore | None = None,
    console: Console | None = None,
) -> Sensitivity:
    """Solve every half line of a plan that ``folder`` does not hold yet; see :func:`study_sensitivity`.

    Every state starts from the field of the one before it on its half line. The results depend neither on the
    number of workers, of which 1 is this process, nor on interruptions: each half line enters ``sensitivity.h5`` when
    it is finished. ``provenance`` are texts that the file keeps.

    Raises
    ------
    DataError
        The file in the folder is damaged or belongs to another cell, backend or plan.
    PluginError, ConfigurationError
        The backend is missing or does not take its options.
    PorocoreError
        The undeformed cell cannot be solved, or a worker process died.
    """
    plan, path = StudyPlan() if plan is None else plan, folder / FILE
    identity = study_identity(cell, fem, plan, conductivity)
    if path.exists():
        study = load(path)
        require_own(path, study.identity, identity, "the study of another cell, backend or plan")
    else:
        # As one of the states, since the file of an undeformed cell has no extrema.
        solver, prepared, _ = prepare_stored(store, fem.backend, fem.options, cell, conductivity)
        reference = CellReference.compute(solver, prepared, cell, identity)
        rest, texts = reference.resting(conductivity), dict(provenance or {})
        study = Sensitivity(plan, identity, rest, reference.conductivity, {}, texts, conductivity)
        save(path, study)
    series = SensitivitySeries(study, path, (fem.backend, fem.options, cell, conductivity), store)
    series.run(series.cases(), console or Console.shown(False), workers)
    return study


def study_identity(
    cell: Cell, fem: FemSettings, plan: StudyPlan, conductivity: ConductivityLaw = "piola-unrotated"
) -> str:
    """Hash of everything that the result depends on."""
    parts: list[Any] = [cell.model_dump(mode="json"), fem.model_dump(mode="json"), plan.describe()]
    # Without another law the study is what it was before there were several.
    parts += [] if conductivity == "piola-unrotated" else [conductivity]
    return json_hash(parts, sort_keys=True)


@dataclass(frozen=True)
class LoadedState:
    """State of a half line that was solved, for the progress."""

    load: str
    value: float
    status: Status

    def __str__(self) -> str:
        return f"{value_text(LOADS[self.load][0], self.value)} {self.status.name.replace('_', ' ')}"


def follow(
    tell: Tell,
    solver: CellSolver,
    prepared: Any,
    known: SolvedStore | None,
    half_line: tuple[str, int, float],
    step: float,
    tolerance: float,
    rest: CellResponse,
) -> HalfLine:
    """Solve the states of a half line one after another, each from the field of the one before.

    ``tell`` takes every state and what came from the store; ``rest`` is the response of the undeformed cell.
    """
    load, sign, goal = half_line
    count, reached = step_count(goal, step), 0

    def solve(value: float, last: FinishedSolve | None) -> FinishedSolve:
        nonlocal reached
        began, saved = time.perf_counter(), known.saved if known else 0.0
        start = None if last is None else last.field
        solution = solution_of(solver, prepared, states_of(load, value), start=[start], fields=True)
        # What the store holds took what it took when it was solved.
        seconds = (known.saved - saved if known else 0.0) or time.perf_counter() - began
        reached += bool(solution.response.valid[0])
        state = LoadedState(load, value, Status(int(solution.response.status[0])))
        tell(CaseProgress(state, min(1.0, reached / count)))
        return FinishedSolve("", solution.response, solution.fields[0] if solution.fields else None, seconds)

    steps = [goal * k / count for k in range(1, count + 1)]
    at_rest = 0.0, FinishedSolve("", rest, None, 0.0)
    with taken(known, lambda count, seconds: tell(FromStore(count, seconds))):
        solved = walk(steps, solve, lambda found: bool(found.response.valid[0]), tolerance, at_rest)
        values, found = zip(at_rest, *solved, strict=True)
    response = CellResponse.concatenate([each.response for each in found])
    return HalfLine(load, sign, np.array(values), response, np.array([each.seconds for each in found]))


class SensitivitySeries(RunSeries[HalfLine]):
    """Half lines of a study, in its file by their names.

    Parameters
    ----------
    study, path
        The study with the half lines that are solved, and its file.
    arguments
        Backend, options, cell and law, as the cell is prepared from them.
    store
        Results that studies share.
    """

    title, unit = "sensitivity", "states"
    function = follow

    def __init__(
        self, study: Sensitivity, path: Path, arguments: tuple[Any, ...], store: ResultStore | None
    ) -> None:
        # One whose process ended is solved again.
        for name in [name for name, line in study.lines.items() if line.end is Status.lost]:
            del study.lines[name]
        super().__init__(study.lines, (prepare_stored, (store, *arguments)))
        self._study, self._path = study, path

    def cases(self) -> list[Case]:
        """Return the half lines as cases."""
        plan, rest = self._study.plan, self._study.rest
        return [
            Case(
                line_name(load, sign),
                ((load, sign, goal), plan.sweeps[load].step, plan.tolerance, rest),
                line_name(load, sign),
                size=step_count(goal, plan.sweeps[load].step),
            )
            for load, sign, goal in plan.half_lines()
        ]

    def save(self, case: Case, result: HalfLine) -> None:
        """Write the file."""
        save(self._path, self._study)

    def lost(self, case: Case, error: Exception) -> HalfLine:
        """Return a half line that ends with the status ``lost`` where its process ended, so that the others go on."""
        if not isinstance(error, ProcessEnded):
            raise error
        (load, sign, goal), step, _, rest = case.arguments
        response = CellResponse.concatenate([rest, failed_response(Status.lost, like=rest)])
        return HalfLine(load, sign, np.array([0.0, goal / step_count(goal, step)]), response, np.zeros(2))
