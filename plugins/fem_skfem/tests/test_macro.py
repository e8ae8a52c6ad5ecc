"""The u–p solver: the discrete equations, closed forms, orders of convergence and balances."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from porocore.cell.material import NeoHookean
from porocore.closures import LinearCellLaw
from porocore.solution import History
from porocore.states import MacroState
from porocore.terzaghi import Terzaghi
from porocore.testing.synthetic import (
    CONDUCTIVITY,
    SOLID_FRACTION,
    AlteredLaw,
    confined_column,
    cubic_reference,
    linear_law,
    mean_gradient_law,
)
from porocore_fem_skfem.macro import SkfemMacroSolver

SOLVER = SkfemMacroSolver()
LINEAR, NONLINEAR = linear_law(), mean_gradient_law()
COEFFICIENTS, PHI_S, K = LINEAR.coefficients, SOLID_FRACTION, CONDUCTIVITY
C22, ALPHA = COEFFICIENTS.stiffness[1, 1, 1, 1], COEFFICIENTS.biot[1, 1]
SHORT = {"end": 6.0, "step": 0.5, "ramp_increments": 4, "ramp_step": 0.05, "profiles": (1.0,)}
SIDES = {face: {"displacement": (0, None, 0)} for face in ("x-", "x+", "z-", "z+")}
HELD = {"displacement": (0, 0, 0)}


def solve(problem, law, **how):
    return SOLVER.solve(SOLVER.prepare(problem), law, **how)


# --- the discrete equations -------------------------------------------------------------------------


@pytest.mark.parametrize("elements", [(1, 2, 1), (2, 1, 2)])
def test_tangent_is_the_slope_of_the_residual(elements):
    """All unknowns free to move, a nonlinear law, a state without any symmetry."""
    problem = confined_column(elements, size=(0.7, 1.1, 0.9))
    assembler = SOLVER.prepare(problem)
    rng = np.random.default_rng(0)
    x, old = 0.02 * rng.standard_normal((2, assembler.mesh.size))
    states, _ = assembler.states(old)
    memory = NONLINEAR.respond(states, np.zeros((len(states), 3)), NONLINEAR.initial(len(states))).memory

    def residual(x):
        states, grad_p = assembler.states(x)
        response = NONLINEAR.respond(states, grad_p, memory)
        return assembler.residual(response, 0.3, -0.2).values[assembler.free], response

    system = assembler.system(residual(x)[1].tangent, 0.3)
    direction, h = rng.standard_normal(assembler.mesh.size), 1e-6
    slope = (residual(x + h * direction)[0] - residual(x - h * direction)[0]) / (2 * h)
    exact = system.free @ direction[assembler.free] + system.coupling @ direction[assembler.prescribed]
    np.testing.assert_allclose(exact, slope, rtol=0, atol=1e-7 * abs(slope).max())


def test_gradients_of_a_quadratic_displacement_and_a_linear_pressure_are_exact():
    assembler = SOLVER.prepare(confined_column((2, 3, 2), size=(1, 2, 3)))
    mesh = assembler.mesh
    rng = np.random.default_rng(2)
    A, B, g = rng.standard_normal((3, 3)), rng.standard_normal((3, 3, 3)), rng.standard_normal(3)
    u = mesh.points @ A.T + np.einsum("ijk,nj,nk->ni", B, mesh.points, mesh.points)
    p = 0.3 + mesh.points[mesh.p_nodes] @ g
    states, grad_p = assembler.states(np.concatenate([u.ravel(), p]))
    np.testing.assert_allclose(grad_p, np.broadcast_to(g, grad_p.shape), rtol=1e-11)
    # H is linear in X, so its mean is its value in the middle; a linear field has the same H everywhere.
    linear, _ = assembler.states(np.concatenate([(mesh.points @ A.T).ravel(), p]))
    np.testing.assert_allclose(linear.grad_u, np.broadcast_to(A, linear.grad_u.shape), atol=1e-12)
    mean = np.einsum("n,nij->ij", assembler.weights, states.grad_u) / assembler.weights.sum()
    expected = A + np.einsum("ijk,k->ij", B + B.transpose(0, 2, 1), np.array([0.5, 1, 1.5]))
    np.testing.assert_allclose(mean, expected, rtol=1e-11)
    assert assembler.weights.sum() == pytest.approx(6, rel=1e-13)


def test_cells_are_triquadratic_hexahedra_in_vtk_order():
    solution = solve(confined_column((1, 2, 1), size=(2, 4, 6), time=SHORT), LINEAR)
    nodes = solution.points[solution.cells]
    first = nodes[np.argmin(nodes[:, :, 1].mean(axis=1))] / np.array([1, 1, 3])
    corners = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
    edges = ["01", "12", "23", "30", "45", "56", "67", "74", "04", "15", "26", "37"]
    faces = ["0473", "1265", "0154", "3762", "0123", "4567"]  # x-, x+, y-, y+, z-, z+
    expected = np.array(
        corners + [np.mean([corners[int(c)] for c in e], axis=0) for e in edges + faces] + [(1, 1, 1)]
    )
    np.testing.assert_allclose(first, expected, atol=1e-12)


# --- states that are known exactly ------------------------------------------------------------------


def test_uniform_drained_strain_is_reproduced():
    """Two faces displaced, one free: H is uniform and P_E,33 = 0, whatever the mesh."""
    roller = [[None] * 3 for _ in range(3)]
    for i in range(3):
        roller[i][i] = 0
    dry = {"pressure": 0}
    boundary = {f"{axis}-": {"displacement": tuple(roller[i]), **dry} for i, axis in enumerate("xyz")}
    boundary |= {
        "x+": {"displacement": (0.1, None, None), **dry},
        "y+": {"displacement": (None, -0.3, None), **dry},
        "z+": dry,
    }
    problem = confined_column((2, 3, 2), load=1.0, size=(1, 2, 1.5), boundary=boundary, time=SHORT)
    profile = solve(problem, NONLINEAR).profiles[-1]
    H = profile.grad_u
    np.testing.assert_allclose(H, np.broadcast_to(H[0], H.shape), atol=1e-10)
    np.testing.assert_allclose(np.diag(H[0])[:2], [0.1, -0.15], atol=1e-12)
    np.testing.assert_allclose(H[0] - np.diag(np.diag(H[0])), 0, atol=1e-10)
    np.testing.assert_allclose(profile.p, 0, atol=1e-14)
    # The stress by the strain energy of the mean deformation, differentiated numerically.
    law = LinearCellLaw(cubic_reference())
    mean = law.predict(MacroState.single(H[0])).mean_grad[0]
    F, h = np.eye(3) + H[0] + mean / PHI_S, 1e-5
    energy = [NeoHookean().energy(F + s * h * np.diag(e)) for e in np.eye(3) for s in (1, -1)]
    stress = PHI_S * (np.array(energy[::2]) - np.array(energy[1::2])) / (2 * h)
    np.testing.assert_allclose(np.diag(profile.stress[0]), stress, atol=1e-9)
    assert abs(stress[2]) < 1e-8 < abs(stress[1])


def test_undrained_column_keeps_its_fluid():
    """Displaced on top and sealed: p = −α ε M_B at once and everywhere, P_E,22 = (C + α² M_B) ε."""
    boundary = {**SIDES, "y-": HELD, "y+": {"displacement": (None, 1, None)}}
    solution = solve(confined_column(5, load=-0.03, boundary=boundary, time=SHORT), LINEAR)
    strain = -0.03 / 7.5
    p = -ALPHA * strain * COEFFICIENTS.biot_modulus
    np.testing.assert_allclose(solution.profiles[-1].p, p, rtol=1e-10)
    np.testing.assert_allclose(solution.profiles[-1].stress[:, 1, 1], C22 * strain - ALPHA * p, rtol=1e-10)
    np.testing.assert_allclose(solution.history.drained_flux, 0, atol=1e-16)
    ramp = np.minimum(1, solution.history.time / 0.2)
    np.testing.assert_allclose(solution.history.settlement, 0.03 * ramp, rtol=1e-12)
    np.testing.assert_allclose(solution.history.pressure_max, p * ramp, rtol=1e-9)
    assert solution.history.iterations.max() == 1  # the prescribed jump is part of the linear system


def test_prescribed_inflow_ends_in_a_linear_pressure():
    """Fluid pressed in at the base and let out on top: p = q̄ (h − y)/K, σ = 0, swelling α p/C."""
    flux, h = 0.02, 7.5
    boundary = {**SIDES, "y-": {**HELD, "flux": -flux}, "y+": {"pressure": 0}}
    plan = {"end": 4000, "step": 200, "ramp_increments": 2, "ramp_step": 10, "profiles": ()}
    solution = solve(confined_column(6, load=1.0, boundary=boundary, time=plan), LINEAR)
    profile, y = solution.profiles[-1], solution.points[:, 1]
    p = flux * (h - y) / K[1, 1]
    np.testing.assert_allclose(profile.p, p, atol=1e-8 * p.max())
    np.testing.assert_allclose(profile.flux, np.broadcast_to([0, flux, 0], (6, 3)), atol=1e-8 * flux)
    swelling = ALPHA / C22 * flux * (h * y - y**2 / 2) / K[1, 1]
    np.testing.assert_allclose(profile.u[:, 1], swelling, atol=1e-7 * swelling.max())
    stored = (COEFFICIENTS.storage + ALPHA**2 / C22) * 0.01 * flux * h**2 / 2 / K[1, 1]
    assert solution.history.drained_flux[-1] == pytest.approx(-stored, rel=1e-7)


def test_prescribed_pressure_scales_with_the_load():
    boundary = {**SIDES, "y-": {**HELD, "pressure": 2}, "y+": {"pressure": -1}}
    plan = {"end": 4000, "step": 200, "ramp_increments": 2, "ramp_step": 10, "profiles": ()}
    solution = solve(confined_column(4, load=0.01, boundary=boundary, time=plan), LINEAR)
    np.testing.assert_allclose(solution.profiles[-1].p, 0.02 - 0.03 * solution.points[:, 1] / 7.5, atol=1e-9)


def test_without_load_nothing_happens():
    history = solve(confined_column(3, load=0.0, time=SHORT), NONLINEAR).history
    for field in fields(History):
        if field.name not in ("time", "ramp"):
            assert not getattr(history, field.name).any(), field.name


# --- orders of convergence --------------------------------------------------------------------------


def discrete_terzaghi(layer, depth, steps, dT):
    """Backward Euler in time, exact in space: each mode M decays by 1/(1 + M² ΔT) a step; depth from the top."""
    M = np.pi / 2 * (2 * np.arange(400) + 1)
    modes = 2 / M * np.sin(M * depth[:, None]) / (1 + M**2 * dT) ** steps
    return layer.initial_pressure * modes.sum(axis=1)


def linear_column(elements, steps, T):
    """A linear column in ``steps`` equal steps up to T = c_v t/h²; its closed form, its solution."""
    layer = Terzaghi.from_coefficients(COEFFICIENTS, 7.5, 1e-3)
    end = T * layer.height**2 / layer.consolidation_coefficient
    plan = {"end": end, "step": end / steps, "ramp_increments": 1, "ramp_step": end / steps, "profiles": ()}
    solution = solve(confined_column(elements, load=-1e-3, time=plan), LINEAR)
    assert len(solution.history.time) == steps + 1
    return layer, end, solution


def test_pressure_converges_with_the_square_of_the_element_size():
    """Linear pressure: order 2 in the L2 norm, against the modes of the equations discrete in time only."""
    depth, steps, T = np.linspace(0, 1, 2001), 20, 0.2
    errors = []
    for elements in (5, 10, 20, 40):
        layer, _, solution = linear_column(elements, steps, T)
        y, first = np.unique(np.rint(solution.points[:, 1] / 7.5 * 2 * elements), return_index=True)
        p = np.interp(1 - depth, y / (2 * elements), solution.profiles[-1].p[first])
        exact = discrete_terzaghi(layer, depth, steps, T / steps)
        errors.append(np.sqrt(np.mean((p - exact) ** 2)) / layer.initial_pressure)
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 1e-4
    np.testing.assert_allclose(orders, 2, atol=0.1)


def test_time_steps_converge_with_order_one():
    """Backward Euler against the continuous series, on a mesh so fine that the error is that of time."""
    errors = []
    for steps in (10, 20, 40):
        layer, end, solution = linear_column(60, steps, 0.3)
        errors.append(
            abs(solution.history.pressure_max[-1] - layer.pressure(0.0, end)) / layer.initial_pressure
        )
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 1, atol=0.1)


# --- laws against each other, balances --------------------------------------------------------------


@pytest.mark.parametrize("load", [-1e-4, -1e-6])
def test_a_small_load_gives_linear_poroelasticity(load):
    problem = confined_column(12, load=load, time=SHORT | {"end": 30.0})
    nonlinear, linear = solve(problem, NONLINEAR).history, solve(problem, LINEAR).history
    np.testing.assert_allclose(nonlinear.settlement[1:], linear.settlement[1:], rtol=1e-3)
    np.testing.assert_allclose(nonlinear.pressure_max[1:], linear.pressure_max[1:], rtol=1e-3)
    np.testing.assert_allclose(nonlinear.drained[1:], linear.drained[1:], rtol=2e-3)
    assert nonlinear.settlement[-1] != linear.settlement[-1]


@pytest.fixture(scope="module")
def large():
    """Strong compression of a column of 30 elements up to its steady state."""
    plan = {"end": 400.0, "step": 4.0, "ramp_increments": 10, "ramp_step": 0.05, "profiles": (1.0, 10.0)}
    return solve(confined_column(30, load=-0.2, time=plan), NONLINEAR)


def test_axial_stress_is_uniform(large):
    assert large.history.stress_spread.max() < 1e-6 * 0.2
    np.testing.assert_allclose(large.profiles[0].stress[:, 1, 1], -0.2, rtol=1e-6)


def test_steady_state_is_the_drained_uniaxial_one(large):
    """P_E,22(H_22) = −0.2 at p = 0, by bisection of the scalar formula."""

    def stress(H22):
        a, b = 1 - 0.0754 * H22 / PHI_S, 1 + H22 - 0.2297 * H22 / PHI_S
        mu, lam = 1 / 2.7, 0.35 / (1.35 * 0.3)
        return PHI_S * (mu * (b - 1 / b) + lam * np.log(a * a * b) / b)

    low, high = -0.6, 0.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if stress(middle) < -0.2 else (low, middle)
    assert large.history.settlement[-1] == pytest.approx(-7.5 * low, rel=1e-6)
    assert abs(large.profiles[-1].p).max() < 1e-6


def test_histories_are_what_they_say(large):
    history, last = large.history, large.profiles[-1]
    assert [p.time for p in large.profiles] == [1.0, 10.0, 400.0]
    assert history.time[0] == 0
    assert history.settlement[0] == 0
    np.testing.assert_allclose(history.ramp, np.minimum(1, history.time / 0.5), rtol=1e-12)
    assert history.settlement[-1] == -last.u[:, 1].min()
    assert (np.diff(history.settlement) > -1e-9).all()
    assert history.iterations[1:20].min() >= 1
    assert last.deformation.shape == (30, 3, 3)
    det = np.linalg.det(last.deformation)
    assert history.drained[-1] > history.drained_flux[-1] * 1.05 > 0  # 1/det F̄ > 1 weighs it up
    np.testing.assert_allclose(last.conductivity[:, 1, 1], 1.94 / last.deformation[:, 1, 1] ** 2, rtol=1e-6)
    assert (det < 1).all()


@pytest.mark.parametrize("law", [LINEAR, NONLINEAR], ids=["linear", "nonlinear"])
def test_fluid_is_conserved(law):
    """What leaves through the boundary is what the body no longer stores."""
    undivided = AlteredLaw(law, lambda r, states, memory: replace(r, volume_ratio=np.ones(len(states))))
    boundary = {**SIDES, "y-": {**HELD, "flux": 0.05}, "y+": {"traction": (0, 1, 0), "pressure": 0}}
    problem = confined_column(8, load=-0.1, boundary=boundary, time=SHORT, newton={"tolerance": 1e-12})
    history = solve(problem, undivided).history
    assert abs(history.drained_flux).max() > 1e-5
    np.testing.assert_allclose(history.drained, history.drained_flux, rtol=1e-10, atol=1e-14)


def test_share_outside_the_trained_range_is_a_volume():
    narrow = AlteredLaw(LINEAR, lambda r, states, memory: replace(r, outside=states.p > 5e-4))
    solution = solve(confined_column(40, load=-1e-3, time=SHORT), narrow)
    layer = Terzaghi.from_coefficients(COEFFICIENTS, 7.5, 1e-3)
    y = np.linspace(0, 7.5, 4001)
    share = (layer.pressure(y, 6.0 - 0.1) > 5e-4).mean()
    assert 0.2 < share < 0.9
    assert solution.history.outside[-1] == pytest.approx(share, abs=0.02)
    assert solution.history.outside[-1] == pytest.approx(solution.profiles[-1].outside.mean(), abs=1e-12)
    assert solution.history.outside[0] == 0
