"""The linear limit: the identities that its coefficients obey."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.errors import ConfigurationError
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.states import CellResponse, CellTangent, MacroState
from porocore.testing.synthetic.response import cubic_reference

PHI_S, NU = 0.5877, 0.35
MATERIAL = NeoHookean(poisson_ratio=NU)
K = np.diag([1.7, 1.94, 2.1])


@pytest.fixture
def coefficients():
    return LinearCoefficients.from_reference(cubic_reference(NU), PHI_S, MATERIAL, K)


def test_hand_values(coefficients):
    """C_eff,2222 = φ_s (λ + 2μ) + (λ + 2μ) M_1111 + 2 λ M_1122 and the rest, by hand."""
    mu, lam = 1 / (2 * (1 + NU)), NU / ((1 + NU) * (1 - 2 * NU))
    stiff = PHI_S * (lam + 2 * mu) + (lam + 2 * mu) * -0.2297 + 2 * lam * -0.0754
    alpha = 1 - PHI_S + 0.2297 + 2 * 0.0754
    storage = 3 * (1 - 2 * NU) * (0.2297 + 2 * 0.0754)
    assert coefficients.stiffness[1, 1, 1, 1] == pytest.approx(stiff, rel=1e-13)
    assert coefficients.stiffness[0, 1, 1, 0] == pytest.approx(mu * (PHI_S + 2 * -0.11), rel=1e-13)
    np.testing.assert_allclose(coefficients.biot, alpha * np.eye(3), atol=1e-14)
    assert coefficients.storage == pytest.approx(storage, rel=1e-13)
    assert coefficients.biot_modulus == pytest.approx(1 / storage, rel=1e-13)
    c_v = 1.94 / (storage + alpha**2 / stiff)
    assert coefficients.consolidation_coefficient() == pytest.approx(c_v, rel=1e-13)


def test_both_forms_of_the_biot_tensor_agree(coefficients):
    np.testing.assert_allclose(coefficients.biot, coefficients.biot_of_stress, rtol=0, atol=1e-14)


def test_a_cell_that_breaks_the_identity_shows_in_the_second_form():
    reference = cubic_reference(NU)
    wrong = CellTangent(reference.tangent.mean_grad_grad_u, 1.1 * reference.tangent.mean_grad_p)
    broken = CellResponse(reference.mean_grad, reference.status, tangent=wrong)
    c = LinearCoefficients.from_reference(broken, PHI_S, MATERIAL, K)
    assert abs(c.biot - c.biot_of_stress).max() > 0.03


def test_stiffness_is_symmetric_in_minor_and_major_indices(coefficients):
    C = coefficients.stiffness
    for permuted in (C.transpose(1, 0, 2, 3), C.transpose(0, 1, 3, 2), C.transpose(2, 3, 0, 1)):
        np.testing.assert_allclose(C, permuted, rtol=0, atol=1e-15)


def test_small_asymmetry_of_a_solved_cell_is_removed():
    reference = cubic_reference(NU)
    noise = 1e-4 * np.random.default_rng(0).standard_normal((1, 3, 3, 3, 3))
    noisy = CellTangent(reference.tangent.mean_grad_grad_u + noise, reference.tangent.mean_grad_p)
    response = CellResponse(reference.mean_grad, reference.status, tangent=noisy)
    C = LinearCoefficients.from_reference(response, PHI_S, MATERIAL, K).stiffness
    np.testing.assert_allclose(C, C.transpose(0, 1, 3, 2), rtol=0, atol=1e-15)
    spin = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 0]])
    np.testing.assert_allclose(np.einsum("ijkl,kl->ij", C, spin), 0, atol=1e-15)


def test_uniform_pressure_on_solid_and_pore_compresses_the_solid_alone(coefficients):
    """Unjacketed test: E = −p/(3 K_s) I makes P_E = −p I and the pore volume shrink as the solid does."""
    p, bulk = 0.01, 1 / (3 * (1 - 2 * NU))
    states = MacroState.single(-p / (3 * bulk) * np.eye(3), p)
    law = LinearPoroelasticity(coefficients)
    response = law.respond(states, np.zeros((1, 3)), law.initial(1))
    np.testing.assert_allclose(response.stress[0], -p * np.eye(3), atol=1e-15)
    np.testing.assert_allclose(response.mean_grad[0], 0, atol=1e-16)
    assert response.storage[0] == pytest.approx(-(1 - PHI_S) * p / bulk, rel=1e-12)


def test_law_is_linear_with_its_tangent(coefficients):
    rng = np.random.default_rng(1)
    law, n = LinearPoroelasticity(coefficients), 5
    old, new = (MacroState(rng.standard_normal((n, 3, 3)), rng.standard_normal(n)) for _ in range(2))
    grad_p = rng.standard_normal((n, 3))
    r = law.respond(new, grad_p, law.respond(old, grad_p, law.initial(n)).memory)
    t = r.tangent
    stress = np.einsum("nijkl,nkl->nij", t.stress_grad_u, new.grad_u) + t.stress_p * new.p[:, None, None]
    storage = np.einsum("nij,nij->n", t.storage_grad_u, new.grad_u - old.grad_u)
    np.testing.assert_allclose(r.stress, stress, rtol=1e-12)
    np.testing.assert_allclose(r.storage, storage + t.storage_p * (new.p - old.p), rtol=1e-12)
    np.testing.assert_allclose(r.flux, np.einsum("nij,nj->ni", t.flux_grad_p, grad_p), rtol=1e-12)
    assert r.volume_ratio.tolist() == [1.0] * n


def test_a_reference_without_tangent_is_refused():
    reference = cubic_reference(NU)
    bare = CellResponse(reference.mean_grad, reference.status)
    with pytest.raises(ValueError, match="one undeformed cell, with its tangent"):
        LinearCoefficients.from_reference(bare, PHI_S, MATERIAL, K)


@pytest.mark.parametrize(
    ("factor", "message"),
    [
        (-1.0, r"got -0\.34.*: the cell gives off fluid under pressure; its solver has the sign"),
        (0.0, r"got 0: the cell takes up no fluid under pressure; give it pores \(cell\.geometry\)"),
        (1e-16, r"the cell takes up no fluid under pressure"),
        (-1e-16, r"the cell takes up no fluid under pressure"),
    ],
)
def test_a_reference_that_takes_up_no_fluid_under_pressure_is_refused(factor, message):
    reference = cubic_reference(NU)
    wrong = CellTangent(reference.tangent.mean_grad_grad_u, factor * reference.tangent.mean_grad_p)
    response = CellResponse(reference.mean_grad, reference.status, tangent=wrong)
    with pytest.raises(ConfigurationError, match=rf"expected 1/M_B = −tr Q > 0, .*{message}"):
        LinearCoefficients.from_reference(response, PHI_S, MATERIAL, K)
