"""A cell solver that provides no more than the interface asks for."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.cli.cell import as_text
from porocore.interfaces.cell import CellSolution
from porocore.study.config.loading import benchmark_path, load_config
from porocore.study.run import reference
from tests.helpers.fake_cell import Fake, FakeCellSolver


class Plain(FakeCellSolver):
    """Without the fields ``lacks`` of its responses."""

    lacks = ("extrema",)

    def solve(self, prepared, states, **how):
        response = super().solve(prepared, states, **how).response
        return CellSolution(replace(response, **dict.fromkeys(self.lacks)))


class Plainest(Plain):
    """Without all that may be None."""

    lacks = ("extrema", "tangent", "potential", "stress", "fluid_volume")


@pytest.mark.parametrize(
    ("solver", "found", "porosity"),
    [(FakeCellSolver, {"tangent", "peaks"}, 0.4), (Plain, {"tangent"}, 0.4), (Plainest, set(), None)],
)
def test_a_state_is_shown_with_what_there_is(monkeypatch, solver, found, porosity):
    monkeypatch.setattr(reference, "prepare_cell", lambda *_: (solver(Fake()), Fake()))
    config = load_config(benchmark_path())
    state = reference.solve_cell(config, np.diag([0.0, -0.1, 0.0]), 0.05)
    assert state["status"] == "converged"
    assert {"tangent", "peaks"} & set(state) == found
    assert state["mean_grad"][1, 1] != 0
    assert (state["stress"] is None) == (solver is Plainest)
    if porosity is None:
        assert state["porosity"] == config.cell.mesh_porosity
    assert "mean_grad" in as_text(state)
