"""Suite of surrogates with a potential (PotentialSuite): symmetry, reciprocity, closed cycles."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.states import Array, MacroState
from porocore.testing.expect import RESPONSES, holds, near, require, states_text, with_derivatives
from porocore.testing.surrogate_checks.base import SurrogateSuite


class PotentialSuite(SurrogateSuite):
    """Further checks of a surrogate whose stress and fluid volume derive from one potential.

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
        for name in RESPONSES:
            require(name, getattr(response, name), states_text(states))
        found, wanted = sorted(dict(with_derivatives(response))), ["fluid_volume", "mean_grad", "stress"]
        holds(found == wanted, states_text(states), f"derivatives of {wanted}", found)

    def test_rest_is_free_of_energy_and_stress(self, fitted: Surrogate, data: TrainingSet) -> None:
        at_rest = fitted.predict(MacroState.zeros(1))
        near("potential", at_rest.potential, 0.0, "at rest", within=1e-12)
        near("stress", at_rest.stress, 0.0, "at rest", within=1e-12)
        near("fluid_volume", at_rest.fluid_volume, data.reference.fluid_volume, "at rest", within=1e-12)

    def test_the_tangent_is_symmetric(self, fitted: Surrogate, states: MacroState) -> None:
        tangent = require("derivatives", fitted.predict(states).tangent, states_text(states))
        A = require("∂P_E/∂H", tangent.stress_grad_u, states_text(states))
        near(
            "∂P_E/∂H, with major symmetry,", A, A.transpose(0, 3, 4, 1, 2), states_text(states), within=1e-12
        )

    def test_reciprocity(self, fitted: Surrogate, states: MacroState) -> None:
        """∂P_E/∂p = −∂φ/∂H."""
        tangent = require("derivatives", fitted.predict(states).tangent, states_text(states))
        by_H = require("∂φ/∂H", tangent.fluid_volume_grad_u, states_text(states))
        near("∂P_E/∂p = −∂φ/∂H", tangent.stress_p, -by_H, states_text(states), within=1e-12)

    def test_objectivity(self, fitted: Surrogate, states: MacroState) -> None:
        """W and φ do not feel a rotation; P_E and <∇u¹> turn with it."""
        R = _rotations(len(states), seed=3)
        turned = MacroState(R @ (np.eye(3) + states.grad_u) - np.eye(3), states.p)
        before, after = fitted.predict(states, tangent=False), fitted.predict(turned, tangent=False)
        for name in ("potential", "fluid_volume"):
            near(
                name,
                getattr(after, name),
                getattr(before, name),
                f"{states_text(states)}, turned",
                within=1e-12,
            )
        for name in ("stress", "mean_grad"):
            expected = R @ getattr(before, name)
            near(name, getattr(after, name), expected, f"{states_text(states)}, turned", within=1e-12)

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
        stress = require("stress", response.stress, states_text(loop))
        volume = require("fluid_volume", response.fluid_volume, states_text(loop))
        power = np.einsum("nij,nij->n", stress, dH) - volume * dp
        state = f"a closed loop of {len(angle)} states"
        mean = np.abs(power).mean()
        holds(mean > 1e-6, state, "a power on the way above 1e-6", mean)
        near("work", power.sum() * 2 * np.pi / len(angle), 0.0, state, within=1e-10)


def _rotations(n: int, seed: int) -> Array:
    """Random rotations (n, 3, 3), by any angle."""
    Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(n, 3, 3)))
    rotations: Array = Q * np.linalg.det(Q)[:, None, None]
    return rotations
