"""Rounds of a fit: where the fitted body leaves the states that are trusted, further cells are solved."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from porocore.calibration.fit.quality import FitQuality, at_bounds
from porocore.calibration.fit.record import EvaluationRecord, RecordedModel
from porocore.calibration.fit.search import CalibrationFit, fit
from porocore.calibration.folder import CalibrationFolder
from porocore.calibration.forward.cells import FamilyCells
from porocore.calibration.forward.experiment import ExperimentModel
from porocore.calibration.forward.model import StudiesModel
from porocore.calibration.forward.steps import error_of_steps
from porocore.calibration.plan import CalibrationPlan
from porocore.calibration.problem import CurveData, CurveModel, CurvePrediction, Fitted, Misfit
from porocore.core.console import Console
from porocore.core.echo import reason
from porocore.core.files.plain_data import json_hash, write_json
from porocore.core.files.reading import read_json, set_aside
from porocore.core.parallel.calls import CallProcesses
from porocore.errors import RunFolderError
from porocore.states import Array

#: With a reduced chi-square above this, no further cells are solved: beyond its samples a surrogate is not that wrong.
HOPELESS = 100.0
#: Where the data are not explained, the cells of a round must make the reduced chi-square smaller by this factor.
LESS = 0.5


class LazyModel(CurveModel):
    """Model that is made when curves are first asked for, which a record may make needless."""

    def __init__(self, plan: CalibrationPlan, make: Callable[[], StudiesModel]) -> None:
        self.unknowns = tuple(each.unknown for each in plan.unknowns)
        self._make = make
        self._made: StudiesModel | None = None

    @property
    def made(self) -> StudiesModel:
        """The model, made at its first use."""
        if self._made is None:
            self._made = self._make()
        return self._made

    def curves(self, values: Array) -> CurvePrediction:
        """Return the curves; see :class:`~porocore.calibration.problem.CurveModel`."""
        return self.made.curves(values)


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
        self._last = min(family.rounds for family in cells)
        for family in cells:
            family.keep_rounds(self._last)
        self.round = 0
        #: True where no further cells are solved because the data are not explained, for which they are no remedy.
        self.given_up = False
        self._begin()

    def _begin(self) -> None:
        """Open the record of the present round."""
        known = [family.identity_after(self.round) for family in self.cells]
        identity = json_hash([experiments_identity(self.plan), *known])
        self.record = EvaluationRecord(self.folder.evaluations(self.round), identity)
        self._lazy = LazyModel(self.plan, self._made)
        self.model = RecordedModel(self._lazy, self.record)
        if len(self.record):
            self.console.note(f"fit: {len(self.record)} evaluations are known")

    def _made(self) -> StudiesModel:
        if self.round < self._last:
            raise RunFolderError(
                f"{self.record.path} lacks evaluations that led to further cells; start again in another --out"
            )
        models = {}
        for family in self.cells:
            law = family.law()
            for experiment in self.plan.experiments:
                if experiment.name in family.experiments:
                    steps = self._known_steps().get(experiment.name)
                    known = None if steps is None else np.array(steps, dtype=float)
                    models[experiment.name] = ExperimentModel(experiment, self.plan.unknowns, law, known)
                    self._keep_steps(experiment.name, models[experiment.name])
        return StudiesModel(
            [each.unknown for each in self.plan.unknowns],
            [models[experiment.name] for experiment in self.plan.experiments],
            self.processes,
        )

    def _known_steps(self) -> dict[str, list[float]]:
        path = self.folder.steps
        try:
            return dict(read_json(path)) if path.exists() else {}
        except (OSError, ValueError, TypeError) as error:
            raise RunFolderError(
                f"{path} is damaged ({reason(error)}); {set_aside(path, 'start again')}"
            ) from error

    def _keep_steps(self, name: str, model: ExperimentModel) -> None:
        known = self._known_steps()
        if model.chosen_steps is not None and name not in known:
            write_json(self.folder.steps, {**known, name: model.chosen_steps.tolist()})

    @property
    def experiments(self) -> Sequence[ExperimentModel]:
        """Models of all experiments with the cells of the present round."""
        return self._lazy.made.experiments

    def dependence(self, misfit: Misfit, coordinates: Array) -> Array:
        """Return the derivatives (n, k), by the coordinates, of all that the experiments know of the unknowns."""
        values = misfit.values(coordinates)
        rows = np.concatenate([one.dependence(values) for one in self.experiments])
        slopes = [one.value_slope(float(x)) for one, x in zip(misfit.unknowns, coordinates, strict=True)]
        return np.asarray(rows * np.array(slopes))

    def error_of_steps(self, misfit: Misfit, best: Fitted, halvings: int) -> Array:
        """Return the error (m,) of the curves at a point that is owed to the steps in time, over their deviations.

        It is estimated from runs whose steps are halved so many times.

        Raises
        ------
        SolveError
            An experiment cannot be computed with halved steps.
        """
        values, deviations = misfit.values(best.coordinates), misfit.data.deviations
        known = self._known_halved(values)
        with self.console.task("error of the steps in time", "halvings") as task:
            while len(known) < halvings:
                task.update(len(known), halvings)
                each = self._lazy.made.with_halved_steps(values, len(known) + 1)
                known.append(np.concatenate(each).tolist())
                kept = {"of": self.record.identity, "unknowns": values.tolist(), "curves": known}
                write_json(self.folder.halved_steps, kept)
            task.update(halvings, halvings)
        curves = [best.prediction.values, *map(np.array, known[:halvings])]
        ends = np.cumsum([sum(map(len, one.curves)) for one in self.plan.experiments])[:-1]
        parts = zip(*(np.split(each, ends) for each in curves), np.split(deviations, ends), strict=True)
        return np.concatenate([error_of_steps(part, by) / by for *part, by in parts])

    def _known_halved(self, values: Array) -> list[list[float]]:
        """Return the curves with halved steps at these values that the folder holds."""
        path = self.folder.halved_steps
        try:
            found = dict(read_json(path)) if path.exists() else {}
            same = (found.get("of"), found.get("unknowns")) == (self.record.identity, values.tolist())
            return list(found["curves"]) if same else []
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise RunFolderError(
                f"{path} is damaged ({reason(error)}); {set_aside(path, 'start again')}"
            ) from error

    def fitted(self, data: CurveData) -> tuple[Misfit, CalibrationFit]:
        """Return misfit and fit of the last round.

        Where no values explain the data, that is said before further cells are solved. None are where they would be of
        no use: the fitted body is then not that of the experiment.

        Raises
        ------
        SolveError
            The experiments can be computed at none of the starts.
        """
        misfit = Misfit(self.model, data)
        found = fit(misfit, self.plan.fit, self.console)
        before = HOPELESS / LESS
        while True:
            quality, bounds = FitQuality.of_fit(misfit, found.best), at_bounds(misfit, found.best.coordinates)
            for complaint in filter(None, (quality.complaint, *bounds)):
                self.console.warn(f"fit: {complaint}")
            if not found.best.prediction.flagged or self.round >= self.plan.fit.rounds:
                break
            self.given_up = not quality.explains and (bool(bounds) or quality.reduced > LESS * before)
            if self.given_up:
                self.console.warn(
                    "fit: the fitted body leaves the states that the surrogate is trusted in; no further cells are "
                    "solved there, since they would not explain the data"
                )
                break
            if not self._extended(misfit.values(found.best.coordinates)):
                break
            before = quality.reduced
            misfit = Misfit(self.model, data)
            found = fit(misfit, self.plan.fit, self.console, [found.best.coordinates])
        return misfit, found

    def _extended(self, values: Array) -> bool:
        """Solve further cells around the body at these values; return False where there are none to be solved."""
        if self.round >= self._last:
            self.console.note(
                "fit: the fitted body leaves the states that the surrogate is trusted in; further cells are solved "
                "there"
            )
            models = self._lazy.made.experiments
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


def experiments_identity(plan: CalibrationPlan) -> str:
    """Return the hash of all that the curves depend on, beside cells and values of the unknowns."""
    experiments = [
        [
            one.name,
            one.config.stages.macro,
            None if one.config.scales is None else one.config.scales.model_dump(),
            one.load,
            [[repr(c.series), c.times.tolist(), c.unit, c.factor] for c in one.curves],
        ]
        for one in plan.experiments
    ]
    unknowns = [
        [each.unknown.name, each.unknown.unit, each.unknown.start, repr(sorted(each.numbers.items()))]
        for each in plan.unknowns
    ]
    return json_hash([experiments, unknowns])
