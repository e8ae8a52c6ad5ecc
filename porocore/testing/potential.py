"""The laws of a surrogate whose stress and fluid volume derive from one potential, beside those of every surrogate."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.states import Array, MacroState
from porocore.testing.compare import RESPONSES, provided
from porocore.testing.surrogate import SurrogateSuite


class PotentialSuite(SurrogateSuite):
    """In addition, the laws of a surrogate whose stress and fluid volume derive from one potential.

    They hold for every state, whether or not the training came near it.
    """

    @pytest.fixture(scope="class")
    @classmethod
    def states(cls) -> MacroState:
        """Stretched, sheared and rotated, and the undeformed state."""
        random = np.random.default_rng(11)
        grad_u = random.uniform(-0.08, 0.08, (40, 3, 3))
        grad_u[0] = 0.0
        return MacroState(grad_u, random.uniform(-0.02, 0.2, 40) * (np.arange(40) > 0))

    def test_it_provides_a_potential(self, fitted: Surrogate, states: MacroState) -> None:
        response = fitted.predict(states)
        assert response.tangent is not None
        for name in RESPONSES:
            assert getattr(response, name) is not None, name
        assert dict(provided(response)).keys() == {"mean_grad", "stress", "fluid_volume"}

    def test_rest_is_free_of_energy_and_stress(self, fitted: Surrogate, data: TrainingSet) -> None:
        at_rest = fitted.predict(MacroState.zeros(1))
        assert abs(_there(at_rest.potential)[0]) < 1e-12
        assert np.abs(_there(at_rest.stress)).max() < 1e-12
        assert abs(_there(at_rest.fluid_volume)[0] - _there(data.reference.fluid_volume)[0]) < 1e-12

    def test_the_tangent_is_symmetric(self, fitted: Surrogate, states: MacroState) -> None:
        tangent = fitted.predict(states).tangent
        assert tangent is not None
        A = _there(tangent.stress_grad_u)
        assert np.abs(A - A.transpose(0, 3, 4, 1, 2)).max() < 1e-12

    def test_reciprocity(self, fitted: Surrogate, states: MacroState) -> None:
        """∂P_E/∂p = −∂φ/∂H."""
        tangent = fitted.predict(states).tangent
        assert tangent is not None
        assert np.abs(_there(tangent.stress_p) + _there(tangent.fluid_volume_grad_u)).max() < 1e-12

    def test_objectivity(self, fitted: Surrogate, states: MacroState) -> None:
        """W and φ do not feel a rotation; P_E and <∇u¹> turn with it."""
        R = _rotations(len(states), seed=3)
        turned = MacroState(R @ (np.eye(3) + states.grad_u) - np.eye(3), states.p)
        before, after = fitted.predict(states, tangent=False), fitted.predict(turned, tangent=False)
        for name in ("potential", "fluid_volume"):
            assert np.abs(getattr(after, name) - getattr(before, name)).max() < 1e-12, name
        for name in ("stress", "mean_grad"):
            assert np.abs(getattr(after, name) - R @ getattr(before, name)).max() < 1e-12, name

    @pytest.mark.parametrize("seed", [0, 1, 2])
    def test_a_closed_cycle_does_no_work(self, fitted: Surrogate, seed: int) -> None:
        """∮ P_E:dH − φ dp over a smooth loop; the trapezoidal rule converges exponentially there."""
        random = np.random.default_rng(seed)
        (H0, H1, H2), (p0, p1, p2) = random.uniform(-0.04, 0.04, (3, 3, 3)), random.uniform(-0.03, 0.03, 3)
        angle = 2 * np.pi * np.arange(400) / 400
        cos, sin = np.cos(angle), np.sin(angle)
        loop = MacroState(
            H0 + cos[:, None, None] * H1 + sin[:, None, None] * H2, 0.08 + p0 + cos * p1 + sin * p2
        )
        response = fitted.predict(loop, tangent=False)
        dH, dp = cos[:, None, None] * H2 - sin[:, None, None] * H1, cos * p2 - sin * p1
        power = np.einsum("nij,nij->n", _there(response.stress), dH) - _there(response.fluid_volume) * dp
        assert np.abs(power).mean() > 1e-6, "nothing happens in this loop"
        assert abs(power.sum() * 2 * np.pi / len(angle)) < 1e-10


def _there(array: Array | None) -> Array:
    assert array is not None
    return array


def _rotations(n: int, seed: int) -> Array:
    """Random rotations (n, 3, 3), by any angle."""
    Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(n, 3, 3)))
    rotations: Array = Q * np.linalg.det(Q)[:, None, None]
    return rotations
