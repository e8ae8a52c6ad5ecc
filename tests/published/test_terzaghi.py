"""One-dimensional consolidation: the series against published values, finite elements against the series."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.macro.analytic import Terzaghi
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.testing.synthetic.response import confined_column, cubic_reference
from porocore_fem_skfem.macro import SkfemMacroSolver

LAYER = Terzaghi(height=7.5, load=0.01, stiffness=0.444, biot=0.79, storage=0.34, conductivity=1.94)
#: Tv at U in per cent for a constant initial pressure, to three decimals (Das, Principles of Geotechnical
#: Engineering).
PUBLISHED = {
    10: 0.008,
    20: 0.031,
    30: 0.071,
    40: 0.126,
    50: 0.197,
    60: 0.286,
    70: 0.403,
    80: 0.567,
    90: 0.848,
}


SUDDEN = 1e-6


def time_of(layer: Terzaghi, T: float) -> float:
    return T * layer.height**2 / layer.consolidation_coefficient


@pytest.mark.parametrize(("percent", "T"), PUBLISHED.items())
def test_degree_of_consolidation_is_the_published_one(percent, T):
    # The table has three decimals of T; half a unit of the last is worth dU/dT × 5e-4.
    slope = (LAYER.degree(time_of(LAYER, T + 1e-6)) - LAYER.degree(time_of(LAYER, T - 1e-6))) / 2e-6
    assert abs(LAYER.degree(time_of(LAYER, T)) - percent / 100) < 6e-4 * slope


def test_undrained_state_stores_nothing_and_bears_the_load():
    p, strain = LAYER.initial_pressure, -LAYER.immediate_settlement / LAYER.height
    assert LAYER.biot * strain + LAYER.storage * p == pytest.approx(0, abs=1e-16)
    assert LAYER.stiffness * strain - LAYER.biot * p == pytest.approx(-LAYER.load, rel=1e-14)


def test_incompressible_constituents_give_the_textbook_values():
    """α = 1, 1/M_B = 0: the water bears all the load and nothing settles at first; c_v = K C."""
    clay = Terzaghi(height=2.0, load=0.3, stiffness=5.0, biot=1.0, storage=0.0, conductivity=0.7)
    assert clay.initial_pressure == pytest.approx(0.3)
    assert clay.immediate_settlement == pytest.approx(0, abs=1e-16)
    assert clay.final_settlement == pytest.approx(0.12)
    assert clay.consolidation_coefficient == pytest.approx(3.5)


@pytest.mark.parametrize("T", [3e-4, 5e-3, 0.1, 0.6])
def test_pressure_solves_the_diffusion_equation_and_the_boundary_conditions(T):
    t, y, h = time_of(LAYER, T), np.linspace(5.5, 7.3, 7), LAYER.height
    dy, dt = 2e-3, 1e-3 * t
    curvature = (LAYER.pressure(y + dy, t) - 2 * LAYER.pressure(y, t) + LAYER.pressure(y - dy, t)) / dy**2
    rate = (LAYER.pressure(y, t + dt) - LAYER.pressure(y, t - dt)) / (2 * dt)
    scale = abs(rate).max()
    np.testing.assert_allclose(LAYER.consolidation_coefficient * curvature, rate, rtol=0, atol=1e-4 * scale)
    assert LAYER.pressure(h, t) == pytest.approx(0, abs=1e-15)
    assert LAYER.pressure(dy, t) == pytest.approx(LAYER.pressure(0, t), rel=1e-6)


def test_settlement_is_the_integral_of_the_strain():
    y = (np.arange(4000) + 0.5) / 4000 * LAYER.height
    for T in (2e-4, 0.02, 0.4):
        t = time_of(LAYER, T)
        strain = (LAYER.biot * LAYER.pressure(y, t) - LAYER.load) / LAYER.stiffness
        assert LAYER.settlement(t) == pytest.approx(-strain.mean() * LAYER.height, rel=1e-5)


def test_series_and_short_time_branch_meet():
    t = np.array([time_of(LAYER, 1e-3 * (1 - 1e-9)), time_of(LAYER, 1e-3 * (1 + 1e-9))])
    for values in (LAYER.degree(t), LAYER.pressure(7.2, t), LAYER.pressure(1.0, t)):
        assert values[0] == pytest.approx(values[1], rel=1e-8)


def test_times_and_heights_broadcast():
    t = time_of(LAYER, 0.1) * np.arange(3)
    assert LAYER.degree(t)[0] == 0
    assert LAYER.pressure(np.array([[0.0], [3.0]]), t).shape == (2, 3)
    assert LAYER.settlement(0.0) == pytest.approx(LAYER.immediate_settlement)


@pytest.fixture(scope="module")
def column():
    """A linear column of 20 elements with 500 steps up to T = 0.5, and its closed form."""
    coefficients = LinearCoefficients.from_reference(
        cubic_reference(), 0.5877, NeoHookean(), 1.94 * np.eye(3)
    )
    layer = Terzaghi.from_coefficients(coefficients, 7.5, 0.01)
    times = {T: time_of(layer, T) for T in (0.05, 0.1, 0.3, 0.5)}
    plan = {"end": times[0.5], "step": times[0.5] / 500, "ramp_increments": 1}
    plan |= {"ramp_step": SUDDEN, "profiles": (SUDDEN, *times.values())}
    solver = SkfemMacroSolver()
    problem = confined_column(20, load=-0.01, time=plan)
    return layer, times, solver.solve(solver.prepare(problem), LinearPoroelasticity(coefficients))


@pytest.mark.parametrize("T", [0.05, 0.1, 0.3, 0.5])
def test_linear_column_follows_the_series(column, T):
    """Pressure within 0.5 % of p₀ everywhere, the settlement and the drained volume within 0.5 %."""
    layer, times, solution = column
    profile = next(p for p in solution.profiles if p.time == times[T])
    exact = layer.pressure(solution.points[:, 1], times[T])
    assert abs(profile.p - exact).max() < 0.005 * layer.initial_pressure
    settlement = -profile.u[:, 1].min()
    assert settlement == pytest.approx(float(layer.settlement(times[T])), rel=0.005)
    history = solution.history
    at = history.time == times[T]
    assert history.settlement[at] == pytest.approx(settlement, rel=1e-14)
    assert history.pressure_max[at] == pytest.approx(layer.pressure(0.0, times[T]), rel=0.005)
    drained = 0.01 * layer.biot * layer.final_settlement  # in the end; the cross-section is 0.01
    assert history.drained[at] == pytest.approx(drained * layer.degree(times[T]), rel=0.005)


def test_linear_column_starts_undrained(column):
    """At first only the uppermost of the 20 elements has lost pressure."""
    layer, _, solution = column
    first = solution.after_rest[0]
    assert first.time == SUDDEN
    assert first.p[solution.points[:, 1] == 0] == pytest.approx(layer.initial_pressure, rel=1e-6)
    more = solution.history.settlement[1] - layer.immediate_settlement
    assert 0 < more < (layer.final_settlement - layer.immediate_settlement) / 20
