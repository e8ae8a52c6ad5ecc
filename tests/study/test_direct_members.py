"""Direct FE² of bodies whose points have cells of their own parameters, held against the surrogate and the cells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from porocore import CellProblem, Study
from porocore.core.files.plain_data import merged
from porocore.errors import ConfigurationError
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution.members import MembersAtRest
from porocore.study.run.composition import prepare_undeformed

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


@pytest.mark.slow
def test_states_beyond_the_samples_are_solved_with_their_parameters(tmp_path: Path) -> None:
    """Few states, all next to rest: the law that learns on the way has the answer of the cells themselves."""
    near = {"inputs": {"H22": {"range": [-0.01, 0.0]}, "p": {"range": [0.0, 0.01]}}, "options": {"count": 10}}
    settings = merged(STUDY, {"sampling": near, "macro": {"fields": {"poisson_ratio": 0.35}}})
    study = Study(settings, out=tmp_path / "run", progress=False, store=False)
    solved = study.solve(("fallback", "direct"))[-0.03]
    learned, direct = solved["potential-fallback"], solved["direct-potential"]
    states = Dataset.open(study.folder.fallback).states()
    assert len(states) > 0
    assert states.parameters is not None
    # Of the points of the body, between the states that were sampled at the members.
    assert states.grad_u[:, 1, 1].min() < -0.02
    assert len(np.unique(states.parameters[:, 0])) > 1
    assert (states.parameters[:, 1] == 0.35).all()
    np.testing.assert_allclose(learned.settlement, direct.settlement, atol=1e-3 * direct.settlement[-1])
    # The law is not to be trusted at parameters that the body has nowhere, be it at rest.
    law, H = study.law(), np.diag([0.0, -0.004, 0.0])
    for theta, flagged in (((0.225, 0.35), False), ((0.225, 0.31), True), ((0.25, 0.35), True)):
        bound = law.at(dict(zip(law.parameters, theta, strict=True)))
        for grad_u in (H, 0 * H):
            assert bound.response(grad_u, 0.0).flagged.tolist() == [flagged]


@pytest.mark.slow
def test_two_families_in_one_body_with_the_other_backend(tmp_path: Path) -> None:
    """dolfinx solves cells and body of two regions, each with a family of its own, as skfem does."""
    pytest.importorskip("porocore_fem_dolfinx")
    clay = {"geometry": {"radius": {"range": [0.15, 0.2]}}, "mesh": CELL["mesh"]}
    regions = {"deep": {"below": 0.5, "cell": "clay", "fields": {"radius": 0.17}}}
    changes = {
        "cells": {"clay": clay},
        "macro": {
            "body": {"elements": [1, 2, 1]},
            "regions": regions,
            "fields": {"radius": 0.23, "poisson_ratio": 0.35},
        },
    }
    found = []
    for backend in ("skfem", "dolfinx"):
        settings = merged(STUDY, changes | {"fem": {"backend": backend}})
        study = Study(settings, out=tmp_path / backend, progress=False, store=False)
        found.append(study.solve(("surrogate",))[-0.03]["potential"])
        used = [study.config.of_cell(name).used_parameters for name in (None, "clay")]
        assert used == [((0.23, 0.35),), ((0.17,),)]
    one, other = found
    np.testing.assert_allclose(other.settlement, one.settlement, rtol=1e-6)
    np.testing.assert_allclose(other.pressure, one.pressure, rtol=1e-6, atol=1e-12)
