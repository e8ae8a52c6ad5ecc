"""Laws of bodies of many cells: parameters at each point, regions, turned axes, their linear limits."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from porocore.errors import ConfigurationError
from porocore.interfaces.law import LawMemory, MacroResponse, MacroTangent
from porocore.macro.laws.composed import BoundLaw, RegionLaw, TurnedLaw
from porocore.macro.laws.linear import LinearisedLaw
from porocore.states import BodyPlace, MacroState
from porocore.testing.synthetic.cell import BoundCell, ParametricCell, parametric_law, porosity
from porocore.testing.synthetic.response import GradientLaw, linear_law

N = 6
INTEGRATED = ("stress", "storage", "flux")


def points(seed, law=None, axes=False, region=False):
    """States and gradients at points that all have other parameters; their regions are 0 and 1 in turn."""
    rng = np.random.default_rng(seed)
    theta = np.stack([rng.uniform(0.15, 0.3, N), rng.uniform(0.5, 2.0, N)], axis=1)
    turns = Rotation.random(N, rng=np.random.default_rng(7)).as_matrix() if axes else None
    place = BodyPlace(np.arange(N) % 2, turns) if axes or region else None
    H, p = 0.05 * rng.standard_normal((N, 3, 3)), 0.05 * rng.standard_normal(N)
    return MacroState(H, p, theta, place), rng.standard_normal((N, 3))


def laws():
    """Name to law, and whether its points have axes, or the parameter that is open."""
    return {
        "potential": (parametric_law(), False),
        "mean-gradient": (parametric_law(closure="mean-gradient"), False),
        "turned": (TurnedLaw(parametric_law()), True),
        "regions": (TurnedLaw(RegionLaw([parametric_law(), linear_law()])), True),
        "gradient": (TurnedLaw(RegionLaw([GradientLaw(parametric_law()), linear_law()])), True),
        "linearised": (LinearisedLaw(parametric_law()), False),
        "bound": (BoundLaw(RegionLaw([parametric_law(), linear_law()]), {"radius": 0.2}), "stiffness"),
    }


@pytest.mark.parametrize("name", laws())
def test_the_tangent_is_the_slope_from_a_memory_with_other_parameters(name):
    law, axes = laws()[name]
    (states, grad_p), (along, along_grad), (old, _) = (points(k, axes=bool(axes)) for k in (1, 2, 3))
    if axes == "stiffness":  # alone is open
        states, old = (replace(each, parameters=each.parameters[:, 1:]) for each in (states, old))
    memory = law.respond(old, grad_p, law.initial_at(old), tangent=False).memory
    h = 1e-5

    def at(share):
        moved = replace(states, grad_u=states.grad_u + share * along.grad_u, p=states.p + share * along.p)
        return law.respond(moved, grad_p + share * along_grad, memory, tangent=False)

    tangent, ends = law.respond(states, grad_p, memory).tangent, (at(h), at(-h))
    for response in INTEGRATED:
        slope = (getattr(ends[0], response) - getattr(ends[1], response)) / (2 * h)
        by_H, by_p = getattr(tangent, f"{response}_grad_u"), getattr(tangent, f"{response}_p")
        found = np.einsum("n...kl,nkl->n...", by_H, along.grad_u) + np.einsum("n...,n->n...", by_p, along.p)
        by_grad = getattr(tangent, f"{response}_grad_p")
        if by_grad is not None:
            found = found + np.einsum("n...j,nj->n...", by_grad, along_grad)
        np.testing.assert_allclose(found, slope, rtol=1e-6, atol=1e-7 * np.abs(slope).max())


@pytest.mark.parametrize("closure", ["potential", "mean-gradient"])
def test_parameters_that_are_constant_give_the_law_with_them_bound(closure):
    (states, grad_p), (old, _) = points(1), points(2)
    theta = np.array([0.2, 1.3])
    states, old = (replace(each, parameters=np.tile(theta, (N, 1))) for each in (states, old))
    found = []
    for law in (parametric_law(closure=closure), parametric_law(BoundCell(theta), 0.2, closure)):
        memory = law.respond(old, grad_p, law.initial_at(old)).memory
        found.append(law.respond(states, grad_p, memory))
    assert_same(found[0], found[1], rtol=1e-12)


@pytest.mark.parametrize("closure", ["potential", "mean-gradient"])
def test_a_bound_parameter_is_one_that_is_given_with_each_state(closure):
    """Bit for bit, from a memory with other parameters; the states outside have those alone that are open."""
    (states, grad_p), (old, _) = points(1), points(2)
    for bound, open_ in (({"radius": 0.21}, ["stiffness"]), ({"stiffness": 1.3}, ["radius"])):
        law, whole = BoundLaw(parametric_law(closure=closure), bound), parametric_law(closure=closure)
        assert law.parameters == tuple(open_) == law.parameters_of(0)
        (column,) = (whole.parameters.index(name) for name in open_)
        given, full = [], []
        for each in (old, states):
            theta = np.array(each.parameters)
            theta[:, 1 - column] = next(iter(bound.values()))
            full.append(replace(each, parameters=theta))
            given.append(replace(each, parameters=theta[:, [column]]))
        begun = law.respond(given[0], grad_p, law.initial_at(given[0])).memory
        found = law.respond(given[1], grad_p, begun)
        memory = whole.respond(full[0], grad_p, whole.initial_at(full[0])).memory
        expected = whole.respond(full[1], grad_p, memory)
        for name in INTEGRATED:
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
        np.testing.assert_array_equal(found.tangent.stress_grad_u, expected.tangent.stress_grad_u)
        assert begun.states is given[0]
        assert found.memory.states is given[1]
    assert BoundLaw(whole, bound).identity != BoundLaw(whole, {"stiffness": 1.4}).identity != whole.identity


def test_a_law_that_learns_is_asked_with_all_parameters():
    """It sees the bound ones, and what it gives back begins from the states outside."""
    seen = []

    class Learning(type(parametric_law())):
        def before_accept(self, response, memory):
            seen.extend([response.memory.states.parameters, memory.states.parameters])
            return self.initial_at(memory.states)

        def reasons(self, states):
            return [f"{row}" for row in states.parameters[:, 0]]

    plain = parametric_law()
    law = BoundLaw(Learning(plain.cell_law, plain.closure), {"radius": 0.21, "stiffness": 2.0})
    states = MacroState(points(1)[0].grad_u, points(1)[0].p)
    memory = law.initial(N)
    changed = law.before_accept(law.respond(states, np.zeros((N, 3)), memory), memory)
    np.testing.assert_array_equal(np.unique(np.concatenate(seen), axis=0), [[0.21, 2.0]])
    assert changed.states is memory.states
    assert law.reasons(states) == ["0.21"] * N


def test_what_cannot_be_bound_is_refused():
    with pytest.raises(
        ConfigurationError, match="raduis: no parameter of the cell has this name; did you mean 'radi"
    ):
        BoundLaw(parametric_law(), {"raduis": 0.2})
    with pytest.raises(ConfigurationError, match=r"radius: expected a finite number, got .nan"):
        BoundLaw(parametric_law(), {"radius": np.nan})
    with pytest.raises(ConfigurationError, match="the cell has no parameters"):
        BoundLaw(linear_law(), {"radius": 0.2})
    law, rest = BoundLaw(parametric_law(), {"radius": 0.2}), MacroState.zeros(1)
    with pytest.raises(
        ConfigurationError, match="has the parameters radius, stiffness, but no values were given"
    ):
        law.respond(rest, np.zeros((1, 3)), LawMemory.forgetful(rest, np.zeros(1)))


def test_pores_that_shrink_at_rest_give_off_their_fluid():
    """The mean-gradient closure counts the change of φ_f too, which the potential's fluid volume holds."""
    for closure in ("potential", "mean-gradient"):
        law = parametric_law(closure=closure)
        start, end = (MacroState(np.zeros((1, 3, 3)), np.zeros(1), np.array([[r, 1.0]])) for r in (0.3, 0.2))
        storage = law.respond(end, np.zeros((1, 3)), law.initial_at(start)).storage
        np.testing.assert_allclose(storage, porosity(np.array([0.2])) - porosity(np.array([0.3])), rtol=1e-13)


