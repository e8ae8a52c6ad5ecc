"""Paths of all files of a run; names of its laws, of direct FE² and of the fallback."""

from __future__ import annotations

from copy import copy
from pathlib import Path
from typing import Self

from porocore.macro.laws import CLOSURES
from porocore.study.config.config import RunConfig

#: Name of the law of linear poroelasticity.
LINEAR = "linear"


class RunFiles:
    """The files of one run; nothing is read or written here.

    Attributes
    ----------
    path
        The folder.
    config
        Configuration of the run, or the other settings with which it continues.
    written
        Configuration that the run began with, which names the files: a run that continues with another closure
        keeps the solutions of each, and one surrogate for each model.
    reference, dataset, test_dataset
        The undeformed cell, and the data sets of the states to learn from and of the held-out ones.
    undeformed
        Data set of the undeformed members of a family of cells.
    decisions
        Decisions of a sampler that explores, for a sampling that is resumed.
    direct_work, fallback, fallback_work
        Record of the cells that direct FE² has solved; data set of the states that solves with a fallback needed
        outside the sampled range, and the record of their cells.
    fields, figures, metrics, report
        Folders of the files for ParaView and of the report's figures, figures of merit, and page of the report.
    timings
        Record of the seconds that each stage took.
    body
        Folder of the macro solutions, their histories and checkpoints: that of the run, or one below it.
    cell
        Name of the cell whose files these are; None: that of the rest of the body, or the only one.
    whole
        Files of the whole run.
    """

    def __init__(self, path: Path, config: RunConfig) -> None:
        self.path = self.body = path
        self.cell: str | None = None
        self.whole: RunFiles = self
        self.config = self.written = config
        self.reference, self.undeformed = path / "cell.json", path / "undeformed.h5"
        self.dataset, self.test_dataset = path / "samples.h5", path / "test.h5"
        self.decisions = path / "decisions.json"
        self.direct_work = path / "direct.json"
        self.fallback, self.fallback_work = path / "fallback.h5", path / "fallback.json"
        self.fields, self.figures = path / "fields", path / "figures"
        self.metrics, self.report = path / "metrics.json", path / "report.html"
        self.timings = path / "timings.json"
        self._lock: int | None = None

    def of_body(self, name: str, config: RunConfig) -> Self:
        """Return the same files with the solutions of another body, in a folder ``name`` below that of the run."""
        other = copy(self)
        other.config, other.body = config, self.path / name
        return other

    def surrogate_of(self, config: RunConfig) -> Path:
        """Return the file of the surrogate that ``config`` needs.

        ``surrogate.h5`` belongs to the closure that the run began with; another model of surrogate lies beside it as
        ``surrogate-MODEL.h5``.
        """
        return self.path / f"surrogate{self._suffix(config)}.h5"

    def training_curve_of(self, config: RunConfig) -> Path:
        """Return the table of losses against epochs of that surrogate."""
        return self.path / f"training{self._suffix(config)}.csv"

    def training_checkpoint_of(self, config: RunConfig) -> Path:
        """Return the checkpoint of an interrupted training of that surrogate."""
        return self.path / "checkpoints" / f"training{self._suffix(config)}.h5"

    def _suffix(self, config: RunConfig) -> str:
        model = config.surrogate_model
        return "" if model == self.written.surrogate_model else f"-{model}"

    def stage_of_cell(self, stage: str) -> str:
        """Return the name of a stage of a cell, with the name of the cell where it has one."""
        return stage if self.cell is None else f"{stage}, {self.cell}"

    def said_of_cell(self, text: str) -> str:
        """Return a sentence with the name of the cell before it where it has one."""
        return text if self.cell is None else f"cell {self.cell}: {text}"

    def macro_checkpoint(self, law: str, load: float) -> Path:
        """Return the checkpoint of an interrupted macro solve."""
        return self.body / "checkpoints" / f"{_file_name(law, load)}.h5"

    def solution(self, law: str, load: float) -> Path:
        """Return the file of the macro solution with one law under one load."""
        return self.body / "solutions" / f"{_file_name(law, load)}.h5"

    def solutions(self, *laws: str) -> list[Path]:
        """Return the files of the solutions for each load with each of ``laws``; by default the closure and linear."""
        laws = laws or (self.config.closure, LINEAR)
        return [self.solution(law, load) for load in self.config.macro.loads for law in laws]

    def solved(self, load: float) -> list[str]:
        """Return the nonlinear laws with a solution under ``load``: closures, with fallback, direct FE²."""
        closures = dict.fromkeys((self.written.closure, *CLOSURES))
        laws = (*closures, *map(fallback_law, closures), *map(direct_law, closures))
        return [law for law in laws if self.solution(law, load).exists()]

    @property
    def shown_closure(self) -> str:
        """Closure that a report shows: the first one with solutions of all loads, else the run's first."""
        loads = self.config.macro.loads
        complete = [c for c in CLOSURES if all(self.solution(c, load).exists() for load in loads)]
        first = self.written.closure
        return first if first in complete or not complete else complete[0]

    def history(self, law: str, load: float) -> Path:
        """Return the table of everything against time of one macro solution."""
        return self.body / "histories" / f"{_file_name(law, load)}.csv"


def direct_law(closure: str) -> str:
    """Return the name of the law of direct FE² with a closure."""
    return f"direct-{closure}"


def fallback_law(closure: str) -> str:
    """Return the name of the law of a closure whose surrogate learns on the way."""
    return f"{closure}-fallback"


def _file_name(law: str, load: float) -> str:
    safe = "".join(c if c.isalnum() else "-" for c in law)
    return f"{safe}_load{load!r}"
