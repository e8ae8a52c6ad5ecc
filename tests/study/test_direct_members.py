"""Direct FE² of bodies whose points have cells of their own parameters, held against the surrogate and the cells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from porocore import CellProblem, Study
from porocore.errors import ConfigurationError
from porocore.sampling.execution.members import MembersAtRest
from porocore.study.stages.stage_files import prepare_undeformed

pytest.importorskip("porocore_fem_skfem")

SIDE = {"displacement": [0, None, 0]}
CELL: dict[str, Any] = {
    "geometry": {"radius": {"range": [0.2, 0.25]}},
    "material": {"poisson_ratio": {"range": [0.3, 0.4]}},
    "mesh": {"size": 0.5, "fluid_size": 0.5, "element": "linear"},
}
#: The radius grows with the height, and one ratio changes while the body settles.
FIELDS = {
    "radius": {"formula": "0.21 + 0.03*y"},
    "poisson_ratio": {"formula": "0.38", "initial": 0.32, "over": {"ramp": 1, "until": 1}},
}
STUDY: dict[str, Any] = {
    "cell": CELL,
    "sampling": {
        "sampler": "sobol",
        "inputs": {"H22": {"range": [-0.08, 0.02]}, "p": {"range": [-0.02, 0.05]}},
        "options": {"count": 12, "states_per_member": 2},
        "test": {"count": 1},
        "workers": 1,
        "executor": "serial",
    },
    "surrogate": {"backend": "polynomial"},
    "closure": "potential",
    "macro": {
        "body": {"kind": "box", "size": [0.1, 1.0, 0.1], "elements": [1, 1, 1]},
        "fields": FIELDS,
        "boundary": {
            **dict.fromkeys(("x-", "x+", "z-", "z+"), SIDE),
            "y-": {"displacement": [0, 0, 0]},
            "y+": {"traction": [0, 1, 0], "pressure": 0},
        },
        "loads": [-0.03],
        "time": {"end": 1.0, "step": 0.5, "ramp_increments": 1, "ramp_step": 0.5},
    },
}


@pytest.mark.slow
def test_a_graded_body_has_the_answer_of_its_surrogate(tmp_path: Path) -> None:
    """The law that solves the cell of each point, and a surrogate of the family, whose parameters vary in time too."""
    study = Study(STUDY, out=tmp_path / "run", progress=False, store=False)
    solved = study.solve(("surrogate", "direct"))[-0.03]
    direct, learned = solved["direct-potential"], solved["potential"]
    assert direct.settlement[-1] > 0.02
    np.testing.assert_allclose(direct.settlement, learned.settlement, atol=1e-4 * direct.settlement[-1])
    here, there = (each.solution.history.pressure_max for each in (direct, learned))
    np.testing.assert_allclose(here, there, atol=1e-3 * there.max())


def test_members_at_rest_are_the_cells_with_their_numbers() -> None:
    theta = np.array([[0.21, 0.35], [0.24, 0.31], [0.21, 0.35]])
    config = Study({**STUDY}, progress=False, store=False).config
    at_rest = MembersAtRest(*prepare_undeformed("skfem", {}, config.cell))
    found = at_rest(theta)
    for k, (radius, ratio) in enumerate(theta):
        member = CellProblem(CELL, parameters={"radius": radius, "poisson_ratio": ratio}, store=False)
        fluid = member.response(np.zeros((3, 3))).fluid_volume
        assert fluid is not None
        assert found.porosity[k] == pytest.approx(fluid[0], rel=1e-12)
        np.testing.assert_allclose(found.conductivity[k], member.conductivity, rtol=1e-10, atol=1e-12)
    with pytest.raises(ConfigurationError, match="radius: expected a number"):
        at_rest(np.array([[0.6, 0.35]]))
