"""Bodies whose solid swells, on every macro backend: free, held, in a pulse, against the cell and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.inputs import InputSpace
from porocore.macro.analytic import SwellingLayer
from porocore.macro.laws.closure import PotentialClosure
from porocore.macro.laws.direct import DirectCellLaw
from porocore.macro.laws.linear import LinearCoefficients, LinearisedLaw
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.macro.problem import MacroProblem
from porocore.macro.reference import CellReference
from porocore.plugins.registry import registry
from porocore.sampling.execution import CellPool
from porocore.states import MacroState
from porocore.study.run.composition import prepare_cell
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing.synthetic.porous_family import PorousFamilyLaw, porosity, porous_training_set
from porocore.testing.synthetic.response import confined_column

STRETCH = 1.06
#: φ_f and K of the family's usual member, whose radius is 0.22; the closure takes those of each point.
POROSITY = float(porosity(0.22))
CONDUCTIVITY = 0.22**4 * (1 + 8 * 0.22)
#: From the dry solid to the swollen one, and long after it.
PLAN = {"end": 5e5, "step": 1e5, "ramp_increments": 2, "ramp_step": 0.5, "profiles": (1.0,)}
GROWING = {"formula": str(STRETCH), "initial": 1.0, "over": {"ramp": 1.0, "until": 1.0}}


@pytest.fixture(params=["skfem", pytest.param("dolfinx", marks=pytest.mark.slow)])
def make_solver(request):
    pytest.importorskip(request.param)
    return registry().get("macro solver", request.param)


def closed(cells):
    return ClosedLaw(cells, PotentialClosure(1 - POROSITY, NeoHookean(), CONDUCTIVITY * np.eye(3)))


@pytest.fixture(scope="module")
def laws():
    """The family in closed form, and a polynomial that has learned it."""
    inputs = InputSpace.from_ranges({"H22": (-0.1, 0.1), "p": (0.0, 0.05)}, {"swelling": (1.0, 1.1)})
    learned = PolynomialSurrogate().fit(porous_training_set(24, 1, inputs), seed=0)
    return {"closed form": closed(PorousFamilyLaw("swelling")), "polynomial": closed(learned)}


def solved(make_solver, problem, law):
    solver = make_solver()
    return solver.solve(solver.prepare(problem), law)


def block(faces, swelling, **more):
    """A cube of edge 1 in two by two by one elements, with these faces."""
    return MacroProblem.model_validate(
        {
            "body": {"kind": "box", "size": (1, 1, 1), "elements": (2, 2, 1)},
            "boundary": faces,
            "time": PLAN,
            "fields": {"swelling": swelling},
            **more,
        }
    )


SLIDES, DRAINED = {"normal": 0}, {"pressure": 0}
FREE = {"x-": SLIDES, "y-": SLIDES, "z-": SLIDES, "x+": DRAINED, "y+": DRAINED, "z+": DRAINED}
HELD = {face: {"displacement": (0, 0, 0)} for face in ("x-", "y-", "z-", "x+", "z+")} | {
    "y+": {"displacement": (0, 0, 0), "pressure": 0}
}


def of_cell(law, grad_u, stretch=STRETCH):
    """The cell's own answer to H."""
    states = MacroState(grad_u[None], np.zeros(1), np.array([[stretch]]))
    return law.cell_law.predict(states, tangent=False)


@pytest.mark.parametrize("name", ["closed form", "polynomial"])
@pytest.mark.parametrize("swelling", [GROWING, STRETCH], ids=["in time", "from the beginning"])
def test_a_free_block_takes_the_stretch_and_the_pore_volume_of_its_cell(make_solver, laws, name, swelling):
    """Drained, on three symmetry planes: u = (λ − 1) X, no stress, and the fluid of the cell at H = (λ − 1) I."""
    law = laws[name]
    found = solved(make_solver, block(FREE, swelling), law)
    end = found.profiles[-1]
    np.testing.assert_allclose(end.u, (STRETCH - 1) * found.points, rtol=0, atol=1e-8 * (STRETCH - 1))
    np.testing.assert_allclose(end.p, 0.0, atol=1e-12)
    np.testing.assert_allclose(end.stress, 0.0, atol=1e-12)
    start = of_cell(law, np.zeros((3, 3)), 1.0 if swelling is GROWING else STRETCH).fluid_volume[0]
    last = of_cell(law, (STRETCH - 1) * np.eye(3)).fluid_volume[0]
    assert last == pytest.approx(STRETCH**3 * POROSITY, rel=1e-9)
    assert -found.history.drained[-1] == pytest.approx(last - start, rel=1e-8)