def test_the_fluid_of_cells_that_change_does_not_depend_on_the_steps():
    """The mean-gradient closure's storage over small steps is what the solid leaves of the volume."""
    law, steps = parametric_law(closure="mean-gradient"), 100
    states, _ = points(1)
    total, memory = np.zeros(N), None
    for share in np.linspace(0, 1, steps + 1):
        theta = (1 - share) * np.array([0.3, 1.0]) + share * states.parameters
        now = MacroState(share * states.grad_u, share * states.p, theta)
        memory = law.initial_at(now) if memory is None else memory
        response = law.respond(now, np.zeros((N, 3)), memory, tangent=False)
        total, memory = total + response.storage, response.memory
    # Without φ_s: ∫ cof F̄:dH along the path, less the change of φ_s det F̄.
    solid = (1 - porosity(states.parameters[:, 0])) * response.volume_ratio - (1 - porosity(np.array([0.3])))
    swept = np.zeros(N)
    for share in (np.arange(steps) + 0.5) / steps:
        theta = (1 - share) * np.array([0.3, 1.0]) + share * states.parameters
        now = MacroState(share * states.grad_u, share * states.p, theta)
        F = law.respond(now, np.zeros((N, 3)), law.initial_at(now), tangent=False).deformation
        cof = np.linalg.det(F)[:, None, None] * np.linalg.inv(F).swapaxes(1, 2)
        swept += np.einsum("nij,nij->n", cof, states.grad_u) / steps
    np.testing.assert_allclose(total, swept - solid, atol=8e-4)


