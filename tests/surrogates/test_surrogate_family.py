"""The potential of a family of cells: exact rest, exact parameters, slopes, fits without slopes, files."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.core.tensors import exponential, logarithm, symmetric_logarithm
from porocore.errors import ConfigurationError, DataError
from porocore.states import MacroState
from porocore.surrogates.family.coordinates import bounds, log_zeta
from porocore.surrogates.family.rest import fit_rest
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing.synthetic.porous_family import (
    INPUTS,
    PARAMETERS,
    porous_training_set,
    respond,
    rest_data,
)

#: All parameters, also those whose effect is known.
ALL = InputSpace.from_ranges(
    {"H22": (-0.12, 0.04), "p": (0.0, 0.1)},
    PARAMETERS | {"modulus": (0.5, 2.0), "swelling": (1.0, 1.1), "viscosity": (0.5, 2.0)},
)
NAMES = ("potential", "stress", "fluid_volume", "mean_grad", "conductivity")


def at_rest(theta):
    return MacroState.zeros(len(theta)).with_parameters(theta)


def moved(states, k, step):
    theta = states.parameters.copy()
    theta[:, k] += step
    return replace(states, parameters=theta)


@pytest.fixture(scope="module")
def everything():
    return PolynomialSurrogate().fit(porous_training_set(40, 1, ALL), seed=0)


def test_logarithm_of_a_matrix_and_its_derivative():
    random = np.random.default_rng(0)
    A, D = random.normal(size=(2, 5, 4, 4))
    A, D = A @ A.swapaxes(1, 2) + np.eye(4), D + D.swapaxes(1, 2)
    A[0] = np.eye(4)
    value, slope = symmetric_logarithm(A, D[:, None])
    np.testing.assert_allclose(exponential(value), A, rtol=1e-12)
    h = 1e-4
    up, down = (symmetric_logarithm(A + step * D, D[:, None])[0] for step in (h, -h))
    np.testing.assert_allclose(slope[:, 0], (up - down) / (2 * h), atol=1e-7)


def test_bounds_and_the_coordinate_of_stiffness():
    phi, nu = np.array([0.0, 0.4]), np.array([0.3, 0.3])
    found, by_phi, by_nu = bounds(phi, nu)
    # Without pores the bound is the solid; its P-wave modulus is E (1 − ν)/((1 + ν)(1 − 2ν)).
    np.testing.assert_allclose(found.drained[0], found.bulk[0])
    np.testing.assert_allclose(found.wave[0], 0.7 / (1.3 * 0.4))
    h = 1e-6
    for slopes, a, b in ((by_phi, (phi + h, nu), (phi - h, nu)), (by_nu, (phi, nu + h), (phi, nu - h))):
        for name in ("drained", "wave", "bulk", "shear"):
            difference = (getattr(bounds(*a)[0], name) - getattr(bounds(*b)[0], name)) / (2 * h)
            np.testing.assert_allclose(getattr(slopes, name), difference, atol=1e-8)
    _, by_phi, by_nu = log_zeta(phi, nu)
    np.testing.assert_allclose(
        by_phi, (log_zeta(phi + h, nu)[0] - log_zeta(phi - h, nu)[0]) / (2 * h), rtol=1e-8
    )
    np.testing.assert_allclose(
        by_nu, (log_zeta(phi, nu + h)[0] - log_zeta(phi, nu - h)[0]) / (2 * h), rtol=1e-8
    )


@pytest.mark.parametrize(
    ("count", "slopes", "tied", "within"),
    [(20, True, True, 1e-4), (40, False, True, 1e-3), (40, True, False, 1e-2)],
)
def test_every_member_between_the_solved_ones_is_exact_at_rest(count, slopes, tied, within):
    rests = rest_data(count, slopes=slopes)
    if not tied:
        rests = replace(rests, young=None, poisson=None)
    data = replace(porous_training_set(30, 1), rests=rests)
    surrogate = PolynomialSurrogate(degree=3).fit(data, seed=0)
    states = at_rest(np.random.default_rng(3).uniform(*INPUTS.parameter_ranges.T, (50, 2)))
    found, truth = surrogate.predict(states), respond(states)
    for name in ("stress_grad_u", "stress_p", "fluid_volume_p", "mean_grad_grad_u", "mean_grad_p"):
        a, b = getattr(found.tangent, name), getattr(truth.tangent, name)
        np.testing.assert_allclose(a, b, atol=within * np.abs(b).max(), err_msg=name)
    np.testing.assert_allclose(found.stress, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.fluid_volume, truth.fluid_volume, rtol=1e-6)
    np.testing.assert_allclose(found.conductivity, truth.conductivity, rtol=1e-3, atol=1e-9)


def test_conductivity_follows_the_parameters_where_a_mesh_breaks_the_symmetry_of_the_cell():
    """K of a gyroid's tetrahedra has entries off the diagonal, and these have slopes, that cubic symmetry excludes."""
    rests = rest_data(20)
    K, slopes = rests.responses.conductivity, rests.responses.slopes
    random, share = np.random.default_rng(0), 1e-3 * np.abs(K).max()
    uneven = replace(slopes, conductivity=slopes.conductivity + share * random.normal(size=(3, 3, 2)))
    broken = replace(rests, responses=replace(rests.responses, conductivity=K + share * 0.1, slopes=uneven))
    rest = fit_rest(broken, INPUTS, porous_training_set(4).symmetry)
    theta = random.uniform(*INPUTS.parameter_ranges.T, (50, 2))
    truth = respond(at_rest(theta)).conductivity
    np.testing.assert_allclose(rest.conductivities(theta), truth, atol=2e-3 * np.abs(truth).max())


