"""The acoustic tensor against closed forms: isotropic, prestressed and cubic media."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from porocore.cell.stability.modes import acoustic_minimum, acoustic_tensor, half_sphere

I = np.eye(3)


def isotropic(lam, mu):
    return (
        lam * np.einsum("ij,kl->ijkl", I, I)
        + mu * np.einsum("ik,jl->ijkl", I, I)
        + mu * np.einsum("il,jk->ijkl", I, I)
    )


def cubic(c11, c12, c44):
    axes = np.zeros((3, 3, 3, 3))
    for i in range(3):
        axes[i, i, i, i] = 1.0
    return isotropic(c12, c44) + (c11 - c12 - 2 * c44) * axes


def rotated(A, R):
    return np.einsum("ia,jb,kc,ld,abcd->ijkl", R, R, R, R, A)


def test_waves_of_an_isotropic_medium():
    Q = acoustic_tensor(isotropic(0.7, 0.4), half_sphere(50))
    expected = np.broadcast_to([0.4, 0.4, 0.7 + 0.8], (50, 3))
    np.testing.assert_allclose(np.linalg.eigvalsh(Q), expected, atol=1e-14)


@pytest.mark.parametrize(
    ("lam", "mu", "least"), [(0.7, 0.4, 0.4), (-0.6, 0.4, 0.2), (-1.0, 0.4, -0.2), (1.0, -0.1, -0.1)]
)
def test_the_least_of_an_isotropic_medium(lam, mu, least):
    """μ for shear waves, λ + 2μ for pressure waves, whichever is less."""
    found = acoustic_minimum(isotropic(lam, mu))
    assert found.value == pytest.approx(least, abs=1e-12)
    along = abs(found.direction @ found.polarisation)
    assert along == pytest.approx(1.0 if lam + mu < 0 else 0.0, abs=1e-6)


def test_under_stress_the_band_is_normal_to_the_least_one():
    """A_ijkl + δ_ik σ_jl has Q(n) + (n·σn) 1."""
    R = Rotation.from_rotvec([0.3, -1.1, 0.4]).as_matrix()
    sigma = R @ np.diag([0.1, -0.55, -0.2]) @ R.T
    found = acoustic_minimum(isotropic(0.7, 0.4) + np.einsum("ik,jl->ijkl", I, sigma))
    assert found.value == pytest.approx(0.4 - 0.55, abs=1e-12)
    assert abs(found.direction @ R[:, 1]) == pytest.approx(1.0, abs=1e-6)


def test_a_cubic_crystal_shears_along_its_diagonals():
    """The least of C44 and (C11 − C12)/2, the latter for n = [110], m = [1-10], in whatever position the crystal is."""
    for seed in range(3):
        R = Rotation.random(random_state=seed).as_matrix()
        found = acoustic_minimum(rotated(cubic(1.0, 0.9, 0.6), R))
        assert found.value == pytest.approx(0.05, abs=1e-12)
        n, m = np.abs(R.T @ found.direction), np.abs(R.T @ found.polarisation)
        for v in (n, m):
            np.testing.assert_allclose(np.sort(v), [0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-5)
        assert acoustic_minimum(rotated(cubic(1.0, 0.2, 0.3), R)).value == pytest.approx(0.3, abs=1e-12)


def test_nothing_that_is_sampled_lies_below():
    rng = np.random.default_rng(1)
    n = rng.normal(size=(200_000, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    for _ in range(3):
        A = rng.normal(size=(9, 9))
        A = (A + A.T).reshape(3, 3, 3, 3)
        sampled = np.linalg.eigvalsh(acoustic_tensor(A, n))[:, 0].min()
        found = acoustic_minimum(A)
        assert sampled - 1e-2 < found.value < sampled + 1e-12
        attained = np.einsum(
            "i,j,ijkl,k,l", *(found.polarisation, found.direction, A), found.polarisation, found.direction
        )
        assert attained == pytest.approx(found.value, abs=1e-9)


def test_a_tangent_that_is_not_finite_has_no_minimum():
    assert acoustic_minimum(isotropic(0.7, 0.4)).value == pytest.approx(0.4, abs=1e-12)
    found = acoustic_minimum(np.full((3, 3, 3, 3), np.nan))
    assert np.isnan([found.value, *found.direction, *found.polarisation]).all()


def test_the_half_sphere_is_covered_evenly():
    n = half_sphere(1000)
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0)
    np.testing.assert_allclose(3 * n.T @ n / 1000, I, atol=0.01)
