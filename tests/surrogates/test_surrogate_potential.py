"""W(ln U, p) as a sum of parts: its identities and derivatives with each of them."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.core.tensors import CUBIC, TRIVIAL
from porocore.errors import DataError
from porocore.states import CellTangent, MacroState, Status
from porocore.surrogates.model import PotentialModel
from porocore.surrogates.network.network import Network
from porocore.surrogates.network.separable import SeparableNetwork
from porocore.surrogates.polynomial.fit import fit_mean_grad, polynomial_model, sampled_range
from porocore.surrogates.polynomial.monomials import invariant, plain
from porocore.surrogates.potential import PotentialData, variables
from porocore.surrogates.stretch import LogStretch
from porocore.surrogates.training_box import TrainingBox
from porocore.testing.synthetic.cell import synthetic_training_set
from porocore.testing.synthetic.potential_cell import (
    IDENTITY,
    SOLID_FRACTION,
    potential_training_set,
    respond,
)
from tests.helpers.cube_symmetry import cube_group

SEVEN = (0, 1, 2, 3, 4, 5, 6)


def random_network(inputs, activation="softplus", seed=0):
    random, widths = np.random.default_rng(seed), [inputs, 6, 5, 1]
    pairs = list(zip(widths[1:], widths, strict=False))
    first, second, last = (random.normal(size=pair) for pair in pairs)
    return Network(
        activation,
        (5 * first, second, 0.02 * last),
        tuple(random.normal(size=width) for width, _ in pairs),
    )


def part(terms, seed=0, activation="softplus"):
    """Weights at random: identities hold whatever a training found."""
    return SeparableNetwork(random_network(len(terms.weights), activation, seed), terms)


def models():
    training = potential_training_set(40, seed=1)
    with_polynomial = polynomial_model(training)[0]
    # Wherever these tests go; what happens beyond the sampled states has tests of its own.
    with_polynomial = replace(
        with_polynomial, training_box=TrainingBox(SEVEN, np.full(7, -1.0), np.full(7, 1.0))
    )
    nothing = {"coarse": None, "fine": None}
    alone = replace(with_polynomial, **nothing, network=part(invariant(CUBIC)))
    two = polynomial_model(synthetic_training_set(60, seed=1))[0]
    two = replace(two, training_box=TrainingBox((1, 6), np.full(2, -1.0), np.full(2, 1.0)))
    return {
        "polynomial": with_polynomial,
        "network": alone,
        "network of tanh": replace(alone, network=part(invariant(CUBIC), 3, "tanh")),
        "network in plain variables": replace(alone, network=part(plain(SEVEN))),
        "network on polynomial": replace(with_polynomial, network=part(invariant(CUBIC), 7, "sigmoid")),
        "two inputs": two,
        "network of two inputs": replace(two, **nothing, network=part(plain((1, 6)))),
    }


MODELS = models()


@pytest.fixture(params=MODELS)
def model(request):
    return MODELS[request.param]


def states(n=30, seed=0):
    random = np.random.default_rng(seed)
    return MacroState(random.uniform(-0.12, 0.12, (n, 3, 3)), random.uniform(-0.02, 0.2, n))


def diagonal_states(n=30, seed=0):
    random = np.random.default_rng(seed)
    return MacroState(random.uniform(-0.3, 0.1, (n, 1, 3)) * np.eye(3), random.uniform(-0.02, 0.2, n))


def column_states(n=30, seed=0):
    """Only H22 and p, so that two stretches are exactly one."""
    found = diagonal_states(n, seed)
    found.grad_u[:, [0, 2], [0, 2]] = 0.0
    return found


def test_rest(model):
    at_rest = model.predict(MacroState.zeros(1), tangent=True)
    assert abs(at_rest.potential[0]) < 1e-12
    assert np.abs(at_rest.stress).max() < 1e-12
    assert np.abs(at_rest.mean_grad).max() < 1e-12
    assert abs(at_rest.fluid_volume[0] - model.rest.values.porosity[0]) < 1e-12


def test_second_order_at_rest_is_the_cells(model):
    """Whatever the other parts are, they begin at third order."""
    at_rest = model.predict(MacroState.zeros(1), tangent=True).tangent
    y, matrix = np.zeros((7, 1)), model.rest.values.matrix[:, :, 0]
    np.testing.assert_allclose(model.potential(y)[2][:, :, 0], matrix, rtol=0, atol=1e-12)
    assert abs(at_rest.fluid_volume_p[0] + matrix[6, 6]) < 1e-12
    np.testing.assert_allclose(at_rest.stress_grad_u[0, 1, 1, 1, 1], matrix[1, 1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("make", [states, diagonal_states, column_states])
def test_reciprocity_and_symmetry(model, make):
    tangent = model.predict(make(), tangent=True).tangent
    assert np.abs(tangent.stress_p + tangent.fluid_volume_grad_u).max() < 1e-12
    A = tangent.stress_grad_u
    assert np.abs(A - A.transpose(0, 3, 4, 1, 2)).max() < 1e-12


def test_objectivity(model):
    at = states()
    Q, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(30, 3, 3)))
    R = Q * np.linalg.det(Q)[:, None, None]
    turned = MacroState(R @ (np.eye(3) + at.grad_u) - np.eye(3), at.p)
    before, after = model.predict(at, tangent=False), model.predict(turned, tangent=False)
    np.testing.assert_allclose(after.potential, before.potential, rtol=0, atol=1e-12)
    np.testing.assert_allclose(after.fluid_volume, before.fluid_volume, rtol=0, atol=1e-12)
    np.testing.assert_allclose(after.stress, R @ before.stress, rtol=0, atol=1e-12)
    np.testing.assert_allclose(after.mean_grad, R @ before.mean_grad, rtol=0, atol=1e-12)


@pytest.mark.parametrize("make", [states, diagonal_states, column_states])
def test_derivatives_are_the_slopes(model, make):
    """P_E and φ of W, and all tangents, in all ten directions; the diagonal states leave the short way for it."""
    at = make(8)
    response = model.predict(at, tangent=True)
    t = response.tangent
    slopes = {
        "potential": (response.stress, -response.fluid_volume),
        "stress": (t.stress_grad_u, t.stress_p),
        "fluid_volume": (t.fluid_volume_grad_u, t.fluid_volume_p),
        "mean_grad": (t.mean_grad_grad_u, t.mean_grad_p),
    }
    h = 2e-4
    for place in range(10):
        direction, dp = np.zeros((3, 3)), float(place == 9)
        if place < 9:
            direction[place // 3, place % 3] = 1.0
        moved = [
            model.predict(MacroState(at.grad_u + k * h * direction, at.p + k * h * dp), tangent=False)
            for k in (-2, -1, 1, 2)
        ]
        for name, (by_H, by_p) in slopes.items():
            m2, m1, p1, p2 = (getattr(response, name) for response in moved)
            expected = (m2 - 8 * m1 + 8 * p1 - p2) / (12 * h)
            found = by_p if place == 9 else by_H[..., place // 3, place % 3]
            np.testing.assert_allclose(found, expected, atol=2e-8, err_msg=f"{name} {place}")


def test_without_tangent_the_values_are_the_same(model):
    with_it, without = (model.predict(states(), tangent=tangent) for tangent in (True, False))
    assert without.tangent is None
    for name in ("potential", "stress", "fluid_volume", "mean_grad"):
        np.testing.assert_allclose(getattr(without, name), getattr(with_it, name), rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", ["polynomial", "network", "network on polynomial"])
def test_the_symmetry_of_the_cube(name):
    """P_E(QHQᵀ) = Q P_E(H) Qᵀ for the 24 rotations of the cube, with any weights."""
    at, model = states(10), MODELS[name]
    before = model.predict(at, tangent=False)
    for Q in cube_rotations():
        turned = model.predict(MacroState(Q @ at.grad_u @ Q.T, at.p), tangent=False)
        np.testing.assert_allclose(turned.potential, before.potential, rtol=0, atol=1e-13)
        np.testing.assert_allclose(turned.stress, Q @ before.stress @ Q.T, rtol=0, atol=1e-12)


def test_a_network_in_plain_variables_has_no_such_symmetry():
    y = np.random.default_rng(1).uniform(-0.1, 0.1, (7, 5))
    group, model = cube_group(SEVEN), MODELS["network in plain variables"]
    values = [model.potential(g @ y)[0] for g in group]
    assert np.ptp(values, axis=0).max() > 1e-6


def cube_rotations():
    for first in np.concatenate([np.eye(3), -np.eye(3)]):
        for second in np.concatenate([np.eye(3), -np.eye(3)]):
            if first @ second == 0:
                yield np.array([first, second, np.cross(first, second)])


def test_a_closed_cycle_does_no_work(model):
    random = np.random.default_rng(5)
    (H0, H1, H2), angle = random.uniform(-0.05, 0.05, (3, 3, 3)), 2 * np.pi * np.arange(300) / 300
    cos, sin = np.cos(angle), np.sin(angle)
    loop = MacroState(H0 + cos[:, None, None] * H1 + sin[:, None, None] * H2, 0.1 + 0.05 * sin)
    response = model.predict(loop, tangent=False)
    dH, dp = cos[:, None, None] * H2 - sin[:, None, None] * H1, 0.05 * cos
    power = np.einsum("nij,nij->n", response.stress, dH) - response.fluid_volume * dp
    assert np.abs(power).mean() > 1e-4
    assert abs(power.sum() * 2 * np.pi / 300) < 1e-10


# ---- data ---------------------------------------------------------------------------------------


def test_data_say_what_the_cell_says():
    """The gradient by (L, p), pulled from stress and fluid volume, is the slope of W between states."""
    training = potential_training_set(30, seed=4)
    data = PotentialData.from_training_set(training)
    assert data.active == SEVEN
    assert data.rest.symmetry == CUBIC
    assert data.rest.values.porosity[0] == pytest.approx(1 - SOLID_FRACTION, abs=1e-15)
    np.testing.assert_array_equal(data.value, training.responses.potential)
    h = 1e-4
    for place in range(9):
        direction = np.zeros((3, 3))
        direction[place // 3, place % 3] = h
        ahead, behind = (
            PotentialData.from_training_set(
                replace(
                    training,
                    states=(
                        moved := MacroState(training.states.grad_u + sign * direction, training.states.p)
                    ),
                    responses=respond(moved),
                )
            )
            for sign in (1, -1)
        )
        by_W = (ahead.value - behind.value) / (2 * h)
        by_L = (data.gradient * (ahead.y - behind.y) / (2 * h)).sum(axis=0)
        np.testing.assert_allclose(by_L, by_W, atol=1e-7)
        by_m = (ahead.mean_grad - behind.mean_grad) / (2 * h)
        by_y = np.einsum("oan,an->on", data.mean_grad_by_y, (ahead.y - behind.y) / (2 * h))
        np.testing.assert_allclose(by_y, by_m, atol=1e-7)


def test_the_expansion_at_rest_is_of_second_order():
    """What it leaves over shrinks with the cube of the load."""
    training = potential_training_set(20, seed=4)
    largest = []
    for load in (1e-1, 1e-2):
        small = MacroState(load * training.states.grad_u, load * training.states.p)
        data = PotentialData.from_training_set(replace(training, states=small, responses=respond(small)))
        largest.append(np.abs(data.remainder[0]).max())
    assert largest[0] / largest[1] == pytest.approx(1000, rel=0.1)


def test_unstable_states_are_left_out():
    training = potential_training_set(20, seed=4)
    training.responses.status[::2] = 1
    data = PotentialData.from_training_set(training)
    assert len(data) == 10
    np.testing.assert_array_equal(data.value, training.responses.potential[1::2])
    kept = sampled_range(training)
    assert not kept.outside(training.states[1::2]).any()


def test_states_in_contact_are_learned_from_and_lie_in_the_sampled_range():
    training = potential_training_set(20, seed=4)
    training.responses.status[::2] = int(Status.contact)
    assert len(PotentialData.from_training_set(training)) == 20
    assert not sampled_range(training).outside(training.states).any()


@pytest.mark.parametrize("name", ["potential", "stress", "fluid_volume", "tangent"])
def test_words_for_missing_responses(name):
    training = potential_training_set(20, seed=4)
    with pytest.raises(DataError, match=rf"learned from {name}, which these states lack; sample again"):
        PotentialData.from_training_set(
            replace(training, responses=replace(training.responses, **{name: None}))
        )


def test_words_for_a_reference_without_derivatives():
    training = potential_training_set(20, seed=4)
    bare = replace(training.reference, tangent=CellTangent())
    with pytest.raises(DataError, match="all derivatives of the undeformed cell; solve it with tangent=True"):
        PotentialData.from_training_set(replace(training, reference=bare))


def test_mean_grad_is_fitted_in_what_rotates_with_the_solid():
    training, unseen = potential_training_set(60, seed=4), potential_training_set(100, seed=5)
    data = PotentialData.from_training_set(training)
    training_box = TrainingBox.from_states(data.y, data.active, TRIVIAL)
    model = PotentialModel(
        data.rest, None, None, fit_mean_grad(data), data.active, sampled_range(training), training_box
    )
    error = model.predict(unseen.states, tangent=False).mean_grad - unseen.responses.mean_grad
    assert np.abs(error).max() < 2e-3 * np.ptp(unseen.responses.mean_grad)
    assert training.identity == IDENTITY


def beyond(training, factor):
    """States as far again beyond the sampled ones, in every direction."""
    return MacroState(factor * training.states.grad_u, factor * training.states.p)


@pytest.mark.parametrize("general", [False, True])
def test_beyond_the_sampled_states_the_fine_parts_rest_and_derivatives_stay_exact(general):
    training = potential_training_set(60, seed=4) if general else synthetic_training_set(60, seed=4)
    assert polynomial_model(training)[1].degree > 4 or not general
    model, _ = polynomial_model(training, degree=6)
    assert model.fine is not None
    states = beyond(training, 1.6)[:10]
    y = variables(LogStretch.from_gradient(states.grad_u), states.p)
    _, gradient, hessian = model.potential(y)
    assert len(model.training_box.beyond(y)) > 5
    h = 1e-5
    for a in model.active:
        step = np.zeros((7, 1))
        step[a] = h
        up, down = model.potential(y + step), model.potential(y - step)
        np.testing.assert_allclose((up[0] - down[0]) / (2 * h), gradient[a], atol=1e-7)
        np.testing.assert_allclose((up[1] - down[1]) / (2 * h), hessian[a], atol=1e-6)
    # Far out only W₂ and the coarse polynomial are left of the slopes.
    far = variables(LogStretch.from_gradient(0 * states.grad_u), 50 + states.p)
    bare = replace(model, fine=None)
    np.testing.assert_allclose(model.potential(far)[1][6], bare.potential(far)[1][6], rtol=1e-12)
    # Inside nothing changes: rest, and the states themselves.
    inside = variables(LogStretch.from_gradient(training.states.grad_u), training.states.p)
    assert not len(model.training_box.beyond(inside))
    np.testing.assert_array_equal(model.training_box.saturated(inside)[0], inside)