def test_turned_axes_are_those_of_the_rotated_tensors():
    """Index by index, from the law at the state in the axes of the material."""
    law, (states, grad_p), (old, _) = parametric_law(), points(1, axes=True), points(2, axes=True)
    R = states.place.axes
    turned = TurnedLaw(law)
    found = turned.respond(states, grad_p, turned.respond(old, grad_p, turned.initial_at(old)).memory)

    def inside(state):
        H = np.einsum("nia,nij,njb->nab", R, state.grad_u, R)
        return MacroState(H, state.p, state.parameters)

    gradient = np.einsum("nia,ni->na", R, grad_p)
    memory = law.respond(inside(old), gradient, law.initial_at(inside(old))).memory
    plain = law.respond(inside(states), gradient, memory)
    close = {"rtol": 1e-10, "atol": 1e-13}
    np.testing.assert_allclose(found.stress, np.einsum("nia,nab,njb->nij", R, plain.stress, R), **close)
    np.testing.assert_allclose(found.storage, plain.storage, **close)
    np.testing.assert_allclose(found.flux, np.einsum("nia,na->ni", R, plain.flux), **close)
    stiffness = np.einsum(
        "nia,njb,nkc,nld,nabcd->nijkl", R, R, R, R, plain.tangent.stress_grad_u, optimize=True
    )
    np.testing.assert_allclose(found.tangent.stress_grad_u, stiffness, **close)
    flux = np.einsum("nia,nkc,nld,nacd->nikl", R, R, R, plain.tangent.flux_grad_u, optimize=True)
    np.testing.assert_allclose(found.tangent.flux_grad_u, flux, **close)


def test_the_turned_stress_is_the_slope_of_the_turned_potential():
    states, grad_p = points(4, axes=True)
    R, h = states.place.axes, 1e-5
    law = TurnedLaw(parametric_law())
    stress = law.respond(states, grad_p, law.initial_at(states)).stress
    for i in range(3):
        for j in range(3):
            ends = []
            for sign in (1, -1):
                H = states.grad_u.copy()
                H[:, i, j] += sign * h
                turned = replace(states, grad_u=R.swapaxes(1, 2) @ H @ R, place=None)
                ends.append(ParametricCell().predict(turned).potential)
            np.testing.assert_allclose((ends[0] - ends[1]) / (2 * h), stress[:, i, j], atol=1e-8)


