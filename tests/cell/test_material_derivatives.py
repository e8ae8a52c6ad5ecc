"""Every kind of material: slopes against differences, symmetry, objectivity, small strains, equal stretches."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.cell.materials.invariants import (
    Kinematics,
    PowerSum,
    power_difference,
    ramp,
    ramp_curvature,
    ramp_derivative,
)
from porocore.cell.materials.material import voigt_moduli
from tests.helpers.solids import LAM, MATERIALS, MU, deformations, make

#: By differences only: eigenvalues of complex tensors are another matter.
SPECTRAL = ("ogden",)


@pytest.fixture(params=MATERIALS)
def material(request):
    return MATERIALS[request.param]


def steps(h):
    for i in range(3):
        for j in range(3):
            step = np.zeros((3, 3), dtype=type(h))
            step[i, j] = h
            yield i, j, step


def test_stress_and_tangent_are_the_slopes(material):
    F = deformations()
    P, A = material.stress(F), material.tangent(F)
    assert P.shape == (27, 3, 3)
    assert A.shape == (27, 3, 3, 3, 3)
    complex_step = material.kind not in SPECTRAL
    h = 1e-30 if complex_step else 2e-4
    for i, j, step in steps(h * 1j if complex_step else h):
        if complex_step:
            slope, bend = material.energy_density(F + step).imag / h, material.stress(F + step).imag / h
        else:  # of fourth order
            ahead, back = (
                [f(F + k * step) for f in (material.energy_density, material.stress) for k in (s, 2 * s)]
                for s in (1, -1)
            )
            slope, bend = (
                (8 * (ahead[k] - back[k]) - (ahead[k + 1] - back[k + 1])) / (12 * h) for k in (0, 2)
            )
        tolerance = 1e-13 if complex_step else 1e-9
        np.testing.assert_allclose(P[:, i, j], slope, rtol=0, atol=tolerance * np.abs(P).max())
        np.testing.assert_allclose(A[..., i, j], bend, rtol=0, atol=tolerance * np.abs(A).max())


def test_the_tangent_is_symmetric(material):
    A = material.tangent(deformations()).reshape(-1, 9, 9)
    np.testing.assert_allclose(A, A.swapaxes(1, 2), rtol=0, atol=1e-14 * np.abs(A).max())


def test_a_rotation_after_the_deformation_turns_the_stress_only(material):
    F, R = deformations(), Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()
    np.testing.assert_allclose(
        material.energy_density(R @ F), material.energy_density(F), rtol=1e-12, atol=1e-14
    )
    np.testing.assert_allclose(material.stress(R @ F), R @ material.stress(F), rtol=0, atol=1e-12)


def test_a_rotation_before_it_is_felt_by_fibres_only(material):
    F, R = deformations()[:22], Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()
    same = np.allclose(material.energy_density(F @ R), material.energy_density(F), rtol=1e-11, atol=1e-13)
    assert same == material.isotropic


def test_mirrors_are_felt_by_fibres_across_them_only():
    F = deformations()[:22]
    for name, material in MATERIALS.items():
        same = all(
            np.allclose(
                material.energy_density(M @ F @ M), material.energy_density(F), rtol=1e-11, atol=1e-13
            )
            for M in (np.diag([-1, 1, 1]), np.diag([1, -1, 1]), np.diag([1, 1, -1]))
        )
        assert same == material.mirrored, name
    assert MATERIALS["holzapfel-gasser-ogden"].mirrored
    assert not MATERIALS["expression with fibres"].mirrored


def test_shapes_of_one_point_and_of_points_by_element(material):
    F = deformations()[:24]
    for function, shape in ((material.energy_density, 0), (material.stress, 2), (material.tangent, 4)):
        flat = function(F)
        assert function(F[3]).shape == (3,) * shape
        np.testing.assert_array_equal(function(F.reshape(4, 6, 3, 3)).reshape(flat.shape), flat)


@pytest.mark.parametrize(
    ("name", "shear", "bulk"),
    [
        ("neo-hookean", MU, LAM + 2 * MU / 3),
        ("mooney-rivlin", 2 * (0.15 + 0.03), 1.1),
        ("ogden", (0.3 * 2.3 + 0.05 * 1.7 + 0.01 * 8) / 2, 1.0),
        ("holzapfel-gasser-ogden", 0.3, 1.0),
        ("expression", MU, LAM + 2 * MU / 3),
    ],
)
def test_linear_moduli(name, shear, bulk):
    """Those of the formulas on the page on materials, isotropic at rest; fibres bear nothing there yet."""
    material, one = MATERIALS[name], np.eye(3)
    symmetric = np.einsum("ik,jl->ijkl", one, one) + np.einsum("il,jk->ijkl", one, one)
    lam = bulk - 2 * shear / 3
    np.testing.assert_allclose(
        material.elasticity, lam * np.einsum("ij,kl->ijkl", one, one) + shear * symmetric, rtol=0, atol=1e-13
    )
    young = 9 * bulk * shear / (3 * bulk + shear)
    assert material.mean_moduli() == pytest.approx((young, shear), rel=1e-12)
    assert voigt_moduli(material.elasticity) == pytest.approx((young, shear), rel=1e-12)


def test_linear_moduli_of_fibres_that_bear_both_ways():
    """f (I4 − 1)² adds 8 f a⊗a⊗a⊗a to the elasticity, g (I5 − 1)² adds 32 g."""
    material = MATERIALS["expression with fibres"]
    plain = make(
        {
            "kind": "expression",
            "energy": "c*(I1*I3**(-1/3) - 3) + k*(J - 1)**2/2",
            "parameters": {"c": 0.2, "k": 1.0},
        }
    )
    a, b = np.array([1, 2, 0]) / np.sqrt(5), np.array([0, 0, 1.0])
    added = (8 * 0.3 + 32 * 0.1 * 3) * np.einsum("i,j,k,l->ijkl", a, a, a, a)
    added += 8 * 0.2 * np.einsum("i,j,k,l->ijkl", b, b, b, b)
    np.testing.assert_allclose(material.elasticity - plain.elasticity, added, rtol=0, atol=1e-12)


def test_the_formula_of_the_neo_hookean_solid_is_the_neo_hookean_solid():
    F, formula, own = deformations(), MATERIALS["expression"], MATERIALS["neo-hookean"]
    for name in ("energy_density", "stress", "tangent"):
        expected = getattr(own, name)(F)
        np.testing.assert_allclose(
            getattr(formula, name)(F), expected, rtol=0, atol=1e-12 * np.abs(expected).max()
        )


def test_ogden_with_exponents_of_two_is_mooney_and_rivlin():
    """λ₁^−2 + λ₂^−2 + λ₃^−2 = I₂/J²."""
    terms = [{"mu": 0.3, "alpha": 2}, {"mu": -0.06, "alpha": -2}]
    ogden = make({"kind": "ogden", "terms": terms, "bulk_modulus": 1.1})
    F, other = deformations(), MATERIALS["mooney-rivlin"]
    for name in ("energy_density", "stress", "tangent"):
        expected = getattr(other, name)(F)
        np.testing.assert_allclose(
            getattr(ogden, name)(F), expected, rtol=0, atol=1e-12 * np.abs(expected).max()
        )


@pytest.mark.parametrize("gap", [0.0, 1e-15, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 0.1])
def test_nearly_equal_stretches_lose_no_digits(gap):
    """The divided difference of x^k, against forty digits; and T₄ = tr C², whose tangent is a polynomial."""
    import mpmath

    with mpmath.workdps(60):
        for k in (-3.5, 0.5, 2.0, 7.3):
            x = np.array([1.37])
            y = x * (1 + gap)
            a, b = mpmath.mpf(float(x[0])), mpmath.mpf(float(y[0]))
            exact = (a**k - b**k) / (a - b) if a != b else k * a ** (k - 1)
            assert power_difference(np.log(x), np.log(y), k)[0] == pytest.approx(float(exact), rel=2e-14)
    R, Q = (Rotation.from_rotvec(v).as_matrix() for v in ([0.3, -0.8, 0.4], [1.0, 0.2, -0.5]))
    F = R @ np.diag([1.2, 1.2 * (1 + gap), 0.9]) @ Q
    found = np.zeros((3, 3, 3, 3, 1))
    PowerSum(4.0).add_hessian(found, np.ones(1), Kinematics(F[:, :, None]))
    C, B, one = F.T @ F, F @ F.T, np.eye(3)
    exact = 4 * (
        np.einsum("ik,jl->ijkl", one, C) + np.einsum("il,kj->ijkl", F, F) + np.einsum("ik,jl->ijkl", B, one)
    )
    np.testing.assert_allclose(found[..., 0], exact, rtol=0, atol=2e-13)


def test_fibres_bear_tension_only():
    hgo = MATERIALS["holzapfel-gasser-ogden"].model_copy(update={"dispersion": 0.0})
    matrix = make(
        {"kind": "mooney-rivlin", "c10": hgo.shear_modulus / 2, "c01": 0.0, "bulk_modulus": hgo.bulk_modulus}
    )
    shortened, stretched = np.diag([0.9, 0.9, 1.2]), np.diag([1.1, 1.1, 0.9])
    np.testing.assert_allclose(hgo.stress(shortened), matrix.stress(shortened), rtol=0, atol=1e-15)
    beyond = (hgo.stress(stretched) - matrix.stress(stretched))[0, 0]
    e = 1.1**2 - 1 - hgo.toe / 2  # of both families
    assert beyond == pytest.approx(2 * hgo.k1 * e * np.exp(hgo.k2 * e**2) * 1.1, rel=1e-12)


def test_the_ramp_has_two_continuous_derivatives():
    x = np.array([0.0, 1.0])
    for side in (-1e-9, 1e-9):
        np.testing.assert_allclose(ramp(x + side), [0, 0.5], atol=2e-9)
        np.testing.assert_allclose(ramp_derivative(x + side), [0, 1], atol=2e-9)
        np.testing.assert_allclose(ramp_curvature(x + side), [0, 0], atol=1e-8)
    x = np.linspace(-0.5, 1.5, 41)
    np.testing.assert_allclose(ramp_derivative(x), ramp(x + 1e-30j).imag / 1e-30, atol=1e-14)
    np.testing.assert_allclose(ramp_curvature(x), ramp_derivative(x + 1e-30j).imag / 1e-30, atol=1e-14)


def test_a_material_survives_being_written_and_sent(material):
    import multiprocessing.reduction

    assert make(material.model_dump(mode="json")) == material
    again = multiprocessing.reduction.ForkingPickler.loads(
        multiprocessing.reduction.ForkingPickler.dumps(material)
    )
    np.testing.assert_array_equal(
        again.stress(np.diag([1.1, 0.9, 1.0])), material.stress(np.diag([1.1, 0.9, 1.0]))
    )


def test_the_neo_hookean_solid_has_the_modulus_of_reference():
    assert NeoHookean(poisson_ratio=0.2).mean_moduli()[0] == 1.0
