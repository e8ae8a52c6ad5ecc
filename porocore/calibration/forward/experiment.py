"""Curves of one experiment with their exact slopes (ExperimentModel), by one run with sensitivities."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import partial

import numpy as np

from porocore.calibration.config.numbers import StudyNumber
from porocore.calibration.forward.changes import UnknownEffect, effect_of
from porocore.calibration.forward.setup import BodyAtValues, require_scalable
from porocore.calibration.forward.steps import with_fixed_steps, with_halved_steps
from porocore.calibration.observations.interpolation import HistoryInterpolation
from porocore.calibration.observations.series import weights_of
from porocore.calibration.plan import Experiment, PlannedUnknown
from porocore.calibration.problem import CurvePrediction
from porocore.core.units.results import speaking
from porocore.errors import ConfigurationError
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.sensitivities import HistoryWeights, MacroChange
from porocore.interfaces.solution import MacroSolution
from porocore.macro.boundary.symmetry import part_weights, whole_sensitivities, whole_specimen
from porocore.plugins.border import body_gradients_of, body_sensitivities_of, body_solution_of
from porocore.states import Array
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig
from porocore.study.stages.solving import prepared_body

#: Derivatives by more unknowns than this and half as many as there are data are found by a pass backwards. For the
#: column of the benchmark the ratios to a run without are 1.8 + 0.073 unknowns, and 2.25 + 0.038 data the other way.
BACKWARDS = 6


class ExperimentModel:
    """Model of one experiment.

    Parameters
    ----------
    experiment
        Its study, load and curves.
    unknowns
        All unknowns of the calibration, k of them.
    law
        Of the family of its cells.
    steps
        Times of the steps that an error control has taken before; None: they are found.

    Raises
    ------
    ConfigurationError
        The macro solver gives no sensitivities, or a formula goes by a time whose scale is unknown.
    SolveError
        The error control fails at the first values.
    """

    def __init__(
        self,
        experiment: Experiment,
        unknowns: Sequence[PlannedUnknown],
        law: MacroLaw,
        steps: Array | None = None,
    ) -> None:
        self.experiment, self.law = experiment, law
        #: Position of each unknown that belongs to the experiment, its number, and the factor to dimensionless values.
        self.numbers: list[tuple[int, StudyNumber, float]] = [
            (j, each.numbers[experiment.name], each.dimensionless(experiment))
            for j, each in enumerate(unknowns)
            if experiment.name in each.numbers
        ]
        self._count = len(unknowns)
        for j, number, _ in self.numbers:
            if number.kind in ("modulus", "viscosity", "pore"):
                require_scalable(experiment.config, unknowns[j].unknown.name)
        self._solver: MacroSolver = make_backend("macro solver", experiment.config)
        if not type(self._solver).sensitivities:
            raise ConfigurationError(
                f"macro.backend: the macro solver '{experiment.config.macro_backend}' gives no sensitivities, which a "
                "calibration needs; choose another, such as skfem"
            )
        first = np.array([each.unknown.start for each in unknowns])
        #: Steps that an error control has taken at the first values; None: there is none.
        self.chosen_steps: Array | None = None
        self.config = self._with_fixed_steps(first, steps)

    def _with_fixed_steps(self, first: Array, steps: Array | None) -> RunConfig:
        """Return the study with the steps that it has at the first values of the unknowns."""
        config = self.experiment.config
        body = BodyAtValues.of_values(config, self.experiment.load, self._values_of(first))

        def chosen() -> Array:
            found = steps
            if found is None:
                prepared = prepared_body(self._solver, config, body.problem)
                solution = body_solution_of(self._solver, prepared, self.law, body.problem)
                found = np.asarray(solution.history.time * body.scales.factor("time"))
            self.chosen_steps = found
            return found

        own = config.macro.problem(self.experiment.load)
        data = np.concatenate([curve.times for curve in self.experiment.curves])
        shifted = any(number.kind == "time_shift" for _, number, _ in self.numbers)
        with speaking(config.result_units):
            plan = with_fixed_steps(own, data, chosen, hit=not shifted)
        return config.model_copy(update={"macro": config.macro.model_copy(update={"time": plan})})

    def halved(self, halvings: int) -> ExperimentModel:
        """Return the model with each step cut into 2^halvings, which shows the error of the steps."""
        macro, made = self.config.macro, copy(self)
        plan = with_halved_steps(macro.problem(self.experiment.load), halvings)
        made.config = self.config.model_copy(update={"macro": macro.model_copy(update={"time": plan})})
        return made

    def values(self, values: Array) -> Array:
        """Return the curves (m,) alone, without their slopes; see :meth:`curves`."""
        with speaking(self.config.result_units):
            body, solution, _ = self.solve(values)
        places = self._places(values, body, solution)
        return np.concatenate(
            [
                curve.factor
                * body.scales.factor(curve.series.quantity)
                * at.values(curve.series.values(solution))
                for curve, at in zip(self.experiment.curves, places, strict=True)
            ]
        )

    def _values_of(self, values: Array) -> dict[StudyNumber, float]:
        return {number: float(values[j]) * factor for j, number, factor in self.numbers}

    def body(self, values: Array) -> BodyAtValues:
        """Return the body for values (k,) of the unknowns."""
        return BodyAtValues.of_values(self.config, self.experiment.load, self._values_of(values))

    def solve(
        self, values: Array, changes: Sequence[MacroChange] = ()
    ) -> tuple[BodyAtValues, MacroSolution, Array]:
        """Return body, solution of the whole specimen, and the derivatives (m, c) of all curves by some changes.

        They are those of the values of the series, in the units of the run, for values (k,) of the unknowns.
        """
        body, solver = self.body(values), self._solver
        problem, prepared = body.problem, prepared_body(solver, self.config, body.problem)
        count = sum(map(len, self.experiment.curves))
        if not changes:
            plain = body_solution_of(solver, prepared, self.law, problem)
            return body, whole_specimen(plain, problem), np.zeros((count, 0))
        if type(solver).gradients and len(changes) > BACKWARDS + count / 2:
            weights = partial(self._weights, values, body)
            back, by = body_gradients_of(solver, prepared, self.law, problem, changes, weights)
            return body, whole_specimen(back, problem), by
        solution, found = body_sensitivities_of(solver, prepared, self.law, problem, changes)
        found = whole_sensitivities(replace(found, changes=tuple(changes)), problem)
        whole = self._whole(solution, body)
        pairs = zip(self.experiment.curves, self._places(values, body, solution), strict=True)
        rows = [at.values(curve.series.slopes(found)) for curve, at in pairs]
        return body, whole, np.concatenate(rows)

    def _whole(self, solution: MacroSolution, body: BodyAtValues) -> MacroSolution:
        """Return the solution of the whole specimen, which has all series that were measured."""
        whole = whole_specimen(solution, body.problem)
        for curve in self.experiment.curves:
            curve.series.values(whole)
        return whole

    def _places(
        self, values: Array, body: BodyAtValues, solution: MacroSolution
    ) -> list[HistoryInterpolation]:
        """Return the places of the data of each curve among the steps."""
        steps = solution.history.time * body.scales.factor("time")
        shift = sum(v for number, v in self._values_of(values).items() if number.kind == "time_shift")
        return [HistoryInterpolation.at(steps, curve.times + shift) for curve in self.experiment.curves]

    def _weights(self, values: Array, body: BodyAtValues, solution: MacroSolution) -> HistoryWeights:
        """Return the weights of the histories of the part that is solved in each datum."""
        self._whole(solution, body)
        steps, found, first = len(solution.history.time), list[Array](), 0
        count = sum(map(len, self.experiment.curves))
        for at in self._places(values, body, solution):
            own = at.weights(steps)
            found.append(np.zeros((steps, count)))
            found[-1][:, first : first + own.shape[1]] = own
            first += own.shape[1]
        whole = weights_of([curve.series for curve in self.experiment.curves], found)
        return part_weights(whole, body.problem)

    def _effects(self, values: Array, body: BodyAtValues) -> dict[int, UnknownEffect]:
        found = {}
        for j, number, factor in self.numbers:
            effect = effect_of(number, float(values[j]) * factor, body)
            if effect is not None:
                found[j] = UnknownEffect(effect.change, effect.factor * factor)
        return found

    def dependence(self, values: Array) -> Array:
        """Return the derivatives (n, k) of all that the body knows of the unknowns, whatever is measured in it.

        A move of the unknowns along which they are zero changes nothing, in no curve and under no load.
        """
        effects = self._effects(values, self.body(values))
        rows = {effect.change: np.zeros(self._count) for effect in effects.values()}
        for j, effect in effects.items():
            rows[effect.change][j] = effect.factor
        clocks = [np.eye(self._count)[j] for j, _, _ in self.numbers if j not in effects]
        return np.reshape([*rows.values(), *clocks], (-1, self._count))

    def curves(self, values: Array) -> CurvePrediction:
        """Return the curves of the experiment for values (k,) of the unknowns, in the units of the data.

        Raises
        ------
        SolveError
            The body cannot be computed there.
        """
        effects = self._effects(values, self.body(values))
        changes = [*dict.fromkeys(effect.change for effect in effects.values())]
        with speaking(self.config.result_units):
            body, solution, derivatives = self.solve(values, changes)
        rows, slopes, first = [], [], 0
        for curve, at in zip(self.experiment.curves, self._places(values, body, solution), strict=True):
            unit = curve.factor * body.scales.factor(curve.series.quantity)
            series = curve.series.values(solution)
            rows.append(unit * at.values(series))
            mine = np.zeros((len(curve), self._count))
            by, first = unit * derivatives[first : first + len(curve)], first + len(curve)
            for j, effect in effects.items():
                mine[:, j] = effect.factor * by[:, changes.index(effect.change)]
            for j, number, factor in self.numbers:
                if number.kind == "time_shift":
                    mine[:, j] = unit * factor * at.rates(series)
            slopes.append(mine)
        flagged = bool((solution.history.outside_training_range > 0).any())
        return CurvePrediction(np.concatenate(rows), np.concatenate(slopes), flagged)
