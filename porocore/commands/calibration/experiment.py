"""Curves of the experiments with their exact slopes (ExperimentModel, StudiesModel), at common steps.

With a modulus E, a viscosity μ_f and a cell of the edge d that are m, v and s times those of the study, the body is
the same in units of E and of the time μ_f L²/(E d²): its prescribed stresses are divided by m, its times by v/(m s²),
and so on, and its results are multiplied by these. So one surrogate serves all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from typing import Any, cast, get_args

import numpy as np

from porocore.commands.calibration.clouds import CAMERA_PARTS, CloudView, CloudViews, FilmComponent
from porocore.commands.calibration.interpolation import HistoryInterpolation
from porocore.commands.calibration.observations import MeasuredSeries, by_curve, weights_of
from porocore.commands.calibration.plan import (
    Experiment,
    NumberKind,
    PlannedUnknown,
    StudyNumber,
    occurrences,
    with_indenter,
)
from porocore.commands.calibration.problem import CurveModel, CurvePrediction, Unknown
from porocore.core.formulas import TimeFunction
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
    HatFunction,
    HistoryWeights,
    IndenterChange,
    LoadChange,
    MacroChange,
    MacroSensitivities,
    ModulusChange,
    ViscosityChange,
)
from porocore.interfaces.solution import MacroSolution
from porocore.macro.body.points import BodyPoints
from porocore.macro.boundary.symmetry import part_weights, whole_sensitivities, whole_specimen
from porocore.macro.composition.fields import AxesField, FactoredField, FormulaField, GridField, as_field
from porocore.macro.integration.stepping import Stepper
from porocore.macro.laws.charges import DENSITY
from porocore.macro.problem import MacroProblem, TimePlan
from porocore.plugins.border import body_gradients_of, body_sensitivities_of, body_solution_of
from porocore.states import Array
from porocore.study.config.config import MacroSettings, RunConfig
from porocore.study.run.composition import make_backend
from porocore.study.run.solving import prepared_body

#: Named rates that go by stresses as multiples of the modulus.
BY_MODULUS = ("growth",)
#: Sections of the body whose numbers depend on modulus, viscosity and pore size; lengths do not.
SCALED = ("boundary", "contact", "body_force", "initial", "fields", "regions", "charges", "evolution")


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
        one, of = Fraction(1), QUANTITIES[quantity].factor
        modulus, viscosity, pore = map(Fraction, (self.modulus, self.viscosity, self.pore))
        return float(of(ExactScales(modulus, one, pore, viscosity)) / of(ExactScales(one, one, one, one)))


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
    cameras
        Unknown parts (6,) of the places of cameras, by the names of the clouds.
    """

    problem: MacroProblem
    scales: RelativeScales
    shift: float
    cameras: Mapping[str, Array]

    @classmethod
    def of_values(cls, config: RunConfig, load: float, values: Mapping[StudyNumber, float]) -> BodyAtValues:
        """Return the body with dimensionless values in place of the numbers of a study."""
        macro, scales, shift = config.macro, relative_scales(values), 0.0
        cameras: dict[str, Array] = {}
        fields = {**macro.fields, **control_fields(values)}
        for number, value in values.items():
            if number.kind == "cell" and number.hat is None:
                fields[number.name] = value
            elif number.kind == "load":
                load = value
            elif number.kind == "time_shift":
                shift += value
            elif number.kind == "camera":
                cloud, part = map(str, number.path)
                cameras.setdefault(cloud, np.zeros(6))[CAMERA_PARTS.index(part)] += value
            elif number.kind == "boundary":
                macro = with_number(macro, number.path, partial(_constant, value))
            elif number.kind == "indenter":
                macro = with_indenter(macro, number, value)
        macro = macro.model_copy(update={"fields": fields, "loads": (load,)})
        unit = scales.factor("time")
        relaxations = {
            name: None if each is None else each.in_times_of(unit)
            for name, each in config.relaxations.items()
        }
        problem = _scaled(macro, scales).problem(load).with_law_numbers(relaxations)
        return cls(_with_numbers_of_the_law(problem, scales, values), scales, shift, cameras)


