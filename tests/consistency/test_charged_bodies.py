"""Bodies with fixed charges on every macro backend: equilibria, a changed bath, sensitivities, no charges at all."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from porocore.commands.verify.linear_cases import potential
from porocore.interfaces.sensitivities import (
    CellParameterChange,
    HistoryWeights,
    LoadChange,
    ModulusChange,
    ViscosityChange,
)
from porocore.macro.analytic import ChargedCell, ChargedLayer
from porocore.macro.laws.charges import ChargedLaw, OsmoticPressure
from porocore.macro.problem import MacroProblem
from porocore.plugins.registry import registry
from porocore.states import MacroState
from porocore.testing.synthetic.response import linear_law
from tests.helpers.sensitivity_bodies import law as family_law

#: R T Φ in units of E per concentration, c_F0 and c*.
OSMOTIC, DENSITY, BATH = 0.25, 0.2, 0.15
HEIGHT, AREA = 1.5, 0.25
CONFINED, FREE = np.diag([0.0, 1.0, 0.0]), np.eye(3)
LAWS = {"potential": lambda: potential()[0], "linear": linear_law}


@pytest.fixture(params=["skfem", pytest.param("dolfinx", marks=pytest.mark.slow)])
def make_solver(request):
    pytest.importorskip(request.param)
    return registry().get("macro solver", request.param)


def solved(make_solver, problem, law):
    solver = make_solver()
    return solver.solve(solver.prepare(problem), law)


def column(pressing=0.0, bath=BATH, density=DENSITY, elements=3, **more):
    """A confined column that drains into the bath on top, under a load that is ramped, or a function of time."""
    sides = {face: {"displacement": (0, None, 0)} for face in ("x-", "x+", "z-", "z+")}
    pressed = {"table": [[t, -q] for t, q in pressing["table"]]} if isinstance(pressing, dict) else -pressing
    ends = {"y-": {"displacement": (0, 0, 0)}, "y+": {"traction": (0, pressed, 0), "pressure": 0}}
    fields = {"charges.density": density, "charges.bath": bath} | more.pop("fields", {})
    data = {
        "body": {"kind": "box", "elements": (1, elements, 1), "size": (0.5, HEIGHT, 0.5)},
        "boundary": sides | ends,
        "time": {"end": 1200.0, "step": 200.0, "ramp_increments": 2, "ramp_step": 0.5, "profiles": ()},
        "newton": {"tolerance": 1e-13},
        "fields": fields,
    }
    return MacroProblem.model_validate(data | more)


def scalar(name, load=0.0, bath=BATH, direction=CONFINED):
    """Strain, pressure and fluid volumes at rest and in equilibrium by the scalar equations."""
    law = LAWS[name]()
    rest = law.initial(1)

    def response(H, p):
        found = law.respond(MacroState.single(H, p), np.zeros((1, 3)), rest)
        return found.stress[0], float(found.memory.fluid_volume[0])

    porosity = float(rest.fluid_volume[0])
    cell = ChargedCell(response, DENSITY * porosity, bath, OSMOTIC)
    strain, p = cell.equilibrium(direction, load)
    return strain, p, porosity, response(strain * direction, p)[1]


@pytest.mark.parametrize("load", [0.0, 0.03])
@pytest.mark.parametrize("name", LAWS)
def test_a_column_comes_to_the_scalar_equilibrium(make_solver, name, load):
    """It begins at H = 0 and μ = 0, with the fluid that the charges draw in while it is held; none is lost."""
    law = ChargedLaw(LAWS[name](), OSMOTIC)
    solution = solved(make_solver, column(load, probes={"top": (0.2, HEIGHT, 0.3)}), law)
    strain, _, porosity, fluid = scalar(name, load)
    assert solution.probes["top"][-1] == pytest.approx([0, strain * HEIGHT, 0, 0], abs=1e-9)
    rest = MacroState.zeros(1).with_parameters([DENSITY, BATH])
    held = float(law.respond(rest, np.zeros((1, 3)), law.initial_at(rest)).memory.fluid_volume[0])
    assert held > porosity
    assert solution.history.drained[-1] / (HEIGHT * AREA) == pytest.approx(held - fluid, abs=1e-10)


def test_a_cube_swells_freely(make_solver):
    """Three of its faces are planes of symmetry, the others touch the bath."""
    slides, bath = {"normal": 0}, {"pressure": 0}
    faces = {"x-": slides, "y-": slides, "z-": slides, "x+": bath, "y+": bath, "z+": bath}
    body = {"kind": "box", "elements": (1, 2, 1), "size": (1, 1, 1)}
    problem = column(body=body, boundary=faces, probes={"corner": (1, 1, 1), "inside": (0.3, 0.4, 0.6)})
    solution = solved(make_solver, problem, ChargedLaw(potential()[0], OSMOTIC))
    strain = scalar("potential", direction=FREE)[0]
    assert solution.probes["corner"][-1] == pytest.approx([*3 * [strain], 0], abs=1e-9)
    expected = [0.3 * strain, 0.4 * strain, 0.6 * strain, 0]
    assert solution.probes["inside"][-1] == pytest.approx(expected, abs=1e-9)


BATHS = {"y-": 0.05, "y+": 0.3}


def between_baths(bath, initial="as charged", elements=6):
    """A column that touches a bath below and another on top."""
    charges = {"density": DENSITY, "bath": bath, "initial": initial}
    problem = column(0.03 * (initial == "as charged"), elements=elements, charges=charges, fields={})
    drained = {name: problem.boundary[name].model_copy(update={"pressure": 0.0}) for name in BATHS}
    problem = problem.model_copy(
        update={"fields": {}, "boundary": problem.boundary | drained, "probes": {"top": (0.2, HEIGHT, 0.3)}}
    )
    return problem.with_law_numbers({None: None})


def end_between_baths(load):
    """The integral of the strains along the column, each of the scalar equation with the bath at its height."""
    x, w = np.polynomial.legendre.leggauss(8)
    low, high = BATHS.values()
    strains = [scalar("potential", load, low + (high - low) * (1 + each) / 2)[0] for each in x]
    return HEIGHT * np.dot(w, strains) / 2


def test_a_column_between_two_baths_swells_by_the_scalar_equation_at_each_height(make_solver):
    """Salt goes linearly from one bath to the other, and the effective pressure is 0 everywhere: no osmosis."""
    expected, errors = end_between_baths(0.03), []
    for elements in (3, 6):
        problem = between_baths(BATHS, elements=elements)
        solution = solved(make_solver, problem, ChargedLaw(potential()[0], OSMOTIC))
        _, top, _, p = solution.probes["top"][-1]
        errors.append(abs(top - expected))
        assert abs(p) < 1e-9
    assert expected < 0
    assert errors[1] < errors[0] / 8
    assert errors[1] < 1e-6 * abs(expected)


@pytest.mark.slow
def test_backends_agree_on_a_column_between_two_baths():
    found = []
    for name in ("skfem", "dolfinx"):
        pytest.importorskip(name)
        problem = between_baths({"y-": 0.05, "y+": {"table": [[0, 0.3], [300, 0.1]]}})
        law = ChargedLaw(potential()[0], OSMOTIC)
        found.append(solved(registry().get("macro solver", name), problem, law))
    one, other = found
    np.testing.assert_allclose(one.probes["top"], other.probes["top"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(one.history.drained, other.history.drained, rtol=0, atol=1e-9)


def test_equal_baths_on_both_ends_are_one(make_solver):
    runs = [
        solved(make_solver, between_baths(bath), ChargedLaw(potential()[0], OSMOTIC))
        for bath in (BATH, dict.fromkeys(BATHS, BATH))
    ]
    one, other = (run.probes["top"] for run in runs)
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(one).max())


def test_a_body_between_two_baths_begins_swollen(make_solver):
    problem = between_baths(BATHS, "free-swelling")
    solution = solved(make_solver, problem, ChargedLaw(potential()[0], OSMOTIC))
    assert np.ptp(solution.profiles[-1].osmotic_pressure) > 0.01
    assert solution.probes["top"][0, 1] == pytest.approx(end_between_baths(0.0), rel=1e-6)
    np.testing.assert_allclose(solution.probes["top"][:, [0, 2, 3]], 0, atol=1e-9)
    assert np.ptp(solution.probes["top"][:, 1]) < 1e-9


def test_baths_are_part_of_what_a_checkpoint_compares():
    said = [between_baths(bath).specification() for bath in (BATHS, {**BATHS, "y-": 0.06}, 0.05)]
    for one, other in pairwise(said):
        assert one["charges"] != other["charges"]
        assert one["fields"] != other["fields"]


@pytest.mark.parametrize(
    ("name", "share"),
    [("linear", -1e-3), ("linear", 1e-3), pytest.param("potential", -1e-3, marks=pytest.mark.slow)],
)
def test_a_small_change_of_the_bath_follows_the_linear_theory(make_solver, name, share):
    """From the equilibrium under a load, against apparent modulus and time constant: 0.5 % of the last rise."""
    law, load = LAWS[name](), 0.01
    strain, p, porosity, fluid = scalar(name, load)
    state = MacroState.single(strain * CONFINED, p)
    tangent = law.respond(state, np.zeros((1, 3)), law.initial(1)).tangent
    osmotic = OsmoticPressure.at(*np.array([[fluid], [DENSITY * porosity], [BATH]]), OSMOTIC)
    layer = ChargedLayer(
        HEIGHT,
        float(tangent.stress_grad_u[0, 1, 1, 1, 1]),
        float(tangent.storage_grad_u[0, 1, 1]),
        float(tangent.storage_p[0]),
        -float(tangent.flux_grad_p[0, 1, 1]),
        float(osmotic.by_fluid[0]),
        float(osmotic.by_bath[0]),
    )
    scale, change = HEIGHT**2 / layer.loaded(1.0).consolidation_coefficient, share * BATH
    sudden = {"ramp": 1.0, "until": 1e-6 * scale}
    problem = column(
        {"table": [[0.0, load], [1.0, load]]},
        {"formula": repr(BATH + change), "initial": BATH, "over": sudden},
        elements=16,
        initial={"gradient": (strain * CONFINED).tolist()},
        time={
            "end": 0.8 * scale,
            "step": scale / 50,
            "ramp_increments": 1,
            "ramp_step": 1e-6 * scale,
            "tolerance": 1e-4,
        },
        probes={"top": (0.2, HEIGHT, 0.3), "bottom": (0.2, 0.0, 0.3)},
    )
    solution = solved(make_solver, problem, ChargedLaw(law, OSMOTIC))
    # Before, the front of the pressure is no wider than an element.
    after = solution.history.time > 0.02 * scale
    times, final = solution.history.time[after], float(layer.rise(change, 1e9 * scale))
    rise = solution.probes["top"][after, 1] - strain * HEIGHT
    np.testing.assert_allclose(rise, layer.rise(change, times), rtol=0, atol=5e-3 * abs(final))
    exact, largest = layer.effective_pressure(change, 0.0, times), abs(layer.by_bath * change)
    np.testing.assert_allclose(solution.probes["bottom"][after, 3], exact, rtol=0, atol=5e-3 * largest)


def test_without_charges_a_run_is_the_same_to_the_last_bit(make_solver):
    law = potential()[0]
    bare = column(0.03).model_copy(update={"fields": {}})
    mine = solved(make_solver, column(0.03, density=0.0), ChargedLaw(law, OSMOTIC))
    plain = solved(make_solver, bare, law)
    for name in ("settlement", "drained", "pressure_max"):
        np.testing.assert_array_equal(getattr(mine.history, name), getattr(plain.history, name))
    np.testing.assert_array_equal(mine.profiles[-1].u, plain.profiles[-1].u)


#: Changes of the run below, each with the value from which it goes.
UNKNOWNS = {
    "density": (CellParameterChange("charges.density"), 0.2),
    "bath": (CellParameterChange("charges.bath"), 0.15),
    "radius": (CellParameterChange("radius"), 0.22),
    "load": (LoadChange(), 1.0),
}


def of_unknowns(density=0.2, bath=0.15, radius=0.22, load=1.0):
    return column(
        0.02,
        f"{bath!r} - 0.02*t",
        f"{density!r} + 0.02*y",
        fields={"radius": f"{radius!r} - 0.01*y", "poisson_ratio": 0.33},
        load=load,
        elements=2,
        time={"end": 2.0, "step": 1.0, "ramp_increments": 2, "ramp_step": 0.2, "profiles": ()},
        probes={"inside": (0.2, 0.6, 0.3)},
    )


@pytest.mark.parametrize("closure", ["potential", "mean-gradient"])
def test_sensitivities_and_gradients_are_differences(make_solver, closure):
    law = ChargedLaw(family_law("radius", "poisson_ratio", closure=closure), OSMOTIC)
    solver, changes = make_solver(), [change for change, _ in UNKNOWNS.values()]
    prepared = solver.prepare(of_unknowns())
    solution, found = solver.solve_with_sensitivities(prepared, law, changes)
    probe = found.probes["inside"]
    for j, (name, (_, value)) in enumerate(UNKNOWNS.items()):
        h = 1e-4 * value
        ends = [solved(make_solver, of_unknowns(**{name: value + s * h}), law) for s in (1, -1)]
        slope = (ends[0].probes["inside"] - ends[1].probes["inside"]) / (2 * h)
        np.testing.assert_allclose(probe[..., j], slope, rtol=0, atol=1e-6 * np.abs(slope).max())
        slope = (ends[0].history.drained - ends[1].history.drained) / (2 * h)
        np.testing.assert_allclose(found.drained[..., j], slope, rtol=0, atol=1e-6 * np.abs(slope).max())
    weights = np.random.default_rng(3).normal(size=(*solution.probes["inside"].shape, 1))
    _, gradient = solver.solve_with_gradients(
        prepared, law, changes, lambda run: HistoryWeights(1, probes={"inside": weights})
    )
    summed = np.einsum("tif,tik->fk", weights, probe)
    np.testing.assert_allclose(gradient, summed, rtol=0, atol=1e-9 * np.abs(summed).max())


def test_modulus_and_viscosity_leave_the_osmotic_pressure(make_solver):
    """A stiffer solid in units of the first one, against a law whose modulus is a parameter of the cell."""
    problem = column(
        0.02,
        fields={"modulus": 1.0, "viscosity": 0.01},
        time={"end": 3.0, "step": 1.0, "ramp_increments": 2, "ramp_step": 0.2, "profiles": ()},
        probes={"inside": (0.2, 0.6, 0.3)},
    )
    law = ChargedLaw(family_law("modulus", "viscosity"), OSMOTIC)
    changes = [
        ModulusChange(),
        CellParameterChange("modulus"),
        ViscosityChange(),
        CellParameterChange("viscosity", factor=True),
    ]
    solver = make_solver()
    found = solver.solve_with_sensitivities(solver.prepare(problem), law, changes)[1].probes["inside"]
    scale = np.abs(found).max(axis=(0, 1))
    assert (scale > 1e-4).all()
    np.testing.assert_allclose(found[..., 0], found[..., 1], rtol=0, atol=1e-10 * scale[0])
    np.testing.assert_allclose(found[..., 2], found[..., 3], rtol=0, atol=1e-10 * scale[2])
