"""A solid that relaxes: limits, small strain, energy and rotations at points; a consolidating column in closed form."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from porocore.interfaces.law import Interval, LawWrapper
from porocore.macro.analytic import LayeredConsolidation, SoilLayer
from porocore.macro.laws.linear import LinearisedLaw
from porocore.macro.laws.relaxation import RelaxingLaw
from porocore.states import MacroState
from porocore.testing.macro_checks.states import COEFFICIENTS
from porocore.testing.synthetic.response import confined_column, linear_law, mean_gradient_law
from tests.helpers import sensitivity_bodies

N = 50
BRANCHES = (0.7, 0.4, 0.3, 6.0)  # strength and time of each
AT_ONCE = Interval(0.0, 0.0)


def states(seed, size=0.05, branches=BRANCHES, n=N):
    rng = np.random.default_rng(seed)
    found = MacroState(rng.uniform(-size, size, (n, 3, 3)), rng.uniform(-size, size, n))
    return found.with_parameters(np.tile(branches, (n, 1)))


def elastic(closure="potential"):
    return sensitivity_bodies.law(closure=closure)


def respond(law, at, memory, step, **how):
    return law.respond(at, np.full((len(at), 3), 0.01), memory, step=step, **how)


def bare(at):
    return replace(at, parameters=None)


@pytest.mark.parametrize("closure", ["potential", "mean-gradient", "linear"])
def test_branches_of_no_strength_change_nothing(closure):
    """To the last bit, along a path."""
    plain = linear_law() if closure == "linear" else elastic(closure)
    law = RelaxingLaw(plain, 2, small_strain=closure == "linear")
    at = states(1, branches=(0.0, 0.4, 0.0, 6.0))
    memory, known = law.initial_at(at), plain.initial(N)
    for share in (0.5, 1.0, 0.2):
        now = replace(at, grad_u=share * at.grad_u, p=share * at.p)
        found = respond(law, now, memory, Interval(share, share + 0.1))
        wanted = respond(plain, bare(now), known, Interval(share, share + 0.1))
        for name in ("stress", "storage", "flux"):
            np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), err_msg=name)
        for name, value in vars(wanted.tangent).items():
            if value is not None:
                np.testing.assert_array_equal(getattr(found.tangent, name), value, err_msg=name)
        memory, known = found.memory, wanted.memory


def test_fast_and_slow_limits_are_elastic():
    """At once the solid is 1 + Σγ times as stiff, W_a(H, p) = a W(H, p/a); after long it is that of equilibrium."""
    plain, law, at = elastic(), RelaxingLaw(elastic(), 2), states(2)
    whole = 1 + BRANCHES[0] + BRANCHES[2]
    found = respond(law, at, law.initial_at(at), AT_ONCE)
    softer = bare(replace(at, p=at.p / whole))
    wanted = respond(plain, softer, plain.initial(N), None)
    np.testing.assert_allclose(found.stress, whole * wanted.stress, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.storage, wanted.storage, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.flux, wanted.flux, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.cell_p, softer.p, rtol=1e-12)
    late = respond(law, at, found.memory, Interval(0.0, 1e12))
    relaxed = respond(plain, bare(at), plain.initial(N), None)
    for name in ("stress", "storage", "flux"):
        ours = late.storage + found.storage if name == "storage" else getattr(late, name)
        np.testing.assert_allclose(ours, getattr(relaxed, name), rtol=0, atol=1e-10, err_msg=name)
    stood = respond(law, at, law.initial_at(at), None)
    for name in ("stress", "storage", "flux"):
        np.testing.assert_array_equal(getattr(stood, name), getattr(relaxed, name), err_msg=name)


@pytest.mark.parametrize("small_strain", [True, False])
def test_small_strain_is_the_correspondence_principle(small_strain):
    """Drained stress of a held strain by g(t); a held pressure drains into p/g's conjugate function."""
    g, t = 0.7, 0.4
    plain = LinearisedLaw(elastic()) if small_strain else elastic()
    law = RelaxingLaw(plain, 1, small_strain=small_strain)
    at = states(3, size=1e-7, branches=(g, t), n=5)
    drained = replace(at, p=0 * at.p)
    C = respond(plain, bare(drained), plain.initial(5), None).stress
    memory = respond(law, drained, law.initial_at(at), AT_ONCE).memory
    for begin, end in ((0.0, 0.1), (0.1, 0.5), (0.5, 2.0)):
        found = respond(law, drained, memory, Interval(begin, end))
        memory = found.memory
        np.testing.assert_allclose(
            found.stress, (1 + g * np.exp(-end / t)) * C, rtol=0, atol=1e-6 * abs(C).max()
        )
    pressed = replace(at, grad_u=0 * at.grad_u)
    alpha_p = respond(plain, bare(pressed), plain.initial(5), None)
    now = respond(law, pressed, law.initial_at(at), AT_ONCE)
    first, times = now.storage, np.linspace(0, 2, 2001)
    taken, memory = first.copy(), now.memory
    for step in map(Interval, times[:-1], times[1:]):
        now = respond(law, pressed, memory, step, tangent=False)
        taken, memory = taken + now.storage, now.memory
    # α does not relax, so the stress of a held pressure is the same at all times.
    np.testing.assert_allclose(now.stress, alpha_p.stress, rtol=0, atol=1e-6 * abs(alpha_p.stress).max())
    crept = 1 - g / (1 + g) * np.exp(-2.0 / (t * (1 + g)))
    np.testing.assert_allclose(first, alpha_p.storage / (1 + g), rtol=1e-6)
    np.testing.assert_allclose(taken, crept * alpha_p.storage, rtol=1e-6)


