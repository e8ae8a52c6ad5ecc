"""K carried along with the solid: it turns with the body, and its slopes know that it turns."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.tensors import polar_rotation, spin
from porocore.macro.laws.closure import CLOSURES, PulledBack, is_isotropic, make_closure
from porocore.states import CellResponse, CellTangent, MacroState

EYE = np.eye(3)
#: K of the cells with one channel along the first axis, and with three of radii 0.2, 0.25 and 0.3, up to a factor.
CHANNEL, THREE = np.diag([1.0, 0.0, 0.0]), np.diag([0.849, 1.956, 3.527])
MOVING = np.random.default_rng(2)


def about_z(degrees):
    return Rotation.from_rotvec([0, 0, np.radians(degrees)]).as_matrix()


def K_ref(F, K, law="piola", mean_grad=None):
    """Of one state whose cell does not move by itself."""
    m = np.zeros((1, 3, 3)) if mean_grad is None else mean_grad
    pulled = PulledBack.from_states(
        MacroState(np.array([F - EYE]), np.zeros(1)), m, np.zeros((1, 3)), 0.6, K, law
    )
    return pulled.conductivity[0]


@pytest.mark.parametrize("K", [CHANNEL, THREE])
@pytest.mark.parametrize("degrees", [10, 30, 90, 180])
def test_a_rigid_rotation_leaves_it_alone(K, degrees):
    np.testing.assert_allclose(K_ref(about_z(degrees), K), K, atol=1e-14 * K.max())


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [
        (90, np.diag([0.0, 1.0, 0.0])),
        (30, np.array([[0.75, -0.25 * 3**0.5, 0], [-0.25 * 3**0.5, 0.25, 0], [0, 0, 0]])),
    ],
)
def test_the_papers_formula_does_not_turn(degrees, expected):
    """QᵀKQ: at 90° the fluid flows into the solid."""
    np.testing.assert_allclose(K_ref(about_z(degrees), CHANNEL, "piola-unrotated"), expected, atol=1e-14)


@pytest.mark.parametrize("law", ["piola", "piola-unrotated"])
def test_a_rotation_of_the_deformed_body_rotates_the_flux(law):
    """Of <∇u¹> that turns with the body."""
    F, m = EYE + 0.2 * MOVING.standard_normal((3, 3)), 0.05 * MOVING.standard_normal((1, 3, 3))
    Q = Rotation.from_rotvec([0.4, -0.9, 0.2]).as_matrix()
    straight, turned = K_ref(F, THREE, law, m), K_ref(Q @ F, THREE, law, Q @ m)
    same = np.abs(turned - straight).max() < 1e-12 * THREE.max()
    assert same == (law == "piola")


def test_the_carried_conductivity_is_K_between_the_inverse_stretches():
    """K_ref = J Ū⁻¹ K Ū⁻¹, with the decomposition of scipy."""
    F = EYE + 0.2 * MOVING.standard_normal((3, 3))
    V = np.linalg.inv(polar(F)[1])
    np.testing.assert_allclose(K_ref(F, THREE), np.linalg.det(F) * V @ THREE @ V, rtol=1e-12)


def test_the_same_in_all_directions_there_is_nothing_to_turn():
    """To the last bit, so that results of the paper's cell stay what they were."""
    F, K = EYE + 0.2 * MOVING.standard_normal((3, 3)), 1.97341018 * EYE
    assert is_isotropic(K)
    assert not is_isotropic(THREE)
    assert (K_ref(F, K) == K_ref(F, K, "piola-unrotated")).all()
    stretch = np.diag([0.98, 0.7, 1.03])
    assert (K_ref(stretch, THREE) == K_ref(stretch, THREE, "piola-unrotated")).all()


@pytest.mark.parametrize("closure", CLOSURES)
@pytest.mark.parametrize("law", ["piola", "piola-unrotated"])
def test_slopes_of_the_flux(closure, law):
    """Both closures have them from one place: against differences of fourth order."""
    n, random = 6, np.random.default_rng(3)
    states = MacroState(0.2 * random.standard_normal((n, 3, 3)), np.zeros(n))
    states.grad_u[0], states.grad_u[1] = about_z(120) - EYE, np.diag([0.1, -0.2, 0.0])
    m, g = 0.05 * random.standard_normal((n, 3, 3)), random.standard_normal((n, 3))
    m[:2] = 0
    M, dH = 0.1 * random.standard_normal((n, 3, 3, 3, 3)), random.standard_normal((n, 3, 3))
    dm = np.einsum("nijkl,nkl->nij", M, dH)
    closed = make_closure(closure, 0.6, NeoHookean(), THREE, law=law)

    def at(h):
        cell = CellResponse(m + h * dm, np.zeros(n, dtype=np.int64))
        return closed.pull_back(MacroState(states.grad_u + h * dH, states.p), cell, g)

    h = 1e-3
    slope = (8 * (at(h).flux - at(-h).flux) - (at(2 * h).flux - at(-2 * h).flux)) / (12 * h)
    by_H, _ = at(0).flux_tangent(CellTangent(M, np.zeros((n, 3, 3))), 0.6)
    np.testing.assert_allclose((by_H @ dH.reshape(n, 9, 1))[..., 0], slope, atol=1e-8 * np.abs(slope).max())


def test_the_polar_rotation_is_that_of_scipy():
    F = EYE + 0.4 * MOVING.standard_normal((200, 3, 3))
    F = F[np.linalg.det(F) > 0.01]
    np.testing.assert_allclose(polar_rotation(F), [polar(one)[0] for one in F], atol=1e-12)


def test_a_stretch_is_not_turned_and_half_a_turn_is():
    """A half turn is symmetric too."""
    stretch, half = np.array([[1.1, 0.2, 0], [0.2, 0.9, 0.1], [0, 0.1, 1.0]]), np.diag([-1.0, -1.0, 1.0])
    R = polar_rotation(np.stack([stretch, half, half @ stretch]))
    assert (R[0] == EYE).all()
    np.testing.assert_allclose(R[1:], [half, half], atol=1e-14)


def test_the_spin_of_a_plane_rotation():
    """F = R(θ) U in a plane: along dR/dθ U the spin is 1 about z."""
    U, R = np.diag([1.3, 0.8, 1.1]), about_z(40)
    rate = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]])
    dF = (R @ rate @ U).reshape(9)
    np.testing.assert_allclose((spin((R @ U)[None], R[None])[0] @ dF), [0, 0, 1], atol=1e-13)


def test_a_state_without_values_spoils_no_other():
    H = np.stack([about_z(30) - EYE, np.diag([0, -1.5, 0])])
    states = MacroState(H, np.zeros(2))
    pulled = PulledBack.from_states(states, np.zeros((2, 3, 3)), np.ones((2, 3)), 0.6, THREE)
    by_H, _ = pulled.flux_tangent(CellTangent(np.zeros((2, 3, 3, 3, 3)), np.zeros((2, 3, 3))), 0.6)
    assert np.isfinite(pulled.flux[0]).all()
    assert np.isfinite(by_H[0]).all()
    assert np.isnan(pulled.flux[1]).all()


def test_an_unknown_law_is_refused():
    with pytest.raises(ValueError, match=r"law of piola, piola-unrotated, deformed, got 'paper'"):
        make_closure("potential", 0.6, NeoHookean(), THREE, law="paper")
