"""Parameters that evolve: closed forms, homeostasis, exact derivatives, ranges, stiff rates, rates of zero."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.errors import ConfigurationError
from porocore.interfaces.law import Interval, MemoryChanges, PointChanges
from porocore.macro.laws.closure import make_closure
from porocore.macro.laws.composed import RegionLaw, TurnedLaw
from porocore.macro.laws.evolution import EvolvingLaw
from porocore.macro.laws.macro_law import ClosedLaw, Law
from porocore.macro.laws.rates import NAMED_RATES, Rate
from porocore.states import BodyPlace, Doubt, MacroState
from porocore.testing.expect import STEPS, central_difference
from porocore.testing.synthetic.porous_family import PorousFamilyLaw

CELL = ("radius", "poisson_ratio", "swelling", "modulus", "viscosity")
AT_REST = (0.22, 0.3, 1.0, 1.0, 1.0)
RANGES = {"radius": (0.1, 0.3), "poisson_ratio": (0.0, 0.49), "swelling": (0.8, 1.4)}


def cells() -> ClosedLaw:
    return ClosedLaw(PorousFamilyLaw(*CELL), make_closure("potential", 0.6, NeoHookean(), np.eye(3)))


def evolving(**formulas: str) -> EvolvingLaw:
    """Law in which parameters follow formulas with the constants a, b and c."""
    rates = {name: Rate(text, CELL, [c for c in "abc" if f"{c}*" in text]) for name, text in formulas.items()}
    return EvolvingLaw(cells(), rates, RANGES)


def states(law, constants, n=4, seed=1, size=0.05) -> MacroState:
    """States at random around the parameters ``AT_REST``, with the same constants at all."""
    rng = np.random.default_rng(seed)
    theta = np.tile([*AT_REST, *constants], (n, 1))
    theta[:, 0] += 0.02 * rng.random(n)
    assert theta.shape[1] == len(law.parameters)
    return MacroState(size * rng.standard_normal((n, 3, 3)), 0.05 * rng.random(n), theta)


def gradients(n=4, seed=2):
    return 20 * np.random.default_rng(seed).standard_normal((n, 3))


def course(law, at, times, grad_p=None):
    """Evolved parameters (steps, n, e) and the last response of states that stand still."""
    grad_p = np.zeros((len(at), 3)) if grad_p is None else grad_p
    memory, found = law.initial_at(at), []
    for begin, end in itertools.pairwise(times):
        response = law.respond(at, grad_p, memory, step=Interval(begin, end))
        memory = response.memory
        found.append(memory.internal)
    return np.array(found), response


@pytest.mark.parametrize(
    ("rate", "constants", "exact"),
    [
        ("-a*radius", [0.4], lambda y, t: y * np.exp(-0.4 * t)),
        (
            "a*radius*(1 - radius/0.28)",
            [1.5],
            lambda y, t: 0.28 / (1 + (0.28 / y - 1) * np.exp(-1.5 * t)),
        ),
        ("(0.25 - radius)/0.7", [], lambda y, t: 0.25 + (y - 0.25) * np.exp(-t / 0.7)),
    ],
)
def test_ordinary_differential_equations_to_first_order(rate, constants, exact):
    law = evolving(radius=rate)
    at = states(law, constants, n=1)
    y = at.parameters[0, 0]
    errors = []
    for steps in (50, 100, 200):
        times = np.linspace(0, 1, steps + 1)
        errors.append(np.abs(course(law, at, times)[0][:, 0, 0] - exact(y, times[1:])).max())
    assert errors[-1] < 2e-3 * y
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 2, rtol=0.02)


def test_a_linear_rate_by_the_formula_of_the_scheme():
    law = evolving(radius="-a*radius")
    at = states(law, [0.3])
    found, _ = course(law, at, [0.0, 0.5, 0.8])
    np.testing.assert_allclose(found[1, :, 0], at.parameters[:, 0] / 1.15 / 1.09, rtol=1e-13)


def test_a_rate_knows_the_time_at_the_end_of_the_step_and_the_other_parameters():
    law = evolving(radius="a*t*poisson_ratio", poisson_ratio="b*1")
    at = states(law, [0.01, 0.1])
    found, _ = course(law, at, [1.0, 1.5, 2.0])
    np.testing.assert_allclose(found[:, :, 1], np.tile([[0.35], [0.4]], (1, 4)), rtol=1e-13)
    moved = 0.01 * 0.5 * (1.5 * 0.35 + 2 * 0.4)
    np.testing.assert_allclose(found[1, :, 0], at.parameters[:, 0] + moved, rtol=1e-13)


def test_growth_at_fixed_strain_reaches_its_stress():
    growth = NAMED_RATES["growth"].of("swelling", CELL)
    law = EvolvingLaw(cells(), {"swelling": growth}, RANGES)
    at = states(law, [2.0, -0.01], n=3)
    swelling, response = course(law, at, np.linspace(0, 300, 101))
    F = np.eye(3) + at.grad_u
    sigma = np.einsum("nij,nij->n", response.stress, F) / (3 * np.linalg.det(F)) + at.p
    np.testing.assert_allclose(sigma, -0.01, atol=1e-6 * 0.01)
    assert (np.abs(swelling[-1] - 1) > 1e-3).all()
    assert not response.flagged.any()


#: Rates of two parameters that hang on one another, on the state and on the flux.
COUPLED = {
    "swelling": "a*(mean_stress - b*0.1) + c*(J - 1)*p*radius*t",
    "radius": "-a*flux*(radius - 0.1) + b*von_mises*swelling*phi + c*energy",
}
CONSTANTS = [0.3, 0.2, 0.5, 0.4, 0.1, 0.7]
STEP = Interval(0.3, 0.7)


@pytest.fixture(scope="module")
def coupled():
    """Law, states, ∇p, and a memory in which the parameters have moved."""
    law = evolving(**COUPLED)
    at, grad_p = states(law, CONSTANTS), gradients()
    memory = law.initial_at(at)
    before = law.respond(replace(at, grad_u=0.7 * at.grad_u), 0.5 * grad_p, memory, step=Interval(0, 0.3))
    return law, at, grad_p, before.memory


def numbers(response):
    """Stress, storage, flux and internal variables of n points side by side."""
    n = len(response.storage)
    parts = [
        response.stress.reshape(n, 9),
        response.storage[:, None],
        response.flux,
        response.memory.internal,
    ]
    return np.concatenate(parts, axis=1)


def rows(changes):
    n, k = changes.storage.shape
    parts = [changes.stress.reshape(n, 9, k), changes.storage[:, None], changes.flux, changes.internal]
    return np.concatenate(parts, axis=1)


def unknowns(law, n, k):
    return PointChanges(np.zeros((n, k)), np.zeros((n, k)), np.zeros((n, len(law.parameters), k)))


def test_the_tangent_is_exact(coupled):
    law, at, grad_p, memory = coupled
    n = len(at)
    found = law.respond(at, grad_p, memory, step=STEP)
    t = found.tangent
    _, changes = law.respond_to_changes(
        at, grad_p, memory, unknowns(law, n, 1), MemoryChanges.zeros(n, law.memory_size, 1), step=STEP
    )
    by_H = [
        t.stress_grad_u.reshape(n, 9, 9),
        t.storage_grad_u.reshape(n, 1, 9),
        t.flux_grad_u.reshape(n, 3, 9),
    ]
    by_H = np.concatenate([*by_H, changes.internal_grad_u.reshape(n, 2, 9)], axis=1)
    by_p = np.concatenate(
        [t.stress_p.reshape(n, 9), t.storage_p[:, None], t.flux_p, changes.internal_p], axis=1
    )
    by_grad_p = [t.stress_grad_p.reshape(n, 9, 3), t.storage_grad_p[:, None], t.flux_grad_p]
    by_grad_p = np.concatenate([*by_grad_p, changes.internal_grad_p], axis=1)
    exact = np.concatenate([by_H, by_p[:, :, None], by_grad_p], axis=2)

    def moved(column, h):
        flat = np.concatenate([at.grad_u.reshape(n, 9), at.p[:, None], grad_p], axis=1)
        flat[:, column] += h
        there = replace(at, grad_u=flat[:, :9].reshape(n, 3, 3), p=flat[:, 9])
        return numbers(law.respond(there, flat[:, 10:], memory, step=STEP, tangent=False))

    for column in range(13):
        by = central_difference((moved(column, 1e-4 * step) for step in STEPS), 1e-4)
        np.testing.assert_allclose(exact[:, :, column], by, rtol=1e-7, atol=2e-9 * np.abs(exact).max())
    assert np.abs(t.stress_grad_p).max() > 1e-5


@pytest.mark.parametrize("step", [STEP, Interval(0.3, 0.3)])
def test_derivatives_by_parameters_constants_and_memory_are_exact(coupled, step):
    law, at, grad_p, memory = coupled
    n, m, v = len(at), len(law.parameters), law.memory_size
    k = m + 1 + v
    changes, before = unknowns(law, n, k), MemoryChanges.zeros(n, v, k)
    changes.parameters[:, np.arange(m), np.arange(m)] = 1
    before.fluid_volume[:, m] = 1
    before.internal[:, np.arange(v), m + 1 + np.arange(v)] = 1
    response, found = law.respond_to_changes(at, grad_p, memory, changes, before, step=step)
    np.testing.assert_allclose(
        numbers(response), numbers(law.respond(at, grad_p, memory, step=step)), rtol=1e-12
    )
    exact = rows(found)

    def moved(j, h):
        there, old = at.parameters.copy(), memory
        if j < m:
            there[:, j] += h
        elif j == m:
            old = replace(memory, fluid_volume=memory.fluid_volume + h)
        else:
            internal = memory.internal.copy()
            internal[:, j - m - 1] += h
            old = replace(memory, internal=internal)
        return numbers(law.respond(replace(at, parameters=there), grad_p, old, step=step, tangent=False))

    for j in range(k):
        by = central_difference((moved(j, 1e-4 * each) for each in STEPS), 1e-4)
        np.testing.assert_allclose(
            exact[:, :, j], by, rtol=1e-6, atol=1e-8 * np.abs(exact).max(), err_msg=f"unknown {j}"
        )
    if step.length:
        assert np.abs(exact[:, :9, len(CELL) : m]).max(axis=(0, 1)).min() > 1e-6


def test_changes_of_modulus_and_viscosity_are_those_of_the_parameters_of_this_name(coupled):
    law, at, grad_p, memory = coupled
    n, v = len(at), law.memory_size
    changes = unknowns(law, n, 4)
    changes.modulus[:, 0] = changes.viscosity[:, 1] = 1
    changes.parameters[:, CELL.index("modulus"), 2] = changes.parameters[:, CELL.index("viscosity"), 3] = 1
    _, found = law.respond_to_changes(at, grad_p, memory, changes, MemoryChanges.zeros(n, v, 4), step=STEP)
    exact = rows(found)
    np.testing.assert_allclose(exact[..., :2], exact[..., 2:], rtol=1e-9, atol=1e-12)


def test_without_a_step_the_parameters_are_the_initial_ones_and_so_are_derivatives(coupled):
    law, at, grad_p, _ = coupled
    n, m = len(at), len(CELL)
    changes = unknowns(law, n, len(law.parameters))
    changes.parameters[:] = np.eye(len(law.parameters))
    before = MemoryChanges.zeros(n, law.memory_size, len(law.parameters))
    response, found = law.respond_to_changes(at, grad_p, law.initial_at(at), changes, before)
    inner = cells()
    bare = at.with_parameters(at.parameters[:, :m])
    plain = PointChanges(changes.modulus[:, :m], changes.viscosity[:, :m], changes.parameters[:, :m, :m])
    expected, by = inner.respond_to_changes(
        bare, grad_p, inner.initial_at(bare), plain, MemoryChanges.zeros(n, 0, m)
    )
    np.testing.assert_array_equal(response.stress, expected.stress)
    np.testing.assert_allclose(rows(found)[:, :13, :m], rows(by), rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(rows(found)[:, :, m:], 0)
    np.testing.assert_array_equal(found.internal[:, 0, :m], np.tile(np.eye(m)[2], (n, 1)))


def test_derivatives_follow_several_steps_from_the_initial_value(coupled):
    law, at, grad_p, _ = coupled
    n, v, columns = len(at), law.memory_size, [0, 2, 5, 7]
    times = [0.0, 0.2, 0.5, 0.6]

    def course_of(theta):
        there = replace(at, parameters=theta)
        return numbers(course(law, there, times, grad_p)[1])

    changes = unknowns(law, n, len(columns))
    changes.parameters[:, columns, np.arange(len(columns))] = 1
    still = [np.zeros((n, *shape, len(columns))) for shape in ((3, 3), (), (3,))]
    memory = law.initial_at(at)
    first, fixed = law.respond_to_changes(
        at.at_rest(), 0 * grad_p, memory, changes, MemoryChanges.zeros(n, v, len(columns))
    )
    _, before = fixed.moved(first.tangent, MemoryChanges.zeros(n, v, len(columns)), *still)
    for begin, end in itertools.pairwise(times):
        response, fixed = law.respond_to_changes(
            at, grad_p, memory, changes, before, step=Interval(begin, end)
        )
        _, before = fixed.moved(response.tangent, before, *still)
        memory = response.memory
    for j, column in enumerate(columns):
        unit = np.eye(at.parameters.shape[1])[column]
        by = central_difference((course_of(at.parameters + 1e-4 * s * unit) for s in STEPS), 1e-4)
        np.testing.assert_allclose(rows(fixed)[:, :, j], by, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("formula", ["-a*radius", "-a*flux*radius + a*mean_stress"])
def test_a_rate_of_zero_changes_nothing(formula):
    law, inner = evolving(radius=formula), cells()
    at, grad_p = states(law, [0.0]), gradients()
    bare = at.with_parameters(at.parameters[:, : len(CELL)])
    found = law.respond(at, grad_p, law.initial_at(at), step=Interval(0, 1e6))
    expected = inner.respond(bare, grad_p, inner.initial_at(bare))
    for name in ("stress", "storage", "flux", "deformation", "volume_ratio", "doubt"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    for name, slope in vars(expected.tangent).items():
        other = getattr(found.tangent, name)
        if slope is None:
            assert other is None or not other.any()
        else:
            np.testing.assert_array_equal(other, slope)
    np.testing.assert_array_equal(found.memory.internal[:, 0], at.parameters[:, 0])


@pytest.mark.parametrize("formula", ["a*1", "a*(2 + mean_stress + flux)"])
@pytest.mark.parametrize(("sign", "end"), [(1, 0.3), (-1, 0.1)])
def test_a_parameter_stays_at_the_end_of_its_range(formula, sign, end):
    law = evolving(radius=formula)
    at, grad_p = states(law, [sign * 10.0]), gradients()
    memory = law.initial_at(at)
    for begin in (0.0, 1.0):
        found = law.respond(at, grad_p, memory, step=Interval(begin, begin + 1))
        memory = found.memory
        np.testing.assert_array_equal(memory.internal, end)
        np.testing.assert_array_equal(found.doubt, int(Doubt.outside))
    n, k = len(at), len(law.parameters)
    changes = unknowns(law, n, k)
    changes.parameters[:] = np.eye(k)
    _, by = law.respond_to_changes(
        at, grad_p, memory, changes, MemoryChanges.zeros(n, 1, k), step=Interval(2, 3)
    )
    for slope in (by.internal, by.internal_grad_u, by.internal_p):
        np.testing.assert_array_equal(slope, 0)
    np.testing.assert_array_equal(by.stress[..., len(CELL) :], 0)
    bare, inner = at.with_parameters(at.parameters[:, : len(CELL)]), cells()
    bare.parameters[:, 0] = end
    expected = inner.respond(bare, grad_p, inner.initial_at(bare)).tangent
    np.testing.assert_array_equal(found.tangent.stress_grad_u, expected.stress_grad_u)


def test_a_parameter_leaves_the_end_when_its_rate_turns():
    law = evolving(radius="a*(2 - t)")
    at = states(law, [0.1])
    found, response = course(law, at, [0.0, 1.0, 1.9, 2.5])
    np.testing.assert_array_equal(found[1], 0.3)
    np.testing.assert_allclose(found[2], 0.3 - 0.6 * 0.05, rtol=1e-12)
    assert not response.flagged.any()


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("-a*(radius - 0.17)", 0.17),
        ("-a*(radius - 0.17)**3", 0.17),
        ("-a*tanh(1e4*(radius - 0.17))", 0.17),
        ("-a*(exp(300*(radius - 0.17)) - 1)", 0.17),
        ("a*(radius - 0.11)*(0.24 - radius)", 0.24),
        ("-a*sqrt(abs(radius - 0.17))*(radius - 0.17)", 0.17),
    ],
)
def test_stiff_rates_settle(formula, expected):
    law = evolving(radius=formula)
    at = states(law, [1e9])
    found = law.respond(at, gradients(), law.initial_at(at), step=Interval(0, 1))
    np.testing.assert_allclose(found.memory.internal, expected, atol=1e-3 if "**3" in formula else 1e-5)
    assert np.isfinite(found.stress).all()


def test_stiff_growth_and_a_stiff_partner_settle():
    law = evolving(swelling="a*(mean_stress + 0.01)", radius="-b*(radius - 0.2*swelling)")
    at, grad_p = states(law, [1e7, 1e8], n=100), gradients(100)
    at.parameters[:, 0] = np.random.default_rng(6).uniform(0.11, 0.29, 100)
    found = law.respond(at, grad_p, law.initial_at(at), step=Interval(0, 1))
    swelling, radius = found.memory.internal.T
    np.testing.assert_allclose(radius, 0.2 * swelling, rtol=1e-8)
    F = np.eye(3) + at.grad_u
    mean = np.einsum("nij,nij->n", found.stress, F) / (3 * np.linalg.det(F)) + at.p
    np.testing.assert_allclose(mean, -0.01, atol=1e-7)


def test_a_rate_without_a_value_has_no_response():
    law = evolving(radius="a*log(p - 1)")
    at = states(law, [1.0])
    found = law.respond(at, gradients(), law.initial_at(at), step=Interval(0, 1))
    assert np.isnan(found.stress).all()


def test_a_point_without_an_answer_leaves_the_others_as_they_are():
    law = evolving(radius="-a*mean_stress*flux")
    at, grad_p = states(law, [0.5]), gradients()
    at.grad_u[1] = np.diag([-2.0, 0.0, 0.0])
    found = law.respond(at, grad_p, law.initial_at(at), step=Interval(0, 1))
    assert np.isnan(found.stress[1]).all()
    others = np.array([0, 2, 3])
    alone = law.respond(at[others], grad_p[others], law.initial_at(at[others]), step=Interval(0, 1))
    np.testing.assert_allclose(numbers(found)[others], numbers(alone), rtol=1e-13)


def test_each_gradient_has_its_own_parameters():
    law = evolving(radius="-a*flux*radius")
    at, grad_p = states(law, [0.5]), gradients()
    memory = law.initial_at(at)
    still, flowing = law.respond_to_each(at, [0 * grad_p, grad_p], memory, step=Interval(0, 1))
    np.testing.assert_array_equal(still.memory.internal, memory.internal)
    assert (flowing.memory.internal < memory.internal).all()
    alone = law.respond(at, grad_p, memory, step=Interval(0, 1))
    np.testing.assert_array_equal(alone.stress, flowing.stress)


def test_axes_and_regions_see_the_same_evolution():
    law = evolving(**COUPLED)
    at, grad_p = states(law, CONSTANTS), gradients()
    R = np.linalg.qr(np.random.default_rng(3).standard_normal((4, 3, 3)))[0]
    R *= np.sign(np.linalg.det(R))[:, None, None]
    turned = replace(at, grad_u=R @ at.grad_u @ R.swapaxes(1, 2), place=BodyPlace(np.array([0, 1, 1, 0]), R))
    flow = (R @ grad_p[:, :, None])[..., 0]
    other = TurnedLaw(RegionLaw([law, evolving(**COUPLED)]))
    expected = law.respond(at, grad_p, law.initial_at(at), step=STEP)
    found = other.respond(turned, flow, other.initial_at(turned), step=STEP)
    np.testing.assert_allclose(found.memory.internal, expected.memory.internal, rtol=1e-12)
    np.testing.assert_allclose(found.stress, R @ expected.stress @ R.swapaxes(1, 2), atol=1e-13)
    by = np.einsum("nia,njb,nkc,nabc->nijk", R, R, R, expected.tangent.stress_grad_p)
    np.testing.assert_allclose(found.tangent.stress_grad_p, by, atol=1e-13)


def test_a_region_without_evolution_stays_as_it_is():
    law, plain = evolving(swelling="a*mean_stress"), cells()
    at = states(law, [1.0])
    at = replace(at, place=BodyPlace(np.array([0, 1, 1, 0])))
    both = RegionLaw([plain, law])
    found = both.respond(at, gradients(), both.initial_at(at), step=STEP)
    bare = at.with_parameters(at.parameters[:, : len(CELL)])
    expected = plain.respond(bare, gradients(), plain.initial_at(bare))
    np.testing.assert_array_equal(found.stress[[0, 3]], expected.stress[[0, 3]])
    assert (found.memory.internal[[1, 2], 0] != 1).all()


def test_the_place_of_a_point_is_known_in_a_rate():
    law = evolving(radius="a*(x - 2*z)")
    at = states(law, [0.01])
    X = np.random.default_rng(5).random((4, 3))
    at = replace(at, place=BodyPlace(np.zeros(4, int), None, X))
    found, _ = course(law, at, [0.0, 2.0])
    np.testing.assert_allclose(
        found[0, :, 0], at.parameters[:, 0] + 0.02 * (X[:, 0] - 2 * X[:, 2]), rtol=1e-13
    )


def test_the_mean_gradient_closure_takes_rates_of_time_alone():
    """Of a porosity that changes within the step it has no derivatives, which a rate that follows the state needs."""
    closed = ClosedLaw(PorousFamilyLaw(*CELL), make_closure("mean-gradient", 0.6, NeoHookean(), np.eye(3)))
    free = EvolvingLaw(closed, {"radius": Rate("-a*radius", CELL, ["a"])}, RANGES)
    at, grad_p = states(free, [0.1]), gradients()
    found = free.respond(at, grad_p, free.initial_at(at), step=Interval(0, 1))
    bare = at.with_parameters(at.parameters[:, : len(CELL)])
    later = bare.with_parameters(np.column_stack([found.memory.internal[:, 9], bare.parameters[:, 1:]]))
    expected = closed.respond(later, grad_p, closed.initial_at(bare))
    np.testing.assert_array_equal(found.storage, expected.storage)
    np.testing.assert_array_equal(found.memory.internal[:, :9], expected.memory.internal)
    follows = EvolvingLaw(closed, {"radius": Rate("-a*flux", CELL, ["a"])}, RANGES)
    with pytest.raises(ConfigurationError, match="choose closure: potential"):
        follows.respond(at, grad_p, follows.initial_at(at), step=Interval(0, 1))


def test_a_rate_that_follows_an_energy_needs_a_law_with_a_potential():
    closed = ClosedLaw(PorousFamilyLaw(*CELL), make_closure("mean-gradient", 0.6, NeoHookean(), np.eye(3)))
    law = EvolvingLaw(closed, {"radius": Rate("-a*energy", CELL, ["a"])}, RANGES)
    at = states(law, [0.1])
    with pytest.raises(ConfigurationError, match=r"follows the energy.*choose closure: potential"):
        law.respond(at, gradients(), law.initial_at(at), step=Interval(0, 1))


def test_the_law_of_a_point_evolves_without_a_flux():
    law = evolving(radius="-a*flux*radius + a*0.01")
    at = states(law, [0.5])
    found = Law(law, 0.4).response(at.grad_u, at.p, parameters=at.parameters, times=(0.0, 2.0))
    np.testing.assert_allclose(found.memory.internal[:, 0], at.parameters[:, 0] + 0.01, rtol=1e-12)
    expected = law.respond(at, np.zeros((4, 3)), law.initial_at(at), step=Interval(0, 2))
    np.testing.assert_array_equal(found.tangent.stress_grad_u, expected.tangent.stress_grad_u)


@pytest.mark.parametrize(
    ("rates", "words"),
    [
        ({}, "at least one"),
        ({"window": Rate("1", CELL)}, "no such parameter"),
        ({"radius": Rate("1", ["radius"])}, "for the parameters"),
        ({"viscosity": Rate("1", CELL)}, "expected a range"),
    ],
)
def test_rates_that_do_not_belong_to_the_law_are_refused(rates, words):
    with pytest.raises(ConfigurationError, match=words):
        EvolvingLaw(cells(), rates, RANGES)


def test_another_rate_is_another_law():
    identities = {evolving(radius=text).identity for text in ("a*1", "a*2", "b*1")} | {cells().identity}
    assert len(identities) == 4
