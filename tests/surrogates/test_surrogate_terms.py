"""Monomials, terms with the symmetry of the cube, and least squares."""

from math import comb

import numpy as np
import pytest

from porocore.core.inputs import Coordinates
from porocore.core.tensors import CUBIC
from porocore.surrogates.polynomial import varying
from porocore.surrogates.polynomial.composition import TermDerivatives, TermSum, composed
from porocore.surrogates.polynomial.fit import RegressionData, fit
from porocore.surrogates.polynomial.monomials import Polynomial, exponents_up_to, invariant, plain
from tests.helpers.cube_symmetry import cube_group

RANDOM = np.random.default_rng(0)


def random_polynomial(terms, lowest=0, highest=4, outputs=1, seed=1):
    exponents = exponents_up_to(terms.weights, lowest, highest)
    return Polynomial(exponents, np.random.default_rng(seed).normal(size=(outputs, len(exponents))))


def difference(function, t, a, h=1e-3):
    step = np.zeros((len(t), 1))
    step[a] = h
    m2, m1, p1, p2 = (function(t + k * step) for k in (-2, -1, 1, 2))
    return (m2 - 8 * m1 + 8 * p1 - p2) / (12 * h)


def test_numbers_of_monomials():
    assert [len(exponents_up_to(invariant(CUBIC).weights, 2, degree)) for degree in (4, 5)] == [38, 78]
    for variables, degree in ((2, 8), (7, 3)):
        every = exponents_up_to((1,) * variables, 0, degree)
        assert len(every) == len({tuple(e) for e in every}) == comb(variables + degree, degree)
        assert (np.diff(every.sum(axis=1)) >= 0).all()


def test_a_polynomial_is_the_sum_of_its_monomials():
    exponents = np.array([[0, 0], [3, 1], [0, 2]])
    polynomial = Polynomial(exponents, np.array([[2.0, -1.0, 0.5], [0.0, 3.0, 0.0]]))
    x, y = t = RANDOM.normal(size=(2, 600))
    expected = [2 - x**3 * y + y**2 / 2, 3 * x**3 * y]
    np.testing.assert_allclose(polynomial.evaluate(t), expected, atol=1e-13)
    value, gradient, hessian = polynomial.derivatives(t)
    np.testing.assert_allclose(value, expected, atol=1e-13)
    np.testing.assert_allclose(gradient[1], [9 * x**2 * y, 3 * x**3], atol=1e-12)
    np.testing.assert_allclose(hessian[0], [[-6 * x * y, -3 * x**2], [-3 * x**2, np.ones(600)]], atol=1e-12)


def test_nothing_is_a_polynomial():
    nothing = Polynomial(np.zeros((0, 2), dtype=np.int64), np.zeros((9, 0)))
    value, gradient, hessian = nothing.derivatives(np.ones((2, 4)))
    for array, shape in ((value, (9, 4)), (gradient, (9, 2, 4)), (hessian, (9, 2, 2, 4))):
        np.testing.assert_array_equal(array, np.zeros(shape))


@pytest.mark.parametrize("size", [1, 255, 256, 257, 1000])
def test_blocks_of_states_make_no_difference(size):
    polynomial = random_polynomial(plain((0, 1, 2, 3, 4, 5, 6)), 2, 5, outputs=2)
    t = np.random.default_rng(3).uniform(-1, 1, (7, size))
    value, gradient, _ = polynomial.derivatives(t)
    np.testing.assert_allclose(value, polynomial.evaluate(t), rtol=0, atol=1e-11)
    np.testing.assert_allclose(gradient[:, :, -1:], polynomial.derivatives(t[:, -1:])[1], rtol=0, atol=1e-11)


@pytest.mark.parametrize("terms", [plain((1, 6)), invariant(CUBIC)], ids=["plain", "cubic"])
def test_derivatives_through_terms(terms):
    polynomial = random_polynomial(terms, outputs=2)
    y = np.random.default_rng(2).uniform(-0.5, 0.5, (7, 20))
    value, gradient, hessian = composed(terms, polynomial, y)
    np.testing.assert_allclose(value, polynomial.evaluate(terms.polynomial.evaluate(y)), rtol=0, atol=1e-12)
    for a in range(7):
        slope = difference(lambda y: composed(terms, polynomial, y)[0], y, a)
        np.testing.assert_allclose(gradient[:, a], slope, atol=1e-9)
        slope = difference(lambda y: composed(terms, polynomial, y)[1], y, a)
        np.testing.assert_allclose(hessian[:, a], slope, atol=1e-8)