def test_biots_data_follow_from_the_stiffness_to_round_off():
    """α = 1 − K_d/K_s and 1/M = (α − φ_f)/K_s, whatever the error of the stiffness."""
    rest = fit_rest(rest_data(12, slopes=False), INPUTS, porous_training_set(4).symmetry)
    theta = np.array([[0.17, 0.22], [0.28, 0.41]])
    at = rest.at(theta)
    K_s = 1 / (3 * (1 - 2 * theta[:, 1]))
    K_d = at.matrix[:3, :3].sum(axis=(0, 1)) / 9
    alpha = 1 - K_d / K_s
    np.testing.assert_allclose(-at.matrix[6, 0], alpha, rtol=1e-12)
    np.testing.assert_allclose(-at.matrix[6, 6], (alpha - at.porosity) / K_s, rtol=1e-11)


def test_modulus_swelling_and_viscosity_need_no_samples(everything):
    """Responses of all five parameters are as good as those of two, far outside the sampled moduli too."""
    unseen = porous_training_set(100, 2, ALL)
    found = everything.predict(unseen.states)
    for name in NAMES:
        truth = getattr(unseen.responses, name)
        values, known = (
            getattr(found, name)[..., *(1, 1)[: truth.ndim - 1]],
            truth[..., *(1, 1)[: truth.ndim - 1]],
        )
        assert np.sqrt(((values - known) ** 2).mean()) < 5e-3 * np.ptp(known), name
    one = unseen.states[:1]
    twice = replace(moved(one, 2, one.parameters[0, 2]), p=2 * one.p)
    softer, stiffer = everything.predict(one), everything.predict(twice)
    np.testing.assert_allclose(stiffer.stress, 2 * softer.stress, rtol=1e-12, atol=1e-14)
    thick = everything.predict(moved(one, 4, one.parameters[0, 4]))
    np.testing.assert_allclose(thick.conductivity, softer.conductivity / 2, rtol=1e-12)


def test_a_swelling_that_all_members_have_needs_no_samples_either(tmp_path):
    """Undeformed members are those before they swell; H = (λ − 1) I is free of stress for every radius."""
    inputs = InputSpace.from_ranges({"H22": (-0.05, 0.1), "p": (0.0, 0.05)}, {"radius": (0.15, 0.3)})
    stretch, dry = 1.06, porous_training_set(30, 1, inputs)

    def wet(states):
        """The responses of members that swell."""
        theta = np.column_stack([states.parameters, np.full(len(states), stretch)])
        found = respond(states.with_parameters(theta), ("radius", "swelling"))
        slopes = {name: value[..., :1] for name, value in vars(found.slopes).items() if value is not None}
        return replace(found, slopes=replace(found.slopes, **slopes))

    data = replace(dry, responses=wet(dry.states), rests=replace(dry.rests, stretch=stretch))
    surrogate = PolynomialSurrogate().fit(data, seed=0)
    path = tmp_path / "surrogate.h5"
    surrogate.save(path)
    free = MacroState(
        np.broadcast_to((stretch - 1) * np.eye(3), (5, 3, 3)), np.zeros(5), np.linspace(0.15, 0.3, 5)[:, None]
    )
    for each in (surrogate, PolynomialSurrogate.load(path)):
        found, truth = each.predict(free), wet(free)
        np.testing.assert_allclose(found.stress, 0.0, atol=1e-13)
        np.testing.assert_allclose(found.fluid_volume, truth.fluid_volume, rtol=1e-6)
        np.testing.assert_allclose(found.conductivity, truth.conductivity, rtol=1e-3, atol=1e-9)
        unseen = porous_training_set(50, 2, inputs).states
        for name in NAMES[:4]:
            a, b = getattr(each.predict(unseen), name), getattr(wet(unseen), name)
            np.testing.assert_allclose(a, b, atol=1e-2 * np.ptp(b), err_msg=name)


