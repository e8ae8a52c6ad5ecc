"""The mean-gradient closure: values against the scalar formulas, derivatives against central differences."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.errors import ConfigurationError
from porocore.interfaces.law import CellLaw, LawMemory
from porocore.macro.laws import macro_law
from porocore.macro.laws.closure import CLOSURES, MeanGradientClosure
from porocore.macro.laws.linear import LinearCellLaw, LinearCoefficients
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.states import CellResponse, CellTangent, MacroState
from porocore.testing.synthetic.response import cubic_reference
from tests.helpers.closure_slopes import INPUTS, assert_slopes

PHI_S, NU = 0.5877, 0.35
MATERIAL = NeoHookean(poisson_ratio=NU)
K = np.array([[1.9, 0.2, -0.1], [0.3, 1.5, 0.05], [-0.2, 0.1, 2.2]])


class QuadraticCellLaw(CellLaw):
    """<∇u¹>_s = M:H + Q p + (a:H + b p) (H + p c): curved in every input, with its exact derivatives."""

    identity = "quadratic"

    def __init__(self) -> None:
        rng = np.random.default_rng(3)
        self.linear = LinearCellLaw(cubic_reference())
        self.a, self.c = 0.3 * rng.standard_normal((2, 3, 3))
        self.b = 0.4

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        H, p = states.grad_u, states.p[:, None, None]
        first = self.linear.predict(states)
        scalar = np.einsum("kl,nkl->n", self.a, H)[:, None, None] + self.b * p
        direction = H + p * self.c
        eye = np.einsum("ik,jl->ijkl", np.eye(3), np.eye(3))
        grad = np.einsum("nij,kl->nijkl", direction, self.a) + scalar[..., None, None] * eye
        return CellResponse(
            mean_grad=first.mean_grad + scalar * direction,
            status=first.status,
            doubt=(states.p > 0.05).astype(np.int64),
            tangent=CellTangent(
                mean_grad_grad_u=first.tangent.mean_grad_grad_u + grad,
                mean_grad_p=first.tangent.mean_grad_p + self.b * direction + scalar * self.c,
            )
            if tangent
            else None,
        )


@pytest.fixture
def law():
    return ClosedLaw(QuadraticCellLaw(), MeanGradientClosure(PHI_S, MATERIAL, K))


@pytest.fixture
def points(law):
    rng = np.random.default_rng(5)
    n = 7
    states = MacroState(0.1 * rng.standard_normal((n, 3, 3)), 0.1 * rng.standard_normal(n))
    old = MacroState(0.1 * rng.standard_normal((n, 3, 3)), 0.1 * rng.standard_normal(n))
    memory = LawMemory(old, np.zeros(len(old)), law.cell_law.predict(old).mean_grad.reshape(-1, 9))
    return states, rng.standard_normal((n, 3)), memory


@pytest.mark.parametrize("response", ["stress", "storage", "flux"])
@pytest.mark.parametrize(("kind", "k"), INPUTS)
def test_derivatives_are_the_slopes(law, points, response, kind, k):
    assert_slopes(law, points, response, kind, k)


def test_uniaxial_values_follow_the_scalar_formulas():
    """F̄ = diag(a, b, a), every quantity by hand."""
    H22, p, slope, phi_f = -0.1, 0.06, -0.7, 1 - PHI_S
    cell = LinearCellLaw(cubic_reference(NU))
    law = ClosedLaw(cell, MeanGradientClosure(PHI_S, MATERIAL, 1.94 * np.eye(3)))
    states = MacroState.single(np.diag([0, H22, 0]), p)
    response = law.respond(states, np.array([[0, slope, 0]]), law.initial(1))

    Q = (1 - 2 * NU) * (-0.2297 - 2 * 0.0754)
    m1, m2 = -0.0754 * H22 + Q * p, -0.2297 * H22 + Q * p
    a, b = 1 + m1 / PHI_S, 1 + H22 + m2 / PHI_S
    mu, lam = 1 / (2 * (1 + NU)), NU / ((1 + NU) * (1 - 2 * NU))
    stress = PHI_S * (mu * (b - 1 / b) + lam * np.log(a * a * b) / b) - phi_f * p * a * a
    storage = phi_f * a * a * H22 - (2 * a * b * m1 + a * a * m2)
    np.testing.assert_allclose(response.stress[0, 1, 1], stress, rtol=1e-13)
    np.testing.assert_allclose(response.storage[0], storage, rtol=1e-13)
    np.testing.assert_allclose(response.flux[0], [0, -1.94 * a * a / b * slope, 0], rtol=1e-13)
    np.testing.assert_allclose(response.deformation[0], np.diag([a, b, a]), rtol=1e-13)
    np.testing.assert_allclose(response.volume_ratio[0], a * a * b, rtol=1e-13)
    expected = 1.94 * np.diag([1 / a**2, 1 / b**2, 1 / a**2])
    np.testing.assert_allclose(response.transformed_conductivity[0], expected, rtol=1e-13)


def test_flux_of_a_general_state_is_the_pull_back_of_the_paper(points):
    law = ClosedLaw(QuadraticCellLaw(), MeanGradientClosure(PHI_S, MATERIAL, K, law="piola-unrotated"))
    states, grad_p, memory = points
    response = law.respond(states, grad_p, memory)
    for n in range(len(states)):
        F = response.deformation[n]
        G = np.linalg.det(F) * np.linalg.inv(F)
        np.testing.assert_allclose(response.flux[n], -G @ K @ np.linalg.inv(F).T @ grad_p[n], rtol=1e-12)


def test_linear_limit_is_biots(law, points):
    """At rest the tangents of the closure are C_eff, α, 1/M_B and K."""
    c = LinearCoefficients.from_reference(cubic_reference(NU), PHI_S, MATERIAL, K)
    law = ClosedLaw(LinearCellLaw(cubic_reference(NU)), MeanGradientClosure(PHI_S, MATERIAL, K))
    tangent = law.respond(MacroState.zeros(1), np.zeros((1, 3)), law.initial(1)).tangent
    close = {"rtol": 1e-13, "atol": 1e-14}
    np.testing.assert_allclose(tangent.stress_grad_u[0], c.stiffness, **close)
    np.testing.assert_allclose(tangent.stress_p[0], -c.biot_of_stress, **close)
    np.testing.assert_allclose(tangent.storage_grad_u[0], c.biot, **close)
    np.testing.assert_allclose(tangent.storage_p[0], c.storage, **close)
    np.testing.assert_allclose(tangent.flux_grad_p[0], -K, **close)


def test_each_point_stands_alone(law, points):
    states, grad_p, memory = points
    whole = law.respond(states, grad_p, memory)
    for n in range(len(states)):
        row = slice(n, n + 1)
        single = law.respond(states[row], grad_p[row], memory[row])
        np.testing.assert_allclose(single.stress, whole.stress[row], rtol=1e-13, atol=1e-15)
        np.testing.assert_allclose(
            single.tangent.flux_grad_u, whole.tangent.flux_grad_u[row], rtol=1e-12, atol=1e-14
        )


def test_many_points_are_treated_by_parts(law, points, monkeypatch):
    near = partial(np.testing.assert_allclose, rtol=1e-12, atol=1e-14)
    states, grad_p, memory = points
    whole = law.respond(states, grad_p, memory)
    monkeypatch.setattr(macro_law, "CHUNK", 2)
    for tangent in (True, False):
        parts = law.respond(states, grad_p, memory, tangent=tangent)
        assert (parts.tangent is not None) == tangent
        near(parts.stress, whole.stress)
        near(parts.memory.internal, whole.memory.internal)
    near(law.respond(states, grad_p, memory).tangent.flux_grad_u, whole.tangent.flux_grad_u)


def test_flags_of_the_cell_law_are_passed_on(law, points):
    states, grad_p, memory = points
    outside = law.respond(states, grad_p, memory).flagged
    assert outside.tolist() == (states.p > 0.05).tolist()
    assert set(outside.tolist()) == {False, True}


@pytest.mark.filterwarnings("error")
def test_an_inverted_point_is_nan_and_spoils_no_other(law, points):
    states, grad_p, memory = points
    H = states.grad_u.copy()
    H[2] = np.diag([0, -1.5, 0])
    response = law.respond(MacroState(H, states.p), grad_p, memory)
    good = np.arange(len(states)) != 2
    assert np.isnan(response.stress[2]).all()
    assert np.isfinite(response.stress[good]).all()
    assert np.isfinite(response.tangent.stress_grad_u[good]).all()
    assert np.isfinite(response.flux[good]).all()


def test_rest_stores_no_fluid_even_where_the_cell_law_has_an_error_there():
    class Offset(QuadraticCellLaw):
        def predict(self, states, *, tangent=True):
            exact = super().predict(states, tangent=tangent)
            return CellResponse(exact.mean_grad + 1e-3 * self.c, exact.status, tangent=exact.tangent)

    law = ClosedLaw(Offset(), MeanGradientClosure(PHI_S, MATERIAL, K))
    assert law.respond(MacroState.zeros(4), np.zeros((4, 3)), law.initial(4)).storage.tolist() == [0.0] * 4


def test_a_cell_law_without_mean_gradient_derivatives_is_refused():
    class Flat(QuadraticCellLaw):
        def predict(self, states, *, tangent=True):
            full = super().predict(states)
            return CellResponse(
                full.mean_grad, full.status, tangent=CellTangent(mean_grad_p=full.tangent.mean_grad_p)
            )

    with pytest.raises(
        ConfigurationError, match=r"closure 'mean-gradient' needs .*Flat does not provide tan"
    ):
        ClosedLaw(Flat(), MeanGradientClosure(PHI_S, MATERIAL, K))


def test_identity_changes_with_what_the_law_answers(law):
    others = [
        ClosedLaw(QuadraticCellLaw(), MeanGradientClosure(0.6, MATERIAL, K)),
        ClosedLaw(QuadraticCellLaw(), MeanGradientClosure(PHI_S, NeoHookean(poisson_ratio=0.3), K)),
        ClosedLaw(QuadraticCellLaw(), MeanGradientClosure(PHI_S, MATERIAL, 2 * K)),
        ClosedLaw(QuadraticCellLaw(), MeanGradientClosure(PHI_S, MATERIAL, K, law="piola-unrotated")),
        ClosedLaw(QuadraticCellLaw(), MeanGradientClosure(PHI_S, MATERIAL, K), identity="other weights"),
        ClosedLaw(LinearCellLaw(cubic_reference(NU)), MeanGradientClosure(PHI_S, MATERIAL, K)),
        ClosedLaw(LinearCellLaw(cubic_reference(0.3)), MeanGradientClosure(PHI_S, MATERIAL, K)),
    ]
    assert len({law.identity, *(other.identity for other in others)}) == 1 + len(others)
    same = ClosedLaw(QuadraticCellLaw(), MeanGradientClosure(PHI_S, MATERIAL, K))
    assert same.identity == law.identity


def test_closures_are_found_by_name():
    assert CLOSURES["mean-gradient"] is MeanGradientClosure


def test_impossible_constants_are_refused():
    with pytest.raises(ValueError, match="solid fraction between 0 and 1, got 1"):
        MeanGradientClosure(1.0, MATERIAL, K)
    with pytest.raises(ValueError, match=r"conductivity \(3, 3\), got \(3,\)"):
        MeanGradientClosure(PHI_S, MATERIAL, np.ones(3))


def test_an_inverted_body_has_no_response_even_where_the_cell_law_extrapolates_to_one():
    """A surrogate far outside its range may give det F̄ > 0 at det(I + H) < 0."""

    class Extrapolating(CellLaw):
        identity = "extrapolating"

        def predict(self, states, *, tangent=True):
            n = len(states)
            zeros = np.zeros((n, 3, 3))
            slope = CellTangent(np.zeros((n, 3, 3, 3, 3)), zeros)
            return CellResponse(-0.9 * states.grad_u * PHI_S, np.zeros(n, dtype=np.int64), tangent=slope)

    law = ClosedLaw(Extrapolating(), MeanGradientClosure(PHI_S, MATERIAL, K))
    states = MacroState(np.array([np.diag([0, -0.5, 0]), np.diag([0, -1.2, 0])]), np.zeros(2))
    response = law.respond(states, np.zeros((2, 3)), law.initial(2))
    assert np.isfinite(response.stress[0]).all()
    assert np.isnan(response.stress[1]).all()
