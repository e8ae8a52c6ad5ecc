"""Results that a reproduction needs, each computed once; the consolidation with both closures."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from porocore.commands.fields.solve import PAPER_STATES, LocalFields, solve_and_write
from porocore.commands.reproduce.calls import CallTimes, call_times
from porocore.commands.sensitivity.results import Sensitivity, write_table
from porocore.commands.sensitivity.study import run_study
from porocore.core.console import Console
from porocore.interfaces.solution import Profile
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.laws.linear import LinearCoefficients
from porocore.macro.reference import CellReference
from porocore.plugins.border import prediction_of
from porocore.report.context import ReportContext
from porocore.report.metrics import LoadCase
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import Array, MacroState
from porocore.study.config.config import RunConfig, with_closure
from porocore.study.run import pipeline
from porocore.study.run.composition import prepare_cell
from porocore.study.run.folder import RunFolder, StageClock, timed
from porocore.study.run.reporting import figures_of_merit
from porocore.study.run.results import RunResults
from porocore.study.run.summary import report_context

#: Loads of the published column.
LARGE, SMALL = -0.2, -0.01
#: M and Q of the paper's figures: field of the tangent, and component, 0-based. The paper's network knows only H_22 and
#: p, so that its "M_2211" can only be the derivative of component 11 by H_22, M_1122; in the undeformed cubic cell both
#: are the same.
TANGENTS: dict[str, tuple[str, tuple[int, ...]]] = {
    "M_2222": ("mean_grad_grad_u", (1, 1, 1, 1)),
    "M_2211": ("mean_grad_grad_u", (0, 0, 1, 1)),
    "Q_22": ("mean_grad_p", (1, 1)),
    "Q_11": ("mean_grad_p", (0, 0)),
}


@dataclass(frozen=True, eq=False)
class Column:
    """The run of the consolidation benchmark, with both closures.

    Attributes
    ----------
    config
        Configuration of the run, with the paper's closure.
    context, metrics
        What its report shows.
    dataset, held_out
        Solved states.
    surrogate
        Of the paper's closure.
    timings
        Seconds by stage.
    """

    config: RunConfig
    context: ReportContext
    metrics: dict[str, Any]
    dataset: Dataset
    held_out: Dataset
    surrogate: Surrogate
    timings: dict[str, float]

    def case(self, load: float) -> LoadCase:
        """Solutions under one load."""
        return next(case for case in self.context.cases if case.load == load)

    def figures_of(self, load: float) -> dict[str, Any]:
        """Figures of merit under one load."""
        found: dict[str, Any] = next(m for m in self.metrics["macro"] if m["load"] == load)
        return found

    @cached_property
    def times(self) -> tuple[float, float, float]:
        """Times of an early, a middle and a late profile."""
        early, middle, late = sorted(self.config.macro.time.profiles)[:3]
        return early, middle, late

    def tangent(self, name: str, profile: Profile) -> Array:
        """Return a component of :data:`TANGENTS` of the surrogate at the states of a profile, (elements,)."""
        field, component = TANGENTS[name]
        found = prediction_of(self.surrogate, MacroState(profile.grad_u, profile.element_p)).tangent
        values: Array = getattr(found, field)[:, *component]
        return values


#: The paper's closure first; the report is about it.
CLOSURES = ("mean-gradient", "potential")


@dataclass(frozen=True, eq=False)
class Results:
    """Everything that the figures and claims are made of; what the folder holds already is not computed again.

    Attributes
    ----------
    folder
        Of the reproduction.
    config
        The benchmark, with the cell that the published values fit.
    as_stated_config
        The same with the radius of the paper's text.
    workers
        Processes of the sensitivity study.
    console
        Shows the progress.
    pictures
        Whether local fields are drawn.
    """

    folder: Path
    config: RunConfig
    as_stated_config: RunConfig
    workers: int
    console: Console
    pictures: bool = True

    @cached_property
    def column(self) -> Column:
        """The consolidation benchmark with both closures and linearly."""
        first, second = (with_closure(self.config, closure) for closure in CLOSURES)
        run = RunFolder.claim(self.folder / "column", first, resume=True)
        with run:
            with self._stage("column"):
                pipeline.solve_reference(run, console=self.console)
                pipeline.sample(run, console=self.console)
                for config in (first, second):
                    pipeline.train(run.with_config(config), console=self.console)
                    pipeline.solve(run.with_config(config), console=self.console)
                if not run.report.exists():
                    pipeline.report(run, console=self.console)
            results = RunResults.load(run)
            context = report_context(results)
        return Column(
            config=first,
            context=context,
            metrics=figures_of_merit(results, context),
            dataset=results.dataset,
            held_out=results.held_out,
            surrogate=results.surrogates[first.closure],
            timings=results.seconds,
        )

    @cached_property
    def sensitivity(self) -> Sensitivity:
        """One load of the cell at a time."""
        folder = self.folder / "sensitivity"
        with self._stage("sensitivity"):
            study = run_study(
                self.config.cell,
                self.config.fem,
                folder,
                workers=self.workers,
                provenance={"config": self.config.resolved_yaml()},
                console=self.console,
            )
            write_table(folder, study)
        return study

    @cached_property
    def fields(self) -> dict[str, LocalFields]:
        """Local fields under the loads of figures 2 to 4."""
        found = {}
        with self._stage("local fields"), self.console.task("local fields", "states") as task:
            for i, (name, state) in enumerate(PAPER_STATES.items()):
                task.update(i, len(PAPER_STATES), detail=name)
                folder = self.folder / "fields"
                drawn = all((folder / f"{kind}_{name}.png").exists() for kind in ("disp", "energy"))
                found[name] = solve_and_write(
                    self.config.cell,
                    self.config.fem,
                    folder,
                    state,
                    name=name,
                    pictures=self.pictures and not drawn,
                )
            task.update(len(PAPER_STATES), len(PAPER_STATES))
        return found

    @cached_property
    def reference(self) -> CellReference:
        """The undeformed cell of the benchmark."""
        return self._cell(self.config, "cell.json")

    @cached_property
    def as_stated(self) -> CellReference:
        """Undeformed cell of the paper's text."""
        return self._cell(self.as_stated_config, "cell-as-stated.json")

    @property
    def linear(self) -> LinearCoefficients:
        """Linear poroelasticity of the benchmark's cell."""
        return self.reference.coefficients(self.config.cell, self.config.conductivity)

    @property
    def linear_as_stated(self) -> LinearCoefficients:
        """Linear poroelasticity of the cell of the paper's text."""
        config = self.as_stated_config
        return self.as_stated.coefficients(config.cell, config.conductivity)

    def tangent_at_rest(self, name: str) -> float:
        """Return a component of :data:`TANGENTS` of the benchmark's undeformed cell."""
        field, component = TANGENTS[name]
        return float(getattr(self.linear, field)[component])

    @cached_property
    def calls(self) -> CallTimes:
        """Time of a call of the surrogate."""
        column = self.column
        return call_times(self.folder / "calls.json", column.surrogate, column.held_out.states())

    @property
    def timings(self) -> Path:
        """Seconds that each part took."""
        return self.folder / "timings.json"

    def _cell(self, config: RunConfig, name: str) -> CellReference:
        path = self.folder / name
        if not path.exists():
            with self._stage(f"undeformed cell, {name}"):
                solver, prepared = prepare_cell(config.fem.backend, config.fem.options, config.cell)
                CellReference.compute(solver, prepared, config.cell, config.stages.cell).save(path)
        return CellReference.load(path, config.stages.cell)

    def _stage(self, name: str) -> AbstractContextManager[StageClock]:
        return timed(self.timings, name)
