"""A learned conductivity: exact at rest, positive definite everywhere, objective; its derivatives are its slopes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.tensors import TRIVIAL, exponential, logarithm, symmetric_exponential
from porocore.errors import ConfigurationError, DataError
from porocore.macro.laws.closure import CLOSURES, make_closure
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.states import MacroState
from porocore.surrogates.conductivity import fit_conductivity
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.surrogates.portable import NumpySurrogate
from porocore.testing.synthetic.cell import SOLID_FRACTION, synthetic_training_set
from porocore.testing.synthetic.potential_cell import potential_training_set
from tests.helpers.made_up_conductivity import EYE, K0, conductivity, with_conductivity


@pytest.fixture(scope="module")
def general():
    """All nine components of H, and p."""
    return with_conductivity(potential_training_set(60, seed=1))


@pytest.fixture(scope="module")
def model(general):
    return fit_conductivity(general)[0]


@pytest.fixture(scope="module")
def surrogate(general):
    return PolynomialSurrogate(degree=3).fit(general, seed=0)


def states(n, size=0.1, seed=5):
    random = np.random.default_rng(seed)
    return MacroState(random.uniform(-size, size, (n, 3, 3)), random.uniform(0, size, n))


def test_unseen_conductivities_are_predicted(model):
    there = states(100)
    error = model.predict(there, tangent=False)[0] - conductivity(there)
    assert np.abs(error).max() < 0.02 * K0
    assert np.sqrt((error**2).mean()) < 2e-3 * K0


def test_rest_is_exact(model):
    np.testing.assert_allclose(
        model.predict(MacroState.zeros(2), tangent=False)[0], K0 * np.array([EYE] * 2), rtol=1e-14
    )


@pytest.mark.parametrize("size", [0.1, 0.5, 1.0])
def test_symmetric_and_positive_everywhere(model, size):
    there = states(2000, size)
    there = there[np.flatnonzero(np.linalg.det(EYE + there.grad_u) > 0)]
    K = model.predict(there, tangent=False)[0]
    np.testing.assert_allclose(K, K.swapaxes(1, 2), atol=1e-13 * np.abs(K).max())
    assert np.linalg.eigvalsh(K).min() > 0


@pytest.mark.parametrize("size", [0.05, 0.3])
def test_derivatives_are_the_slopes(model, size):
    """Inside the sampled box and where the variables come to rest beyond it."""
    there, h = states(20, size), 1e-6
    _, by_H, by_p = model.predict(there, tangent=True)
    random = np.random.default_rng(2)
    dH, dp = random.normal(size=(20, 3, 3)), random.normal(size=20)
    ends = [
        model.predict(MacroState(there.grad_u + s * dH, there.p + s * dp), tangent=False)[0] for s in (h, -h)
    ]
    slope = np.einsum("nijkl,nkl->nij", by_H, dH) + by_p * dp[:, None, None]
    np.testing.assert_allclose((ends[0] - ends[1]) / (2 * h), slope, atol=1e-7 * np.abs(slope).max())


def test_values_do_not_depend_on_the_tangent(model):
    there = states(10)
    np.testing.assert_allclose(
        model.predict(there, tangent=True)[0], model.predict(there, tangent=False)[0], rtol=1e-13
    )


def test_objective(model):
    there = states(10)
    R = Rotation.from_rotvec([0.4, -0.3, 0.8]).as_matrix()
    turned = MacroState(R @ (EYE + there.grad_u) - EYE, there.p)
    np.testing.assert_allclose(
        model.predict(turned, tangent=False)[0], model.predict(there, tangent=False)[0], atol=1e-12
    )


def test_the_symmetry_of_the_cube(model):
    there = states(10)
    Q = np.array([[0.0, 0, 1], [-1, 0, 0], [0, 1, 0]])
    moved = MacroState(Q @ there.grad_u @ Q.T, there.p)
    K = model.predict(there, tangent=False)[0]
    np.testing.assert_allclose(model.predict(moved, tangent=False)[0], Q @ K @ Q.T, atol=1e-8 * K0)


def test_along_one_axis_the_symmetric_components_are_equal_and_zero():
    model, error = fit_conductivity(with_conductivity(synthetic_training_set(40, seed=1)))
    assert model.active == (1, 6)
    assert error < 1e-3
    H = np.zeros((1, 3, 3))
    H[0, 1, 1] = -0.1
    K = model.predict(MacroState(H, np.array([0.1])), tangent=False)[0][0]
    assert K[0, 0] == pytest.approx(K[2, 2], rel=1e-10)
    assert K[0, 0] != pytest.approx(K[1, 1], rel=1e-2)
    assert np.abs(K[[0, 0, 1], [1, 2, 2]]).max() < 1e-10 * K0


def test_a_pore_stays_closed_where_it_is(general):
    open_to = np.array([[1.0, 0, 0], [0, 0.6, 0.8]]).T
    keep = open_to @ open_to.T
    data = replace(
        general,
        responses=replace(general.responses, conductivity=keep @ general.responses.conductivity @ keep),
        reference=replace(general.reference, conductivity=K0 * keep[None]),
        symmetry=TRIVIAL,
    )
    model, _ = fit_conductivity(data)
    K = model.predict(states(20), tangent=False)[0]
    values = np.linalg.eigvalsh(K)
    assert np.abs(values[:, 0]).max() < 1e-12
    assert values[:, 1].min() > 0
    np.testing.assert_allclose(K @ [0, 0.8, -0.6], 0, atol=1e-12)


def test_states_without_conductivity_are_left_out_and_flagged(general):
    few = general.responses.conductivity.copy()
    few[general.states.grad_u[:, 0, 0] > 0.03] = np.nan
    data = replace(general, responses=replace(general.responses, conductivity=few))
    surrogate = PolynomialSurrogate(degree=3).fit(data, seed=0)
    H = np.zeros((2, 3, 3))
    H[0, 0, 0], H[1, 0, 0] = 0.02, 0.09
    response = surrogate.predict(MacroState(H, np.full(2, 0.05)))
    assert response.flagged.tolist() == [False, True]
    assert np.isfinite(response.conductivity).all()
    few[:] = np.nan
    with pytest.raises(DataError, match="only 0 of 60 stable states have a conductivity"):
        fit_conductivity(replace(data, responses=replace(general.responses, conductivity=few)))


def test_without_conductivity_nothing_is_learned():
    data = potential_training_set(30, seed=1)
    assert fit_conductivity(data) is None
    response = PolynomialSurrogate(degree=3).fit(data, seed=0).predict(states(2))
    assert response.conductivity is None
    assert response.tangent.conductivity_grad_u is None


def test_the_file_carries_it(surrogate, tmp_path):
    surrogate.save(tmp_path / "surrogate.h5")
    read, there = NumpySurrogate.load(tmp_path / "surrogate.h5"), states(5, 0.2)
    a, b = surrogate.predict(there), read.predict(there)
    assert (a.conductivity == b.conductivity).all()
    assert (a.tangent.conductivity_grad_u == b.tangent.conductivity_grad_u).all()
    assert (a.flagged == b.flagged).all()
    assert read.accuracy == surrogate.accuracy
    assert 0 < read.accuracy["cross-validated ln K"] < 0.05


@pytest.mark.parametrize("name", CLOSURES)
def test_closures_take_the_flux_from_it(surrogate, name):
    closure = make_closure(name, SOLID_FRACTION, NeoHookean(), K0 * EYE, law="deformed")
    law, there, h = ClosedLaw(surrogate, closure), states(5, 0.05), 1e-6
    memory = law.initial(5)
    g = np.random.default_rng(3).normal(size=(5, 3))
    response = law.respond(there, g, memory)
    cell = surrogate.predict(there)
    np.testing.assert_allclose(response.flux, -np.einsum("nij,nj->ni", cell.conductivity, g), rtol=1e-13)
    J = np.linalg.det(EYE + there.grad_u + cell.mean_grad / SOLID_FRACTION)
    np.testing.assert_allclose(
        response.transformed_conductivity, cell.conductivity / J[:, None, None], rtol=1e-12
    )
    random = np.random.default_rng(4)
    dH, dp, dg = random.normal(size=(5, 3, 3)), random.normal(size=5), random.normal(size=(5, 3))
    ends = [
        law.respond(MacroState(there.grad_u + s * dH, there.p + s * dp), g + s * dg, memory, tangent=False)
        for s in (h, -h)
    ]
    t = response.tangent
    slope = np.einsum("nikl,nkl->ni", t.flux_grad_u, dH) + t.flux_p * dp[:, None]
    slope += np.einsum("nij,nj->ni", t.flux_grad_p, dg)
    np.testing.assert_allclose(
        (ends[0].flux - ends[1].flux) / (2 * h), slope, atol=1e-6 * np.abs(slope).max()
    )
    carried = make_closure(name, SOLID_FRACTION, NeoHookean(), K0 * EYE)
    assert carried.identity != closure.identity
    other = ClosedLaw(surrogate, carried).respond(there, g, memory)
    assert (other.stress == response.stress).all()
    assert (other.storage == response.storage).all()
    assert np.abs(other.flux - response.flux).max() > 0.1


def test_a_cell_law_that_knows_none_is_refused():
    without = PolynomialSurrogate(degree=3).fit(potential_training_set(30, seed=1), seed=0)
    closure = make_closure("potential", SOLID_FRACTION, NeoHookean(), K0 * EYE, law="deformed")
    with pytest.raises(ConfigurationError, match="conductivity: 'deformed' needs"):
        ClosedLaw(without, closure)


def test_logarithm_and_exponential():
    random = np.random.default_rng(0)
    A, D = random.normal(size=(4, 3, 3)), random.normal(size=(4, 2, 3, 3))
    A, D = A + A.swapaxes(1, 2), D + D.swapaxes(2, 3)
    A[0] = EYE  # equal eigenvalues
    E, slopes = symmetric_exponential(A, D)
    np.testing.assert_allclose(E, exponential(A), rtol=1e-12)
    np.testing.assert_allclose(logarithm(E), A, atol=1e-12)
    h = 1e-5
    for k in range(2):
        difference = (exponential(A + h * D[:, k]) - exponential(A - h * D[:, k])) / (2 * h)
        np.testing.assert_allclose(slopes[:, k], difference, atol=1e-8 * np.abs(difference).max())
    assert np.isnan(logarithm(-EYE)).all()