@pytest.mark.parametrize("n", [500, pytest.param(10_000, marks=pytest.mark.slow)])
def test_no_closed_path_gives_work(n):
    """On random paths of (H, p) that end where they began; the quadrature alone is in error by 1e-3."""
    law, rng = RelaxingLaw(elastic(), 2), np.random.default_rng(7)
    at = states(4, n=n)
    ends = [at.at_rest()]
    for _ in range(5):
        ends.append(replace(at, grad_u=rng.uniform(-0.06, 0.06, (n, 3, 3)), p=rng.uniform(-0.05, 0.05, n)))
    found, old, time = respond(law, ends[0], law.initial_at(at), AT_ONCE), ends[0], 0.0
    work, scale = np.zeros(n), np.zeros(n)
    for start, end in pairwise([*ends, ends[0]]):
        length = float(rng.choice([0.02, 0.3, 3.0])) / 4
        for share in (0.25, 0.5, 0.75, 1.0):
            H = start.grad_u + share * (end.grad_u - start.grad_u)
            now = replace(at, grad_u=H, p=start.p + share * (end.p - start.p))
            step, last = Interval(time, time + length), found
            found = respond(law, now, last.memory, step, tangent=False)
            stress = (found.stress + last.stress) / 2
            fluid = (found.memory.fluid_volume + last.memory.fluid_volume) / 2
            done = np.einsum("nij,nij->n", stress, now.grad_u - old.grad_u) - fluid * (now.p - old.p)
            work, scale, old, time = work + done, scale + abs(done), now, step.end
    assert (work > 5e-3 * scale).all()


class LearningLaw(LawWrapper):
    """A law that becomes stiffer when a step is to be accepted, once."""

    factor = 1.0

    def response_out(self, response, states):
        return replace(response, stress=self.factor * response.stress)

    def before_accept(self, response, memory):
        done, self.factor = self.factor > 1, 1.1
        return None if done else memory


def test_a_law_that_learns_leaves_the_overstress_as_it_is():
    """The stress that relaxes is measured from what the new law says of the beginning."""
    inner = LearningLaw(elastic())
    law, at = RelaxingLaw(inner, 2), states(6, n=8)
    memory = respond(law, at, law.initial_at(at), AT_ONCE).memory
    reached = respond(law, at, memory, Interval(0.0, 0.1))
    changed = law.before_accept(reached, memory)
    assert law.before_accept(reached, memory) is None
    over = slice(0, 20)
    np.testing.assert_array_equal(changed.internal[:, over], memory.internal[:, over])
    again = respond(law, at, changed, Interval(0.0, 0.0)).memory
    np.testing.assert_allclose(again.internal[:, over], memory.internal[:, over], rtol=0, atol=1e-14)
    assert np.abs(again.internal[:, 20:29] - memory.internal[:, 20:29]).max() > 1e-3


