"""The error of a closure against responses that are given in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.macro.laws.closure import MeanGradientClosure, closure_error
from porocore.states import CellResponse, MacroState, Status

PHI_S, C = 0.6, -0.2
MATERIAL = NeoHookean(poisson_ratio=0.35)
CLOSURE = MeanGradientClosure(PHI_S, MATERIAL, np.eye(3))
STRAIN = np.linspace(-0.2, 0.05, 6)
P = np.linspace(-0.1, 0.2, 6)


@pytest.fixture
def solved():
    """Uniaxial states with <∇u¹>_s = C H, and what the mean-gradient closure is on paper for them.

    There F̄ = diag(1, F, 1) with F = 1 + (1 + C/φ_s) H, and the storage (φ_f − C) H, for Ḡ_22 = 1 all along.
    """
    n, phi_f = len(STRAIN), 1 - PHI_S
    states, mean_grad, stress = MacroState(np.zeros((n, 3, 3)), P), np.zeros((n, 3, 3)), np.zeros((n, 3, 3))
    states.grad_u[:, 1, 1], mean_grad[:, 1, 1] = STRAIN, C * STRAIN
    F = 1 + (1 + C / PHI_S) * STRAIN
    log = MATERIAL.lam * np.log(F)
    stress[:, 1, 1] = PHI_S * (MATERIAL.mu * (F - 1 / F) + log / F) - phi_f * P
    stress[:, 0, 0] = stress[:, 2, 2] = PHI_S * log - phi_f * P * F
    fluid = phi_f + (phi_f - C) * STRAIN
    return states, CellResponse(
        mean_grad, np.full(n, int(Status.converged)), stress=stress, fluid_volume=fluid
    )


def test_a_closure_that_is_exact_has_no_error(solved):
    error = closure_error(CLOSURE, *solved)
    assert max(vars(error).values()) < 1e-12


def test_errors_are_referred_to_the_range_of_the_exact_values(solved):
    states, exact = solved
    off = np.array([0.0, 0.0, 0.0, -3e-3, 0.0, 4e-3])
    stress, fluid = exact.stress.copy(), exact.fluid_volume + off
    stress[:, 1, 1] += off
    found = closure_error(CLOSURE, states, replace(exact, stress=stress, fluid_volume=fluid))
    rms, stress_range, fluid_range = 5e-3, np.ptp(stress, axis=0).max(), np.ptp(fluid)
    # Three components of the stress vary, six states each.
    assert found.stress_rms == pytest.approx(100 * rms / 18**0.5 / stress_range, rel=1e-9)
    assert found.stress_largest == pytest.approx(100 * 4e-3 / stress_range, rel=1e-9)
    assert found.fluid_rms == pytest.approx(100 * rms / 6**0.5 / fluid_range, rel=1e-9)
    assert found.fluid_largest == pytest.approx(100 * 4e-3 / fluid_range, rel=1e-9)
    assert set(found.for_json()) == {
        f"{what}_{kind}_percent_of_range" for what in ("stress", "fluid") for kind in ("rms", "largest")
    }


def test_the_storage_is_integrated_in_time_and_not_by_backward_euler():
    """Isotropic states with <∇u¹>_s = C H: cof F̄ = F² I, so the storage is 3 (φ_f − C) ∫ F² dH."""
    n, slope = len(STRAIN), 1 + C / PHI_S
    eye = np.broadcast_to(np.eye(3), (n, 3, 3))
    H, F = STRAIN[:, None, None] * eye, 1 + slope * STRAIN
    exact = 3 * (1 - PHI_S - C) * (F**3 - 1) / (3 * slope)
    response = CellResponse(
        C * H,
        np.full(n, int(Status.converged)),
        stress=STRAIN[:, None, None] * eye,
        fluid_volume=1 - PHI_S + exact,
    )
    error = closure_error(CLOSURE, MacroState(H, np.zeros(n)), response)
    one_step = 3 * (1 - PHI_S - C) * F**2 * STRAIN
    backward_euler = 100 * np.abs(one_step - exact).max() / np.ptp(exact)
    assert backward_euler > 5
    # The trapezoidal rule errs by 3 (φ_f − C) slope² H³ / 6.
    trapezoidal = 0.5 * (1 - PHI_S - C) * slope**2 * np.abs(STRAIN**3).max()
    assert error.fluid_largest == pytest.approx(100 * trapezoidal / np.ptp(exact), rel=1e-9)


def test_responses_that_cannot_be_compared_are_refused(solved):
    states, exact = solved
    with pytest.raises(ValueError, match="stress and fluid volume"):
        closure_error(CLOSURE, states, replace(exact, stress=None))
    with pytest.raises(ValueError, match="different stresses"):
        closure_error(CLOSURE, states, replace(exact, stress=np.ones((len(states), 3, 3))))
