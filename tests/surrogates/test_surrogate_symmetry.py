"""A learned law has the point group of its cell: exactly, and nothing that the group allows is missing."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.core.tensors import CUBIC, TRIVIAL, PointGroup
from porocore.states import MacroState
from porocore.surrogates.polynomial.monomials import integrity_basis, invariant
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from tests.helpers.cube_symmetry import symmetry_error
from tests.helpers.grouped_cell import GroupedCell

CYCLE = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
SWAP = [[0, 1, 0], [1, 0, 0], [0, 0, 1]]
TURN = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
GROUPS = {
    "triclinic": TRIVIAL,
    "monoclinic": PointGroup.generated([np.diag([1, -1, 1])]),
    "mirrors z and x-y": PointGroup.generated([SWAP, np.diag([1, 1, -1])]),
    "orthorhombic": PointGroup.generated([np.diag([1, 1, -1]), np.diag([1, -1, 1])]),
    "trigonal": PointGroup.generated([CYCLE]),
    "tetragonal 4/m": PointGroup.generated([TURN]),
    "tetragonal 4/mmm": PointGroup.generated([TURN, np.diag([-1, 1, 1])]),
    "pyritohedral": PointGroup.generated([CYCLE, np.diag([1, 1, -1])]),
    "cubic": CUBIC,
}
COLUMN = InputSpace.from_ranges({"H22": (-0.1, 0.05), "p": (0.0, 0.1)})


@pytest.fixture(params=GROUPS)
def group(request):
    return GROUPS[request.param]


def molien(group, degree):
    """How many invariant polynomials of each degree in L there are, by the series of 1/|G| Σ 1/det(1 − t ρ(g))."""
    total = np.zeros(degree + 1)
    for Q in group.matrices:
        rho = np.zeros((6, 6))
        for b, (k, l) in enumerate(((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))):
            E = np.zeros((3, 3))
            E[k, l] = E[l, k] = 1.0
            image = Q @ E @ Q.T
            rho[:, b] = image[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
        determinant = np.poly(rho)  # of λ − ρ; read backwards it is that of 1 − t ρ
        series = np.zeros(degree + 1)
        for d in range(degree + 1):
            series[d] = float(d == 0) - sum(determinant[k] * series[d - k] for k in range(1, min(d, 6) + 1))
        total += series
    return (total / len(group)).round().astype(int)


def test_no_term_is_missing_and_none_too_many(group):
    """As many monomials of each degree as there are invariant polynomials, p included."""
    terms, highest = invariant(group), 6
    known = molien(group, highest)
    for degree in range(highest + 1):
        assert len(terms.monomials(degree, degree)) == known[: degree + 1].sum()


@pytest.mark.slow
def test_no_term_is_missing_of_higher_degree(group):
    """None of the integrity bases lacks an element of a degree above six."""
    if len(group) == 1:
        pytest.skip("the variables themselves")
    known = molien(group, 9)
    for degree in (7, 8, 9):
        assert len(invariant(group).monomials(degree, degree)) == known[: degree + 1].sum()


def test_numbers_of_elements():
    """Smith & Rivlin (1958), tables of one symmetric tensor: triclinic 6, monoclinic 7, …, cubic 14 and 9."""
    found = {name: len(integrity_basis(g)) for name, g in GROUPS.items()}
    assert found == {
        "triclinic": 6,
        "monoclinic": 7,
        "mirrors z and x-y": 7,
        "orthorhombic": 7,
        "trigonal": 14,
        "tetragonal 4/m": 12,
        "tetragonal 4/mmm": 8,
        "pyritohedral": 14,
        "cubic": 9,
    }


def states(n=12, seed=5):
    random = np.random.default_rng(seed)
    return MacroState(random.uniform(-0.1, 0.1, (n, 3, 3)), random.uniform(0.0, 0.1, n))


def test_the_law_has_the_group_and_no_more(group):
    """W, φ, P_E, <∇u¹> and K_ref under all 48 operations: exact for those of the group, and wrong for each other."""
    degree = 3 if len(group) < 4 else 4
    law = GroupedCell.random(group, degree=degree)
    surrogate = PolynomialSurrogate(degree=degree).fit(law.training_set(), seed=0)
    at = states()
    for Q in CUBIC.matrices:
        worst = symmetry_error(lambda s: surrogate.predict(s, tangent=False), at, Q)
        if Q in group:
            assert max(worst.values()) < 2e-12, worst
            assert max(symmetry_error(lambda s: surrogate.predict(s, tangent=False), at, -Q).values()) < 2e-12
        else:
            assert worst["potential"] > 1e-6, Q


def test_a_potential_with_this_group_is_recovered(group):
    """To round-off but for the ridge, from states with their slopes; conductivity and <∇u¹> as well."""
    degree = 3 if len(group) < 4 else 4
    law = GroupedCell.random(group, degree=degree)
    data = law.training_set(120 if len(group) < 4 else 60)
    surrogate = PolynomialSurrogate(degree=degree).fit(data, seed=0)
    at = states()
    found, expected = surrogate.predict(at), law.respond(at)
    for name in ("potential", "stress", "fluid_volume", "mean_grad", "conductivity"):
        one, other = getattr(found, name), getattr(expected, name)
        assert np.abs(one - other).max() < 1e-6 * np.abs(other).max(), name


def test_what_the_stiffness_cannot_tell_is_kept_apart():
    """A pyritohedral law whose second order is cubic; taken for cubic, it would be wrong by far more than it is."""
    law = GroupedCell.random(GROUPS["pyritohedral"])
    data = law.training_set(45)
    wrong = replace(data, symmetry=CUBIC)
    at = states()
    expected = law.respond(at)
    errors = []
    for known in (data, wrong):
        found = PolynomialSurrogate(degree=4).fit(known, seed=0).predict(at)
        errors.append(
            [
                np.abs(found.potential - expected.potential).max(),
                np.abs(found.conductivity - expected.conductivity).max(),
            ]
        )
    assert (np.array(errors[0]) < 1e-6 * np.array(errors[1])).all()


COUPLED = ["triclinic", "mirrors z and x-y", "trigonal", "tetragonal 4/m"]


@pytest.mark.parametrize("name", GROUPS)
def test_stresses_across_the_sampled_inputs(name):
    """All six are learned from H22 and p: a shear stress of a cell without mirrors is not taken for nothing."""
    group = GROUPS[name]
    law = GroupedCell.random(group)
    surrogate = PolynomialSurrogate(degree=4).fit(law.training_set(30, inputs=COLUMN), seed=0)
    x = np.random.default_rng(6).uniform([-0.1, 0.0], [0.05, 0.1], (20, 2))
    at = COLUMN.scatter(x)
    found, expected = surrogate.predict(at), law.respond(at)
    shear = np.abs(expected.stress[:, 0, 1]).max()
    assert (shear > 1e-3) == (name in COUPLED)
    np.testing.assert_allclose(found.stress, expected.stress, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.fluid_volume, expected.fluid_volume, rtol=0, atol=1e-6)
    assert found.stress[:, 0, 1].any() == (name in COUPLED)


def test_fluid_volume_where_no_pressure_is_sampled():
    """Its course with H22 is learned too, though no state moves p."""
    law = GroupedCell.random(CUBIC)
    inputs = InputSpace.from_ranges({"H22": (-0.1, 0.05)})
    surrogate = PolynomialSurrogate(degree=4).fit(law.training_set(20, inputs=inputs), seed=0)
    at = inputs.scatter(np.linspace(-0.1, 0.05, 7)[:, None])
    np.testing.assert_allclose(
        surrogate.predict(at).fluid_volume, law.respond(at).fluid_volume, rtol=0, atol=1e-6
    )


def test_four_variables_of_a_cube():
    """Plane strain and p: terms that such states do not move are left out, and lateral stresses are right."""
    law = GroupedCell.random(CUBIC)
    inputs = InputSpace.from_ranges(
        {"H11": (-0.1, 0.1), "H22": (-0.1, 0.1), "H12": (-0.1, 0.1), "p": (0.0, 0.1)}
    )
    data = law.training_set(40, inputs=inputs)
    surrogate = PolynomialSurrogate(degree=4).fit(data, seed=0)
    random = np.random.default_rng(7)
    at = inputs.scatter(random.uniform([-0.1, -0.1, -0.1, 0], 0.1, (20, 4)))
    found, expected = surrogate.predict(at), law.respond(at)
    np.testing.assert_allclose(found.stress, expected.stress, rtol=0, atol=1e-6)


def test_terms_of_few_variables():
    """Those of the cube where only L_22 and p move: ΣL_ii³ says nothing more than ΣL_ii and ΣL_ii² do.

    Of the third order in L_22 there are L_22³ and the slope of L_22² L_11, of the second two, of the first one.
    """
    terms = invariant(CUBIC, (1, 6))
    assert [len(terms.monomials(degree, degree)) for degree in (1, 2, 3)] == [2, 4, 6]