def _with_numbers_of_the_law(
    problem: MacroProblem, scales: RelativeScales, values: Mapping[StudyNumber, float]
) -> MacroProblem:
    """Return a problem in units of other scales with dimensionless values in place of numbers of its law."""
    fields: dict[str, Any] = {**problem.fields}
    factor, density = scales.factor("concentration"), fields.get(DENSITY)
    if factor != 1 and density is not None and not isinstance(density, float):
        # The numbers of a field have no unit by which they were scaled.
        fields[DENSITY] = FactoredField(field=as_field(density), factor=1 / factor)
    for number, value in values.items():
        if number.kind == "law":
            fields[number.name] = value / scales.factor(number.quantity)
        elif number.kind == "law_field":
            fields[number.name] = FactoredField(field=as_field(fields[number.name]), factor=value)
    return problem.model_copy(update={"fields": fields})


def control_fields(values: Mapping[StudyNumber, float]) -> dict[str, GridField]:
    """Return the fields whose control values are among the values of numbers, by the names of the parameters."""
    nodes: dict[str, dict[HatFunction, float]] = {}
    for number, value in values.items():
        if number.hat is not None:
            nodes.setdefault(number.name, {})[number.hat] = value
    return {name: _control_field(found) for name, found in nodes.items()}


def _control_field(nodes: Mapping[HatFunction, float]) -> GridField:
    """Return the field with the values of all nodes of one grid."""
    one = next(iter(nodes))
    lines = dict(zip(one.axes, one.places, strict=True))
    values = tuple(nodes[hat] for hat in HatFunction.grid(lines))
    x, y, z = (lines.get(axis) for axis in range(3))
    return GridField(kind="grid", x=x, y=y, z=z, values=values)


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


def require_scalable(config: RunConfig, unknown: str, kind: NumberKind) -> None:
    """Refuse formulas of dimensionless numbers whose units change with an unknown.

    Parameters
    ----------
    config
        The study.
    unknown, kind
        Name of the unknown, and what it is: modulus, viscosity or pore size.

    Raises
    ------
    ConfigurationError
        A prescribed value or a parameter is a formula of t, or the rate of a parameter is a formula, or goes by a
        multiple of the unknown modulus.
    """
    for name, evolution in config.macro.evolution.items():
        if evolution.rate is not None:
            raise ConfigurationError(
                f"macro.evolution.{name}.rate: the formula goes by dimensionless numbers, whose units change with the "
                f"unknown '{unknown}'; give a named law in its place"
            )
        if kind == "modulus" and evolution.law in BY_MODULUS:
            raise ConfigurationError(
                f"macro.evolution.{name}.law: the rate of '{evolution.law}' goes by multiples of the modulus, the "
                f"unknown '{unknown}', so that its constants mean something else at each value; fix the modulus"
            )
    formulas = [f.expression for f in config.macro.time_functions if f.expression is not None]
    charges = config.macro.charges
    entries: list[Any] = [*config.macro.fields.values()]
    if charges is not None:
        entries.append(charges.density)
        courses = (bath for bath in charges.baths.values() if isinstance(bath, TimeFunction))
        formulas += [course.expression for course in courses if course.expression is not None]
    entries += [entry for region in config.macro.regions.values() for entry in region.fields.values()]
    formulas += filter(None, map(_formula_of_time, entries))
    if formulas:
        raise ConfigurationError(
            f"macro: the formula '{formulas[0]}' goes by a dimensionless time, whose unit changes with the unknown "
            f"'{unknown}'; give a table or a ramp in its place"
        )


def _formula_of_time(entry: Any) -> str | None:
    """Return the formula of time by which an entry of a body's fields changes; None: by none."""
    if isinstance(entry, AxesField):
        return None
    field = as_field(entry)
    if field.over is not None and field.over.expression is not None:
        return field.over.expression
    return field.formula if isinstance(field, FormulaField) and field.by_formula else None