@pytest.mark.parametrize("name", ["closed form", "polynomial"])
def test_a_free_disc_takes_the_stretch_of_its_cell(make_solver, laws, name):
    """In its meridian, where the hoop grows too: u = (λ − 1) X, no stress, and the fluid of the cell in its volume."""
    law, area = laws[name], np.pi * 0.8**2
    faces = {"y-": SLIDES, "y+": DRAINED, "side": DRAINED}
    disc = {"kind": "axisymmetric", "radius": 0.8, "height": 1, "elements": (3, 2), "grading": (2, 0.5)}
    found = solved(make_solver, block(faces, GROWING, body=disc), law)
    end = found.profiles[-1]
    wanted = (STRETCH - 1) * found.points * (1, 1, 0)
    np.testing.assert_allclose(end.u, wanted, rtol=0, atol=1e-8 * (STRETCH - 1))
    np.testing.assert_allclose(end.stress, 0.0, atol=1e-12)
    start, last = (
        of_cell(law, (stretch - 1) * np.eye(3), stretch).fluid_volume[0] for stretch in (1.0, STRETCH)
    )
    assert -found.history.drained[-1] == pytest.approx(area * (last - start), rel=1e-8)


def test_a_held_block_has_the_stress_of_its_cell(make_solver, laws):
    law = laws["closed form"]
    found = solved(make_solver, block(HELD, GROWING), law)
    cell, dry = of_cell(law, np.zeros((3, 3))), of_cell(law, np.zeros((3, 3)), 1.0)
    assert cell.stress[0, 1, 1] < -0.03
    np.testing.assert_allclose(
        found.profiles[-1].stress, np.broadcast_to(cell.stress[0], (4, 3, 3)), rtol=0, atol=1e-8 * 0.03
    )
    assert found.history.drained[-1] == pytest.approx(dry.fluid_volume[0] - cell.fluid_volume[0], rel=1e-8)


def test_a_free_block_of_solved_cells_takes_their_stretch(make_solver):
    """Direct FE² of a cell whose stretch is a number: held until t = 0, then released; drained at all its corners."""
    cell = Cell(mesh={"size": 0.5, "fluid_size": 0.5, "element": "linear"}, material={"swelling": STRETCH})
    arguments = ("skfem", {}, cell)
    solver, prepared = prepare_cell(*arguments)
    at_rest = CellReference.compute(solver, prepared, cell, "cell")
    free = solver.solve_one(prepared, (STRETCH - 1) * np.eye(3))
    faces = {face: each | {"pressure": 0} for face, each in FREE.items()}
    problem = block(faces, STRETCH).model_dump() | {"fields": {}}
    problem["body"]["elements"] = (1, 1, 1)
    with CellPool(prepare_cell, arguments) as pool:
        cells = DirectCellLaw(pool, at_rest.response, "cell")
        law = ClosedLaw(cells, at_rest.closure("potential", cell.solid, "piola"))
        found = solved(make_solver, MacroProblem.model_validate(problem), law)
    end = found.profiles[-1]
    np.testing.assert_allclose(end.u, (STRETCH - 1) * found.points, rtol=0, atol=1e-8 * (STRETCH - 1))
    np.testing.assert_allclose(end.stress, 0.0, atol=1e-9)
    taken_up = free.fluid_volume[0] - at_rest.response.fluid_volume[0]
    assert -found.history.drained[-1] == pytest.approx(taken_up, rel=1e-8)


def test_a_body_that_is_swollen_and_free_at_first_stays_so(make_solver, laws):
    """The initial gradient is that of free swelling: nothing moves, and no fluid."""
    initial = {"gradient": ((STRETCH - 1) * np.eye(3)).tolist()}
    found = solved(make_solver, block(FREE, STRETCH, initial=initial), laws["closed form"])
    np.testing.assert_allclose(found.history.drained, 0.0, atol=1e-13)
    np.testing.assert_allclose(found.history.pressure_max, 0.0, atol=1e-13)
    np.testing.assert_allclose(found.profiles[-1].u, (STRETCH - 1) * found.points, rtol=0, atol=1e-13)