@pytest.mark.parametrize("terms", [plain((1, 6)), invariant(CUBIC)], ids=["plain", "cubic"])
def test_a_sum_adds_to_what_is_there(terms):
    polynomial = random_polynomial(terms, 3, 6)
    y = np.random.default_rng(2).uniform(-0.5, 0.5, (7, 30))
    value, gradient, hessian = np.ones(30), np.ones((7, 30)), np.ones((7, 7, 30))
    TermSum(terms, polynomial).start(y)(value, gradient, hessian)
    for one, other in zip(composed(terms, polynomial, y), (value, gradient, hessian), strict=True):
        np.testing.assert_allclose(one[0] + 1, other, rtol=0, atol=1e-12)


def test_rows_of_other_terms():
    assert invariant(CUBIC).rows_of(invariant(CUBIC).subset((9, 1))) == (9, 1)
    assert invariant(CUBIC).rows_of(plain((1,))) is None
    assert plain((1, 6), (0,)).rows_of(plain((6, 1))) == (1, 0)


def test_the_group_of_the_cube():
    """24 rotations; the inversion does nothing to a symmetric tensor."""
    group = cube_group((0, 1, 2, 3, 4, 5, 6))
    assert len(group) == 24
    listed = {g.round().astype(int).tobytes() for g in group}
    assert {(g @ h).round().astype(int).tobytes() for g in group for h in group} == listed
    assert len(cube_group((1, 6))) == 1
    assert len(cube_group((0, 1, 2, 6))) == 6


def test_cubic_terms_do_not_feel_the_group():
    y = np.random.default_rng(4).uniform(-0.5, 0.5, (7, 10))
    at = invariant(CUBIC).polynomial.evaluate(y)
    for g in cube_group((0, 1, 2, 3, 4, 5, 6)):
        np.testing.assert_allclose(invariant(CUBIC).polynomial.evaluate(g @ y), at, rtol=0, atol=1e-15)


def test_cubic_terms_tell_apart_what_the_group_does_not_join():
    """Their derivatives span all seven directions."""
    y = np.random.default_rng(4).uniform(-0.5, 0.5, (7, 10))
    _, gradients, _ = invariant(CUBIC).polynomial.derivatives(y, second=False)
    assert (np.linalg.matrix_rank(np.moveaxis(gradients, -1, 0)) == 7).all()


def test_some_of_the_terms():
    y = np.random.default_rng(4).uniform(-0.5, 0.5, (7, 10))
    part = invariant(CUBIC).subset((0, 5, 9))
    assert part.weights == (1, 3, 1)
    expected = [y[:3].sum(axis=0), y[3] * y[4] * y[5], y[6]]
    np.testing.assert_allclose(part.polynomial.evaluate(y), expected, atol=1e-15)
    motion = TermDerivatives(part, y)
    gradient, hessian = np.zeros((7, 10)), np.zeros((7, 7, 10))
    motion.push(np.ones((3, 10)), np.zeros((3, 3, 10)), gradient, hessian)
    np.testing.assert_allclose(gradient[3], y[4] * y[5], atol=1e-15)
    np.testing.assert_allclose(hessian[3, 4], y[5], atol=1e-15)


# ---- least squares ------------------------------------------------------------------------------


def samples_of(terms, polynomial, n, seed=0):
    y = np.random.default_rng(seed).uniform(-0.3, 0.3, (7, n))
    value, gradient, _ = composed(terms, polynomial, y)
    active = terms.polynomial.exponents.any(axis=0)
    scale = np.where(active, gradient.std(axis=2), np.inf)
    return RegressionData(y, value, gradient, value.std(axis=1), scale)


@pytest.mark.parametrize(
    ("terms", "n"), [(plain((1, 6)), 20), (invariant(CUBIC), 40)], ids=["plain", "cubic"]
)
def test_a_polynomial_is_recovered(terms, n):
    """From values and gradients, its degree by cross-validation; the ridge leaves a ten-billionth."""
    truth = random_polynomial(terms, 3, 5)
    found = fit(samples_of(terms, truth, n), terms, 3)
    assert found.degree == 5
    assert found.errors[5] < 1e-6 < found.errors[4]
    np.testing.assert_array_equal(found.polynomial.exponents, truth.exponents)
    t = terms.polynomial.evaluate(np.random.default_rng(8).uniform(-0.3, 0.3, (7, 100)))
    error = found.polynomial.evaluate(t) - truth.evaluate(t)
    assert np.abs(error).max() < 1e-7 * np.abs(truth.evaluate(t)).max()


def test_two_equations_for_each_term():
    """(1, 6): three equations a state; degree D from third order on has (D+1)(D+2)/2 − 6 monomials."""
    terms = plain((1, 6))
    truth = random_polynomial(terms, 3, 9)
    for n, largest in ((2, 2), (3, 3), (6, 4), (10, 5), (15, 6)):
        monomials = (largest + 1) * (largest + 2) // 2 - 6
        after = (largest + 2) * (largest + 3) // 2 - 6
        assert 2 * monomials <= 3 * n < 2 * after
        assert fit(samples_of(terms, truth, n), terms, 3, degree=9).degree == largest
        assert fit(samples_of(terms, truth, n), terms, 3).degree <= largest