def test_slopes_by_all_parameters_are_those_of_the_predictions(everything):
    states = porous_training_set(6, 3, ALL).states
    states = replace(states, grad_u=states.grad_u + np.random.default_rng(1).uniform(-0.02, 0.02, (6, 3, 3)))
    slopes = everything.slopes(states)
    for k in range(5):
        h = 1e-4
        values = [everything.predict(moved(states, k, i * h), tangent=False) for i in (-2, -1, 1, 2)]
        for name in NAMES:
            a, b, c, d = (getattr(value, name) for value in values)
            difference = (a - 8 * b + 8 * c - d) / (12 * h)
            found = getattr(slopes, name)[..., k]
            np.testing.assert_allclose(
                found, difference, atol=1e-8 * max(np.abs(found).max(), 1), err_msg=name
            )


def test_one_member_is_evaluated_as_a_batch_of_several():
    """A batch of one member uses a polynomial that is bound to it."""
    surrogate = PolynomialSurrogate(degree=4).fit(porous_training_set(30, 1), seed=0)
    states = porous_training_set(64, 5).states
    one = states.with_parameters(states.parameters[0])
    both = MacroState.concatenate([one, states])
    together, alone = surrogate.predict(both), surrogate.predict(one)
    for name in NAMES[:4]:
        np.testing.assert_allclose(
            getattr(together, name)[:64], getattr(alone, name), atol=1e-13, err_msg=name
        )
    np.testing.assert_allclose(together.tangent.stress_grad_u[:64], alone.tangent.stress_grad_u, atol=1e-12)


def test_what_is_missing_is_told():
    data = porous_training_set(30, 1)
    with pytest.raises(DataError, match="undeformed members"):
        PolynomialSurrogate().fit(replace(data, rests=None), seed=0)
    surrogate = PolynomialSurrogate(degree=3).fit(data, seed=0)
    with pytest.raises(ConfigurationError, match="radius, poisson_ratio"):
        surrogate.predict(MacroState.zeros(2))
    plain = PolynomialSurrogate(degree=3)
    with pytest.raises(ConfigurationError, match="no derivatives by parameters"):
        plain.fit(_without_parameters(), seed=0).slopes(MacroState.zeros(1))


def _without_parameters():
    from porocore.testing.synthetic.potential_cell import potential_training_set

    return potential_training_set(12, seed=1)


def test_the_estimate_of_one_member_or_few_is_that_of_all_together():
    """Its polynomials are bound to the members where these are few."""
    surrogate = PolynomialSurrogate(degree=4).fit(porous_training_set(30, 1, tolerance=0.01), seed=0)
    model = surrogate.fitted
    plain = replace(model, estimate=replace(model.estimate, coordinates=0))
    assert model.estimate.coordinates == 2
    states = porous_training_set(90, 5).states
    for theta in (states.parameters[0], states.parameters[np.arange(90) % 3], states.parameters):
        asked = states.with_parameters(theta)
        np.testing.assert_allclose(model.error(asked), plain.error(asked), rtol=1e-9)
        flags = [each.predict(asked, tangent=False).flagged for each in (model, plain)]
        np.testing.assert_array_equal(*flags)


@pytest.mark.parametrize("inputs", [INPUTS, ALL], ids=["learned", "all"])
def test_flags_of_the_conductivity_of_a_family_follow_its_error(inputs):
    """It had no estimate of its error, other than that of a cell without parameters."""
    tolerance, n = 1e-3, 30 if inputs is INPUTS else 40
    data = porous_training_set(n, 1, inputs, tolerance=tolerance)
    model = PolynomialSurrogate().fit(data, seed=0).conductivity
    random, (low, high) = np.random.default_rng(3), (np.array(inputs.lower), np.array(inputs.upper))
    states = inputs.scatter(low + (high - low) * random.random((400, len(inputs))))
    wrong = logarithm(model.predict(states, tangent=False)[0]) - logarithm(
        respond(states, inputs.parameters).conductivity
    )
    error = np.abs(wrong).reshape(400, -1).max(axis=1) / model.estimate.spread.max()
    flagged, beyond = (model.doubt(states) != 0), error > tolerance
    assert beyond.sum() >= 4
    assert flagged[beyond].all()
    assert flagged[~beyond].mean() <= 0.02
    np.testing.assert_array_equal(flagged, ~(model.error(states) <= tolerance))
