"""A sensitivity study: its half lines side by side in worker processes, each kept as soon as it is finished."""

from __future__ import annotations

import hashlib
import heapq
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from porocore.cell.cell import Cell
from porocore.errors import DataError
from porocore.macro.laws.pull_back import ConductivityLaw
from porocore.macro.reference import CellReference
from porocore.sampling.execution import CellPool
from porocore.states import Status
from porocore.study.config.sections import FemSettings
from porocore.study.stages.stage_files import prepare_cell
from porocore.verification.sensitivity.file import load, save
from porocore.verification.sensitivity.line import HalfLine, Walk
from porocore.verification.sensitivity.plan import StudyPlan
from porocore.verification.sensitivity.results import Sensitivity, line_name

FILE = "sensitivity.h5"


@dataclass(frozen=True)
class Progress:
    """After one state.

    Attributes
    ----------
    load, value, status
        What was solved.
    done, expected
        States so far, and in all if every load reaches its goal from here on.
    """

    load: str
    value: float
    status: Status
    done: int
    expected: int


def run_study(
    cell: Cell,
    fem: FemSettings,
    folder: Path,
    plan: StudyPlan | None = None,
    *,
    conductivity: ConductivityLaw = "piola-unrotated",
    workers: int = 1,
    on_state: Callable[[Progress], None] = lambda progress: None,
    provenance: Mapping[str, str] | None = None,
) -> Sensitivity:
    """Solve every half line of a plan that ``folder`` does not hold yet.

    Every state starts from the field of the one before it on its half line. What is found does not depend on the
    number of workers, nor on interruptions: ``sensitivity.h5`` takes in each half line when it is finished.

    Parameters
    ----------
    cell, fem
        The cell and the backend that solves it.
    folder
        Where ``sensitivity.h5`` lies or will lie.
    plan
        By default all loads of the paper, see :data:`porocore.verification.sensitivity.plan.SWEEPS`.
    conductivity
        Of which K_t is told; by default the paper's.
    workers
        Processes; with 1 everything is solved in this one.
    on_state
        Called after every state.
    provenance
        Texts that the file keeps.

    Raises
    ------
    DataError
        The file in the folder is damaged or belongs to another cell, backend or plan.
    PluginError, ConfigurationError
        The backend is missing or does not take its options.
    PorocoreError
        The undeformed cell cannot be solved, or a worker process died.
    """
    plan = StudyPlan() if plan is None else plan
    path, identity = folder / FILE, study_identity(cell, fem, plan, conductivity)
    if path.exists():
        study = load(path)
        if study.identity != identity:
            raise DataError(
                f"{path}: holds the study of another cell, backend or plan; choose another --out or delete it"
            )
    else:
        solver, prepared = prepare_cell(fem.backend, fem.options, cell, conductivity)
        reference = CellReference.compute(solver, prepared, cell, identity)
        study = Sensitivity(
            plan,
            identity,
            reference.resting(conductivity),
            reference.conductivity,
            {},
            dict(provenance or {}),
            conductivity,
        )
        save(path, study)
    walks = [
        Walk(name, sign, goal, plan.sweeps[name].step, plan.tolerance, study.rest)
        for name, sign, goal in plan.half_lines()
        if line_name(name, sign) not in study.lines
    ]
    if walks:
        arguments = (fem.backend, fem.options, cell, conductivity)
        with CellPool(prepare_cell, arguments, workers=min(workers, len(walks))) as pool:
            for line in _Campaign(study, pool, walks, on_state).lines():
                study.lines[line_name(line.load, line.sign)] = line
                save(path, study)
    return study


def study_identity(
    cell: Cell, fem: FemSettings, plan: StudyPlan, conductivity: ConductivityLaw = "piola-unrotated"
) -> str:
    """Hash of everything that the result depends on."""
    parts: list[Any] = [cell.model_dump(mode="json"), fem.model_dump(mode="json"), plan.describe()]
    # Without another law the study is what it was before there were several.
    parts += [] if conductivity == "piola-unrotated" else [conductivity]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


class _Campaign:
    """Half lines that share the workers of a pool, the longest first."""

    def __init__(
        self, study: Sensitivity, pool: CellPool, walks: list[Walk], on_state: Callable[[Progress], None]
    ) -> None:
        self.study, self.pool, self.on_state = study, pool, on_state
        self._idle = list(enumerate(walks))  # a heap: first the one that the plan names first
        self._under_way: dict[str, tuple[int, Walk]] = {}
        self._done = sum(len(line) - 1 for line in study.lines.values())
        self._ahead = {id(walk): walk.steps for walk in walks}

    def lines(self) -> Iterator[HalfLine]:
        """As they are finished."""
        while self._idle or self._under_way:
            while self._idle and self.pool.has_room:
                number, walk = heapq.heappop(self._idle)
                key = f"{walk.load} {walk.value:g}"
                self._under_way[key] = number, walk
                self.pool.submit(key, walk.state, walk.field)
            outcome = self.pool.wait()
            number, walk = self._under_way.pop(outcome.key)
            value = walk.value
            walk.take(outcome)
            self._tell(walk, value, Status(int(outcome.response.status[0])))
            if walk.done:
                yield walk.line()
            else:
                heapq.heappush(self._idle, (number, walk))

    def _tell(self, walk: Walk, value: float, status: Status) -> None:
        self._done += 1
        ahead = self._ahead[id(walk)] - 1
        self._ahead[id(walk)] = 0 if walk.done else max(ahead if status.has_values else 1, 1)
        self.on_state(Progress(walk.load, value, status, self._done, self._done + sum(self._ahead.values())))
