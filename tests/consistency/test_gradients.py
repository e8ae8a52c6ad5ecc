"""Gradients of sums over the histories, by one pass backwards, against sensitivities and central differences."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.errors import ConfigurationError
from porocore.interfaces.sensitivities import (
    HISTORY_SERIES,
    BoundaryChange,
    CellParameterChange,
    HatFunction,
    HistoryWeights,
    InitialPressureChange,
    LoadChange,
    ModulusChange,
    ViscosityChange,
)
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.composed import BoundLaw, RegionLaw
from porocore.macro.laws.linear import LinearisedLaw
from porocore.macro.laws.macro_law import AdaptiveLaw
from porocore.macro.laws.relaxation import RelaxingLaw
from porocore.plugins.registry import registry
from porocore.testing.synthetic.porous_family import PorousFamilyLaw
from porocore.testing.synthetic.response import GradientLaw, linear_law
from tests.helpers.anisotropic_cell import AXES, FIELDS, anisotropic_law, block
from tests.helpers.anisotropic_cell import linear_law as anisotropic_linear_law
from tests.helpers.sensitivity_bodies import LAYERS, RELAXING, UNKNOWNS, column, law, layers, pressed

#: Difference of gradients from sensitivities, as a share of the largest of a sum.
ALIKE = 1e-9
#: Difference from central differences.
ACCURACY = 1e-6
CLOSURES = pytest.mark.parametrize(
    "closure", ["potential", pytest.param("mean-gradient", marks=pytest.mark.slow)]
)
SERIES = ("probes", "reactions", "inflow")


@pytest.fixture(params=["skfem", pytest.param("dolfinx", marks=pytest.mark.slow)])
def make_solver(request):
    pytest.importorskip(request.param)
    return registry().get("macro solver", request.param)


def series(found):
    values = {name: getattr(getattr(found, "history", found), name) for name in HISTORY_SERIES}
    return values | {f"{kind}/{name}": each for kind in SERIES for name, each in getattr(found, kind).items()}


def weights_for(solution):
    """One sum for each series with random weights of its values, and one over all of them together."""
    noise, values = np.random.default_rng(5), series(solution)
    count = len(values) + 1
    found = {}
    for i, (name, value) in enumerate(values.items()):
        found[name] = np.zeros((*value.shape, count))
        found[name][..., i] = noise.normal(size=value.shape)
        found[name][..., -1] = noise.normal(size=value.shape) / max(np.abs(value).max(), 1e-3)
    groups = {kind: {} for kind in SERIES}
    for name, value in found.items():
        kind, _, which = name.partition("/")
        if which:
            groups[kind][which] = value
    return HistoryWeights(count, **{name: found[name] for name in HISTORY_SERIES}, **groups)


def summed(solution, weights):
    """The sums (f,), or their derivatives (f, k) from those of the series."""
    total = 0.0
    for name, weight in series(weights).items():
        value = series(solution)[name]
        flat = weight.reshape(-1, weights.count)
        total = total + flat.T @ value.reshape(len(flat), -1)
    return total


def compare(make_solver, problem, law, changes, within=ALIKE):
    solver = make_solver()
    prepared = solver.prepare(problem)
    made = []
    solution, gradients = solver.solve_with_gradients(
        prepared, law, changes, lambda found: made.append(weights_for(found)) or made[0]
    )
    again, sensitivities = solver.solve_with_sensitivities(prepared, law, changes)
    np.testing.assert_allclose(solution.history.settlement, again.history.settlement, rtol=1e-11)
    wanted = summed(sensitivities, made[0])
    assert gradients.shape == wanted.shape == (made[0].count, len(changes))
    scale = np.abs(wanted).max(axis=0, keepdims=True)
    assert (np.abs(gradients - wanted) <= within * scale).all(), (
        np.abs(gradients - wanted).max(axis=0) / scale
    )
    return gradients, made[0]


CHANGES = [change for change, *_ in UNKNOWNS.values()]
LAYERS_AXES = {"about": (0.3, 0.2, 1.0), "angle": "30 + 20*x"}
HATS = [CellParameterChange("radius", weight=HatFunction.along(1, (0.0, 0.7, 1.5), i)) for i in range(3)]


@CLOSURES
def test_gradients_are_sums_of_sensitivities(make_solver, closure):
    given = law("radius", "poisson_ratio", "viscosity", closure=closure)
    problem = column(radius=0.0, poisson_ratio=1.0, viscosity=0.01)
    compare(make_solver, problem, given, [*CHANGES, *HATS])


def test_stress_and_storage_that_depend_on_the_gradient_of_the_pressure_have_gradients(make_solver):
    given = GradientLaw(law("radius", "poisson_ratio", "viscosity"))
    problem = column(radius=0.0, poisson_ratio=1.0, viscosity=0.01)
    compare(make_solver, problem, given, [*CHANGES, *HATS])


@CLOSURES
def test_a_solid_that_relaxes_has_gradients(make_solver, closure):
    given = RelaxingLaw(law("radius", "poisson_ratio", "viscosity", closure=closure), 2)
    values = {name: value for name, (_, value) in RELAXING.items()}
    problem = column(radius=0.0, poisson_ratio=1.0, viscosity=0.01, **values)
    compare(make_solver, problem, given, [*CHANGES, *(change for change, _ in RELAXING.values())])


@pytest.mark.slow
@pytest.mark.parametrize("closure", ["potential", "mean-gradient"])
def test_large_bodies_have_gradients(make_solver, closure):
    """By the iteration that bodies of many unknowns take; it leaves a tenth of the tolerance of its own."""
    given = law("radius", "poisson_ratio", "viscosity", closure=closure, conductivity="deformed")
    problem = column(radius=0.0, poisson_ratio=1.0, viscosity=0.01)
    compare(partial(make_solver, solver="iterative"), problem, given, [*CHANGES, *HATS], within=10 * ALIKE)


PULLED = {"traction": 0.05, "pressure": -0.002, "initial": -0.001}


@pytest.mark.parametrize("loads", [{}, PULLED], ids=["pressed", "pulled"])
def test_a_constant_tangent_has_gradients(make_solver, loads):
    names = ("load", "traction", "pressure", "initial")
    compare(make_solver, column(**loads), linear_law(), [UNKNOWNS[name][0] for name in names])


@pytest.mark.slow
def test_regions_turned_axes_and_both_closures_have_gradients(make_solver):
    """A layer of the potential closure in a block of the mean-gradient one, with material axes."""
    given = RegionLaw([law(closure="mean-gradient"), law("radius", "modulus")])
    fields = {"axes": {"about": (0.3, 0.2, 1.0), "angle": 40}}
    hard = {"kind": "layer", "above": 0.5, "fields": {"radius": 0.21, "modulus": 1.0}}
    problem = layers(regions={"hard": hard}, fields=fields)
    compare(make_solver, problem, given, [LAYERS[name][0] for name in ("radius", "modulus", "moved")])


@pytest.mark.slow
def test_factors_of_fields_that_vary_have_gradients(make_solver):
    given = BoundLaw(law("radius", "modulus", "viscosity"), {"viscosity": 0.02})
    problem = layers(fields={"radius": "0.24 - 0.02*x + 0.01*t", "modulus": 1.0, "axes": LAYERS_AXES})
    compare(make_solver, problem, given, [change for change, *_ in LAYERS.values()])


@pytest.mark.parametrize("closure", ["mean-gradient", pytest.param("potential", marks=pytest.mark.slow)])
def test_plates_followers_and_fluxes_have_gradients(make_solver, closure):
    problem = pressed(follower=0.02, plate=0.01, flux=0.001, normal=0.01, load=0.9, initial=0.002)
    changes = [
        BoundaryChange("side", "follower"),
        BoundaryChange("y+", "plate"),
        BoundaryChange("y-", "flux"),
        BoundaryChange("y-", "normal"),
        LoadChange(),
        InitialPressureChange(),
    ]
    compare(make_solver, problem, law(closure=closure), changes)


@pytest.mark.slow
@pytest.mark.parametrize("closure", ["potential", "mean-gradient"])
def test_the_gradient_of_half_a_sum_of_squares_is_the_limit_of_differences(make_solver, closure):
    """Against runs that know nothing of derivatives, along a direction in the control values of a field."""
    given, places = law("radius", closure=closure), (0.0, 0.5, 1.5)
    start, direction = np.array([0.2, 0.24, 0.22]), np.array([1.0, -0.6, 0.7])
    solver = make_solver()

    def problem(values):
        found = column()
        table = {"kind": "table", "along": "y", "table": tuple(zip(places, values, strict=True))}
        return type(found).model_validate(found.model_dump() | {"fields": {"radius": table}})

    def residuals(solution):
        measured = 1.1 * np.linspace(0, 1, len(solution.history.time))
        return solution.history.settlement / 0.05 - measured, solution.probes["inside"][
            :, 3
        ] / 0.02 - measured

    def weights(solution):
        settled, pressed_ = residuals(solution)
        probe = np.zeros((len(settled), 4, 1))
        probe[:, 3, 0] = pressed_ / 0.02
        return HistoryWeights(1, settlement=settled[:, None] / 0.05, probes={"inside": probe})

    def half(values):
        found = residuals(solver.solve(solver.prepare(problem(values)), given))
        return 0.5 * sum(float(each @ each) for each in found)

    changes = [CellParameterChange("radius", weight=HatFunction.along(1, places, i)) for i in range(3)]
    _, gradient = solver.solve_with_gradients(solver.prepare(problem(start)), given, changes, weights)
    step = 1e-5 * direction
    wanted = (half(start + step) - half(start - step)) / 2
    assert abs(gradient[0] @ step - wanted) <= ACCURACY * abs(gradient[0]) @ abs(step)


def test_a_law_that_learns_during_the_run_is_refused():
    pytest.importorskip("skfem")
    cell = PorousFamilyLaw("radius")
    cell.predict = partial(flagged, cell)
    adaptive = AdaptiveLaw(
        cell,
        make_closure("potential", 0.6, NeoHookean(), np.eye(3)),
        lambda states: PorousFamilyLaw("radius"),
    )
    solver, problem = (
        registry().get("macro solver", "skfem")(),
        column().model_copy(update={"fields": {"radius": 0.22}}),
    )
    with pytest.raises(ConfigurationError, match="the law learns during the run"):
        solver.solve_with_gradients(solver.prepare(problem), adaptive, [LoadChange()], weights_for)


@pytest.mark.parametrize(
    ("given", "naming"),
    [
        (lambda n: {"probes": {"insde": np.ones((n, 4, 1))}}, "no series 'insde'; did you mean 'inside'"),
        (lambda n: {"reactions": {"y+": np.ones((n, 3, 1))}}, "weights of reactions: no series 'y+'"),
        (
            lambda n: {"inflow": {"y+": np.ones((n, 2))}},
            r"weights of inflow/y+: expected the shape (6, 1), got (6, 2)",
        ),
        (lambda n: {"heave": np.ones((n - 1, 1))}, "weights of heave: expected the shape (6, 1), got (5, 1)"),
        (lambda n: {"compression": {"y-": np.ones((n, 1))}}, "expected weights of the forces in reactions"),
    ],
)
def test_weights_of_what_a_run_does_not_have_are_refused(given, naming):
    solver, problem = registry().get("macro solver", "skfem")(), column()

    def weights(solution):
        return HistoryWeights(1, **given(len(solution.history.time)))

    with pytest.raises(ConfigurationError, match=re.escape(naming)):
        solver.solve_with_gradients(solver.prepare(problem), linear_law(), [LoadChange()], weights)


def flagged(cell, states, *, tangent=True):
    """Responses of a cell that is not to be trusted."""
    found = PorousFamilyLaw.predict(cell, states, tangent=tangent)
    return replace(found, doubt=np.ones(len(states), np.int64))


@pytest.mark.parametrize("name", ["potential", "mean-gradient", "linear", "linear of a family"])
def test_fields_and_axes_that_change_in_time_have_gradients(make_solver, name):
    family = name in ("potential", "linear of a family")
    parameters = ("porosity", "swelling") if family else ()
    closure = "mean-gradient" if name == "mean-gradient" else "potential"
    given = anisotropic_linear_law() if name == "linear" else anisotropic_law(*parameters, closure=closure)
    changes = [LoadChange(), InitialPressureChange(), ModulusChange(), ViscosityChange()]
    if name == "potential":
        changes += [CellParameterChange("porosity"), CellParameterChange("swelling", factor=True)]
    if name == "linear of a family":
        given = LinearisedLaw(given)
    problem = block({key: FIELDS[key] for key in parameters} | {"axes": AXES})
    compare(make_solver, problem, given, changes)