def effect_of(number: StudyNumber, value: float, body: BodyAtValues) -> tuple[MacroChange, float] | None:
    """Return the change of a body under a number with this dimensionless value; None for a clock or a camera.

    With it comes the factor from the derivative by the change to that by the value.
    """
    problem = body.problem
    match number.kind:
        case "law":
            return CellParameterChange(number.name), 1 / body.scales.factor(number.quantity)
        case "law_field":
            return CellParameterChange(number.name, factor=True), 1 / value
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
        case "indenter":
            _, name, key = number.path
            return IndenterChange(name, "radius" if key == "radius" else "offset"), 1.0
        case "boundary" if number.path[0] == "contact":
            _, name, key, *rest = number.path
            motion = IndenterChange(name, "force" if key == "force" else "displacement")
            given = problem.contact[name].motion
            # As below.
            return motion, 1 / value if rest else float(cast("float", given)) / value
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


@dataclass(frozen=True, eq=False)
class SeenSeries:
    """A series of a run at the times of its data.

    Attributes
    ----------
    measured
        Which series.
    at
        Places of the data among the steps.
    series : (steps,)
        Of the run.
    """

    measured: MeasuredSeries
    at: HistoryInterpolation
    series: Array

    @property
    def values(self) -> Array:
        """Values (m,) at the times of the data."""
        return self.at.values(self.series)

    @property
    def rates(self) -> Array:
        """Derivatives (m,) of the values by the time."""
        return self.at.rates(self.series)

    def slopes(self, found: MacroSensitivities) -> Array:
        """Return the derivatives (m, k) by the unknowns of the run."""
        return self.at.values(self.measured.slopes(found))

    def weights(self, given: Array) -> Array:
        """Return the weights (steps, f) of the series in sums over the data, which weigh (m, f)."""
        return np.asarray(self.at.weights(len(self.series)) @ given)


@dataclass(frozen=True, eq=False)
class SeenField:
    """A component of the fields of a run at the points and times of its data.

    Attributes
    ----------
    measured
        Which component, and where.
    view
        Cloud of points in the run.
    """

    measured: FilmComponent
    view: CloudView

    @property
    def values(self) -> Array:
        """Values (m,) at the times of the data."""
        return self.measured.of_points(self.view.values(self.measured.component))

    @property
    def rates(self) -> Array:
        """Derivatives (m,) of the values by the time."""
        return self.measured.of_points(self.view.rates(self.measured.component))

    def slopes(self, found: MacroSensitivities) -> Array:
        """Return the derivatives (m, k) by the unknowns of the run."""
        return self.measured.of_points(self.view.slopes(self.measured.component, found))

    def weights(self, given: Array) -> Array:
        """Return the weights (profiles, unknowns, f) of the nodal fields in sums over the data, which weigh (m, f)."""
        return self.view.weights(self.measured.component, self.measured.to_points(given))

    def by_camera(self, part: str) -> Array:
        """Return the derivatives (m,) by an unknown part of the place of the camera."""
        by = self.view.by_camera(self.measured.component)
        return self.measured.of_points(by[:, CAMERA_PARTS.index(part)])


Seen = SeenSeries | SeenField


@dataclass(frozen=True, eq=False)
class SolvedExperiment:
    """Run of an experiment.

    Attributes
    ----------
    body
        What was solved.
    solution
        Of the whole specimen.
    seen
        What was measured, each curve in the solution.
    slopes : (m, c)
        Derivatives of the values of all curves, or gradients of sums over them, by c changes, in the units of the run.
    """

    body: BodyAtValues
    solution: MacroSolution
    seen: Sequence[Seen]
    slopes: Array


