"""Sensitivities of a macro run against central differences: each kind of unknown, both closures, both backends."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.inputs import InputSpace
from porocore.errors import ConfigurationError
from porocore.interfaces.sensitivities import (
    HISTORY_SERIES,
    BoundaryChange,
    CellParameterChange,
    InitialPressureChange,
    LoadChange,
    ModulusChange,
    ViscosityChange,
)
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.composed import BoundLaw, NearestMemberLaw, RegionLaw
from porocore.macro.laws.linear import LinearisedLaw
from porocore.macro.laws.macro_law import AdaptiveLaw, ClosedLaw
from porocore.macro.laws.relaxation import RelaxingLaw
from porocore.plugins.registry import registry
from porocore.testing.synthetic.porous_family import PorousFamilyLaw, porous_training_set
from porocore.testing.synthetic.response import GradientLaw, linear_law, mean_gradient_law
from tests.helpers.anisotropic_cell import AXES, anisotropic_law, block
from tests.helpers.anisotropic_cell import linear_law as anisotropic_linear_law
from tests.helpers.sensitivity_bodies import LAYERS, RELAXING, TIME, UNKNOWNS, column, law, layers, pressed

#: Difference from central differences, as a share of the largest derivative of a series.
ACCURACY = 1e-6
#: Relative step of the differences.
STEP = 1e-4
SERIES = ("probes", "reactions", "inflow")


@pytest.fixture(params=["skfem", pytest.param("dolfinx", marks=pytest.mark.slow)])
def make_solver(request):
    pytest.importorskip(request.param)
    return registry().get("macro solver", request.param)


def solve(make_solver, problem, law):
    solver = make_solver()
    return solver.solve(solver.prepare(problem), law)


def series(solution, modulus=1.0):
    """Name to values, in units that do not depend on the modulus."""
    units = {"pressure_max": modulus, "pressure_min": modulus}
    found = {name: getattr(solution.history, name) * units.get(name, 1) for name in HISTORY_SERIES}
    for name, values in solution.probes.items():
        found[f"probes/{name}"] = values * [1, 1, 1, modulus]
    found |= {f"reactions/{name}": values * modulus for name, values in solution.reactions.items()}
    return found | {f"inflow/{name}": values for name, values in solution.inflow.items()}


def derivatives(found):
    values = {name: getattr(found, name) for name in HISTORY_SERIES}
    return values | {f"{kind}/{name}": each for kind in SERIES for name, each in getattr(found, kind).items()}


def compare(found, expected, sizes):
    assert found.keys() == expected.keys()
    for key, wanted in expected.items():
        # What an unknown does not change, such as the force that bears the load, is round-off of the differences.
        alike = [
            np.abs(values).max() for name, values in sizes.items() if name.split("/")[0] == key.split("/")[0]
        ]
        scale = max(np.abs(wanted).max(), 0.1 * max(alike))
        assert np.abs(found[key] - wanted).max() <= ACCURACY * scale, key


def check(make_solver, problem, law, unknowns, *, together=False, modulus=None):
    """Compare each derivative, or that along the direction of all unknowns, with central differences.

    ``problem`` takes unknowns by name; ``unknowns`` has for each the change and the value, and for a derivative by the
    logarithm True. Each is changed by its own share, one that is zero by 0.2. ``modulus`` names the unknown that is the
    unit of the problem's pressures.
    """
    solver, base = make_solver(), {name: value for name, (_, value, *_) in unknowns.items()}
    changes = [change for change, *_ in unknowns.values()]
    solution, found = solver.solve_with_sensitivities(solver.prepare(problem(**base)), law, changes)
    plain = solve(make_solver, problem(**base), law)
    np.testing.assert_allclose(solution.history.settlement, plain.history.settlement, rtol=1e-11)
    shares = np.array([1.0 if more else value or 0.2 for _, value, *more in unknowns.values()])
    scaled = {key: values * shares for key, values in derivatives(found).items()}
    for part in [[*unknowns]] if together else [[name] for name in unknowns]:
        ends = []
        for sign in (1, -1):
            at = {name: base[name] + sign * STEP * (base[name] or 0.2) for name in part}
            ends.append(series(solve(make_solver, problem(**base | at), law), at.get(modulus, 1.0)))
        differences = {key: (ends[0][key] - ends[1][key]) / (2 * STEP) for key in ends[0]}
        chosen = [[*unknowns].index(name) for name in part]
        mine = {key: values[..., chosen].sum(axis=-1) for key, values in scaled.items()}
        compare(mine, differences, series(plain))


# ---- a column ------------------------------------------------------------------------------------


@pytest.mark.parametrize("closure", ["potential", "mean-gradient"])
def test_the_derivative_along_all_unknowns_is_the_limit_of_differences(make_solver, closure):
    given = law("radius", "poisson_ratio", "viscosity", closure=closure)
    check(make_solver, column, given, UNKNOWNS, together=True, modulus="modulus")


@pytest.mark.parametrize("closure", ["potential", pytest.param("mean-gradient", marks=pytest.mark.slow)])
def test_a_solid_that_relaxes_has_derivatives(make_solver, closure):
    """By strengths and times, too, along all unknowns together and each of the branches alone."""
    given = RelaxingLaw(law("radius", "poisson_ratio", "viscosity", closure=closure), 2)
    check(make_solver, column, given, UNKNOWNS | RELAXING, together=True, modulus="modulus")


@pytest.mark.slow
def test_each_number_of_a_branch_has_derivatives(make_solver):
    given, base = RelaxingLaw(law("radius", "poisson_ratio", "viscosity"), 2), {}
    for name in ("radius", "poisson_ratio", "viscosity"):
        base[name] = UNKNOWNS[name][1]
    check(make_solver, partial(column, **base), given, RELAXING)


def test_heave_and_suction_have_derivatives(make_solver):
    """A column whose top is pulled up, so that its fluid is under suction."""
    given = law("radius", "poisson_ratio", "viscosity")
    pulled = {"traction": 0.05, "pressure": -0.002, "initial": -0.001}
    unknowns = {
        name: (change, pulled.get(name, value), *more) for name, (change, value, *more) in UNKNOWNS.items()
    }
    check(make_solver, column, given, unknowns, together=True, modulus="modulus")
    found = solve(make_solver, column(**pulled, radius=0.0, poisson_ratio=1.0, viscosity=0.01), given).history
    assert found.heave.max() > 0.05
    assert found.pressure_min.min() < -0.05


@pytest.mark.slow
@pytest.mark.parametrize("closure", ["potential", "mean-gradient"])
def test_derivatives_by_each_unknown_are_limits_of_differences(make_solver, closure):
    check(
        make_solver,
        column,
        law("radius", "poisson_ratio", "viscosity", closure=closure),
        UNKNOWNS,
        modulus="modulus",
    )


@pytest.mark.slow
@pytest.mark.parametrize("closure", ["potential", "mean-gradient"])
def test_the_conductivity_of_the_deformed_pore_depends_on_the_unknowns_too(make_solver, closure):
    given = law("radius", "poisson_ratio", "viscosity", closure=closure, conductivity="deformed")
    check(make_solver, column, given, UNKNOWNS, together=True, modulus="modulus")


@pytest.mark.slow
def test_a_surrogate_of_a_family_has_derivatives(make_solver):
    """Whose flux goes by the conductivity that it has learned of the deformed pore."""
    inputs = InputSpace.from_ranges(
        {"H22": (-0.12, 0.04), "p": (0.0, 0.1)},
        {"radius": (0.15, 0.3), "poisson_ratio": (0.2, 0.45), "viscosity": (0.005, 0.02)},
    )
    surrogate = registry().get("surrogate", "polynomial")().fit(porous_training_set(60, 0, inputs), seed=0)
    given = ClosedLaw(surrogate, make_closure("potential", 0.6, NeoHookean(), np.eye(3), law="deformed"))
    unknowns = {name: UNKNOWNS[name] for name in ("radius", "poisson_ratio", "viscosity", "load", "initial")}
    check(make_solver, column, given, unknowns, together=True)


def test_stress_and_storage_that_depend_on_the_gradient_of_the_pressure_have_derivatives(make_solver):
    given = GradientLaw(law("radius", "poisson_ratio", "viscosity"))
    check(make_solver, column, given, UNKNOWNS, together=True, modulus="modulus")


@pytest.mark.parametrize("given", [linear_law(), mean_gradient_law()], ids=["linear", "mean-gradient"])
def test_laws_of_one_cell_have_derivatives_by_loads(make_solver, given):
    names = ("load", "traction", "pressure", "initial")
    check(make_solver, column, given, {name: UNKNOWNS[name] for name in names}, together=True)


def test_the_linear_limit_has_derivatives_by_modulus_and_viscosity(make_solver):
    given = LinearisedLaw(law("radius", "poisson_ratio", "viscosity"))
    names = ("modulus", "viscosity", "load", "initial")
    chosen = {name: UNKNOWNS[name] for name in names}
    check(
        make_solver,
        partial(column, radius=0.0, poisson_ratio=1.0),
        given,
        chosen,
        together=True,
        modulus="modulus",
    )


# ---- other bodies ----------------------------------------------------------------------------------


@pytest.mark.parametrize("bound", [False, True], ids=["one law", "a law of each region"])
def test_regions_fields_and_turned_axes_have_derivatives(make_solver, bound):
    given = law("radius", "modulus", "viscosity")
    given = BoundLaw(given, {"viscosity": 0.02})
    if bound:
        given = RegionLaw(
            [given, BoundLaw(law("radius", "modulus", "poisson_ratio"), {"poisson_ratio": 0.31})]
        )
    unknowns = LAYERS | {"moved": (LAYERS["moved"][0], 1.0)}
    check(
        make_solver,
        lambda moved, **values: layers(moved=-0.05 * moved, **values),
        given,
        unknowns,
        together=True,
    )


def test_a_body_of_both_closures_has_derivatives(make_solver):
    given = RegionLaw([law(closure="mean-gradient"), law("radius", "modulus")])
    fields = {"axes": {"about": (0.3, 0.2, 1.0), "angle": 40}}
    hard = {"kind": "layer", "above": 0.5}

    def problem(radius, modulus):
        regions = {"hard": hard | {"fields": {"radius": radius, "modulus": modulus}}}
        return layers(regions=regions, fields=fields)

    check(make_solver, problem, given, {name: LAYERS[name] for name in ("radius", "modulus")}, together=True)


@pytest.mark.parametrize("closure", ["potential", "mean-gradient"])
def test_each_boundary_value_has_a_derivative(make_solver, closure):
    unknowns = {
        "follower": (BoundaryChange("side", "follower"), 0.02),
        "plate": (BoundaryChange("y+", "plate"), 1.0),
        "flux": (BoundaryChange("y-", "flux"), 0.001),
        "normal": (BoundaryChange("y-", "normal"), 0.01),
        "load": (LoadChange(), 0.9),
        "initial": (InitialPressureChange(), 0.002),
    }

    def problem(plate, **values):
        return pressed(plate=0.01 * plate, **values)

    check(make_solver, problem, law(closure=closure), unknowns, together=True)


# ---- what is refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "naming"),
    [
        (CellParameterChange("width"), "has no parameter 'width'; the parameters are radius, modulus"),
        (CellParameterChange("radius", "soft"), "the body has no region 'soft'; the regions are hard"),
        (ModulusChange("soft"), "the body has no region 'soft'"),
        (BoundaryChange("lid", "traction"), "nothing is prescribed on a surface 'lid'"),
        (BoundaryChange("x+", "plate"), "macro.boundary.x+.plate: it is free"),
        (BoundaryChange("x+", "follower"), "macro.boundary.x+.follower: it is zero"),
        (BoundaryChange("y+", "displacement", 4), "expected a component 0, 1 or 2"),
    ],
)
def test_an_unknown_of_what_is_not_there_is_refused(change, naming):
    pytest.importorskip("skfem")
    solver = registry().get("macro solver", "skfem")()
    with pytest.raises(ConfigurationError, match=re.escape(naming)):
        solver.solve_with_sensitivities(solver.prepare(layers()), law("radius", "modulus"), [change])


def test_laws_that_know_no_derivatives_are_refused():
    pytest.importorskip("skfem")
    solver = registry().get("macro solver", "skfem")()
    prepared, change = solver.prepare(layers()), CellParameterChange("radius")
    family = law("radius", "modulus")
    values = {"radius": (0.15, 0.3), "modulus": (0.5, 2.0)}
    members = NearestMemberLaw([law(closure="potential")], np.array([[0.2, 1.0]]), values)
    for given, naming in (
        (LinearisedLaw(family), "gives no derivatives by parameters"),
        (members, "jumps with"),
    ):
        with pytest.raises(ConfigurationError, match=naming):
            solver.solve_with_sensitivities(prepared, given, [change])
    with pytest.raises(ConfigurationError, match="at least one unknown"):
        solver.solve_with_sensitivities(prepared, family, [])


# ---- how a run goes --------------------------------------------------------------------------------


def largest_difference(found, expected):
    """Largest difference of the derivatives, as a share of the largest derivative of a series by an unknown."""
    shares = []
    for key, values in found.items():
        times = tuple(range(values.ndim - 1))
        # What an unknown does not change is round-off.
        scale = np.maximum(np.abs(expected[key]).max(axis=times), 1e-6)
        shares.append((np.abs(values - expected[key]).max(axis=times) / scale).max())
    return max(shares)


def test_an_iteration_gives_the_derivatives_of_a_factor(make_solver):
    given = mean_gradient_law()
    changes = [ModulusChange(), ViscosityChange(), BoundaryChange("y+", "displacement", 1)]
    body = {"kind": "box", "elements": (2, 3, 2), "size": (0.8, 1.0, 0.6)}
    block = layers(body=body, regions={}, fields={}, time=TIME | {"end": 0.9, "step": 0.5})
    found = []
    for solver in (make_solver(solver="iterative"), make_solver(solver="direct")):
        found.append(derivatives(solver.solve_with_sensitivities(solver.prepare(block), given, changes)[1]))
    assert largest_difference(*found) < ACCURACY


@pytest.mark.slow
def test_halved_steps_are_held_fixed(make_solver):
    """A step that fails is halved on either side of a difference, too."""

    def problem(load):
        found = column(traction=-0.3, load=load)
        return found.model_copy(update={"newton": found.newton.model_copy(update={"iterations": 4})})

    solution = solve(make_solver, problem(1.0), law())
    assert len(solution.history.time) > 6
    check(make_solver, problem, law(), {"load": UNKNOWNS["load"]})


def test_a_law_that_learns_within_a_step_is_followed(make_solver):
    """Its memory is that of the new cell law, and so is the derivative of the memory."""
    early, late = (PorousFamilyLaw("radius", deformed=deformed) for deformed in (False, False))
    early.predict = partial(flagged, early, -0.02)
    constants = make_closure("potential", 0.6, NeoHookean(), np.eye(3))
    adaptive = AdaptiveLaw(early, constants, lambda states: late)
    problem = column().model_copy(update={"fields": {"radius": 0.22}})
    changes = [CellParameterChange("radius"), LoadChange(), InitialPressureChange()]
    found = []
    for given in (adaptive, law("radius")):
        solver = make_solver()
        found.append(derivatives(solver.solve_with_sensitivities(solver.prepare(problem), given, changes)[1]))
    assert adaptive.cell_law is late
    assert largest_difference(*found) < 1e-9


def flagged(cell, limit, states, *, tangent=True):
    """Responses of a cell that is not to be trusted below a strain."""
    found = PorousFamilyLaw.predict(cell, states, tangent=tangent)
    return replace(found, doubt=(states.grad_u[:, 1, 1] < limit).astype(np.int64))


# ---- fields and axes that change in time -----------------------------------------------------------

ALL = ("porosity", "swelling", "mobility")
CHANGING = {
    "potential": (anisotropic_law(*ALL), ALL),
    "mean-gradient": (anisotropic_law("porosity", "mobility", closure="mean-gradient"), ALL[::2]),
    "linear": (anisotropic_linear_law(), ()),
    "linear of a family": (LinearisedLaw(anisotropic_law(*ALL)), ALL),
}


@pytest.mark.parametrize("name", CHANGING)
def test_fields_and_axes_that_change_in_time_have_derivatives(make_solver, name):
    given, parameters = CHANGING[name]
    unknowns = {
        "traction": (BoundaryChange("y+", "traction", 1), -0.03),
        "initial": (InitialPressureChange(), 0.001),
    }
    if parameters:
        unknowns["modulus"] = (ModulusChange(), 1.0, True)
    if name == "potential":
        unknowns["porosity"] = (CellParameterChange("porosity"), 0.0)
        unknowns["swelling"] = (CellParameterChange("swelling", factor=True), 1.0)

    def problem(traction, initial, modulus=1.0, porosity=0.0, swelling=1.0):
        """In units of the modulus, in which fluid flows the more easily the larger it is."""
        fields = {
            "porosity": f"0.22 + 0.05*t*x + {porosity!r}",
            "swelling": f"{swelling!r}*0.004*t*y",
            "mobility": modulus,
        }
        return block(
            {key: fields[key] for key in parameters} | {"axes": AXES},
            traction=traction / modulus,
            initial={"pressure": initial / modulus},
        )

    check(make_solver, problem, given, unknowns, together=True, modulus="modulus")
