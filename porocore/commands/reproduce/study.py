"""Results that a reproduction needs, each computed once; the consolidation with both closures."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from porocore.commands.fields.solve import PAPER_STATES, LocalFields, solve_and_write
from porocore.commands.sensitivity.results import Sensitivity, write_table
from porocore.commands.sensitivity.study import run_study
from porocore.core.console import Console
from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import complete, read_json
from porocore.interfaces.solution import Profile
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.laws.linear import LinearCoefficients
from porocore.macro.reference import CellReference
from porocore.plugins.border import prediction_of
from porocore.report.context import ReportContext
from porocore.report.metrics import LoadCase
from porocore.states import Array, MacroState
from porocore.study.config.config import RunConfig, with_closure
from porocore.study.run import pipeline
from porocore.study.run.composition import prepare_cell
from porocore.study.run.folder import RunFolder, timed
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
    results
        Results of the run, shown with the paper's closure.
    context, metrics
        Contents of its report.
    """

    results: RunResults
    context: ReportContext
    metrics: dict[str, Any]

    @property
    def surrogate(self) -> Surrogate:
        """Surrogate of the paper's closure."""
        return self.results.surrogates[self.results.config.closure]

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
        early, middle, late = sorted(self.results.config.macro.time.profiles)[:3]
        return early, middle, late

    def tangent(self, name: str, profile: Profile) -> Array:
        """Return a component of :data:`TANGENTS` of the surrogate at the states of a profile, (elements,)."""
        field, component = TANGENTS[name]
        found = prediction_of(self.surrogate, MacroState(profile.grad_u, profile.cell_p)).tangent
        values: Array = getattr(found, field)[:, *component]
        return values


#: Calls in one time increment of the paper's example.
POINTS = 2250
REPEATS = 30


def call_seconds(path: Path, surrogate: Surrogate, states: MacroState) -> float:
    """Return the seconds of a call for :data:`POINTS` states with all derivatives, the best of several times.

    Parameters
    ----------
    path
        File with the time; it is measured and written where it does not exist.
    states
        Some in the sampled range; they are repeated until there are :data:`POINTS`.

    Raises
    ------
    DataError
        The file is damaged.
    """
    if path.exists():
        with complete(path, "record of call times", "start again"):
            return float(read_json(path)["seconds"])
    asked = states[np.resize(np.arange(len(states)), POINTS)]
    best = np.inf
    for _ in range(REPEATS):
        began = time.perf_counter()
        surrogate.predict(asked)
        best = min(best, time.perf_counter() - began)
    write_json(path, {"points": POINTS, "seconds": best}, indent=1)
    return best


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
            with timed(self.timings, "column"):
                pipeline.solve_reference(run, console=self.console)
                pipeline.sample(run, console=self.console)
                for config in (first, second):
                    pipeline.train(run.with_config(config), console=self.console)
                    pipeline.solve(run.with_config(config), console=self.console)
                if not run.report.exists():
                    pipeline.report(run, console=self.console)
            results = RunResults.load(run)
            context = report_context(results)
        return Column(results, context, figures_of_merit(results, context))

    @cached_property
    def sensitivity(self) -> Sensitivity:
        """One load of the cell at a time."""
        config, folder = self.config, self.folder / "sensitivity"
        provenance = {"config": config.resolved_yaml()}
        with timed(self.timings, "sensitivity"):
            study = run_study(
                config.cell,
                config.fem,
                folder,
                workers=self.workers,
                provenance=provenance,
                console=self.console,
            )
            write_table(folder, study)
        return study

    @cached_property
    def fields(self) -> dict[str, LocalFields]:
        """Local fields under the loads of figures 2 to 4."""
        config, folder, found = self.config, self.folder / "fields", {}
        with timed(self.timings, "local fields"), self.console.task("local fields", "states") as task:
            for i, (name, state) in enumerate(PAPER_STATES.items()):
                task.update(i, len(PAPER_STATES), detail=name)
                drawn = all((folder / f"{kind}_{name}.png").exists() for kind in ("disp", "energy"))
                found[name] = solve_and_write(
                    config.cell, config.fem, folder, state, name=name, pictures=self.pictures and not drawn
                )
            task.update(len(PAPER_STATES), len(PAPER_STATES))
        return found

    @property
    def reference(self) -> CellReference:
        """The undeformed cell of the benchmark."""
        return self.column.results.reference

    @cached_property
    def as_stated(self) -> CellReference:
        """Undeformed cell of the paper's text."""
        config, path = self.as_stated_config, self.folder / "cell-as-stated.json"
        if not path.exists():
            with timed(self.timings, f"undeformed cell, {path.name}"):
                solver, prepared = prepare_cell(config.fem.backend, config.fem.options, config.cell)
                CellReference.compute(solver, prepared, config.cell, config.stages.cell).save(path)
        return CellReference.load(path, config.stages.cell)

    @property
    def linear(self) -> LinearCoefficients:
        """Linear poroelasticity of the benchmark's cell."""
        return self.column.results.coefficients

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
    def call_seconds(self) -> float:
        """Seconds of a call of the surrogate for :data:`POINTS` states."""
        states = self.column.results.held_out.states()
        return call_seconds(self.folder / "calls.json", self.column.surrogate, states)

    @property
    def timings(self) -> Path:
        """File with the seconds that each part took."""
        return self.folder / "timings.json"
