"""The made-up cell that potentials are tested with: derivatives, identities, symmetry."""

import numpy as np
import pytest

from porocore.states import MacroState
from porocore.testing.cell_checks.identities import cubic_symmetry
from porocore.testing.expect import perturbed, with_derivatives
from porocore.testing.synthetic.potential_cell import respond


def states(n=6):
    random = np.random.default_rng(3)
    return MacroState(random.uniform(-0.15, 0.15, (n, 3, 3)), random.uniform(-0.05, 0.2, n))


@pytest.mark.parametrize("column", range(10))
def test_derivatives_are_the_slopes(column):
    at, h = states(), 1e-3
    response = respond(at)
    slopes = dict(with_derivatives(response)) | {"potential": (response.stress, -response.fluid_volume)}
    near = [respond(perturbed(at, column, k * h)) for k in (-2, -1, 1, 2)]
    for name, (by_H, by_p) in slopes.items():
        m2, m1, p1, p2 = (getattr(value, name) for value in near)
        found = by_p if column == 9 else by_H[..., column // 3, column % 3]
        np.testing.assert_allclose(found, (m2 - 8 * m1 + 8 * p1 - p2) / (12 * h), atol=1e-9, err_msg=name)


def test_rest_symmetry_and_objectivity():
    at_rest = respond(MacroState.zeros(1))
    for name in ("potential", "stress", "mean_grad"):
        np.testing.assert_array_equal(getattr(at_rest, name), 0)
    C = at_rest.tangent.stress_grad_u[0]
    assert cubic_symmetry(C) < 1e-14
    assert abs(C[0, 0, 0, 0] - C[0, 0, 1, 1] - 2 * C[0, 1, 0, 1]) > 0.05, "isotropic"
    at = states()
    Q, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(6, 3, 3)))
    R = Q * np.linalg.det(Q)[:, None, None]
    before = respond(at)
    after = respond(MacroState(R @ (np.eye(3) + at.grad_u) - np.eye(3), at.p))
    np.testing.assert_allclose(after.potential, before.potential, atol=1e-14)
    np.testing.assert_allclose(after.stress, R @ before.stress, atol=1e-14)
    np.testing.assert_allclose(after.mean_grad, R @ before.mean_grad, atol=1e-14)