def test_a_rotation_of_the_body_rotates_the_stress():
    law, at = RelaxingLaw(elastic(), 2), states(5, n=20)
    R = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    R *= np.linalg.det(R)

    def path(turn):
        memory, found = law.initial_at(at), None
        for share in (0.5, 1.0, 0.3):
            F = np.eye(3) + share * at.grad_u
            now = replace(at, grad_u=turn @ F - np.eye(3), p=share * at.p)
            found = respond(law, now, memory, Interval(share, share + 0.2))
            memory = found.memory
        return found

    plain, turned = path(np.eye(3)), path(R)
    np.testing.assert_allclose(turned.stress, R @ plain.stress, rtol=0, atol=1e-13)
    np.testing.assert_allclose(turned.storage, plain.storage, rtol=0, atol=1e-13)
    np.testing.assert_allclose(turned.memory.internal, plain.memory.internal, rtol=0, atol=1e-13)
    np.testing.assert_allclose(
        plain.memory.internal[:, :9].reshape(-1, 3, 3).swapaxes(1, 2),
        plain.memory.internal[:, :9].reshape(-1, 3, 3),
        atol=1e-13,
    )


NUMBERS = {"1.strength": 1.0, "1.time": 2.0, "2.strength": 0.5, "2.time": 40.0}
FIELDS = {f"relaxation.{name}": value for name, value in NUMBERS.items()}
TIME = {"end": 60.0, "step": 20.0, "ramp_increments": 1, "ramp_step": 1e-3, "profiles": (1.0, 5.0, 20.0)}


def column(elements=16, tolerance=3e-5, **settings):
    settings = {"load": -1e-4, "time": TIME | {"tolerance": tolerance}} | settings
    return confined_column(elements, fields=FIELDS, **settings)


@pytest.mark.parametrize("linear", [True, False])
def test_a_column_consolidates_as_in_closed_form(linear):
    """Settlement and pressure at the base to 0.2 % of the largest, with two branches."""
    Solver = pytest.importorskip("porocore_fem_skfem.macro").SkfemMacroSolver
    solver = Solver()
    law = RelaxingLaw(linear_law() if linear else mean_gradient_law(), 2, small_strain=linear)
    found = solver.solve(solver.prepare(column()), law)
    layer = SoilLayer.from_coefficients(COEFFICIENTS, 7.5, ((1.0, 2.0), (0.5, 40.0)))
    exact = LayeredConsolidation([layer], 1e-4, ramp=1e-3)
    for profile in found.profiles[1:]:
        u = -profile.u[:, 1].min()
        assert u == pytest.approx(exact.settlement(profile.time), abs=2e-3 * exact.settlement(60.0)), (
            profile.time
        )
        p = float(exact.pressure(np.array([0.0]), profile.time)[0])
        assert profile.p.max() == pytest.approx(p, abs=2e-3 * layer.initial_pressure(1e-4)), profile.time


def test_a_run_that_is_interrupted_goes_on_to_the_last_bit(tmp_path):
    Solver = pytest.importorskip("porocore_fem_skfem.macro").SkfemMacroSolver
    law = RelaxingLaw(mean_gradient_law(), 2)
    problem = column(4, 1e-3, load=-0.05)
    whole = Solver().solve(Solver().prepare(problem), law)

    class Enough(Exception):
        pass

    for stop in (2, 7, len(whole.history.time) - 2):
        path, steps = tmp_path / f"{stop}.h5", []

        def interrupt(report, steps=steps, stop=stop):
            steps.append(report)
            if len(steps) == stop:
                raise Enough

        solver = Solver(checkpoint_seconds=0)
        with pytest.raises(Enough):
            solver.solve(solver.prepare(problem), law, checkpoint=path, on_step=interrupt)
        found = Solver().solve(Solver().prepare(problem), law, checkpoint=path)
        np.testing.assert_array_equal(found.history.settlement, whole.history.settlement)
        theirs = whole.profiles[-1].arrays()
        for name, values in found.profiles[-1].arrays().items():
            np.testing.assert_array_equal(values, theirs[name], err_msg=name)
    assert {"internal/overstress_1", "internal/relaxed_pressure", "internal/mean_grad"} <= theirs.keys()
