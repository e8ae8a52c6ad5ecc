"""The exact closure: the cell's own stress and fluid volume, symmetric tangents, and no work over a closed cycle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.errors import ConfigurationError
from porocore.interfaces.law import CellLaw
from porocore.macro.laws.closure import CLOSURES, MeanGradientClosure, PotentialClosure, closure_error
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.states import MacroState
from porocore.surrogates.polynomial.fit import polynomial_model
from porocore.testing.synthetic.cell import SOLID_FRACTION, STORAGE, respond, synthetic_training_set
from porocore.testing.synthetic.response import mean_gradient_law
from tests.helpers.closure_slopes import INPUTS, assert_slopes
from tests.helpers.loading_cycle import elliptic_cycle, work_over_cycle

MATERIAL = NeoHookean()
K = np.array([[1.9, 0.2, -0.1], [0.2, 1.5, 0.05], [-0.1, 0.05, 2.2]])
CLOSURE = PotentialClosure(SOLID_FRACTION, MATERIAL, K)
MEAN_GRADIENT = MeanGradientClosure(SOLID_FRACTION, MATERIAL, K)


class SyntheticCell(CellLaw):
    """The made-up cell, whose stress and fluid volume derive from a W in closed form."""

    identity = "synthetic"

    def predict(self, states, *, tangent=True):
        response = respond(states)
        return response if tangent else replace(response, tangent=None)


class Model(CellLaw):
    """A fitted potential."""

    identity = "model"

    def __init__(self):
        self.model, _ = polynomial_model(synthetic_training_set(60), degree=5)

    def predict(self, states, *, tangent=True):
        return self.model.predict(states, tangent=tangent)


@pytest.fixture(scope="module", params=[SyntheticCell, Model])
def law(request):
    return ClosedLaw(request.param(), CLOSURE)


@pytest.fixture
def points(law):
    rng = np.random.default_rng(5)
    n = 6
    states, old = (
        MacroState(0.07 * rng.standard_normal((n, 3, 3)), 0.1 * rng.standard_normal(n)) for _ in range(2)
    )
    return states, rng.standard_normal((n, 3)), CLOSURE.memory(old, law.cell_law.predict(old))


@pytest.mark.parametrize("response", ["stress", "storage", "flux"])
@pytest.mark.parametrize(("kind", "k"), INPUTS)
def test_derivatives_are_the_slopes(law, points, response, kind, k):
    assert_slopes(law, points, response, kind, k)


def test_the_tangent_is_that_of_a_potential(law, points):
    states, grad_p, memory = points
    tangent = law.respond(states, grad_p, memory).tangent
    stiffness = tangent.stress_grad_u.reshape(-1, 9, 9)
    np.testing.assert_allclose(stiffness, stiffness.transpose(0, 2, 1), rtol=0, atol=1e-13)
    np.testing.assert_allclose(tangent.stress_p, -tangent.storage_grad_u, rtol=0, atol=1e-12)


def test_stress_and_storage_are_those_of_the_made_up_potential():
    law = ClosedLaw(SyntheticCell(), CLOSURE)
    states = MacroState.single(np.diag([0.02, -0.1, 0.01]), 0.06)
    response = law.respond(states, np.zeros((1, 3)), law.initial(1))
    F = np.eye(3) + states.grad_u[0]
    phi_f, J = 1 - SOLID_FRACTION, 1.02 * 0.9 * 1.01
    mu, lam = MATERIAL.mu, MATERIAL.lam
    inverse = np.linalg.inv(F).T
    stress = SOLID_FRACTION * (mu * (F - inverse) + lam * np.log(J) * inverse) - phi_f * 0.06 * J * inverse
    np.testing.assert_allclose(response.stress[0], stress, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(response.storage[0], phi_f * (J - 1) + STORAGE * 0.06, rtol=1e-12)


def test_storage_adds_up_to_the_same_whatever_the_steps(law):
    ends = MacroState.single(np.diag([0.0, -0.12, 0.0]), 0.1)
    at_once = law.respond(ends, np.zeros((1, 3)), law.initial(1)).storage
    total, memory = 0.0, law.initial(1)
    for share in (0.3, 0.45, 1.2, 1.0):
        step = law.respond(MacroState(share * ends.grad_u, share * ends.p), np.zeros((1, 3)), memory)
        total, memory = total + step.storage, step.memory
    np.testing.assert_allclose(total, at_once, rtol=1e-12)


def test_conductivity_and_kinematics_are_those_of_the_mean_gradient_closure(law, points):
    states, grad_p, memory = points
    ours = law.respond(states, grad_p, memory)
    other = ClosedLaw(law.cell_law, MEAN_GRADIENT)
    theirs = other.respond(states, grad_p, other.initial_at(states))
    for name in ("flux", "deformation", "volume_ratio", "transformed_conductivity"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    np.testing.assert_allclose(ours.tangent.flux_grad_u, theirs.tangent.flux_grad_u, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(ours.tangent.flux_p, theirs.tangent.flux_p, rtol=1e-11, atol=1e-12)


def test_a_closed_cycle_does_no_work_on_a_potential_and_some_on_the_mean_gradient_closure(law):
    """In (H₂₂, p) and with shear; the mean-gradient closure beside it, on the same cell."""
    column = elliptic_cycle(
        (np.diag([0, -0.08, 0]), 0.1), (np.diag([0, 0.08, 0]), 0.0), (np.zeros((3, 3)), 0.1)
    )
    rng = np.random.default_rng(1)
    general = elliptic_cycle(
        (np.zeros((3, 3)), 0.05),
        (0.06 * rng.standard_normal((3, 3)), 0.02),
        (0.06 * rng.standard_normal((3, 3)), 0.05),
    )
    of_mean_gradient = ClosedLaw(law.cell_law, MEAN_GRADIENT)
    for cycle in (column, general):
        assert abs(work_over_cycle(law, cycle)) < 1e-10
        assert abs(work_over_cycle(of_mean_gradient, cycle)) > 1e-5
    # The integral is converged, so that what is left is the closure's and not the rule's.
    half = work_over_cycle(of_mean_gradient, column, 64)
    assert half == pytest.approx(work_over_cycle(of_mean_gradient, column), rel=1e-9)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("wild", [-1.5, -1e300, np.nan])
def test_a_point_that_is_no_state_is_nan_and_spoils_no_other(wild):
    law = ClosedLaw(Model(), CLOSURE)
    H = np.zeros((3, 3, 3))
    H[:, 1, 1] = -0.1, wild, 0.02
    response = law.respond(MacroState(H, np.zeros(3)), np.ones((3, 3)), law.initial(3))
    assert np.isnan(response.stress[1]).all()
    for value in (response.stress, response.storage, response.flux, response.tangent.stress_grad_u):
        assert np.isfinite(value[[0, 2]]).all()


def test_a_cell_law_that_lacks_stress_or_fluid_volume_is_refused_in_words():
    with pytest.raises(
        ConfigurationError,
        match=r"'potential' needs mean_grad, stress, .* LinearCellLaw does not provide stress, fluid_volume, ",
    ):
        ClosedLaw(mean_gradient_law().cell_law, CLOSURE)


def test_the_mean_gradient_closure_takes_a_potential_too(law, points):
    states, grad_p, _ = points
    closed = ClosedLaw(law.cell_law, MEAN_GRADIENT)
    np.testing.assert_allclose(closed.initial(2).fluid_volume, 1 - MEAN_GRADIENT.solid_fraction)
    assert np.isfinite(closed.respond(states, grad_p, closed.initial(len(states))).stress).all()


def test_the_exact_closure_has_no_error_of_its_own():
    data = synthetic_training_set(20)
    assert max(vars(closure_error(CLOSURE, data.states, data.responses)).values()) < 1e-12
    assert max(vars(closure_error(MEAN_GRADIENT, data.states, data.responses)).values()) > 1


def test_the_closure_is_found_by_name():
    assert CLOSURES["potential"] is PotentialClosure