# --- a pulse in a layer --------------------------------------------------------------------------------

HEIGHT, SMALL = 1.0, 1e-4
#: Up in a short time, kept, and down again.
PULSE = ((0.0, 0.0), (0.02, SMALL), (0.2, SMALL), (0.22, 0.0))


def coefficients():
    cells = PorousFamilyLaw("swelling")
    rest = cells.predict(MacroState.zeros(1).with_parameters(np.ones((1, 1))))
    return LinearCoefficients.from_reference(
        rest, 1 - POROSITY, NeoHookean(poisson_ratio=0.3), cells.undeformed(np.ones((1, 1))).conductivity[0]
    )


def layer(between=None):
    """The pulse in units in which c_v = h = 1."""
    c = coefficients()
    rate = c.consolidation_coefficient()
    return SwellingLayer.from_coefficients(
        c, POROSITY, HEIGHT, [(t / rate, e) for t, e in PULSE], between
    ), rate


def pulse_problem(rate, between):
    table = [[t / rate, e / SMALL] for t, e in PULSE]
    ends = [t for t, _ in table]
    plan = {
        "end": 0.5 / rate, "step": 0.05 / rate, "ramp_increments": 1, "ramp_step": 0.002 / rate,
        "profiles": (0.05 / rate, ends[2], 0.24 / rate, 0.3 / rate), "tolerance": 3e-3 if between is None else 1e-3,
    }  # fmt: skip
    low, high = between or (0.0, HEIGHT)
    heights = [[low, 1.0], [low, 1.0 + SMALL], [high, 1.0 + SMALL], [high, 1.0]]
    swelling = {"kind": "table", "along": "y", "table": heights, "initial": 1.0, "over": {"table": table}}
    return confined_column(24, 0.0, size=(0.1, HEIGHT, 0.1), time=plan, fields={"swelling": swelling})


@pytest.mark.parametrize(
    ("kind", "between"),
    [
        ("linear", None),
        pytest.param("nonlinear", None, marks=pytest.mark.slow),
        pytest.param("nonlinear", (0.25, 0.5), marks=pytest.mark.slow),
    ],
    ids=["linear", "nonlinear", "in a part"],
)
def test_a_pulse_of_swelling_relaxes_as_the_linear_theory_says(make_solver, laws, kind, between):
    exact, rate = layer(between)
    law = laws["polynomial"]
    found = solved(make_solver, pulse_problem(rate, between), LinearisedLaw(law) if kind == "linear" else law)
    largest = max(
        np.abs(exact.pressure(found.points[:, 1], profile.time)).max() for profile in found.profiles[1:]
    )
    assert largest > 0.01 * SMALL
    for profile in found.profiles[1:]:
        pressure = exact.pressure(found.points[:, 1], profile.time)
        np.testing.assert_allclose(profile.p, pressure, rtol=0, atol=0.01 * largest)
    top = np.isclose(found.points[:, 1], HEIGHT)
    rises = [exact.rise(profile.time) for profile in found.profiles[1:]]
    tops = [profile.u[top, 1].mean() for profile in found.profiles[1:]]
    np.testing.assert_allclose(tops, rises, rtol=0, atol=0.01 * max(np.abs(rises)))


def test_the_closed_form_tends_to_free_swelling_and_begins_undrained():
    """At the end the confined rise B e/C; at first no fluid has moved, so that ζ = 0."""
    c = coefficients()
    sudden = SwellingLayer.from_coefficients(c, POROSITY, HEIGHT, [(0.0, SMALL)])
    late = 20 / c.consolidation_coefficient()
    bulk = np.einsum("kk->", c.stiffness[1, 1]) / 3
    assert sudden.rise(late) == pytest.approx(3 * bulk / c.stiffness[1, 1, 1, 1] * SMALL * HEIGHT, rel=1e-10)
    p = sudden.sudden_pressure * SMALL
    strain = (c.biot[1, 1] * p + 3 * bulk * SMALL) / c.stiffness[1, 1, 1, 1]
    taken_up = c.biot[1, 1] * strain + c.storage * p - (np.trace(c.biot) - 3 * POROSITY) * SMALL
    assert taken_up == pytest.approx(0.0, abs=1e-12 * SMALL)
