"""A step that fails where the surrogate is not to be trusted says so, in every backend."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.errors import SolveError
from porocore.interfaces.law import MacroLaw
from porocore.states import Doubt
from porocore.testing.macro_checks.runs import NONLINEAR
from porocore.testing.synthetic.response import AlteredLaw, confined_column

TIME = {"ramp_increments": 4, "ramp_step": 1.0, "smallest_step": 0.5, "step": 1.0, "end": 5.0, "profiles": ()}


class Departed(MacroLaw):
    """A law that is asked far from its states, and beyond H22 = −0.04 has no values."""

    name, identity, initial = "departed", "departed", staticmethod(NONLINEAR.initial)
    internal = NONLINEAR.internal

    def __init__(self, flagged):
        self.flagged = flagged

    def respond(self, states, grad_p, memory, *, step=None, tangent=True):
        response = NONLINEAR.respond(states, grad_p, memory, step=step, tangent=tangent)
        stress = np.where(states.grad_u[:, 1:2, 1:2] > -0.04, response.stress, np.nan)
        outside = np.full(len(states), self.flagged) & (np.abs(states.grad_u[:, 1, 1]) > 1e-3)
        return replace(response, stress=stress, doubt=outside.astype(np.int64))

    def reasons(self, states):
        return [f"H22 = {H[1, 1]:.3f}, which was not sampled" for H in states.grad_u]


def test_the_history_has_the_share_of_each_reason(macro_solver, load):
    """Half of a homogeneous block is doubted for two reasons at once, and none of it for others."""
    problem = confined_column(4, load=-0.01, time=TIME)

    def respond(response, states, memory):
        doubt = np.where(np.arange(len(states)) % 2, Doubt.error | Doubt.closed, Doubt.closed)
        return replace(response, doubt=np.where(states.p > -1, doubt, 0).astype(np.int64))

    solver = load("macro solver", macro_solver)
    history = solver.solve(solver.prepare(problem), AlteredLaw(NONLINEAR, respond)).history
    found = {each.name: getattr(history, f"flagged_{each.name}")[-1] for each in Doubt}
    assert found.pop("closed") == pytest.approx(1.0, abs=1e-12) == history.flagged[-1]
    assert 0.2 < found.pop("error") < 0.8
    assert set(found.values()) == {0.0}


def failure(solver, flagged):
    prepared = solver.prepare(confined_column(1, size=(1, 1, 1), load=-0.1, time=TIME))
    with pytest.raises(SolveError) as error:
        solver.solve(prepared, Departed(flagged))
    return str(error.value)


def test_a_failed_step_names_a_flagged_component(macro_solver, load):
    solver = load("macro solver", macro_solver)
    said = failure(solver, flagged=True)
    assert "points are flagged, one of them for H22 = -0.0" in said
    assert "which was not sampled; lower the load" in said
    assert "flagged" not in failure(solver, flagged=False)
