"""ln U, R and derivatives through them, against scipy's matrix functions and against differences."""

from decimal import Decimal, localcontext

import numpy as np
import pytest
from scipy.linalg import logm, polar

from porocore.core.tensors import symmetric_eigen
from porocore.surrogates.stretch import PLACES, LogStretch, pair_differences, triple_difference

N = 24


def rotations(n, seed=2):
    Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(n, 3, 3)))
    return Q * np.linalg.det(Q)[:, None, None]


def with_stretches(stretches, seed=1):
    """F of given principal stretches (n, 3), axes and rotations at random."""
    Q = rotations(len(stretches), seed)
    U = np.einsum("nia,na,nja->nij", Q, stretches, Q)
    return rotations(len(stretches), seed + 1) @ U


def kinds():
    random = np.random.default_rng(0)
    wide = random.uniform(0.5, 2, (N, 3))
    double = wide[:, [0, 0, 1]]
    near = double * np.array([1, 1 + 1e-7, 1])
    yield "general", np.eye(3) + random.uniform(-0.2, 0.2, (N, 3, 3))
    yield "stretches from 0.5 to 2", with_stretches(wide)
    yield "two equal", with_stretches(double)
    yield "two nearly equal", with_stretches(near)
    yield "all nearly equal", with_stretches(1.3 + 1e-5 * random.normal(size=(N, 3)))
    yield "all equal", with_stretches(np.repeat(wide[:, :1], 3, axis=1))
    yield "a little apart", with_stretches(1 + 0.02 * random.normal(size=(N, 3)))
    yield "almost diagonal", np.eye(3) * wide[:, None] + 1e-6 * random.normal(size=(N, 3, 3))
    yield "diagonal", np.eye(3) * wide[:, None]
    yield "diagonal, two equal", np.eye(3) * double[:, None]
    for axis in range(3):
        alone = np.ones((N, 3))
        alone[:, axis] = wide[:, 0]
        yield f"one component, {axis + 1}", np.eye(3) * alone[:, None]


CASES = dict(kinds())


@pytest.fixture(params=CASES)
def F(request):
    return CASES[request.param]


def stretch_of(F):
    return LogStretch.from_gradient(F - np.eye(3))


def matrix(components):
    """Symmetric (n, 3, 3) of six components (6, n)."""
    out = np.zeros((components.shape[1], 3, 3))
    for value, (i, j) in zip(components, PLACES, strict=True):
        out[:, i, j] = out[:, j, i] = value
    return out


def potential(seed=5):
    """Coefficients of a made-up W(L) = T:L + ½ L:K:L in six components."""
    random = np.random.default_rng(seed)
    T, K = random.normal(size=6), random.normal(size=(6, 6))
    return T, K + K.T


def value_and_slopes(F):
    T, K = potential()
    L = stretch_of(F).L
    slope = T[:, None] + K @ L
    return (T[:, None] * L).sum(axis=0) + (L * (K @ L)).sum(axis=0) / 2, slope, K


def test_stretch_and_rotation(F):
    stretch = stretch_of(F)
    R = np.repeat(np.eye(3)[None], N, 0) if stretch.rotation is None else np.moveaxis(stretch.rotation, -1, 0)
    for n in range(N):
        rotation, U = polar(F[n])
        np.testing.assert_allclose(R[n], rotation, atol=1e-13)
        np.testing.assert_allclose(matrix(stretch.L)[n], logm(U).real, atol=1e-13)


def difference(function, F, direction, h):
    """Central difference of fourth order."""
    m2, m1, p1, p2 = (function(F + k * h * direction) for k in (-2, -1, 1, 2))
    return (m2 - 8 * m1 + 8 * p1 - p2) / (12 * h)


DIRECTIONS = np.eye(9).reshape(9, 3, 3)


def test_gradient(F):
    stretch = stretch_of(F)
    for place, direction in enumerate(DIRECTIONS):
        slope = difference(lambda F: stretch_of(F).L, F, direction, 1e-3).T
        np.testing.assert_allclose(stretch.gradient[:, place], slope, atol=2e-9)


