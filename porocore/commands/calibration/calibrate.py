"""Calibration of one or more studies (calibrate): cells, rounds of the fit (FitRounds), intervals, report."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from porocore.commands.calibration.cells import FamilyCells, families, further_data
from porocore.commands.calibration.clouds import FilmComponent, PointCloud
from porocore.commands.calibration.derived import derived_cells
from porocore.commands.calibration.expectations import start_notes
from porocore.commands.calibration.experiment import ExperimentModel, SeenField, StudiesModel, error_of_steps
from porocore.commands.calibration.films import outside_note, require_few_outside
from porocore.commands.calibration.fit import (
    CalibrationFit,
    FitQuality,
    RecordedModel,
    at_bounds,
    far_from_start,
    fit,
)
from porocore.commands.calibration.infer import Inference, infer
from porocore.commands.calibration.loading import at_points, read_document, read_plan
from porocore.commands.calibration.observations import ObservedCurve, by_curve, curve_data
from porocore.commands.calibration.plan import CalibrationFolder, CalibrationPlan
from porocore.commands.calibration.posterior import Posterior, sample_posterior
from porocore.commands.calibration.problem import (
    CurveData,
    CurveModel,
    Fitted,
    Misfit,
    first_coordinates,
    slopes_at,
    values_at,
)
from porocore.commands.calibration.results import Calibration, results_of, write_tables
from porocore.commands.calibration.suggestions import shift_words
from porocore.core.console import Console
from porocore.core.echo import joined
from porocore.core.files.plain_data import json_hash, json_ready, write_json
from porocore.core.files.reading import complete, read_json
from porocore.core.files.store import ResultStore
from porocore.core.files.yaml_document import YamlDocument
from porocore.core.parallel.calls import CallProcesses
from porocore.core.parallel.memory import one_blas_thread
from porocore.core.units import using_units
from porocore.errors import RunFolderError, SolveError
from porocore.macro.problem import body_mesh
from porocore.states import Array
from porocore.study.notes.checks import check_backends
from porocore.study.store import chosen_store


def calibrate(
    source: Path | str | Mapping[str, Any],
    out: Path | str,
    *,
    synthetic: bool = False,
    resume: bool = False,
    progress: bool = True,
    store: ResultStore | str | Path | bool = True,
) -> Calibration:
    """Find the unknowns of one or more studies from measured curves, and their identifiability.

    The cells between the bounds are sampled and learned once. Every evaluation is kept in the folder, so that a call
    that was interrupted goes on with ``resume`` to the same answer.

    Parameters
    ----------
    source
        A study with a section ``calibration:``, a file with ``unknowns:`` and ``experiments:``, or settings nested as
        in one.
    out
        Folder of the results.
    synthetic
        Generate synthetic data: curves at the start values of the unknowns, with noise of their standard deviations.
    resume
        Continue what the folder holds.
    progress
        Show progress on standard error.
    store
        As for :class:`porocore.Study`.

    Raises
    ------
    ConfigurationError
        Configuration or data are faulty; each fault on a line of its own.
    RunFolderError
        The folder holds something else, or this calibration while ``resume`` is not set.
    SolveError
        The experiments can be computed at none of the starts.
    """
    began = time.monotonic()
    console = Console.shown(progress)
    document = read_document(source)
    plan = read_plan(document, synthetic=synthetic)
    for experiment in plan.experiments:
        check_backends(experiment.config)
    folder = CalibrationFolder(Path(out), _identity(plan, synthetic), resume=resume)
    for note in plan.notes:
        console.note(note)
    with one_blas_thread(), folder, ExitStack() as stack:
        cells = families(plan, folder.path, stack, console, chosen_store(store))
        for family in cells:
            family.learn()
        if not synthetic:
            plan = _with_points_inside(plan, cells, folder.path, console, document)
        count = min(len(plan.experiments), plan.experiments[0].config.sampling.worker_count())
        processes = stack.enter_context(CallProcesses(count)) if count > 1 else None
        rounds = FitRounds(plan, folder, cells, console, processes)
        if synthetic:
            plan = rounds.plan = _with_made_up_data(plan, rounds.model)
        else:
            for note in start_notes(plan, rounds.model):
                console.warn(note)
        rounds.fit(curve_data(plan.curves))
        inference = rounds.with_error_of_steps(rounds.infer(), synthetic)
        posterior, quality = rounds.posterior(inference), FitQuality.of_fit(rounds.misfit, inference.best)
        done = Calibration(
            folder.path,
            plan,
            rounds.misfit.data,
            inference,
            quality,
            posterior,
            derived_cells(inference, plan, cells),
            sum(family.solves for family in cells),
            len(rounds.model),
            time.monotonic() - began,
            tuple(rounds.warnings(inference, quality, posterior)),
            np.array([each.unknown.start for each in plan.unknowns]) if synthetic else None,
        )
        from porocore.commands.calibration.page import write_report  # matplotlib is slow to import

        write_tables(done, rounds.model)
        write_report(done)
        # Last, so that a folder with results has all of them.
        entries = json_ready(results_of(done))
        write_json(folder.path / "calibration.json", entries, indent=2, ensure_ascii=False)
        for warning in done.warnings:
            console.warn(warning)
        return done


def _identity(plan: CalibrationPlan, synthetic: bool) -> dict[str, str]:
    """Return the hashes of all that the answer depends on, by what they are of; the data of each curve by its file."""
    return {
        "studies": _studies_identity(plan),
        **{f"data of {_source(curve)}": json_hash([_contents(curve), synthetic]) for curve in plan.curves},
        "unknowns": json_hash([repr(each.unknown) for each in plan.unknowns]),
        "settings of the fit": json_hash(plan.fit.model_dump()),
    }


def _source(curve: ObservedCurve) -> str:
    return f"'{curve.name}'" if curve.file is None else f"'{curve.name}' ({curve.file.name})"


def _contents(curve: ObservedCurve) -> list[Any]:
    """Return all that a fit takes from a curve."""
    measured = None if curve.measured is None else curve.measured.tolist()
    return [_place(curve), measured, _listed(curve.spread), curve.share, curve.weights.tolist()]


def _listed(spread: float | Array | None) -> float | list[float] | None:
    # The text of a long array leaves out its middle.
    return spread.tolist() if isinstance(spread, np.ndarray) else spread


def _with_made_up_data(plan: CalibrationPlan, model: CurveModel) -> CalibrationPlan:
    """Return the plan with curves at the start values of the unknowns, and noise."""
    # At the coordinates where the search begins, to the last bit, so that this run is not made twice.
    starts = values_at(model.unknowns, first_coordinates(model.unknowns))
    try:
        exact = model.curves(starts).values
    except SolveError as error:
        at = ", ".join(f"{one.name} {value:g}" for one, value in zip(model.unknowns, starts, strict=True))
        raise SolveError(
            f"no synthetic data can be computed at the start values of the unknowns, {at}; give "
            f"other bounds, or a 'start:' for each: {error}"
        ) from error
    pairs = enumerate(zip(plan.curves, by_curve(exact, plan.curves), strict=True))
    curves = iter([curve.made_up(part, [plan.fit.seed, number]) for number, (curve, part) in pairs])
    experiments = [replace(one, curves=tuple(islice(curves, len(one.curves)))) for one in plan.experiments]
    return replace(plan, experiments=tuple(experiments))


def _with_points_inside(
    plan: CalibrationPlan, cells: Sequence[FamilyCells], path: Path, console: Console, document: YamlDocument
) -> CalibrationPlan:
    """Return the plan without points that lie outside the deformed body at the start values of the unknowns.

    Raises
    ------
    ConfigurationError
        They are too many.
    """
    file, starts = path / "points.json", np.array([each.unknown.start for each in plan.unknowns])
    with complete(file, "record of points", "start again"):
        known = dict(read_json(file)) if file.exists() else {}
    experiments = []
    for one in plan.experiments:
        fields = [curve.series for curve in one.curves if isinstance(curve.series, FilmComponent)]
        clouds = {each.cloud.name: each.cloud for each in fields if not each.is_reference}
        if clouds and one.name not in known:
            laws = next(family.laws() for family in cells if one.name in family.experiments)
            seen = ExperimentModel(one, plan.unknowns, laws(one.config)).solve(starts).seen
            views = {each.view.cloud.name: each.view for each in seen if isinstance(each, SeenField)}
            mesh, lost = body_mesh(one.config.macro), dict[str, list[int]]()
            with using_units(one.config.result_units):
                for name, cloud in clouds.items():
                    outside = ~views[name].counting
                    with at_points(document, one.name, name.removeprefix(f"{one.name}: ")):
                        require_few_outside(cloud, outside, mesh, f"'{name}'", "")
                    lost[name] = np.flatnonzero(outside).tolist()
            known[one.name] = lost
            write_json(file, known)
        curves = one.curves
        for name, cloud in clouds.items():
            if rows := known[one.name][name]:
                console.note(f"{name}: {outside_note(len(rows), cloud)}")
                curves = tuple(_without_points(curve, cloud, rows) for curve in curves)
        experiments.append(replace(one, curves=curves))
    return replace(plan, experiments=tuple(experiments))


def _without_points(curve: ObservedCurve, cloud: PointCloud, lost: Sequence[int]) -> ObservedCurve:
    """Return a curve without some points of a cloud."""
    if not isinstance(curve.series, FilmComponent) or curve.series.cloud.name != cloud.name:
        return curve
    kept = np.ones(len(cloud), dtype=bool)
    kept[lost] = False
    series, left = curve.series.without(cloud.kept(kept), kept)
    spread = curve.spread[left] if isinstance(curve.spread, np.ndarray) else curve.spread
    measured = None if curve.measured is None else curve.measured[left]
    return replace(
        curve, series=series, times=curve.times[left], weights=curve.weights[left], measured=measured,
        spread=spread,
    )  # fmt: skip


def _experiments_identity(plan: CalibrationPlan) -> str:
    """Return the hash of all that the curves depend on, beside cells and values of the unknowns."""
    return json_hash([_studies_identity(plan), [_place(curve) for curve in plan.curves]])


def _place(curve: ObservedCurve) -> list[Any]:
    """Return what a curve is of, its times and its units, for a hash."""
    return [repr(curve.series), curve.times.tolist(), curve.unit, curve.factor]


def _studies_identity(plan: CalibrationPlan) -> str:
    """Return the hash of the studies and of the numbers in them that are unknown."""
    experiments = [
        [
            one.name,
            one.config.stages.macro,
            None if one.config.scales is None else one.config.scales.model_dump(),
            one.load,
        ]
        for one in plan.experiments
    ]
    unknowns = [
        [each.unknown.name, each.unknown.unit, each.unknown.start, repr(sorted(each.numbers.items()))]
        for each in plan.unknowns
    ]
    return json_hash([experiments, unknowns])


#: With a reduced chi-square above this, no further cells are solved: beyond its samples a surrogate is not that wrong.
HOPELESS = 100.0
#: Where the data are not explained, the cells of a round must make the reduced chi-square smaller by this factor.
LESS = 0.5


class FitRounds:
    """Models of the rounds of a calibration, each with the cells that are known then.

    Parameters
    ----------
    plan
        Of the calibration.
    folder
        Keeps evaluations and time steps.
    cells
        Families of the experiments, learned.
    console
        Shows the progress.
    processes
        Solve experiments side by side; None: there are none.
    """

    def __init__(
        self,
        plan: CalibrationPlan,
        folder: CalibrationFolder,
        cells: Sequence[FamilyCells],
        console: Console,
        processes: CallProcesses | None = None,
    ) -> None:
        self.processes = processes
        self.plan, self.folder, self.cells, self.console = plan, folder, tuple(cells), console
        self._last = min(len(family.rounds) for family in cells)
        for family in cells:
            family.keep_rounds(self._last)
        self.round = 0
        #: Misfit and fit of the last round, once it is made.
        self.misfit: Misfit
        self.found: CalibrationFit
        #: True where no further cells are solved because the data are not explained, for which they are no remedy.
        self.given_up = False
        self._begin()

    def _begin(self) -> None:
        """Open the record of the present round."""
        known = [family.identity(self.round) for family in self.cells]
        identity = json_hash([_experiments_identity(self.plan), *known])
        unknowns = [each.unknown for each in self.plan.unknowns]
        path = self.folder.path / f"evaluations-{self.round}.jsonl"
        self._studies: StudiesModel | None = None
        self.model = RecordedModel(unknowns, lambda: self.studies, path, identity)
        if len(self.model):
            self.console.note(f"fit: {len(self.model)} evaluations are known")

    @property
    def studies(self) -> StudiesModel:
        """Models of all experiments with the cells of the present round, made at their first use."""
        if self._studies is not None:
            return self._studies
        if self.round < self._last:
            raise RunFolderError(
                f"{self.model.path} lacks evaluations that led to further cells; start again in another --out"
            )
        path, models = self.folder.path / "steps.json", dict[str, ExperimentModel]()
        with complete(path, "record of time steps", "start again"):
            steps = dict(read_json(path)) if path.exists() else {}
        for family in self.cells:
            law_of = family.laws()
            for experiment in self.plan.experiments:
                if (name := experiment.name) in family.experiments:
                    known = np.array(steps[name], dtype=float) if name in steps else None
                    models[name] = ExperimentModel(
                        experiment, self.plan.unknowns, law_of(experiment.config), known
                    )
                    if name not in steps and (chosen := models[name].chosen_steps) is not None:
                        steps[name] = chosen.tolist()
                        write_json(path, steps)
        experiments = [models[experiment.name] for experiment in self.plan.experiments]
        self._studies = StudiesModel(self.model.unknowns, experiments, self.processes)
        return self._studies

    def dependence(self, coordinates: Array) -> Array:
        """Return the derivatives (n, k), by the coordinates, of all that the experiments know of the unknowns."""
        values = self.misfit.values(coordinates)
        rows = np.concatenate([one.dependence(values) for one in self.studies.experiments])
        return np.asarray(rows * slopes_at(self.misfit.unknowns, coordinates))

    def error_of_steps(self, best: Fitted, halvings: int) -> Array:
        """Return the error (m,) of the curves at a point that is owed to the steps in time, over their deviations.

        It is estimated from runs whose steps are halved so many times.

        Raises
        ------
        SolveError
            An experiment cannot be computed with halved steps.
        """
        values, deviations = self.misfit.values(best.coordinates), self.misfit.data.deviations
        known = self._known_halved(values)
        with self.console.task("error of the steps in time", "halvings") as task:
            while len(known) < halvings:
                task.update(len(known), halvings)
                each = self.studies.with_halved_steps(values, len(known) + 1)
                known.append(np.concatenate(each).tolist())
                kept = {"of": self.model.identity, "unknowns": values.tolist(), "curves": known}
                write_json(self.folder.path / "halved-steps.json", kept)
            task.update(halvings, halvings)
        curves = [best.prediction.values, *map(np.array, known[:halvings])]
        ends = np.cumsum([sum(map(len, one.curves)) for one in self.plan.experiments])[:-1]
        parts = zip(*(np.split(each, ends) for each in (*curves, deviations)), strict=True)
        return np.concatenate([error_of_steps(part, by) / by for *part, by in parts])

    def _known_halved(self, values: Array) -> list[list[float]]:
        """Return the curves with halved steps at these values that the folder holds."""
        path = self.folder.path / "halved-steps.json"
        with complete(path, "record of halved steps", "start again"):
            found = dict(read_json(path)) if path.exists() else {}
            same = (found.get("of"), found.get("unknowns")) == (self.model.identity, values.tolist())
            return list(found["curves"]) if same else []

    def fit(self, data: CurveData) -> None:
        """Fit the unknowns; in further rounds with further cells where the fitted body leaves the sampled states.

        Where no values explain the data, that is said before further cells are solved. None are where they would be of
        no use: the fitted body is then not that of the experiment.

        Raises
        ------
        SolveError
            The experiments can be computed at none of the starts.
        """
        first: list[Array] | None = None
        before = HOPELESS / LESS
        while True:
            self.misfit = Misfit(self.model, data)
            self.found = fit(self.misfit, self.plan.fit, self.console, first)
            best = self.found.best
            quality = FitQuality.of_fit(self.misfit, best)
            bounds = at_bounds(self.misfit, best.coordinates, explained=quality.explains)
            for complaint in filter(None, (quality.complaint, *bounds)):
                self.console.warn(f"fit: {complaint}")
            if not best.prediction.flagged or self.round >= self.plan.fit.rounds:
                return
            self.given_up = not quality.explains and (bool(bounds) or quality.reduced > LESS * before)
            if self.given_up:
                self.console.warn(
                    "fit: the fitted body leaves the states that the surrogate is trusted in; no further cells are "
                    "solved there, since they would not explain the data"
                )
                return
            if not self._extended(self.misfit.values(best.coordinates)):
                return
            first, before = [best.coordinates], quality.reduced

    def _extended(self, values: Array) -> bool:
        """Solve further cells around the body at these values; return False where there are none to be solved."""
        if self.round >= self._last:
            self.console.note(
                "fit: the fitted body leaves the states that the surrogate is trusted in; further cells are solved "
                "there"
            )
            models = self.studies.experiments
            new = [
                family.extend([one for one in models if one.experiment.name in family.experiments], values)
                for family in self.cells
            ]
            self.console.note(f"fit: {sum(map(len, new))} further cells")
            if not any(new):
                return False
            for family, keys in zip(self.cells, new, strict=True):
                family.end_round(keys)
            self._last = self.round + 1
        self.round += 1
        self._begin()
        return True

    def infer(self) -> Inference:
        """Return what the data say, with progress."""
        asked, total = 0, 2 * len(self.plan.unknowns) + 3
        with self.console.task("intervals", "ends") as task:

            def tell(words: str) -> None:
                nonlocal asked
                task.update(min(asked, total), total, detail=words)
                asked += 1

            values = self.misfit.values(self.found.best.coordinates)
            return infer(
                self.misfit,
                self.found.best,
                dependence=self.dependence,
                rule=self.plan.rule,
                further=further_data(self.studies.experiments, self.plan, values, self.processes, tell),
                rays=self.plan.fit.rays,
                tell=tell,
            )

    def with_error_of_steps(self, inference: Inference, synthetic: bool) -> Inference:
        """Return the statements with the error of the steps in time, which the intervals hold unless it is small.

        Synthetic data have the same error, which then shifts nothing; it is reported for the planned test.
        """
        try:
            once = inference.with_error(self.error_of_steps(inference.best, 1), not synthetic)
            assert once.systematic is not None
            if synthetic or once.systematic.is_small:
                return once
            # How fast the error falls says how large it is; it is asked only where that counts.
            return inference.with_error(self.error_of_steps(inference.best, 2))
        except SolveError as error:
            self.console.warn(f"the error of the steps in time is not known: {error}")
            return inference

    def posterior(self, inference: Inference) -> Posterior | None:
        """Return draws from the posterior distribution where the plan wants them, with progress."""
        if self.plan.posterior is None:
            return None
        with self.console.task("posterior", "per cent") as task:

            def tell(words: str, share: float) -> None:
                task.update(int(100 * share), 100, detail=words)

            found = sample_posterior(self.misfit, inference.points, inference.best, self.plan.posterior, tell)
            task.update(100, 100, detail="")
        return found

    def warnings(
        self, inference: Inference, quality: FitQuality, posterior: Posterior | None
    ) -> Iterator[str]:
        """Yield sentences on what is to be doubted."""
        if quality.complaint:
            yield quality.complaint
        if not self.found.converged:
            most = self.plan.fit.evaluations
            yield f"the fit has not converged after {most} evaluations a start; raise fit.evaluations"
        if inference.best.prediction.flagged:
            yield "the fitted body leaves the states that the surrogate is trusted in; " + (
                "no further cells were solved there, since they would not explain the data"
                if self.given_up
                else "sample wider ranges, or raise fit.rounds"
            )
        if unmoved := self.misfit.unmoved(inference.best):
            yield (
                f"no unknown changes {joined(unmoved)}, which may be prescribed by the study; leave it out, or fit "
                "another quantity"
            )
        error = inference.systematic
        if error is not None and error.counted:
            yield (
                "the steps in time are long for these data: in the limit of short steps "
                f"{shift_words(inference.unknowns, inference.best.coordinates, error)}. The intervals include them. "
                "A quarter of macro.time.tolerance, or half of macro.time.step where there is none, halves the error"
            )
        yield from at_bounds(self.misfit, inference.best.coordinates, explained=quality.explains)
        yield from far_from_start(self.misfit, inference.best.coordinates)
        yield from () if posterior is None else posterior.complaints