def sum_weights(seen: Sequence[Seen], given: Sequence[Array]) -> HistoryWeights:
    """Return the weights of the histories and fields of a whole specimen in f sums over data, which weigh (m, f)."""
    series = [
        (each.measured, each.weights(own))
        for each, own in zip(seen, given, strict=True)
        if isinstance(each, SeenSeries)
    ]
    fields = [each.weights(own) for each, own in zip(seen, given, strict=True) if isinstance(each, SeenField)]
    count = given[0].shape[1]
    found = (
        weights_of([one for one, _ in series], [each for _, each in series])
        if series
        else HistoryWeights(count)
    )
    return replace(found, profiles=sum(fields[1:], fields[0])) if fields else found


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
                require_scalable(experiment.config, unknowns[each.index].unknown.name, each.number.kind)
        self._solver: MacroSolver = make_backend("macro solver", experiment.config)
        if not type(self._solver).sensitivities:
            raise ConfigurationError(
                f"macro.backend: the macro solver '{experiment.config.macro_backend}' gives no sensitivities, which a "
                "calibration needs; choose another, such as skfem"
            )
        first = np.array([one.unknown.start for one in unknowns])
        fields = [curve.series for curve in experiment.curves if isinstance(curve.series, FilmComponent)]
        self._clouds = {each.cloud.name: each.cloud for each in fields}
        #: Where the points of clouds were found last.
        self._near: dict[str, list[BodyPoints]] = {}
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
            found = self.solve(values)
            pairs = zip(self._units(found.body), found.seen, strict=True)
            return np.concatenate([unit * each.values for unit, each in pairs])

    def _values_of(self, values: Array) -> dict[StudyNumber, float]:
        return {each.number: each.value(values) for each in self.numbers}

    def body(self, values: Array) -> BodyAtValues:
        """Return the body for values (k,) of the unknowns."""
        return BodyAtValues.of_values(self.config, self.experiment.load, self._values_of(values))

    def solve(self, values: Array, changes: Sequence[MacroChange] = ()) -> SolvedExperiment:
        """Return the run for values (k,) of the unknowns, with the derivatives of all curves by some changes."""
        body, solver, curves = self.body(values), self._solver, self.experiment.curves
        problem, prepared = body.problem, prepared_body(solver, self.config.macro_backend, body.problem)
        count = sum(map(len, curves))
        if not changes:
            plain = whole_specimen(body_solution_of(solver, prepared, self.law, problem), problem)
            return SolvedExperiment(body, plain, self._seen(body, plain), np.zeros((count, 0)))
        if type(solver).gradients and len(changes) > BACKWARDS + count / 2:
            return self.solve_back(values, changes, lambda seen: by_curve(np.eye(count), curves))
        solution, found = body_sensitivities_of(
            solver, prepared, self.law, problem, changes, profiles=bool(self._clouds)
        )
        found = whole_sensitivities(replace(found, changes=tuple(changes)), problem)
        whole = whole_specimen(solution, problem)
        seen = self._seen(body, whole)
        return SolvedExperiment(body, whole, seen, np.concatenate([each.slopes(found) for each in seen]))

    def solve_back(
        self,
        values: Array,
        changes: Sequence[MacroChange],
        given: Callable[[Sequence[Seen]], Sequence[Array]],
    ) -> SolvedExperiment:
        """Return the run for values (k,) of the unknowns, with the gradients (f, c) of f sums over the data.

        They are found by one pass back over the steps, which costs as much for any number of changes.

        Parameters
        ----------
        values
            Of the unknowns.
        changes
            By which the gradients are.
        given
            Returns the weights (m, f) of the values of each curve, which may depend on these.
        """
        body, solver = self.body(values), self._solver
        problem, prepared = body.problem, prepared_body(solver, self.config.macro_backend, body.problem)
        kept: list[Seen] = []

        def weights(solution: MacroSolution) -> HistoryWeights:
            kept[:] = self._seen(body, whole_specimen(solution, problem))
            return part_weights(sum_weights(kept, given(kept)), problem)

        solution, by = body_gradients_of(solver, prepared, self.law, problem, changes, weights)
        return SolvedExperiment(body, whole_specimen(solution, problem), kept, by)

    def _seen(self, body: BodyAtValues, whole: MacroSolution) -> list[Seen]:
        """Return what was measured, each curve in the solution of the whole specimen.

        Raises
        ------
        ConfigurationError
            The solution has no such probe, surface or force.
        """
        to_study = body.scales.factor("time")
        views = CloudViews(self._clouds, whole, to_study, body.shift, body.cameras, self._near)
        steps, found = whole.history.time * to_study, list[Seen]()
        for curve in self.experiment.curves:
            if isinstance(curve.series, FilmComponent):
                found.append(SeenField(curve.series, views[curve.series.cloud.name]))
            else:
                at = HistoryInterpolation.at(steps, curve.times + body.shift)
                found.append(SeenSeries(curve.series, at, curve.series.values(whole)))
        return found

    def _units(self, body: BodyAtValues) -> list[float]:
        """Return the factors from results of the run to the unit of each curve."""
        curves = self.experiment.curves
        return [curve.factor * body.scales.factor(curve.series.quantity) for curve in curves]

    def _effects(self, values: Array, body: BodyAtValues) -> dict[int, tuple[MacroChange, float]]:
        """Return by the position of an unknown the change that it makes, and the factor to its derivative."""
        found = {}
        for each in self.numbers:
            effect = effect_of(each.number, each.value(values), body)
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
            found = self.solve(values, changes)
        rows, slopes = [], []
        parts = by_curve(found.slopes, self.experiment.curves)
        for unit, seen, part in zip(self._units(found.body), found.seen, parts, strict=True):
            rows.append(unit * seen.values)
            mine, by = np.zeros((len(part), self._count)), unit * part
            for j, (change, factor) in effects.items():
                mine[:, j] = factor * by[:, changes.index(change)]
            for each in self.numbers:
                mine[:, each.index] += unit * each.factor * _beside(each.number, seen)
            slopes.append(mine)
        flagged = bool((found.solution.history.flagged > 0).any())
        return CurvePrediction(np.concatenate(rows), np.concatenate(slopes), flagged)

    def gradient(self, values: Array, given: Callable[[Array], Array]) -> tuple[Array, Array]:
        """Return the curves (m,) for values (k,) of the unknowns, and the gradient (k,) of one sum over them.

        One run and one pass back over its steps find it, whatever the number of unknowns and data. The slopes of the
        single values, which a search by least squares needs, are not found.

        Parameters
        ----------
        values
            Of the unknowns.
        given
            Returns the weights (m,) of the values (m,) of all curves in the sum, in the units of the data; with the
            residuals over the variances the sum is that of which half the sum of squares has the gradient.

        Raises
        ------
        SolveError
            The body cannot be computed there.
        """
        curves, kept = self.experiment.curves, list[Array]()
        with using_units(self.config.result_units):
            body = self.body(values)
            effects, units = self._effects(values, body), self._units(body)
            changes = [*dict.fromkeys(change for change, _ in effects.values())]

            def weights(seen: Sequence[Seen]) -> list[Array]:
                of_curves = [unit * each.values for unit, each in zip(units, seen, strict=True)]
                kept[:] = [np.concatenate(of_curves), *by_curve(given(np.concatenate(of_curves)), curves)]
                return [unit * part[:, None] for unit, part in zip(units, kept[1:], strict=True)]

            found = self.solve_back(values, changes, weights)
        gradient = np.zeros(self._count)
        for j, (change, factor) in effects.items():
            gradient[j] = factor * found.slopes[0, changes.index(change)]
        for unit, seen, part in zip(units, found.seen, kept[1:], strict=True):
            for each in self.numbers:
                if each.index not in effects:
                    gradient[each.index] += unit * each.factor * np.sum(part * _beside(each.number, seen))
        return kept[0], gradient


def _beside(number: StudyNumber, seen: Seen) -> Array | float:
    """Return the derivatives (m,) of data by a number that a run does not depend on: a clock, or a camera's place."""
    if number.kind == "time_shift":
        return seen.rates
    if number.kind == "camera" and isinstance(seen, SeenField):
        cloud, part = map(str, number.path)
        return seen.by_camera(part) if seen.measured.cloud.name == cloud else 0.0
    return 0.0


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