def test_stress(F):
    _, T, _ = value_and_slopes(F)
    stress = stretch_of(F).stress(T).reshape(N, 9)
    for place, direction in enumerate(DIRECTIONS):
        slope = difference(lambda F: value_and_slopes(F)[0], F, direction, 1e-3)
        np.testing.assert_allclose(stress[:, place], slope, atol=1e-8)


def test_tangent(F):
    def stress(F):
        return stretch_of(F).stress(value_and_slopes(F)[1])

    _, T, K = value_and_slopes(F)
    tangent = stretch_of(F).tangent(T, np.repeat(K[:, :, None], N, axis=2))
    np.testing.assert_allclose(tangent, tangent.transpose(0, 3, 4, 1, 2), rtol=0, atol=2e-12)
    for place, direction in enumerate(DIRECTIONS):
        slope = difference(stress, F, direction, 1e-3)
        np.testing.assert_allclose(tangent.reshape(N, 3, 3, 9)[..., place], slope, atol=1e-7)


@pytest.mark.parametrize("name", [name for name in CASES if name.startswith(("diagonal", "one"))])
def test_the_short_way_of_diagonal_states_is_the_long_one(name):
    """Orthotropic W: entries written out, against the products of matrices with the axes given."""
    F = CASES[name]
    random = np.random.default_rng(1)
    T, K = random.normal(size=(6, N)), np.zeros((6, 6, N))
    T[3:] = 0
    K[:3, :3] = random.normal(size=(3, 3, N))
    K[:3, :3] += K[:3, :3].swapaxes(0, 1)
    K[[3, 4, 5], [3, 4, 5]] = random.normal(size=(3, N))
    short = stretch_of(F)
    long = LogStretch(short.F, short.stretches, np.repeat(np.eye(3)[:, :, None], N, axis=2))
    np.testing.assert_allclose(short.stress(T), long.stress(T), atol=1e-13)
    np.testing.assert_allclose(short.tangent(T, K), long.tangent(T, K), atol=1e-12)
    A, slopes = (
        random.normal(size=(3, 3, N)),
        {(o, a): random.normal(size=N) for o in range(9) for a in range(6)},
    )
    np.testing.assert_allclose(
        short.rotated_gradient(A, slopes), long.rotated_gradient(A, slopes), atol=1e-13
    )


def test_pull_undoes_stress(F):
    _, T, _ = value_and_slopes(F)
    stretch = stretch_of(F)
    np.testing.assert_allclose(stretch.pull(np.moveaxis(stretch.stress(T), 0, -1)), T, atol=1e-12)


def test_a_pure_stretch_does_not_rotate(F):
    stretch = stretch_of(F)
    for component in range(len(PLACES)):
        direction = np.moveaxis(stretch.pull_direction(component), -1, 0)
        change = difference(lambda F: stretch_of(F).L, F, direction, 1e-3)
        np.testing.assert_allclose(change, np.eye(6)[:, [component]] * np.ones(N), atol=1e-8)
        turn = difference(rotation_of, F, direction, 1e-3)
        np.testing.assert_allclose(turn, 0, atol=1e-8)


def rotation_of(F):
    rotation = stretch_of(F).rotation
    return np.broadcast_to(np.eye(3), F.shape) if rotation is None else np.moveaxis(rotation, -1, 0)


def test_rotation_gradient(F):
    A = np.random.default_rng(3).normal(size=(3, 3, N))
    gradient = stretch_of(F).rotated_gradient(A, {}).reshape(N, 3, 3, 9)
    for place, direction in enumerate(DIRECTIONS):
        slope = difference(lambda F: rotation_of(F) @ np.moveaxis(A, -1, 0), F, direction, 1e-3)
        np.testing.assert_allclose(gradient[..., place], slope, atol=1e-8)


