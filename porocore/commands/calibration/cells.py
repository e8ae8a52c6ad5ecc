"""Cells of a calibration (FamilyCells), shared by its experiments; measurements that were not made."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from porocore.commands.calibration.experiment import ExperimentModel
from porocore.commands.calibration.observations import (
    OF_INDENTERS,
    MeasuredSeries,
    ObservedCurve,
    by_curve,
)
from porocore.commands.calibration.plan import CalibrationPlan, Experiment, PlannedUnknown
from porocore.commands.calibration.problem import MANY_VALUES, slopes_at
from porocore.commands.calibration.suggestions import FurtherData
from porocore.core.console import Console
from porocore.core.files.plain_data import json_hash, write_json
from porocore.core.files.reading import complete, read_json
from porocore.core.files.store import ResultStore
from porocore.core.parallel.calls import CallProcesses, Tell, side_by_side
from porocore.core.units import using_units
from porocore.errors import DataError, SolveError
from porocore.interfaces.law import MacroLaw
from porocore.macro.laws.linear import EffectiveProperties, LinearisedLaw
from porocore.macro.laws.macro_law import AdaptiveLaw, ClosedLaw
from porocore.plugins.border import body_solution_of
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import Array, MacroState
from porocore.study.config.config import RunConfig
from porocore.study.run import pipeline
from porocore.study.run.composition import (
    RunLaw,
    law_of_body,
    law_of_cell,
    make_backend,
    porosity_of,
    with_memory,
)
from porocore.study.run.folder import RunFolder
from porocore.study.run.results import load_reference
from porocore.study.run.solving import body_progress, prepared_body

#: Record of the further cells that each round has solved, in the folder of a family.
ROUNDS = "rounds.json"


class FamilyCells:
    """Cells that some experiments share, in a run folder.

    Parameters
    ----------
    folder
        The run folder, which is locked.
    config
        Study of the first of these experiments.
    experiments
        Names of all of them.
    console, store
        Progress, and results of other studies.
    """

    def __init__(
        self,
        folder: RunFolder,
        config: RunConfig,
        experiments: Sequence[str],
        console: Console,
        store: ResultStore | None,
    ) -> None:
        self.folder, self.config, self.experiments = folder, config, tuple(experiments)
        self._console, self._store = console, store

    def learn(self) -> None:
        """Solve and learn the cells that the folder does not hold."""
        with using_units(self.config.result_units):
            pipeline.learn(self.folder, console=self._console, store=self._store)

    @property
    def rounds(self) -> list[list[str]]:
        """Keys of the further cells that each round has solved."""
        path = self.folder.path / ROUNDS
        if not path.exists():
            return []
        with complete(path, "record of rounds", "start again"):
            return [[str(key) for key in keys] for keys in read_json(path)]

    def keep_rounds(self, count: int) -> None:
        """Keep the further cells of so many rounds, and forget those of one that was not finished."""
        if len(self.rounds) > count:
            write_json(self.folder.path / ROUNDS, self.rounds[:count])
        further, kept = self._further(), set(chain(*self.rounds))
        if further is not None and (unfinished := [key for key in further.keys if key not in kept]):
            further.drop(unfinished)

    def _further(self) -> Dataset | None:
        path = self.folder.fallback
        return Dataset.open(path) if path.exists() else None

    def identity(self, rounds: int | None = None) -> str:
        """Return the hash of the cells that are known after so many rounds; None: after all."""
        known = chain(*self.rounds[:rounds])
        return json_hash([self.config.stages.training, self.config.closure, *known])

    def laws(self) -> Callable[[RunConfig], MacroLaw]:
        """Return what gives the body of each experiment its law, which knows the further cells of all rounds.

        The experiments share the cells; each has its own memory: relaxation, fixed charges, rates of parameters.
        """
        if not self.config.cells:
            law = self._in_equilibrium()
            return lambda config: with_memory(law, config)
        with ExitStack() as stack:
            laws = {
                files.cell: law_of_cell(files, stack, "surrogate").law for files in self.folder.of_each_cell
            }

        def of(config: RunConfig) -> MacroLaw:
            return law_of_body(config, {name: with_memory(laws[name], config.of_cell(name)) for name in laws})

        return of

    def _in_equilibrium(self) -> MacroLaw:
        """Return that law of the only cell, as the cell is learned."""
        with ExitStack() as stack:
            if any(self.rounds):
                law = self._adaptive(stack)[1]
                # What it has learned so far; it learns no more.
                return ClosedLaw(law.cell_law, law.closure, identity=self.identity(), name=law.name)
            return law_of_cell(self.folder, stack, "surrogate").law

    def at_rest(self) -> Callable[[Array], EffectiveProperties] | None:
        """Return the properties of the undeformed cell by the values (m,) of its parameters, as they were learned.

        None where the body has several cells.
        """
        config = self.config
        if config.cells:
            return None
        reference = load_reference(self.folder)
        if not config.cell.is_family:
            return lambda parameters: reference.properties(config.cell, config.conductivity)
        law, names = self._in_equilibrium(), [each.name for each in config.cell.parameters]
        porosity = porosity_of(law, reference)
        assert callable(porosity)

        def of(parameters: Array) -> EffectiveProperties:
            points = MacroState.zeros(1).with_parameters(parameters[None])
            given = dict(zip(names, parameters, strict=True))
            viscosity = float(given.get("viscosity", config.cell.viscosity))
            found = LinearisedLaw(law).coefficients(points).at(0)
            return EffectiveProperties.of(found, float(porosity(parameters[None])[0]), viscosity)

        return of

    def _adaptive(self, stack: ExitStack) -> tuple[RunLaw, AdaptiveLaw]:
        """Return the law that learns on the way, with its solves, and the same as what it is."""
        if self.config.cells:
            raise DataError(
                "the body has several cells, beyond whose sampled states none are solved; sample wider ranges"
            )
        run = law_of_cell(self.folder, stack, "fallback", store=self._store)
        assert isinstance(run.law, AdaptiveLaw)
        return run, run.law

    def extend(self, models: Sequence[ExperimentModel], values: Array) -> list[str]:
        """Solve cells where bodies with these values of the unknowns leave the sampled states; return their keys."""
        before = set(chain(*self.rounds))
        with ExitStack() as stack:
            run, learning = self._adaptive(stack)
            for model in models:
                units, name = model.config.result_units, model.experiment.name
                stack.enter_context(using_units(units))
                body, solver = model.body(values), make_backend("macro solver", model.config)
                problem, prepared = (
                    body.problem,
                    prepared_body(solver, model.config.macro_backend, body.problem),
                )
                law = with_memory(learning, model.config)
                title = f"further cells{f' of {name}' if name else ''}"
                progress = body_progress(self._console, title, problem, units, scale=body.scales.factor)
                with progress as (show, say):
                    run.tell_work(say)
                    body_solution_of(solver, prepared, law, problem, on_step=show)
        further = self._further()
        return [] if further is None else [key for key in further.keys if key not in before]

    def end_round(self, new: Sequence[str]) -> None:
        """Record the further cells of a round, by which it is finished."""
        write_json(self.folder.path / ROUNDS, [*self.rounds, [*new]])

    @property
    def solves(self) -> int:
        """Number of cells that were solved for the family, whether now or, by the store, for another study."""
        folder = self.folder
        count = 0
        for path in (folder.undeformed, folder.dataset, folder.test_dataset, folder.fallback):
            count += len(Dataset.open(path)) if path.exists() else 0
        return count


def families(
    plan: CalibrationPlan, out: Path, stack: ExitStack, console: Console, store: ResultStore | None
) -> list[FamilyCells]:
    """Return the families of a calibration, each in a folder below ``out`` that is held until ``stack`` ends.

    Experiments with the same cells, samples, surrogate and closure share one.

    Raises
    ------
    RunFolderError
        A folder holds other cells.
    """
    groups: dict[tuple[str, str, str], list[int]] = {}
    for k, experiment in enumerate(plan.experiments):
        config = experiment.config
        key = (config.stages.training, config.closure, config.conductivity)
        groups.setdefault(key, []).append(k)
    found = []
    for number, members in enumerate(groups.values()):
        config = plan.experiments[members[0]].config
        name = "cells" if len(groups) == 1 else f"cells-{number + 1}"
        folder = RunFolder.claim(out / name, config, resume=True)
        stack.enter_context(folder)
        names = [plan.experiments[k].name for k in members]
        found.append(FamilyCells(folder, config, names, console, store))
    return found


#: Factors of a larger load, tried in this order until the surrogate is trusted in the body.
LOADS = (10.0, 3.0, 1.5)
#: Size of a curve, a share of the largest one of its test, below which there is nothing to be measured.
NOTHING = 1e-6


def further_data(
    models: Sequence[ExperimentModel],
    plan: CalibrationPlan,
    values: Array,
    processes: CallProcesses | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> list[FurtherData]:
    """Return data of measurements that were not made, to be ranked beside those that were.

    Each test is computed once with all quantities, and once under a larger load if the surrogate is trusted there. The
    standard deviations are the same share of the largest value as those of the measured curves; where all of these are
    zero there is no such share, and nothing is proposed.

    Parameters
    ----------
    models
        Of all experiments.
    plan
        Has the measured curves.
    values : (k,)
        Best values.
    processes
        Compute the tests side by side; None: this process computes one after the other.
    tell
        Called with what is computed next.
    """
    shares = {experiment.name: _noise(experiment) for experiment in plan.experiments}
    calls = [
        (
            f"while it solved the experiment '{name}' under a larger load",
            (model, plan.unknowns, values, share),
        )
        for model in models
        if (share := shares[name := model.experiment.name]) is not None
    ]
    if processes is not None and len(calls) > 1:
        tell("other quantities and larger loads")
    return [data for one in side_by_side(processes, _further_of, calls, tell) for data in one]


def _further_of(
    tell: Tell, model: ExperimentModel, unknowns: Sequence[PlannedUnknown], values: Array, share: float
) -> list[FurtherData]:
    """Return the further data of a test; ``share`` is the deviation of a curve by its largest value."""
    test = model.experiment
    of = f" in the test '{test.name}'" if test.name else ""
    ones = [each.unknown for each in unknowns]
    by_coordinate = slopes_at(ones, [one.coordinate(float(x)) for one, x in zip(ones, values, strict=True)])

    def rows(experiment: Experiment, *, trusted: bool = False) -> list[tuple[str, Array]]:
        """Return name and weighted derivatives by the coordinates of each curve that does not stay zero.

        None are returned where the experiment cannot be computed, or only in states that are not ``trusted``.
        """
        curves = experiment.curves
        if not curves:
            return []
        try:
            # The steps in time are the same.
            variant = ExperimentModel(experiment, unknowns, model.law, model.chosen_steps)
            found = variant.curves(values)
        except SolveError:
            return []
        if trusted and found.flagged:
            return []
        sizes = [float(np.abs(each).max()) for each in by_curve(found.values, curves)]
        return [
            (curve.name, by * by_coordinate / (share * size))
            for curve, by, size in zip(curves, by_curve(found.slopes, curves), sizes, strict=True)
            if size > NOTHING * max(sizes)
        ]

    tell(f"other quantities{of}")
    further = [FurtherData(f"{words}{of}", each) for words, each in rows(_other_quantities(model))]
    if any(each.number.kind == "load" for each in model.numbers):
        return further
    tell(f"larger load{of}")
    for factor in LOADS:
        if larger := rows(replace(test, load=factor * test.load), trusted=True):
            name = f"the test '{test.name}'" if test.name else "the same test"
            words = f"{name} under {factor:g} times the load, too"
            every = np.concatenate([each for _, each in larger])
            # A square factor tells as much of the unknowns as very many rows.
            if len(every) > MANY_VALUES:
                every = np.asarray(np.linalg.qr(every, mode="r"))
            return [*further, FurtherData(words, every)]
    return further


def _noise(experiment: Experiment) -> float | None:
    """Return the standard deviation of the measured curves as a share of their largest values, that of the worst.

    Curves of zeros and components of films that show nothing do not count; None: there are no others.
    """
    sizes = [
        (c, float(np.abs(c.measured).max()))
        for c in experiment.curves
        if c.measured is not None and not c.is_noise
    ]
    return max((float(np.mean(c.deviations)) / size for c, size in sizes if size > 0), default=None)


def _other_quantities(model: ExperimentModel) -> Experiment:
    """Return the experiment with all quantities that were not measured, at the times of the first curve."""
    measured = {curve.series for curve in model.experiment.curves}
    first = _with_distinct_times(model.experiment.curves)
    curves = [
        replace(first, name=words, series=series, factor=1.0)
        for series, words in _quantities(model)
        if series not in measured
    ]
    return replace(model.experiment, curves=tuple(curves))


def _with_distinct_times(curves: Sequence[ObservedCurve]) -> ObservedCurve:
    """Return the first curve of a series, else one with the times of the first field."""
    first = next((curve for curve in curves if isinstance(curve.series, MeasuredSeries)), None)
    if first is not None:
        return first
    times = np.unique(curves[0].times)
    return replace(curves[0], times=times, weights=np.ones(len(times)), measured=None, spread=1.0)


def _quantities(model: ExperimentModel) -> Iterator[tuple[MeasuredSeries, str]]:
    yield MeasuredSeries("settlement"), "the settlement"
    yield MeasuredSeries("pressure"), f"the largest {model.config.macro.pressure}"
    yield MeasuredSeries("drained"), "the drained volume"
    for probe in model.config.macro.probes:
        yield (
            MeasuredSeries("pressure", probe=probe),
            f"the {model.config.macro.pressure} of the probe '{probe}'",
        )
        for i in (1, 2, 3):
            series = MeasuredSeries("displacement", probe=probe, component=i)
            yield series, f"the displacement {i} of the probe '{probe}'"
    for name, indenter in model.config.macro.contact.items():
        given = "displacement" if indenter.force is None else "force"
        for kind in OF_INDENTERS:
            is_round = indenter.touches_circle(section=model.config.macro.body.is_section)
            if kind != given and (kind != "contact_radius" or is_round):
                series = MeasuredSeries(kind, indenter=name)
                yield series, f"the {kind.replace('_', ' ')} of the indenter '{name}'"
