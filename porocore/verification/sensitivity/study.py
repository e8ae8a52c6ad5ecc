"""The sensitivity study as a whole: half lines solved side by side, each kept when finished."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from porocore.cell.cell import Cell
from porocore.core.files.atomic import new_folder
from porocore.core.files.plain_data import json_hash
from porocore.core.files.store import ResultStore
from porocore.core.inputs import require_possible, value_text
from porocore.core.units import speaking
from porocore.errors import RunFolderError
from porocore.macro.laws.closure import ConductivityLaw
from porocore.macro.reference import CellReference
from porocore.sampling.execution import CellPool
from porocore.sampling.execution.solved_store import StoringSolver
from porocore.states import Status
from porocore.study.config.config import FemSettings, RunConfig
from porocore.study.notes.checks import find_backends
from porocore.study.series import require_own
from porocore.study.stages.stage_files import prepare_cell
from porocore.study.store import chosen_store, solved_states, told
from porocore.verification.sensitivity.plan import LOADS, HalfLine, HalfLineSolve, StudyPlan, states_of
from porocore.verification.sensitivity.results import Sensitivity, line_name, load, save, write_table

FILE = "sensitivity.h5"


@dataclass(frozen=True)
class SensitivityProgress:
    """Progress of a study after one state.

    Attributes
    ----------
    load, value, status
        State that was solved.
    done, expected
        Solved states, and all if every load reaches its goal from here on.
    """

    load: str
    value: float
    status: Status
    done: int
    expected: int

    def __str__(self) -> str:
        value = value_text(LOADS[self.load][0], self.value)
        return f"{self.load} {value} {self.status.name.replace('_', ' ')}"


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
    on_state: Callable[[SensitivityProgress], None] = lambda progress: None,
    store: ResultStore | str | Path | bool = True,
    tell: Callable[[str], None] = lambda text: None,
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
    on_state
        Called after every state.
    store
        Folder of results that studies share; True: that of the user, False: none. A state that it holds is not solved.
    tell
        Called with what came from the store.

    Raises
    ------
    ConfigurationError
        No cell can be in a state of the plan.
    RunFolderError
        The folder cannot be written, or holds a study and ``resume`` is not given.
    DataError, PluginError, PorocoreError
        See ``run_study``.
    """
    from porocore.verification.sensitivity.figures import write_figures

    folder, plan = Path(folder), StudyPlan() if plan is None else plan
    _require_possible(config, plan)
    if (folder / FILE).exists() and not resume:
        raise RunFolderError(
            f"{folder} already holds a study; add --resume to continue it, or choose another --out"
        )
    find_backends(config, ["cell solver"])
    study = run_study(
        config.cell, config.fem, new_folder(folder), plan, conductivity=config.conductivity,
        workers=config.sampling.worker_count() if workers is None else workers, on_state=on_state,
        provenance={"config": config.resolved_yaml()}, store=chosen_store(store), tell=tell,
    )  # fmt: skip
    with speaking(config.result_units):
        return SensitivityFiles(study, write_table(folder, study), write_figures(folder, study))


def _require_possible(config: RunConfig, plan: StudyPlan) -> None:
    """Refuse goals at which no cell can be."""
    for name, _, goal in plan.half_lines():
        state, where = states_of(name, goal), f"--loads: {name} = {value_text(LOADS[name][0], goal)}"
        require_possible(state.grad_u[0], float(state.p[0]), config.cell.modulus, where)


