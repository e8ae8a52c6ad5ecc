"""Fixed charges: equilibria, tangent, derivatives and memory of the law; runs of a column in a bath."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from porocore.commands.verify.linear_cases import potential
from porocore.errors import ConfigurationError
from porocore.interfaces.law import Interval, LawWrapper, MemoryChanges, PointChanges
from porocore.macro.analytic import ChargedCell
from porocore.macro.laws.charges import ChargedLaw, OsmoticPressure
from porocore.macro.laws.evolution import EvolvingLaw
from porocore.macro.laws.rates import Rate
from porocore.macro.laws.relaxation import RelaxingLaw
from porocore.states import MacroState
from porocore.testing.synthetic.response import linear_law, mean_gradient_law
from tests.helpers.sensitivity_bodies import law as family_law

#: R T Φ in units of E per concentration, c_F0 and c*.
OSMOTIC, DENSITY, BATH = 0.25, 0.2, 0.15
FREE, CONFINED = np.eye(3), np.diag([0.0, 1.0, 0.0])
STEP = Interval(0.3, 0.5)
N = 5


class SeepingLaw(LawWrapper):
    """A law whose stress and stored fluid depend on ∇p, too."""

    def respond_to_each(self, states, gradients, memory, *, step=None, tangent=True):
        v, one = np.array([0.1, -0.2, 0.05]), np.eye(3)
        found = []
        for grad_p, response in zip(
            gradients,
            self.law.respond_to_each(states, gradients, memory, step=step, tangent=tangent),
            strict=True,
        ):
            along, p = grad_p @ v, states.p
            more = 0.2 * along * (1 + 3 * p)
            t = response.tangent
            if t is not None:
                t = replace(
                    t,
                    storage_p=t.storage_p + 0.6 * along,
                    storage_grad_p=0.2 * (1 + 3 * p)[:, None] * v,
                    stress_grad_p=0.3 * np.broadcast_to(one[..., None] * v, (len(p), 3, 3, 3)),
                )
            reached = replace(response.memory, fluid_volume=response.memory.fluid_volume + more)
            stress = response.stress + 0.3 * along[:, None, None] * one
            storage = response.storage + more
            found.append(replace(response, stress=stress, storage=storage, memory=reached, tangent=t))
        return found


def combined_law():
    """A cell whose pores grow with the flux and the pressure, and whose solid relaxes."""
    rate = Rate("a*flux*(1 + p)", ("radius", "poisson_ratio"), ["a"])
    return RelaxingLaw(EvolvingLaw(family_law("radius", "poisson_ratio"), {"radius": rate}, RANGES), 2)


LAWS = {
    "potential": lambda: potential()[0],
    "mean-gradient": mean_gradient_law,
    "linear": linear_law,
    "family": lambda: family_law("radius", "poisson_ratio"),
    "family mean-gradient": lambda: family_law("radius", "poisson_ratio", closure="mean-gradient"),
    "deformed pore": lambda: family_law("radius", conductivity="deformed"),
    "seeping": lambda: SeepingLaw(potential()[0]),
    "combined": combined_law,
}
#: Values of the parameters of the cells.
CELL = {
    "radius": 0.22,
    "poisson_ratio": 0.3,
    "evolution.radius.a": 0.02,
    "relaxation.1.strength": 0.6,
    "relaxation.1.time": 0.15,
    "relaxation.2.strength": 0.3,
    "relaxation.2.time": 2.0,
}
RANGES = {"radius": (0.1, 0.3)}


def charged(name, density=DENSITY, bath=BATH):
    """The law, and the parameters of a point."""
    law = ChargedLaw(LAWS[name](), OSMOTIC)
    return law, np.array([*(CELL[each] for each in law.law.parameters), density, bath])


def points(theta, seed=1, n=N):
    """Random states with parameters, and gradients."""
    rng = np.random.default_rng(seed)
    H, p = 0.04 * rng.standard_normal((n, 3, 3)), 0.03 * rng.standard_normal(n)
    return MacroState(H, p).with_parameters(theta), rng.standard_normal((n, 3))


def reached(law, theta):
    """The memory of points that have been elsewhere."""
    old, grad_p = points(theta, 2)
    return law.respond(old, grad_p, law.initial_at(old)).memory


def inner_memory(law, memory):
    return law.memory_in(memory, memory.states)


# ---- equilibria ----------------------------------------------------------------------------------


@pytest.mark.parametrize("direction", [FREE, CONFINED], ids=["free", "confined"])
@pytest.mark.parametrize("bath", [0.015, 0.15, 1.0])
@pytest.mark.parametrize("name", ["potential", "mean-gradient", "linear", "family"])
def test_equilibria_are_those_of_the_scalar_equations(name, bath, direction):
    law, theta = charged(name, bath=bath)
    still, inner = np.zeros((1, 3)), law.law
    given = theta[:-2] if inner.parameters else None

    def response(H, p):
        states = MacroState.single(H, p).with_parameters(given)
        found = inner.respond(states, still, inner.initial_at(states))
        return found.stress[0], float(found.memory.fluid_volume[0])

    rest = MacroState.zeros(1).with_parameters(given)
    charge = DENSITY * float(inner.initial_at(rest).fluid_volume[0])
    strain, p = ChargedCell(response, charge, bath, OSMOTIC).equilibrium(direction)
    states = MacroState.single(strain * direction).with_parameters(theta)
    found = law.respond(states, still, law.initial_at(states))
    assert strain > 1e-4
    assert float(np.sum(found.stress[0] * direction)) == pytest.approx(0, abs=1e-10)
    assert found.memory.internal[0, -2] == pytest.approx(p, rel=1e-10)
    assert found.memory.internal[0, -1] == pytest.approx(charge, rel=1e-14)
    assert found.memory.fluid_volume[0] == pytest.approx(response(strain * direction, p)[1], rel=1e-10)


@pytest.mark.parametrize("step", [None, STEP])
@pytest.mark.parametrize("name", LAWS)
def test_the_pressure_of_the_cell_is_osmotic_and_effective(name, step):
    law, theta = charged(name)
    (states, grad_p), memory = points(theta), reached(law, theta)
    found = law.respond(states, grad_p, memory, step=step)
    p, charge = found.memory.internal[:, -2:].T
    concentration = charge / found.memory.fluid_volume
    osmotic = OSMOTIC * (np.sqrt(concentration**2 + 4 * BATH**2) - 2 * BATH)
    np.testing.assert_allclose(p - osmotic, states.p, rtol=0, atol=1e-14)
    np.testing.assert_allclose(found.storage, found.memory.fluid_volume - memory.fluid_volume, atol=1e-15)
    inner = law.law.respond(replace(law.states_in(states), p=p), grad_p, inner_memory(law, memory), step=step)
    for part in ("stress", "storage", "flux", "deformation", "cell_p", "doubt"):
        np.testing.assert_array_equal(getattr(found, part), getattr(inner, part))


def test_charges_stay_when_the_concentration_of_the_point_changes():
    law, theta = charged("potential")
    (states, grad_p), memory = points(theta), reached(law, theta)
    other = states.with_parameters([2 * DENSITY, BATH])
    kept = law.respond(other, grad_p, memory, step=STEP)
    np.testing.assert_array_equal(kept.stress, law.respond(states, grad_p, memory, step=STEP).stress)
    settled = law.respond(other, grad_p, memory)
    np.testing.assert_allclose(settled.memory.internal[:, -1], 2 * memory.internal[:, -1], rtol=1e-15)


@pytest.mark.parametrize("name", LAWS)
def test_without_charges_nothing_changes(name):
    law, theta = charged(name, density=0.0)
    (states, grad_p), memory = points(theta), reached(law, theta)
    gradients = [grad_p, 0 * grad_p, 2 * grad_p]
    found = law.respond_to_each(states, gradients, memory, step=STEP)
    plain = law.law.respond_to_each(law.states_in(states), gradients, inner_memory(law, memory), step=STEP)
    for mine, theirs in zip(found, plain, strict=True):
        for part in fields(theirs):
            if part.name not in ("memory", "tangent"):
                np.testing.assert_array_equal(getattr(mine, part.name), getattr(theirs, part.name))
        for part in fields(theirs.tangent):
            np.testing.assert_array_equal(
                getattr(mine.tangent, part.name), getattr(theirs.tangent, part.name)
            )
        np.testing.assert_array_equal(mine.memory.fluid_volume, theirs.memory.fluid_volume)
        np.testing.assert_array_equal(mine.memory.internal[:, :-2], theirs.memory.internal)
        np.testing.assert_array_equal(mine.memory.internal[:, -2:], np.column_stack([states.p, 0 * states.p]))


@pytest.mark.parametrize("density", [1e-9, 0.05, 3.0])
@pytest.mark.parametrize("bath", [0.0, 1e-4, 2.0])
def test_any_charge_in_any_bath_has_its_pressure(density, bath):
    """A cell pressed until it would hold no fluid without charges, too."""
    law, theta = charged("linear", density, bath)
    states = MacroState(
        np.array([-1.2, -0.3, 0.0, 0.5])[:, None, None] * FREE, np.array([-0.4, 0, 0.1, -1.0])
    )
    states = states.with_parameters(theta)
    found = law.respond(states, np.zeros((4, 3)), law.initial_at(states))
    assert np.isfinite(found.stress).all()
    p, charge = found.memory.internal[:, -2:].T
    osmotic = OsmoticPressure.at(found.memory.fluid_volume, charge, theta[-1] + 0 * p, OSMOTIC).value
    assert (found.memory.fluid_volume > 0).all()
    # Where hardly any fluid is left, π feels the round-off of φ.
    sensitive = osmotic / found.memory.fluid_volume
    np.testing.assert_allclose((p - osmotic - states.p) / (1 + sensitive), 0, atol=1e-13)


# ---- derivatives ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["potential", "linear", "family"])
def test_the_tangent_is_symmetric(name):
    law, theta = charged(name)
    (states, grad_p), memory = points(theta), reached(law, theta)
    t = law.respond(states, grad_p, memory, step=STEP).tangent
    C = t.stress_grad_u.reshape(N, 9, 9)
    np.testing.assert_allclose(C, C.swapaxes(1, 2), atol=1e-12 * np.abs(C).max())
    np.testing.assert_allclose(t.stress_p, -t.storage_grad_u, atol=1e-12)


@pytest.mark.parametrize("step", [None, STEP])
@pytest.mark.parametrize("name", LAWS)
def test_the_tangent_is_the_slope(name, step):
    law, theta = charged(name)
    (states, grad_p), (along, along_grad), memory = points(theta), points(theta, 3), reached(law, theta)

    def at(share):
        moved = replace(states, grad_u=states.grad_u + share * along.grad_u, p=states.p + share * along.p)
        return law.respond(moved, grad_p + share * along_grad, memory, step=step, tangent=False)

    t, ends, h = law.respond(states, grad_p, memory, step=step).tangent, (at(1e-4), at(-1e-4)), 1e-4
    assert ends[0].tangent is None
    for part in ("stress", "storage", "flux"):
        slope = (getattr(ends[0], part) - getattr(ends[1], part)) / (2 * h)
        found = np.einsum("n...kl,nkl->n...", getattr(t, f"{part}_grad_u"), along.grad_u)
        found += np.einsum("n...,n->n...", getattr(t, f"{part}_p"), along.p)
        by_gradient = getattr(t, f"{part}_grad_p")
        if by_gradient is not None:
            found += np.einsum("n...k,nk->n...", by_gradient, along_grad)
        np.testing.assert_allclose(found, slope, atol=1e-7 * np.abs(slope).max())


def changed(states, name, law, share):
    theta = states.parameters.copy()
    theta[:, law.parameters.index(name)] += share
    return replace(states, parameters=theta)


@pytest.mark.parametrize(
    ("name", "unknown"),
    [
        (name, unknown)
        for name in ("family", "family mean-gradient", "potential", "deformed pore", "combined")
        for unknown in ("charges.density", "charges.bath", *["radius"] * (name != "potential"))
    ],
)
def test_derivatives_by_way_of_the_memory_are_slopes(name, unknown):
    """A state that has stood for long, and two steps from it; the total derivatives of the last response."""
    law, theta = charged(name)
    path = [points(theta, seed) for seed in (4, 5, 6)]

    def last(share):
        memory, response = None, None
        for number, (states, grad_p) in enumerate(path):
            at = changed(states, unknown, law, share)
            memory = law.initial_at(at) if memory is None else memory
            step = Interval(0.1 * number - 0.1, 0.1 * number) if number else None
            response = law.respond(at, grad_p, memory, step=step, tangent=False)
            memory = response.memory
        return response

    by = np.zeros((N, len(theta), 1))
    by[:, law.parameters.index(unknown)] = 1.0
    points_change = PointChanges(np.zeros((N, 1)), np.zeros((N, 1)), by)
    first = path[0][0]
    before = replace(
        MemoryChanges.zeros(N, law.memory_size, 1), fluid_volume=law.rest_changes(first, points_change)
    )
    memory, still = law.initial_at(first), (np.zeros((N, 3, 3, 1)), np.zeros((N, 1)), np.zeros((N, 3, 1)))
    for number, (states, grad_p) in enumerate(path):
        step = Interval(0.1 * number - 0.1, 0.1 * number) if number else None
        response, fixed = law.respond_to_changes(states, grad_p, memory, points_change, before, step=step)
        memory = response.memory
        total, before = fixed.moved(response.tangent, before, *still)
    h = 1e-4
    ends = last(h), last(-h)
    for part in ("stress", "storage", "flux"):
        slope = (getattr(ends[0], part) - getattr(ends[1], part)) / (2 * h)
        np.testing.assert_allclose(
            getattr(total, part)[..., 0], slope, atol=1e-6 * max(np.abs(slope).max(), 1e-3)
        )
    internal = (ends[0].memory.internal - ends[1].memory.internal) / (2 * h)
    np.testing.assert_allclose(before.internal[..., 0], internal, atol=1e-6 * np.abs(internal).max())
    fluid = (ends[0].memory.fluid_volume - ends[1].memory.fluid_volume) / (2 * h)
    np.testing.assert_allclose(before.fluid_volume[:, 0], fluid, atol=1e-6 * np.abs(fluid).max())


@pytest.mark.parametrize("name", ["family", "mean-gradient", "combined"])
def test_internal_variables_have_their_slopes(name):
    law, theta = charged(name)
    (states, grad_p), (along, along_grad), memory = points(theta), points(theta, 3), reached(law, theta)
    nothing = PointChanges(np.zeros((N, 1)), np.zeros((N, 1)), np.zeros((N, len(theta), 1)))
    before = MemoryChanges.zeros(N, law.memory_size, 1)
    found = law.respond_to_changes(states, grad_p, memory, nothing, before, step=STEP)[1]

    def at(share):
        moved = replace(states, grad_u=states.grad_u + share * along.grad_u, p=states.p + share * along.p)
        return law.respond(
            moved, grad_p + share * along_grad, memory, step=STEP, tangent=False
        ).memory.internal

    slope = (at(1e-4) - at(-1e-4)) / 2e-4
    mine = np.einsum("nvkl,nkl->nv", found.internal_grad_u, along.grad_u)
    mine += found.internal_p * along.p[:, None]
    if found.internal_grad_p is not None:
        mine += np.einsum("nvk,nk->nv", found.internal_grad_p, along_grad)
    assert (found.internal_grad_p is not None) == (name == "combined")
    np.testing.assert_allclose(mine, slope, atol=1e-7 * np.abs(slope).max())
    assert not found.internal.any()


# ---- what is refused -----------------------------------------------------------------------------


def test_what_cannot_be_is_told():
    with pytest.raises(ConfigurationError, match="a positive osmotic pressure per concentration, got 0"):
        ChargedLaw(linear_law(), 0.0)
    law, _ = charged("linear")
    with pytest.raises(ConfigurationError, match="has charges already"):
        ChargedLaw(law, OSMOTIC)
    with pytest.raises(ValueError, match="call initial_at"):
        law.initial(3)
    with pytest.raises(ConfigurationError, match=r"parameters charges\.density, charges\.bath, but no"):
        law.respond(MacroState.zeros(1), np.zeros((1, 3)), law.law.initial(1))
