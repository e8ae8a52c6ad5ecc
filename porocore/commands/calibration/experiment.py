"""Curves of the experiments with their exact slopes (ExperimentModel, StudiesModel), at common steps.

With a modulus E, a viscosity μ_f and a cell of the edge d that are m, v and s times those of the study, the body is
the same in units of E and of the time μ_f L²/(E d²): its prescribed stresses are divided by m, its times by v/(m s²),
and so on, and its results are multiplied by these. So one surrogate serves all of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from typing import Any, get_args

import numpy as np

from porocore.commands.calibration.observations import HistoryInterpolation, by_curve, weights_of
from porocore.commands.calibration.plan import AXES, Experiment, PlannedUnknown, StudyNumber, occurrences
from porocore.commands.calibration.problem import CurveModel, CurvePrediction, Unknown
from porocore.core.models.bounds import MOST_TIMES
from porocore.core.models.strict import with_number
from porocore.core.parallel.calls import CallProcesses, Tell, side_by_side
from porocore.core.units import QUANTITIES, ExactScales, dimensions, using_units
from porocore.errors import ConfigurationError
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.sensitivities import (
    BoundaryChange,
    BoundaryQuantity,
    CellParameterChange,
    HistoryWeights,
    LoadChange,
    MacroChange,
    ModulusChange,
    ViscosityChange,
)
from porocore.interfaces.solution import MacroSolution
from porocore.macro.boundary.symmetry import part_weights, whole_sensitivities, whole_specimen
from porocore.macro.composition.fields import TableField
from porocore.macro.integration.stepping import Stepper
from porocore.macro.problem import MacroProblem, TimePlan
from porocore.plugins.border import body_gradients_of, body_sensitivities_of, body_solution_of
from porocore.states import Array
from porocore.study.config.config import MacroSettings, RunConfig
from porocore.study.run.composition import make_backend
from porocore.study.run.solving import prepared_body

#: Sections of the body whose numbers depend on modulus, viscosity and pore size; lengths do not.
SCALED = ("boundary", "body_force", "initial")


@dataclass(frozen=True)
class RelativeScales:
    """Modulus, viscosity and edge of the cell, as multiples of those of the study."""

    modulus: float = 1.0
    viscosity: float = 1.0
    pore: float = 1.0

    def factor(self, quantity: str) -> float:
        """Return the factor from a number in the units of these scales to that of the study."""
        if not quantity:
            return 1.0
        modulus, viscosity, pore = map(Fraction, (self.modulus, self.viscosity, self.pore))
        return float(QUANTITIES[quantity].factor(ExactScales(modulus, Fraction(1), pore, viscosity)))


def relative_scales(values: Mapping[StudyNumber, float]) -> RelativeScales:
    """Return the scales that the modulus, viscosity and edge among the values of numbers make."""
    found = {str(number.kind): value / number.value for number, value in values.items() if number.is_scale}
    return RelativeScales(**found)


@dataclass(frozen=True, eq=False)
class BodyAtValues:
    """Body of an experiment with certain values of its unknown numbers.

    Attributes
    ----------
    problem
        Of the part of a symmetric body that is solved, in the units of :attr:`scales`.
    scales
        Modulus, viscosity and pore size.
    shift
        Added to the times of the data, in the times of the study.
    """

    problem: MacroProblem
    scales: RelativeScales
    shift: float

    @classmethod
    def of_values(cls, config: RunConfig, load: float, values: Mapping[StudyNumber, float]) -> BodyAtValues:
        """Return the body with dimensionless values in place of the numbers of a study."""
        macro, scales, shift = config.macro, relative_scales(values), 0.0
        fields = {**macro.fields, **table_fields(values)}
        for number, value in values.items():
            if number.kind == "cell" and number.hat is None:
                fields[number.name] = value
            elif number.kind == "load":
                load = value
            elif number.kind == "time_shift":
                shift += value
            elif number.kind == "boundary":
                macro = with_number(macro, number.path, partial(_constant, value))
        macro = macro.model_copy(update={"fields": fields, "loads": (load,)})
        return cls(_scaled(macro, scales).problem(load), scales, shift)


def table_fields(values: Mapping[StudyNumber, float]) -> dict[str, TableField]:
    """Return the fields whose control values are among the values of numbers, by the names of the parameters."""
    tables: dict[str, list[tuple[float, float]]] = {}
    axes = {}
    for number, value in values.items():
        if number.hat is not None:
            tables.setdefault(number.name, []).append((number.hat.places[number.hat.index], value))
            axes[number.name] = AXES[number.hat.axis]
    return {
        name: TableField(kind="table", along=axes[name], table=tuple(sorted(table)))
        for name, table in tables.items()
    }


def _constant(value: float, _: float) -> float:
    return value


def _divided(factor: float, number: float) -> float:
    return number / factor


def _scaled(macro: MacroSettings, scales: RelativeScales) -> MacroSettings:
    """Return a body in the units of other scales."""
    if scales == RelativeScales():
        return macro
    scaled = macro
    for place, dimension in dimensions(type(macro), macro):
        value = place.value
        if place.path[:1] and place.path[0] in SCALED and dimension is not None and isinstance(value, float):
            factor = scales.factor(dimension.quantity)
            if value != 0 and factor != 1:
                scaled = with_number(scaled, place.path, partial(_divided, factor))
    time, factor = macro.time, scales.factor("time")
    plain = {name: getattr(time, name) / factor for name in ("end", "step", "ramp_step", "smallest_step")}
    lists = {
        "profiles": tuple(t / factor for t in time.profiles),
        "load_curve": tuple((t / factor, share) for t, share in time.load_curve),
    }
    return scaled.model_copy(update={"time": time.model_copy(update={**plain, **lists})})


def require_scalable(config: RunConfig, unknown: str) -> None:
    """Refuse formulas of a dimensionless time where the scale of time is unknown.

    Raises
    ------
    ConfigurationError
        A prescribed value or a parameter is a formula of t.
    """
    formulas = [f for f in config.macro.time_functions if f.expression is not None]
    entries = [*config.macro.fields.values()]
    entries += [entry for region in config.macro.regions.values() for entry in region.fields.values()]
    texts = [entry for entry in entries if isinstance(entry, str) and _of_time(entry)]
    if formulas or texts:
        formula = formulas[0].expression if formulas else texts[0]
        raise ConfigurationError(
            f"macro: the formula '{formula}' goes by a dimensionless time, whose unit changes with the unknown "
            f"'{unknown}'; give a table or a ramp in its place"
        )


def _of_time(formula: str) -> bool:
    return re.search(r"\bt\b", formula) is not None


def effect_of(number: StudyNumber, value: float, problem: MacroProblem) -> tuple[MacroChange, float] | None:
    """Return the change of a run under a number with this dimensionless value; None for a time shift.

    With it comes the factor from the derivative by the change to that by the value.
    """
    match number.kind:
        case "cell":
            return CellParameterChange(number.name, weight=number.hat), 1.0
        case "modulus":
            return ModulusChange(), 1 / value
        case "viscosity":
            return ViscosityChange(), 1 / value
        case "pore":  # The conductivity goes with d²/μ_f.
            return ViscosityChange(), -2 / value
        case "load":
            return LoadChange(), 1.0
        case "boundary":
            _, surface, key, *rest = number.path
            quantity = next(each for each in get_args(BoundaryQuantity) if each == key)
            component = next((int(part) for part in rest if part in "012"), 0)
            change = BoundaryChange(surface, quantity, component)
            if rest and rest[-1] == "ramp":  # The derivative is by the factor of the function of time.
                return change, 1 / value
            # The number in the part of a symmetric body that is solved, in the units of the run.
            found = dict(problem.boundary[surface])[key]
            for each in rest:
                found = found[int(each)]
            return change, float(found) / value
    return None


#: A step nearer than this share of its length to the time of a datum is left out, but for kinks of the loads.
NEAR = 0.5
#: Differences of curves whose steps are halved again and again fall by 1/2 each time for steps of the first order. A
#: ratio beyond this is one of steps that are far too long, of which nothing is known but that they are.
HALF, MOST_RATIO = 0.5, 0.8


def planned_times(problem: MacroProblem) -> Array:
    """Return the times of all steps of a plan without an error control, none of which fails."""
    stepper = Stepper(problem.time.model_copy(update={"tolerance": None}), problem.corners)
    times = []
    while not stepper.done:
        stepper.accept()
        times.append(stepper.time)
    return np.array(times)


def with_fixed_steps(
    problem: MacroProblem, data: Array, chosen: Callable[[], Array], hit: bool = True
) -> TimePlan:
    """Return the time plan of an experiment with steps that do not depend on the unknowns.

    Parameters
    ----------
    problem
        With the time plan of the study.
    data : (m,)
        Times of the data.
    chosen
        Returns the steps that an error control takes at the first values; asked only where there is one.
    hit
        Whether steps end at the times of the data.

    Raises
    ------
    ConfigurationError
        There are too many steps.
    """
    plan = problem.time
    steps = planned_times(problem) if plan.tolerance is None else chosen()
    steps = steps[steps > 0]
    if hit:
        steps = _meeting(steps, np.unique(data[(data > 0) & (data <= plan.end)]), _kinks(problem))
    if len(steps) > MOST_TIMES:
        raise ConfigurationError(
            f"macro.time: an experiment of a calibration takes at most {MOST_TIMES} steps, got {len(steps)}; "
            "give a longer 'step:'"
        )
    profiles = tuple(float(t) for t in steps[steps < plan.end])
    return plan.model_copy(update={"tolerance": None, "step": plan.end, "profiles": profiles})


def with_halved_steps(problem: MacroProblem, halvings: int) -> TimePlan:
    """Return the time plan with each step cut into 2^halvings equal ones, for a plan whose steps are fixed."""
    times = np.concatenate([[0.0], planned_times(problem)])
    parts = 2**halvings
    shares = np.arange(parts) / parts
    cut = (times[:-1, None] + np.diff(times)[:, None] * shares).ravel()
    return problem.time.model_copy(update={"profiles": tuple(float(t) for t in cut[1:])})


def error_of_steps(curves: Sequence[Array], deviations: Array) -> Array:
    """Return the error (m,) of the first of some curves, each with half the steps of the one before.

    The differences of neighbours are taken to go on falling by the ratio of the last two; of a single difference, by
    that of backward Euler steps.

    Parameters
    ----------
    curves : (m,) each
        Two or more.
    deviations : (m,)
        Standard deviations of the values, by which differences are compared.
    """
    differences = np.diff(np.stack(curves), axis=0)
    sizes = np.linalg.norm(differences / deviations, axis=1)
    ratio = HALF
    if len(sizes) > 1 and sizes[-2] > 0:
        ratio = min(float(sizes[-1] / sizes[-2]), MOST_RATIO)
    return np.asarray(-differences.sum(axis=0) - differences[-1] * ratio / (1 - ratio))


def _kinks(problem: MacroProblem) -> Array:
    """Return the times that every run hits: increments of the ramp, kinks of the loads, the end."""
    plan = problem.time
    stepper = Stepper(plan.model_copy(update={"tolerance": None}), problem.corners)
    increments = [k * plan.ramp_step for k in range(1, plan.ramp_increments + 1)]
    return np.array([*stepper.kinks, *increments, plan.end])


def _meeting(steps: Array, data: Array, kinks: Array) -> Array:
    """Return steps that end at the times of the data, and nowhere near them but at kinks of the loads."""
    if not len(data):
        return steps
    lengths = np.diff(steps, prepend=0.0)
    away = np.abs(steps[:, None] - data).min(axis=1)
    corner = np.abs(steps[:, None] - kinks).min(axis=1) <= 1e-9 * lengths
    kept = steps[(away > NEAR * lengths) | corner]
    merged = np.union1d(kept, data)
    # Two that round-off alone parts are one.
    distinct = np.diff(merged, prepend=-1.0) > 1e-9 * merged
    return np.asarray(merged[distinct])


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
        self.numbers = occurrences(unknowns, experiment)
        self._count = len(unknowns)
        for each in self.numbers:
            if each.number.is_scale:
                require_scalable(experiment.config, unknowns[each.index].unknown.name)
        self._solver: MacroSolver = make_backend("macro solver", experiment.config)
        if not type(self._solver).sensitivities:
            raise ConfigurationError(
                f"macro.backend: the macro solver '{experiment.config.macro_backend}' gives no sensitivities, which a "
                "calibration needs; choose another, such as skfem"
            )
        first = np.array([one.unknown.start for one in unknowns])
        #: Steps that an error control has taken at the first values; None: there is none.
        self.chosen_steps: Array | None = None
        self.config = self._with_fixed_steps(first, steps)

    def _with_fixed_steps(self, first: Array, steps: Array | None) -> RunConfig:
        """Return the study with the steps that it has at the first values of the unknowns."""
        config = self.experiment.config

        def chosen() -> Array:
            found = steps
            if found is None:
                body = BodyAtValues.of_values(config, self.experiment.load, self._values_of(first))
                prepared = prepared_body(self._solver, config.macro_backend, body.problem)
                solution = body_solution_of(self._solver, prepared, self.law, body.problem)
                found = np.asarray(solution.history.time * body.scales.factor("time"))
            self.chosen_steps = found
            return found

        own = config.macro.problem(self.experiment.load)
        data = np.concatenate([curve.times for curve in self.experiment.curves])
        shifted = any(each.number.kind == "time_shift" for each in self.numbers)
        with using_units(config.result_units):
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
        with using_units(self.config.result_units):
            body, solution, _ = self.solve(values)
        return np.concatenate([unit * at.values(series) for unit, at, series in self._series(body, solution)])

    def _values_of(self, values: Array) -> dict[StudyNumber, float]:
        return {each.number: each.value(values) for each in self.numbers}

    def body(self, values: Array) -> BodyAtValues:
        """Return the body for values (k,) of the unknowns."""
        return BodyAtValues.of_values(self.config, self.experiment.load, self._values_of(values))

    def solve(
        self, values: Array, changes: Sequence[MacroChange] = ()
    ) -> tuple[BodyAtValues, MacroSolution, Array]:
        """Return body, solution of the whole specimen, and the derivatives (m, c) of all curves by some changes.

        They are those of the values of the series, in the units of the run, for values (k,) of the unknowns.
        """
        body, solver, curves = self.body(values), self._solver, self.experiment.curves
        problem, prepared = body.problem, prepared_body(solver, self.config.macro_backend, body.problem)
        count = sum(map(len, curves))
        if not changes:
            plain = body_solution_of(solver, prepared, self.law, problem)
            return body, whole_specimen(plain, problem), np.zeros((count, 0))
        if type(solver).gradients and len(changes) > BACKWARDS + count / 2:
            weights = partial(self._weights, body)
            back, by = body_gradients_of(solver, prepared, self.law, problem, changes, weights)
            return body, whole_specimen(back, problem), by
        solution, found = body_sensitivities_of(solver, prepared, self.law, problem, changes)
        found = whole_sensitivities(replace(found, changes=tuple(changes)), problem)
        whole = self._whole(solution, body)
        pairs = zip(curves, self._places(body, solution), strict=True)
        return body, whole, np.concatenate([at.values(curve.series.slopes(found)) for curve, at in pairs])

    def _whole(self, solution: MacroSolution, body: BodyAtValues) -> MacroSolution:
        """Return the solution of the whole specimen, which has all series that were measured."""
        whole = whole_specimen(solution, body.problem)
        for curve in self.experiment.curves:
            curve.series.values(whole)
        return whole

    def _places(self, body: BodyAtValues, solution: MacroSolution) -> list[HistoryInterpolation]:
        """Return the places of the data of each curve among the steps."""
        steps = solution.history.time * body.scales.factor("time")
        return [HistoryInterpolation.at(steps, curve.times + body.shift) for curve in self.experiment.curves]

    def _series(
        self, body: BodyAtValues, whole: MacroSolution
    ) -> Iterator[tuple[float, HistoryInterpolation, Array]]:
        """Yield the factor to the unit of each curve, the places of its data, and its series (steps,) of the run."""
        for curve, at in zip(self.experiment.curves, self._places(body, whole), strict=True):
            unit = curve.factor * body.scales.factor(curve.series.quantity)
            yield unit, at, curve.series.values(whole)

    def _weights(self, body: BodyAtValues, solution: MacroSolution) -> HistoryWeights:
        """Return the weights of the histories of the part that is solved in each datum."""
        self._whole(solution, body)
        curves, steps = self.experiment.curves, len(solution.history.time)
        data = by_curve(np.eye(sum(map(len, curves))), curves)
        places = zip(self._places(body, solution), data, strict=True)
        found = [at.weights(steps) @ own for at, own in places]
        return part_weights(weights_of([curve.series for curve in curves], found), body.problem)

    def _effects(self, values: Array, body: BodyAtValues) -> dict[int, tuple[MacroChange, float]]:
        """Return by the position of an unknown the change that it makes, and the factor to its derivative."""
        found = {}
        for each in self.numbers:
            effect = effect_of(each.number, each.value(values), body.problem)
            if effect is not None:
                found[each.index] = effect[0], effect[1] * each.factor
        return found

    def dependence(self, values: Array) -> Array:
        """Return the derivatives (n, k) of all that the body knows of the unknowns, whatever is measured in it.

        A move of the unknowns along which they are zero changes nothing, in no curve and under no load.
        """
        effects = self._effects(values, self.body(values))
        rows = {change: np.zeros(self._count) for change, _ in effects.values()}
        for j, (change, factor) in effects.items():
            rows[change][j] = factor
        clocks = [np.eye(self._count)[each.index] for each in self.numbers if each.index not in effects]
        return np.reshape([*rows.values(), *clocks], (-1, self._count))

    def curves(self, values: Array) -> CurvePrediction:
        """Return the curves of the experiment for values (k,) of the unknowns, in the units of the data.

        Raises
        ------
        SolveError
            The body cannot be computed there.
        """
        with using_units(self.config.result_units):
            effects = self._effects(values, self.body(values))
            changes = [*dict.fromkeys(change for change, _ in effects.values())]
            body, solution, derivatives = self.solve(values, changes)
        rows, slopes = [], []
        parts = by_curve(derivatives, self.experiment.curves)
        for (unit, at, series), part in zip(self._series(body, solution), parts, strict=True):
            rows.append(unit * at.values(series))
            mine, by = np.zeros((len(part), self._count)), unit * part
            for j, (change, factor) in effects.items():
                mine[:, j] = factor * by[:, changes.index(change)]
            for each in self.numbers:
                if each.number.kind == "time_shift":
                    mine[:, each.index] = unit * each.factor * at.rates(series)
            slopes.append(mine)
        flagged = bool((solution.history.flagged > 0).any())
        return CurvePrediction(np.concatenate(rows), np.concatenate(slopes), flagged)


class StudiesModel(CurveModel):
    """Curves of several experiments.

    Parameters
    ----------
    unknowns
        All unknowns.
    experiments
        A model of each experiment.
    processes
        Solve the experiments side by side; None: this process solves one after the other.
    """

    def __init__(
        self,
        unknowns: Sequence[Unknown],
        experiments: Sequence[ExperimentModel],
        processes: CallProcesses | None = None,
    ) -> None:
        self.unknowns, self.experiments = tuple(unknowns), tuple(experiments)
        self._processes = processes

    def curves(self, values: Array) -> CurvePrediction:
        """Return the curves; see :class:`~porocore.commands.calibration.problem.CurveModel`."""
        found: list[CurvePrediction] = self._each(_curves, values)
        return CurvePrediction(
            np.concatenate([each.values for each in found]),
            np.concatenate([each.slopes for each in found]),
            any(each.flagged for each in found),
        )

    def with_halved_steps(self, values: Array, halvings: int) -> list[Array]:
        """Return the curves of each experiment without slopes, each step in time cut into 2^halvings.

        Raises
        ------
        SolveError
            An experiment cannot be computed with these steps.
        """
        return self._each(_halved, values, halvings)

    def _each(self, function: Callable[..., Any], *arguments: Any) -> list[Any]:
        """Return what a function of each experiment returns, side by side where there are processes."""
        calls = [
            (f"while it solved the experiment '{one.experiment.name}'", (one, *arguments))
            for one in self.experiments
        ]
        return side_by_side(self._processes, function, calls)


def _curves(tell: Tell, model: ExperimentModel, values: Array) -> CurvePrediction:
    return model.curves(values)


def _halved(tell: Tell, model: ExperimentModel, values: Array, halvings: int) -> Array:
    return model.halved(halvings).values(values)