def run_study(
    cell: Cell,
    fem: FemSettings,
    folder: Path,
    plan: StudyPlan | None = None,
    *,
    conductivity: ConductivityLaw = "piola-unrotated",
    workers: int = 1,
    on_state: Callable[[SensitivityProgress], None] = lambda progress: None,
    provenance: Mapping[str, str] | None = None,
    store: ResultStore | None = None,
    tell: Callable[[str], None] = lambda text: None,
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
    study = _load_or_begin(path, cell, fem, plan, conductivity, dict(provenance or {}), store)
    half_lines = [
        HalfLineSolve(name, sign, goal, plan.sweeps[name].step, plan.tolerance, study.rest)
        for name, sign, goal in plan.half_lines()
        if line_name(name, sign) not in study.lines
    ]
    if half_lines:
        arguments = (fem.backend, fem.options, cell, conductivity)
        known, workers = solved_states(store, *arguments), min(workers, len(half_lines))
        with (
            CellPool(prepare_cell, arguments, workers=workers, known=known) as pool,
            told(known, "sensitivity", tell),
        ):
            for line in _HalfLineSolves(study, pool, half_lines, on_state).lines():
                study.lines[line_name(line.load, line.sign)] = line
                save(path, study)
    return study


def _load_or_begin(
    path: Path,
    cell: Cell,
    fem: FemSettings,
    plan: StudyPlan,
    conductivity: ConductivityLaw,
    provenance: dict[str, str],
    store: ResultStore | None,
) -> Sensitivity:
    """Return the study that the file holds, or a new one with the undeformed cell alone."""
    identity = study_identity(cell, fem, plan, conductivity)
    if path.exists():
        study = load(path)
        require_own(path, study.identity, identity, "the study of another cell, backend or plan")
        return study
    # As one of the states, since the file of an undeformed cell has no extrema.
    arguments = (fem.backend, fem.options, cell, conductivity)
    (solver, prepared), known = prepare_cell(*arguments), solved_states(store, *arguments)
    solver = solver if known is None else StoringSolver(solver, known)
    reference = CellReference.compute(solver, prepared, cell, identity)
    rest = reference.resting(conductivity)
    study = Sensitivity(plan, identity, rest, reference.conductivity, {}, provenance, conductivity)
    save(path, study)
    return study


def study_identity(
    cell: Cell, fem: FemSettings, plan: StudyPlan, conductivity: ConductivityLaw = "piola-unrotated"
) -> str:
    """Hash of everything that the result depends on."""
    parts: list[Any] = [cell.model_dump(mode="json"), fem.model_dump(mode="json"), plan.describe()]
    # Without another law the study is what it was before there were several.
    parts += [] if conductivity == "piola-unrotated" else [conductivity]
    return json_hash(parts, sort_keys=True)


class _HalfLineSolves:
    """Half lines that share the workers of a pool, the longest first."""

    def __init__(
        self,
        study: Sensitivity,
        pool: CellPool,
        half_lines: list[HalfLineSolve],
        on_state: Callable[[SensitivityProgress], None],
    ) -> None:
        self.study, self.pool, self.on_state = study, pool, on_state
        self._idle = list(enumerate(half_lines))  # a heap: first the one that the plan names first
        self._under_way: dict[str, tuple[int, HalfLineSolve]] = {}
        self._done = sum(len(line) - 1 for line in study.lines.values())
        self._ahead = {id(half_line): half_line.steps for half_line in half_lines}

    def lines(self) -> Iterator[HalfLine]:
        """Yield the half lines as they finish."""
        while self._idle or self._under_way:
            while self._idle and self.pool.has_room:
                number, half_line = heapq.heappop(self._idle)
                key = f"{half_line.load} {half_line.value:g}"
                self._under_way[key] = number, half_line
                self.pool.submit(key, half_line.state, half_line.field)
            outcome = self.pool.wait()
            number, half_line = self._under_way.pop(outcome.key)
            value = half_line.value
            half_line.record(outcome)
            self._tell(half_line, value, Status(int(outcome.response.status[0])))
            if half_line.done:
                yield half_line.line()
            else:
                heapq.heappush(self._idle, (number, half_line))

    def _tell(self, half_line: HalfLineSolve, value: float, status: Status) -> None:
        self._done += 1
        ahead = self._ahead[id(half_line)] - 1
        self._ahead[id(half_line)] = 0 if half_line.done else max(ahead if status.has_values else 1, 1)
        self.on_state(
            SensitivityProgress(
                half_line.load, value, status, self._done, self._done + sum(self._ahead.values())
            )
        )
