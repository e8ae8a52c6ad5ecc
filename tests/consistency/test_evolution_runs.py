"""Runs of bodies whose cells evolve: derivatives, a filter that clogs, restart, place of the points."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from porocore.interfaces.sensitivities import CellParameterChange, ModulusChange, ViscosityChange
from porocore.macro.laws.evolution import EvolvingLaw
from porocore.macro.laws.rates import NAMED_RATES, Rate
from porocore.macro.problem import MacroProblem
from porocore.plugins.registry import registry
from porocore.testing.synthetic.porous_family import porosity
from tests.consistency.test_gradients import compare
from tests.consistency.test_sensitivities import check, solve
from tests.helpers.sensitivity_bodies import NEWTON, SIDES, TIME, law

CELL = ("radius", "swelling", "viscosity")
RANGES = {"radius": (0.1, 0.3), "swelling": (0.8, 1.4)}
#: Rates that follow stress, pressure, fluid, flux, place and time, and hang on one another.
RATES = {
    "swelling": Rate("a*(mean_stress - target) + 0.02*a*y*p*phi", CELL, ["a", "target"]),
    "radius": Rate("-k*(radius - 0.1)*flux + 0.01*k*t*J*swelling", CELL, ["k"]),
}


@pytest.fixture(params=["skfem", pytest.param("dolfinx", marks=pytest.mark.slow)])
def make_solver(request):
    pytest.importorskip(request.param)
    return registry().get("macro solver", request.param)


def evolving(rates=RATES) -> EvolvingLaw:
    return EvolvingLaw(law(*CELL), rates, RANGES)


def column(*, radius=0.0, a=0.4, target=-0.02, k=3.0, viscosity=0.01, **settings) -> MacroProblem:
    """A column under a load, whose fluid leaves at the top."""
    data = {
        "body": {"kind": "box", "elements": (1, 3, 1), "size": (0.5, 1.5, 0.5)},
        "boundary": {
            **SIDES,
            "y-": {"displacement": (0, 0, 0)},
            "y+": {"traction": (0, -0.05, 0), "pressure": 0},
        },
        "time": TIME,
        "newton": NEWTON,
        "probes": {"inside": (0.2, 0.6, 0.3)},
        "fields": {
            "radius": f"{0.2 + radius!r} + 0.01*y",
            "swelling": 1.0,
            "viscosity": viscosity,
            "evolution.swelling.a": a,
            "evolution.swelling.target": target,
            "evolution.radius.k": k,
        },
    }
    return MacroProblem.model_validate(data | settings)


UNKNOWNS = {
    "radius": (CellParameterChange("radius"), 0.0),
    "a": (CellParameterChange("evolution.swelling.a"), 0.4),
    "target": (CellParameterChange("evolution.swelling.target"), -0.02),
    "k": (CellParameterChange("evolution.radius.k", factor=True), 3.0, True),
    "viscosity": (ViscosityChange(), 0.01, True),
}


def test_derivatives_by_constants_of_rates_and_initial_values(make_solver):
    check(make_solver, column, evolving(), UNKNOWNS, together=True)


@pytest.mark.slow
def test_derivatives_by_each_constant_and_initial_value(make_solver):
    check(make_solver, column, evolving(), UNKNOWNS)


def test_gradients_by_constants_of_rates_and_initial_values(make_solver):
    changes = [*(change for change, *_ in UNKNOWNS.values()), ModulusChange()]
    compare(make_solver, column(), evolving(), changes)


def test_rates_of_zero_are_a_run_without_evolution(make_solver):
    still = solve(make_solver, column(a=0.0, k=0.0), evolving())
    fields = {name: value for name, value in column().fields.items() if "evolution" not in name}
    plain = solve(make_solver, column().model_copy(update={"fields": fields}), law(*CELL))
    np.testing.assert_array_equal(still.history.settlement, plain.history.settlement)
    np.testing.assert_array_equal(still.probes["inside"], plain.probes["inside"])


def test_a_run_that_drives_a_parameter_out_of_its_range_goes_on_and_is_flagged(make_solver):
    rates = {"radius": Rate("-k*(1 + flux)", CELL, ["k"])}
    problem = column(k=0.05, viscosity=1e-4)
    fields = {name: value for name, value in problem.fields.items() if "swelling." not in name}
    found = solve(make_solver, problem.model_copy(update={"fields": fields}), evolving(rates)).history
    assert found.time[-1] == TIME["end"]
    assert found.flagged_outside[-1] > 0
    assert np.isfinite(found.settlement).all()


@pytest.mark.parametrize("formula", ["-k*radius", "-k*t"])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_steps_follow_the_error_of_what_evolves(make_solver, tolerance, formula):
    """Of a change that is small beside r: the error is a share of the change; also of one that begins at rest."""
    rates, rate = {"radius": Rate(formula, CELL, ["k"])}, 0.05 if "radius" in formula else 0.01
    problem = column(k=rate)
    fields = {name: value for name, value in problem.fields.items() if "swelling." not in name}
    time = problem.time.model_copy(update={"tolerance": tolerance, "step": 3.0})
    given = problem.model_copy(update={"fields": fields | {"radius": 0.25}, "time": time, "load": 1e-6})
    found = solve(make_solver, given, evolving(rates))
    end = TIME["end"]
    exact = 0.25 * np.exp(-rate * end) if "radius" in formula else 0.25 - rate * end**2 / 2
    error = abs(found.profiles[-1].internal["radius"] - exact).max() / (0.25 - exact)
    steps = len(found.history.time) - 1
    # Errors of steps add up where the change does not lag behind its rate.
    assert 0 < error < tolerance * (3 if "radius" in formula else steps)
    assert steps < 200


# ---- a filter that clogs ------------------------------------------------------------------------------

PRESSURE, VISCOSITY, DEPOSITION, CLOGGED, RAMP, END = 1e-4, 1e-5, 8.0, 0.1, 0.05, 3.0


def clogging_filter(step: float) -> MacroProblem:
    """A filter of length 1 that hardly deforms, through which a pressure drives fluid."""
    data = {
        "body": {"kind": "box", "elements": (1, 4, 1), "size": (0.2, 1.0, 0.2)},
        "boundary": {
            **SIDES,
            "y-": {"displacement": (0, 0, 0), "pressure": PRESSURE},
            "y+": {"displacement": (0, 0, 0), "pressure": 0},
        },
        "time": {"end": END, "step": step, "ramp_increments": 1, "ramp_step": RAMP, "profiles": ()},
        "fields": {
            "radius": "0.24 - 0.04*y",
            "viscosity": VISCOSITY,
            "evolution.radius.deposition": DEPOSITION,
            "evolution.radius.clogged": CLOGGED,
        },
    }
    return MacroProblem.model_validate(data)


def flow_by_differences(cells=400):
    """Flux that enters and leaves a rigid filter at the end, by finite volumes.

    ∂φ_f/∂t + ∂q/∂y = 0, q = −K ∂p/∂y, ṙ = −d q (r − c): so ∂q/∂y = d (r − c) q ∂φ_f/∂r, and ∫ q/K dy is the pressure.
    """
    y = (np.arange(cells) + 0.5) / cells

    def flow(t, r):
        K = r**4 * (1 + 8 * r) / VISCOSITY
        gain = DEPOSITION * (r - CLOGGED) * (porosity(r + 1e-6) - porosity(r - 1e-6)) / 2e-6 / cells
        end = np.exp(np.cumsum(gain))
        middle = end * np.exp(-gain / 2)
        inlet = PRESSURE * min(1.0, t / RAMP) / np.mean(middle / K)
        return inlet, middle * inlet, end[-1] * inlet

    def rate(t, r):
        return -DEPOSITION * flow(t, r)[1] * (r - CLOGGED)

    found = solve_ivp(rate, (0, END), 0.24 - 0.04 * y, rtol=1e-8, atol=1e-11, max_step=RAMP)
    inlet, _, outlet = flow(END, found.y[:, -1])
    return inlet, outlet


def test_a_filter_clogs_as_by_finite_differences(make_solver):
    cell = ("radius", "viscosity")
    rates = {"radius": NAMED_RATES["clogging"].of("radius", cell)}
    given = EvolvingLaw(law(*cell), rates, RANGES)
    ends = []
    for step in (0.295, 0.1475):
        found = solve(make_solver, clogging_filter(step), given)
        ends.append(np.array([found.inflow["y-"][-1], -found.inflow["y+"][-1]]) / 0.04)
    coarse, fine = ends
    expected = np.array(flow_by_differences())
    np.testing.assert_allclose(2 * fine - coarse, expected, rtol=5e-3)
    # Backward Euler is of first order.
    np.testing.assert_allclose((coarse[1] - expected[1]) / (fine[1] - expected[1]), 2, rtol=0.05)
    assert expected[1] > 3 * expected[0]