def test_rotated_gradient(F):
    """Of R A(L) with A linear in L."""
    random = np.random.default_rng(4)
    B, C = random.normal(size=(3, 3)), random.normal(size=(9, 6))

    def A(F):
        return B + (C @ stretch_of(F).L).T.reshape(-1, 3, 3)

    slopes = {(o, a): float(C[o, a]) for o in range(9) for a in range(6)}
    gradient = stretch_of(F).rotated_gradient(np.moveaxis(A(F), 0, -1), slopes).reshape(N, 3, 3, 9)
    for place, direction in enumerate(DIRECTIONS):
        slope = difference(lambda F: rotation_of(F) @ A(F), F, direction, 1e-3)
        np.testing.assert_allclose(gradient[..., place], slope, atol=2e-8)


def test_states_that_are_none_are_nan_alone():
    F = CASES["general"].copy()
    F[3, 0] *= -1
    F[5] = np.nan
    stretch = stretch_of(F)
    bad = np.zeros(N, dtype=bool)
    bad[[3, 5]] = True
    np.testing.assert_array_equal(np.isnan(stretch.L).all(axis=0), bad)
    np.testing.assert_array_equal(np.isnan(stretch.L).any(axis=0), bad)
    np.testing.assert_allclose(stretch.L[:, ~bad], stretch_of(F[~bad]).L, rtol=0, atol=1e-15)
    diagonal = CASES["diagonal"].copy()
    diagonal[2, 1, 1] = -0.1
    np.testing.assert_array_equal(np.isnan(stretch_of(diagonal).L).any(axis=0), np.arange(N) == 2)


def test_no_states():
    stretch = LogStretch.from_gradient(np.zeros((0, 3, 3)))
    assert stretch.L.shape == (6, 0)
    assert stretch.tangent(np.zeros((6, 0)), np.zeros((6, 6, 0))).shape == (0, 3, 3, 3, 3)


@pytest.mark.parametrize("gap", [1.0, 1e-3, 1e-8, 1e-15, 0.0])
def test_symmetric_eigen(gap):
    Q = rotations(N)
    values = np.sort(1 + gap * np.random.default_rng(0).uniform(size=(N, 3)), axis=1)
    A = np.einsum("nia,na,nja->nij", Q, values, Q)
    found, axes = symmetric_eigen(np.moveaxis(A, 0, -1))
    np.testing.assert_allclose(np.sort(found, axis=0).T, np.linalg.eigvalsh(A), rtol=0, atol=3e-15)
    np.testing.assert_allclose(np.einsum("ian,an,jan->nij", axes, found, axes), A, rtol=0, atol=3e-15)
    np.testing.assert_allclose(
        np.einsum("ian,ibn->abn", axes, axes), np.eye(3)[:, :, None] * np.ones(N), atol=3e-15
    )


@pytest.mark.parametrize("gap", [0, 1e-14, 1e-8, 1e-4, 1e-3, 0.01, 0.05, 0.0599, 0.0601, 0.2, 1.0, 3.0])
def test_divided_differences_to_the_last_digits(gap):
    """Against a hundred digits, on both sides of every switch between formulas."""
    x, y, z = 0.7, 0.7 * (1 + gap), 0.7 * (1 + gap / 3)
    first, left, right = (float(value[0]) for value in pair_differences(np.array([x]), np.array([y])))
    assert first == pytest.approx(divided(x, y), rel=1e-15)
    assert left == pytest.approx(divided(x, x, y), rel=1e-14)
    assert right == pytest.approx(divided(x, y, y), rel=1e-14)
    for three in ((x, y, z), (y, z, x), (z, x, y)):
        found = triple_difference(*(np.array([value]) for value in three))
        assert float(found[0]) == pytest.approx(divided(x, z, y), rel=2e-14)


def divided(*points):
    """ln[points] in a hundred digits; equal points are moved apart by less than matters and more than is lost."""
    with localcontext() as context:
        context.prec = 100
        exact = [Decimal(point) * (1 + Decimal(10) ** -25 * k) for k, point in enumerate(points)]
        table = [point.ln() for point in exact]
        for order in range(1, len(points)):
            table = [(table[k + 1] - table[k]) / (exact[k + order] - exact[k]) for k in range(len(table) - 1)]
        return float(table[0])
