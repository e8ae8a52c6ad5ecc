"""A charged body begins swollen in its bath: equilibria, what is counted from there, derivatives, resumed runs."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.errors import ConfigurationError, SolveError
from porocore.interfaces.sensitivities import (
    BoundaryChange,
    CellParameterChange,
    HistoryWeights,
    ModulusChange,
    ViscosityChange,
)
from porocore.macro.analytic import ChargedCell
from porocore.macro.laws.charges import ChargedLaw
from porocore.macro.laws.relaxation import RelaxingLaw
from porocore.macro.problem import MacroProblem
from porocore.plugins.registry import registry
from porocore.states import MacroState
from tests.helpers import sensitivity_bodies

OSMOTIC, DENSITY, BATH = 0.25, 0.2, 0.05
SIDES = {face: {"displacement": (0, None, 0)} for face in ("x-", "x+", "z-", "z+")}
ROLLERS = {f"{axis}-": {"displacement": [0 if axis == other else None for other in "xyz"]} for axis in "xyz"}
PRESSED = {"displacement": (None, -0.03, None), "pressure": 0}


@pytest.fixture(params=["skfem", pytest.param("dolfinx", marks=pytest.mark.slow)])
def make_solver(request):
    pytest.importorskip(request.param)
    return registry().get("macro solver", request.param)


def charged(closure="potential", relaxing=False):
    law = sensitivity_bodies.law("radius", closure=closure)
    return ChargedLaw(RelaxingLaw(law, 1) if relaxing else law, OSMOTIC)


def problem(
    *, sides=SIDES, top=PRESSED, moved=-0.03, density=DENSITY, bath=BATH, radius=0.21, strength=None, **more
):
    top = {**top, "displacement": (None, moved, None)} if top is PRESSED else top
    fields = {"charges.density": density, "charges.bath": bath, "radius": f"{radius!r} + 0.01*y"}
    if strength is not None:
        fields |= {"relaxation.1.strength": strength, "relaxation.1.time": 0.6}
    data = {
        "body": {"kind": "box", "elements": (1, 3, 1), "size": (0.5, 1.5, 0.5)},
        "boundary": {
            **sides,
            "y-": {"displacement": (0, 0, 0) if sides is SIDES else (None, 0, None)},
            "y+": top,
        },
        "time": {"end": 3.0, "step": 1.0, "ramp_increments": 2, "ramp_step": 0.2, "profiles": ()},
        "newton": {"tolerance": 1e-13},
        "fields": fields,
        "charges": {"density": density, "bath": bath},
        "probes": {"inside": (0.2, 0.6, 0.3)},
        "load": 1.0,
    }
    return MacroProblem.model_validate(data | more)


def equilibrium(law, radius, along):
    """Return the strain of a cell in its bath, by the scalar equations."""
    inner = law.law

    def response(H, p):
        at = MacroState.single(H, p).with_parameters([radius])
        found = inner.respond(at, np.zeros((1, 3)), inner.initial_at(at.at_rest()))
        return found.stress[0], float(found.memory.fluid_volume[0])

    rest = MacroState.zeros(1).with_parameters([radius])
    charge = DENSITY * float(inner.initial_at(rest).fluid_volume[0])
    return ChargedCell(response, charge, BATH, OSMOTIC).equilibrium(along)


EVEN = {"charges.density": DENSITY, "charges.bath": BATH, "radius": 0.22}
CONFINED = np.diag([0.0, 1.0, 0.0])


@pytest.mark.parametrize("closure", ["potential", "mean-gradient"])
@pytest.mark.parametrize("sides", ["held", "free"])
def test_a_body_begins_in_equilibrium_with_its_bath(make_solver, closure, sides):
    """A column between walls, and one on rollers, by the scalar equations; nothing moves while nothing is changed.

    The fluid of the closure mean-gradient is summed over the steps of the swelling, that of the equations over one.
    """
    law, solver = charged(closure), make_solver()
    held, exact = sides == "held", closure == "potential"
    given = problem(sides=SIDES if held else ROLLERS, top={"pressure": 0}, fields=EVEN)
    found = solver.solve(solver.prepare(given), law)
    strain, p = equilibrium(law, 0.22, CONFINED if held else np.eye(3))
    assert strain > 0.01
    H = strain * (CONFINED if held else np.eye(3))
    for profile in found.profiles:
        np.testing.assert_allclose(profile.grad_u - H, 0, atol=1e-8 if exact else 2e-5)
        np.testing.assert_allclose(profile.p, 0, atol=1e-10)
        np.testing.assert_allclose(profile.internal["pore_pressure"], p, rtol=1e-7 if exact else 1e-3)
    np.testing.assert_allclose(found.history.heave, 1.5 * strain, rtol=1e-8 if exact else 1e-3)
    np.testing.assert_allclose(found.history.heave, found.history.heave[0], rtol=1e-9)
    assert abs(found.history.drained).max() < 1e-10


def test_displacements_are_counted_from_the_swollen_state(make_solver):
    law, solver = charged(), make_solver()
    time = {"end": 4e6, "step": 1e6, "ramp_increments": 2, "ramp_step": 0.2, "profiles": ()}
    found = solver.solve(solver.prepare(problem(fields=EVEN, time=time)), law)
    strain, _ = equilibrium(law, 0.22, CONFINED)
    top = found.profiles[-1].grad_u[:, 1, 1]
    np.testing.assert_allclose(top, strain - 0.03 / 1.5, rtol=0, atol=1e-8)
    force = found.reactions["y+"][:, 1]
    assert abs(force[0]) < 1e-12
    # On a wall, which holds the body from the beginning.
    assert found.reactions["x-"][0, 0] > 1e-4
    np.testing.assert_allclose(found.reactions["x-"][0], -found.reactions["x+"][0], atol=1e-12)
    assert force[-1] < -1e-4


UNKNOWNS = {
    "density": (CellParameterChange("charges.density"), DENSITY),
    "bath": (CellParameterChange("charges.bath"), BATH),
    "radius": (CellParameterChange("radius"), 0.21),
    "strength": (CellParameterChange("relaxation.1.strength"), 0.5),
    "moved": (BoundaryChange("y+", "displacement", 1), -0.03),
}
BASE = {name: value for name, (_, value) in UNKNOWNS.items()}


def values(solution):
    """Numbers of a run by name."""
    history = solution.history if hasattr(solution, "history") else solution
    found = {name: getattr(history, name) for name in ("heave", "pressure_max", "drained")}
    return found | {
        "probe": solution.probes["inside"],
        "force": solution.reactions["y+"],
        "wall": solution.reactions["x-"],
    }


@pytest.mark.parametrize(
    ("closure", "tried"),
    [
        ("potential", ["density", "moved"]),
        pytest.param("potential", [*UNKNOWNS], marks=pytest.mark.slow),
        pytest.param("mean-gradient", [*UNKNOWNS], marks=pytest.mark.slow),
    ],
)
def test_derivatives_are_limits_of_differences(make_solver, closure, tried):
    """By charges, bath, cell, branch and the motion, and by one pass backwards."""
    law, solver = charged(closure, relaxing=True), make_solver()
    changes = [UNKNOWNS[name][0] for name in tried]
    prepared = solver.prepare(problem(**BASE))
    solution, found = solver.solve_with_sensitivities(prepared, law, changes)
    plain = solver.solve(solver.prepare(problem(**BASE)), law)
    np.testing.assert_array_equal(solution.history.heave, plain.history.heave)
    mine, sizes = values(found), values(plain)
    for k, name in enumerate(tried):
        value = BASE[name]
        step = 1e-4 * value
        ends = [
            values(solver.solve(solver.prepare(problem(**BASE | {name: value + h})), law))
            for h in (step, -step)
        ]
        for key, size in sizes.items():
            wanted = (ends[0][key] - ends[1][key]) / (2 * step)
            derivative = mine[key][..., k].copy()
            # Forces of the beginning have no derivatives.
            if key in ("force", "wall"):
                wanted, derivative = wanted[1:], derivative[1:]
            scale = max(abs(wanted).max(), 0.1 * abs(size).max())
            assert abs(derivative - wanted).max() <= 2e-6 * scale, (
                name,
                key,
                abs(derivative - wanted).max() / scale,
            )

    noise, steps = np.random.default_rng(3), len(plain.history.time)
    drawn = {key: noise.normal(size=(*size.shape, 2)) for key, size in sizes.items()}
    weights = HistoryWeights(
        2,
        heave=drawn["heave"],
        pressure_max=drawn["pressure_max"],
        drained=drawn["drained"],
        probes={"inside": drawn["probe"]},
        reactions={"y+": drawn["force"], "x-": drawn["wall"]},
    )
    for key in ("force", "wall"):
        drawn[key][0] = 0.0
    _, gradients = solver.solve_with_gradients(prepared, law, changes, lambda given: weights)
    wanted = sum(
        each.reshape(-1, 2).T @ mine[key].reshape(each.reshape(-1, 2).shape[0], -1)
        for key, each in drawn.items()
    )
    np.testing.assert_allclose(gradients, wanted, rtol=0, atol=1e-8 * abs(wanted).max())
    assert steps == 6


def test_modulus_and_viscosity_have_derivatives_of_a_swollen_body(make_solver):
    """Twice as stiff a solid in osmotic pressures twice as large swells alike; the viscosity changes no equilibrium."""
    law, solver = charged(), make_solver()
    changes = [
        ModulusChange(),
        ViscosityChange(),
        CellParameterChange("charges.density"),
        CellParameterChange("charges.bath"),
    ]
    still = problem(top={"pressure": 0})
    _, found = solver.solve_with_sensitivities(solver.prepare(still), law, changes)
    by_modulus, by_viscosity, density, bath = found.heave[0]
    assert by_modulus == pytest.approx(-(DENSITY * density + BATH * bath), rel=1e-6)
    assert abs(by_viscosity) < 1e-8 * abs(by_modulus)


def test_a_swollen_run_that_is_interrupted_goes_on_to_the_last_bit(make_solver, tmp_path):
    law = charged(relaxing=True)
    given = problem(**BASE)
    whole = make_solver().solve(make_solver().prepare(given), law)

    class Enough(Exception):
        pass

    def interrupt(report):
        if report.time > 0.3:
            raise Enough

    solver = make_solver(checkpoint_seconds=0)
    with pytest.raises(Enough):
        solver.solve(solver.prepare(given), law, checkpoint=tmp_path / "m.h5", on_step=interrupt)
    found = make_solver().solve(make_solver().prepare(given), law, checkpoint=tmp_path / "m.h5")
    theirs = whole.profiles[-1].arrays()
    for name, value in found.profiles[-1].arrays().items():
        np.testing.assert_array_equal(value, theirs[name], err_msg=name)
    np.testing.assert_array_equal(found.reactions["x-"], whole.reactions["x-"])


def test_what_cannot_swell_is_told():
    pytest.importorskip("skfem")
    solver, law = registry().get("macro solver", "skfem")(), charged()
    sealed = problem(top={"displacement": (None, -0.03, None)})
    with pytest.raises(
        ConfigurationError, match=r"charges\.initial: free swelling takes up fluid, but no surface"
    ):
        solver.solve(solver.prepare(sealed), law)
    both = problem()
    loose = both.model_copy(update={"boundary": {**both.boundary, "y-": both.boundary["y+"].model_copy()}})
    with pytest.raises(
        ConfigurationError, match=r"charges\.initial: without what moves it, the body is not held"
    ):
        solver.solve(solver.prepare(loose), law)
    ball = {
        "shape": {"kind": "sphere", "radius": 0.5},
        "place": (0.25, 1.5, 0.25),
        "displacement": 0.05,
        "surfaces": ["y+"],
    }
    touched = problem(top={"pressure": 0}, contact={"ball": ball})
    with pytest.raises(
        SolveError, match=r"contact\.ball: the indenter begins .* deep inside the swollen body"
    ):
        solver.solve(solver.prepare(touched), law)
