"""First iterates, kept linearisations and reused factors change the work of a solve, and not its answers."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.macro.integration.newton import ROUND_OFF, Linearisations, Predictor, _round_off, largest_free
from porocore.states import MacroState
from porocore.testing.synthetic.response import AlteredLaw, confined_column, linear_law, mean_gradient_law

SkfemMacroSolver = pytest.importorskip("porocore_fem_skfem.macro").SkfemMacroSolver
PLAN = {"end": 6.0, "step": 0.5, "ramp_increments": 4, "ramp_step": 0.05, "profiles": ()}


def solved(law, load=-0.1):
    """Return solution and number of systems that were assembled."""
    problem = confined_column(6, load=load, time=PLAN)
    solver = SkfemMacroSolver()
    d = solver.prepare(problem)
    count, assemble = [], d.system
    d.system = lambda *of: count.append(of[1]) or assemble(*of)
    return solver.solve(d, law), count


def test_a_parabola_is_continued_exactly_and_ends_at_a_kink():
    predictor, states = Predictor(), lambda t: np.array([1 + t, 2 - 3 * t + t**2])
    for time in (0.0, 0.1, 0.4, 0.5):
        predictor.add(time, states(time), kink=False)
    np.testing.assert_allclose(predictor.guess(0.9), states(0.9), rtol=1e-13)
    predictor.add(0.9, states(0.9), kink=True)
    assert predictor.guess(1.0) is None
    predictor.add(1.0, states(1.0), kink=False)
    np.testing.assert_allclose(predictor.guess(1.1)[0], 2.1, rtol=1e-13)


def test_a_linear_law_says_that_its_tangent_is_constant_and_it_is():
    law, rng = linear_law(), np.random.default_rng(0)
    found = []
    for _ in range(2):
        states = MacroState(0.1 * rng.standard_normal((3, 3, 3)), rng.standard_normal(3))
        memory = law.respond(states, np.zeros((3, 3)), law.initial(3)).memory
        later = MacroState(0.1 * rng.standard_normal((3, 3, 3)), rng.standard_normal(3))
        found.append(law.respond(later, rng.standard_normal((3, 3)), memory).tangent)
    assert law.constant_tangent
    for name, value in vars(found[0]).items():
        if value is None:
            continue
        np.testing.assert_array_equal(value, getattr(found[1], name))
        np.testing.assert_array_equal(value, np.broadcast_to(value[:1], value.shape))


def test_a_constant_tangent_is_assembled_once_for_each_length_of_step_with_the_same_answer():
    law = linear_law()
    kept, systems = solved(law)
    anew, all_systems = solved(AlteredLaw(law, lambda response, states, memory: response))
    assert len(systems) == len(set(systems)) <= 4  # two lengths, and the ends of both stretches
    assert len(all_systems) == len(kept.history.time) - 1
    for name in ("settlement", "pressure_max", "drained"):
        np.testing.assert_allclose(getattr(kept.history, name), getattr(anew.history, name), rtol=1e-11)


def test_one_factor_a_step_leads_to_the_answer_of_newtons_method(monkeypatch):
    law = mean_gradient_law()
    reused, systems = solved(law)
    monkeypatch.setattr(Predictor, "guess", lambda self, time: None)
    monkeypatch.setattr(Linearisations, "serves", lambda *_: False)
    plain, all_systems = solved(law)
    steps = len(plain.history.time) - 1
    assert len(systems) <= 1.25 * steps < 2 * steps < len(all_systems)
    for name in ("settlement", "pressure_max", "drained"):
        np.testing.assert_allclose(getattr(reused.history, name), getattr(plain.history, name), rtol=1e-7)


def test_a_guess_that_leads_nowhere_is_given_up(monkeypatch):
    law = mean_gradient_law()
    plain, _ = solved(law)
    monkeypatch.setattr(Predictor, "guess", lambda self, time: 100 * np.ones_like(self.states[-1]))
    found, _ = solved(law)
    np.testing.assert_array_equal(found.history.time, plain.history.time)
    np.testing.assert_allclose(found.history.settlement, plain.history.settlement, rtol=1e-7)


def test_what_a_step_takes_up_is_round_off_below_that_of_the_fluid_volume():
    """At 1e-7 of the consolidation time, no step could be short enough for 1e-9 of the volume that it took up."""
    d, law = SkfemMacroSolver().prepare(confined_column(6, load=-0.1, time=PLAN)), mean_gradient_law()
    x, dt, eps = np.full(len(d.unknowns), 1e-6), 1e-9, float(np.finfo(float).eps)
    states, grad_p = d.states(x)
    response = law.respond(states, grad_p, law.initial(d.n_points))
    shaken = MacroState(states.grad_u + eps * np.eye(3), states.p)
    residual = d.residual(law.respond(shaken, grad_p, response.memory), dt, d.loads(0.0), x)
    _, volume = largest_free(d, residual.values)
    linear = Linearisations(d, law).at(response, dt, x, d.loads(0.0))
    first, later = (_round_off(d, linear, x, ROUND_OFF, begun=begun)[1] for begun in (False, True))
    assert first < volume < later < 1e3 * volume
    assert d.mesh.share_of_volume == pytest.approx(d.mesh.weights.sum() / 6 / 4)
