"""A step that fails where the surrogate is not to be trusted says so, in every backend."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.errors import SolveError
from porocore.interfaces.law import MacroLaw
from porocore.testing.macro_laws.runs import NONLINEAR
from porocore.testing.synthetic.response import confined_column

TIME = {"ramp_increments": 4, "ramp_step": 1.0, "smallest_step": 0.5, "step": 1.0, "end": 5.0, "profiles": ()}


class Departed(MacroLaw):
    """A law that is asked far from its states, and beyond H22 = −0.04 has no values."""

    name, identity, initial = "departed", "departed", staticmethod(NONLINEAR.initial)

    def __init__(self, flagged):
        self.flagged = flagged

    def respond(self, states, grad_p, memory, *, tangent=True):
        response = NONLINEAR.respond(states, grad_p, memory, tangent=tangent)
        stress = np.where(states.grad_u[:, 1:2, 1:2] > -0.04, response.stress, np.nan)
        outside = np.full(len(states), self.flagged) & (np.abs(states.grad_u[:, 1, 1]) > 1e-3)
        return replace(response, stress=stress, outside_training_range=outside)

    def reasons(self, states):
        return [f"H22 = {H[1, 1]:.3f}, which was not sampled" for H in states.grad_u]


def failure(solver, flagged):
    prepared = solver.prepare(confined_column(1, size=(1, 1, 1), load=-0.1, time=TIME))
    with pytest.raises(SolveError) as error:
        solver.solve(prepared, Departed(flagged))
    return str(error.value)


def test_it_names_a_flagged_component(macro_solver, load):
    solver = load("macro solver", macro_solver)
    said = failure(solver, flagged=True)
    assert "points are flagged, one of them for H22 = -0.0" in said
    assert "which was not sampled; lower the load" in said
    assert "flagged" not in failure(solver, flagged=False)
