"""Large-strain consolidation: the closed form against its equations, the law against its derivatives."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from porocore.commands.verify.xie_leo import PUBLISHED, ClayLaw
from porocore.macro.analytic import XieLeo
from porocore.states import MacroState

EXAMPLE = Path(__file__).parents[2] / "examples" / "xie_leo.py"
LAYER = XieLeo()
LAW = ClayLaw(LAYER)


def test_the_closed_form_solves_the_nonlinear_equation():
    """∂J/∂t = ∂/∂a ((k₀/γ_w) J ∂u/∂a), with u and J from each other by constant compressibility."""
    t = next(iter(PUBLISHED))
    a, da, dt = np.linspace(1, 9, 9), 1e-2, 1e-4 * t
    upper, lower = (LAYER.stretch(a + s * da / 2, t) for s in (1, -1))
    up = (LAYER.pressure(a + da, t) - LAYER.pressure(a, t)) / da
    down = (LAYER.pressure(a, t) - LAYER.pressure(a - da, t)) / da
    divergence = LAYER.conductivity * (upper * up - lower * down) / da
    rate = (LAYER.stretch(a, t + dt) - LAYER.stretch(a, t - dt)) / (2 * dt)
    np.testing.assert_allclose(divergence, rate, rtol=0, atol=2e-5 * abs(rate).max())
    assert LAYER.pressure(0.0, t) == pytest.approx(0, abs=1e-9)
    shift = LAYER.pressure(10.0, t) - LAYER.pressure(10.0 - 1e-3, t)
    assert abs(shift) < 1e-5


def test_settlement_is_what_the_layer_loses():
    a = (np.arange(4000) + 0.5) / 400
    for t in PUBLISHED:
        assert LAYER.settlement(t) == pytest.approx((1 - LAYER.stretch(a, t)).mean() * 10, rel=1e-6)
    assert LAYER.final_settlement == pytest.approx(3.296800, abs=1e-6)
    assert LAYER.settlement(1e12) == pytest.approx(LAYER.final_settlement, rel=1e-12)


def test_the_law_is_the_papers_in_uniaxial_motion():
    J = np.array([1.2, 1.0, 0.8, 0.6])
    H = np.zeros((4, 3, 3))
    H[:, 1, 1] = J - 1
    p, gradient = np.array([0.0, 3.0, 20.0, -5.0]), np.tile([0.1, -0.7, 0.2], (4, 1))
    found = LAW.respond(MacroState(H, p), gradient, LAW.initial(4))
    np.testing.assert_allclose(found.stress[:, 1, 1], np.log(J) / 4e-3 - p, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.storage, J - 1, atol=1e-15)
    # k = k₀ J², through the same area and over a length shortened by J.
    np.testing.assert_allclose(found.flux[:, 1], -1e-10 * J**2 / J * gradient[:, 1], rtol=1e-12)
    np.testing.assert_allclose(found.transformed_conductivity[:, 0, 0], 1e-10 * J**2, rtol=1e-12)


def general():
    rng = np.random.default_rng(0)
    return MacroState(rng.uniform(-0.15, 0.15, (5, 3, 3)), rng.uniform(-5, 40, 5)), rng.normal(size=(5, 3))


def test_the_tangent_is_the_slope():
    states, gradient = general()
    memory = LAW.initial(5)
    tangent = LAW.respond(states, gradient, memory).tangent
    rng = np.random.default_rng(1)
    dH, dp, dg = rng.normal(size=(3, 3)), rng.normal(), rng.normal(size=3)
    h = 1e-4

    def at(k):
        moved = MacroState(states.grad_u + k * h * dH, states.p + k * h * dp)
        found = LAW.respond(moved, gradient + k * h * dg, memory, tangent=False)
        return found.stress, found.storage, found.flux * 1e10

    steps = [at(k) for k in (-2, -1, 1, 2)]
    slopes = [(a - 8 * b + 8 * c - d) / (12 * h) for a, b, c, d in zip(*steps, strict=True)]
    stress = np.tensordot(tangent.stress_grad_u, dH, axes=2) + tangent.stress_p * dp
    storage = np.tensordot(tangent.storage_grad_u, dH, axes=2) + tangent.storage_p * dp
    flux = np.tensordot(tangent.flux_grad_u, dH, axes=2) + tangent.flux_grad_p @ dg + tangent.flux_p * dp
    for slope, expected in zip(slopes, (stress, storage, flux * 1e10), strict=True):
        np.testing.assert_allclose(slope, expected, rtol=0, atol=1e-8 * abs(expected).max())
    A = tangent.stress_grad_u.reshape(5, 9, 9)
    np.testing.assert_allclose(A, A.swapaxes(1, 2), atol=1e-11 * abs(A).max())


def test_the_law_is_objective_and_isotropic():
    states, gradient = general()
    R = Rotation.from_rotvec([0.4, -0.2, 0.9]).as_matrix()
    F = np.eye(3) + states.grad_u
    before = LAW.respond(states, gradient, LAW.initial(5), tangent=False)
    turned = MacroState(R @ F - np.eye(3), states.p)
    after = LAW.respond(turned, gradient, LAW.initial(5), tangent=False)
    np.testing.assert_allclose(after.stress, R @ before.stress, atol=1e-11 * abs(before.stress).max())
    np.testing.assert_allclose(after.flux, before.flux, rtol=1e-10)
    material = MacroState(F @ R.T - np.eye(3), states.p)
    other = LAW.respond(material, gradient @ R.T, LAW.initial(5), tangent=False)
    np.testing.assert_allclose(other.stress, before.stress @ R.T, atol=1e-11 * abs(before.stress).max())
    np.testing.assert_allclose(other.flux, before.flux @ R.T, rtol=1e-10)


def test_where_nothing_can_be_there_is_no_value():
    flat = MacroState.single(np.diag([0.0, -1.0, 0.0]), 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        assert np.isnan(LAW.respond(flat, np.zeros((1, 3)), LAW.initial(1)).stress).all()


@pytest.mark.slow
def test_the_example_prints_what_it_says():
    done = subprocess.run([sys.executable, EXAMPLE], capture_output=True, text=True, check=True)
    rows = np.array([[float(word) for word in line.split()] for line in done.stdout.splitlines()[2:]])
    assert rows[:, 0].tolist() == [5, 10, 20, 40, 80]
    np.testing.assert_allclose(rows[:, 1], rows[:, 2], rtol=0.01)
    np.testing.assert_allclose(rows[:, 3], rows[:, 4], rtol=0.01)