def test_too_few_states_give_no_polynomial():
    terms = plain((1, 6))
    found = fit(samples_of(terms, random_polynomial(terms, 3, 4), 2), terms, 3)
    assert found.degree == 2
    assert not len(found.polynomial.exponents)


def test_slopes_alone_decide_where_values_are_the_same():
    """A derivative with infinite scale is left out, and does not count as an equation."""
    terms = plain((1, 6))
    samples = samples_of(terms, random_polynomial(terms, 3, 3), 10)
    assert samples.fitted.tolist() == [a in (1, 6) for a in range(7)]


@pytest.mark.parametrize("sets", ["one", "ten", "ten in order", "each its own", "none"])
@pytest.mark.parametrize("moved", [(0, 1, 2), (1,)])
@pytest.mark.parametrize("kept", [True, False])
def test_polynomials_bound_to_coordinates_are_those_of_all_variables(sets, moved, kept, monkeypatch):
    """All points may have the same coordinates, few different ones, or each its own; some variables are zero."""
    monkeypatch.setattr(varying, "MOST_KEPT", 1000 if kept else 0)
    random, inner, n = np.random.default_rng(5), 3, 700
    whole = random_polynomial(plain((0, 1, 2, 3, 4)), 0, 5, outputs=3)
    chosen = random.random(whole.coefficients.shape) < 0.5
    whole = Polynomial(whole.exponents, whole.coefficients * chosen * [[1], [0], [1]])
    t, x = np.zeros((inner, n)), random.uniform(-1, 1, (2, n))
    t[list(moved)] = random.uniform(-1, 1, (len(moved), n))
    if sets == "none":
        t, x, n = t[:, :0], x[:, :0], 0
    elif sets != "each its own":
        number = random.integers(0, 1 if sets == "one" else 10, n)
        x = x[:, np.sort(number) if sets == "ten in order" else number]
    bound = varying.VaryingPolynomial(whole, inner).at(Coordinates(x))
    assert_bound(bound, t, whole.derivatives(np.concatenate([t, x])))
    some = np.flatnonzero(random.random(n) < 0.3)[::-1]
    assert_bound(bound.take(some), t[:, some], whole.derivatives(np.concatenate([t, x])[:, some]))


def assert_bound(bound, t, expected):
    """Values and derivatives by t, and these alone, are as expected; what is left out is zero."""
    inner, (value, gradient, hessian) = len(t), expected
    found, first, second = bound.entries(t)
    np.testing.assert_allclose(found, value, atol=1e-12)
    one, two = np.zeros_like(gradient[:, :inner]), np.zeros_like(hessian[:, :inner, :inner])
    for place, row in first:
        one[place] = row
    for (o, a, b), row in second:
        two[o, a, b] = two[o, b, a] = row
    np.testing.assert_allclose(one, gradient[:, :inner], atol=1e-12)
    np.testing.assert_allclose(two, hessian[:, :inner, :inner], atol=1e-11)
    assert not {o for (o, *_), _ in first + second} & {1}
    assert not bound.entries(t, second=False)[2]
    for (place, row), (other, same) in zip(bound.gradients(t), first, strict=True):
        assert place == other
        np.testing.assert_allclose(row, same, atol=1e-13)


def test_few_sets_are_told_from_many():
    random = np.random.default_rng(1)
    x = random.uniform(-1, 1, (2, 10))
    number = np.repeat([3, 1, 7], 50)
    sets = Coordinates(x[:, number]).sets
    assert sets.count == 3
    assert sets.in_order
    assert list(sets.parts(40, 120)) == [(0, slice(40, 50)), (1, slice(50, 100)), (2, slice(100, 120))]
    assert not sets.take(np.array([149, 0, 60])).in_order
    assert Coordinates(random.uniform(-1, 1, (2, 150))).sets is None


def test_coordinates_of_all_points_and_a_unit_are_given_once():
    random, whole = np.random.default_rng(6), random_polynomial(plain((0, 1, 2)))
    t, x, unit = random.uniform(-1, 1, (2, 40)), random.uniform(-1, 1, (1, 1)), 3.0
    one = varying.VaryingPolynomial(whole, 2).at(Coordinates(x), unit)
    every = varying.VaryingPolynomial(whole, 2).at(Coordinates(np.tile(x, 40)))
    np.testing.assert_allclose(one.entries(t)[0], unit * every.entries(t)[0], atol=1e-13)
    points = np.array([3, 7, 3])
    for bound, by in ((one, unit), (every, 1.0)):
        near = bound.take(points).entries(t[:, points])
        np.testing.assert_allclose(near[0], by * every.entries(t)[0][:, points], atol=1e-13)