def test_each_region_answers_by_its_own_law():
    one, two = parametric_law(), linear_law()
    law = RegionLaw.by_name(["clay"], {"clay": two}, rest=one)
    states, grad_p = points(1, region=True)
    response = law.respond(states, grad_p, law.initial_at(states))
    for own, rows in ((one, np.arange(0, N, 2)), (two, np.arange(1, N, 2))):
        part = replace(states[rows], place=None)
        alone = own.respond(part, grad_p[rows], own.initial_at(part))
        for name in INTEGRATED:
            np.testing.assert_array_equal(getattr(response, name)[rows], getattr(alone, name))
    assert law.parameters_of(0) == ("radius", "stiffness")
    assert law.parameters_of(1) == ()
    assert response.memory.states is states
    assert not law.constant_tangent
    with pytest.raises(ConfigurationError, match="there is no region 'sand'; the regions are clay"):
        RegionLaw.by_name(["clay"], {"sand": two}, rest=one)


def test_regions_that_share_a_law_ask_it_once():
    class Counted(ParametricCell):
        asked = 0

        def predict(self, states, *, tangent=True):
            Counted.asked += tangent
            return super().predict(states, tangent=tangent)

    one, two = parametric_law(Counted()), linear_law()
    states, grad_p = points(1, region=True)
    states = replace(states, place=replace(states.place, region=np.arange(N) % 5))
    law = RegionLaw([one, two, one, one, two])
    memory, Counted.asked = law.initial_at(states), 0
    response = law.respond(states, grad_p, memory)
    assert Counted.asked == 1
    apart = RegionLaw([parametric_law(), two, parametric_law(), parametric_law(), linear_law()])
    assert_same(response, apart.respond(states, grad_p, apart.initial_at(states)))
    assert response.memory.states is states


def test_the_linearised_law_is_linear_poroelasticity_of_the_rest():
    """Its response to a small state is that of the law, to first order."""
    law, linear = parametric_law(), LinearisedLaw(parametric_law())
    states, grad_p = points(1)
    small = replace(states, grad_u=1e-7 * states.grad_u, p=1e-7 * states.p)
    exact = law.respond(small, 1e-7 * grad_p, law.initial_at(small))
    found = linear.respond(small, 1e-7 * grad_p, linear.initial_at(small))
    for name in INTEGRATED:
        np.testing.assert_allclose(getattr(found, name), getattr(exact, name), rtol=1e-5, atol=1e-13)
    assert linear.constant_tangent
    # Cells that change at rest give off what the law says.
    later = replace(states, grad_u=0 * states.grad_u, p=0 * states.p, parameters=states.parameters * 0.9)
    memory = linear.initial_at(states)
    np.testing.assert_allclose(
        linear.respond(later, grad_p, memory).storage,
        law.respond(later, grad_p, law.initial_at(states)).storage,
        rtol=1e-12,
    )


def test_parameters_that_are_missing_are_said():
    law = parametric_law()
    with pytest.raises(
        ConfigurationError, match="has the parameters radius, stiffness, but no values were given"
    ):
        law.respond(
            MacroState.zeros(1),
            np.zeros((1, 3)),
            LawMemory.forgetful(MacroState.zeros(1), np.zeros(1)),
        )
    with pytest.raises(ValueError, match="call initial_at"):
        law.initial(2)


def assert_same(one, other, **close):
    for f in fields(MacroResponse):
        a, b = getattr(one, f.name), getattr(other, f.name)
        if isinstance(a, MacroTangent):
            for g in fields(MacroTangent):
                own, others = getattr(a, g.name), getattr(b, g.name)
                assert (own is None) == (others is None)
                if own is not None:
                    np.testing.assert_allclose(own, others, atol=1e-13, **close)
        elif f.name == "potential":
            assert (a is None) == (b is None)
            assert a is None or np.allclose(a, b, atol=1e-13, **close)
        elif f.name != "memory":
            np.testing.assert_allclose(a, b, atol=1e-13, **close)
