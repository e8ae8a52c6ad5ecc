"""A study of a column whose solid swells in time, from the command line, against the solved cell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.optimize import brentq

from porocore.interfaces.solution import MacroSolution
from porocore.study.api.solved import CellProblem
from tests.e2e.test_family_sample import called

STRETCH, HEIGHT, AREA = 1.06, 2.0, 0.01
MESH = {"size": 0.5, "fluid_size": 0.5, "element": "linear"}
SIDE = {"displacement": [0, None, 0]}
STUDY = {
    "cell": {"material": {"swelling": {"range": [1.0, 1.1]}}, "mesh": MESH},
    "sampling": {
        "sampler": "sobol",
        "inputs": {"H22": {"range": [-0.05, 0.2]}, "p": {"range": [-0.1, 0.05]}},
        "options": {"count": 24, "states_per_member": 3},
        "test": {"count": 2},
        "workers": 1,
    },
    "surrogate": {"backend": "polynomial"},
    "closure": "potential",
    "macro": {
        "body": {"kind": "box", "size": [0.1, HEIGHT, 0.1], "elements": [1, 4, 1]},
        "boundary": {
            **dict.fromkeys(("x-", "x+", "z-", "z+"), SIDE),
            "y-": {"displacement": [0, 0, 0]},
            "y+": {"pressure": 0},
        },
        "loads": [1.0],
        "time": {"end": 400, "step": 50, "ramp_increments": 2, "ramp_step": 0.25, "profiles": []},
        "fields": {
            "swelling": {"formula": str(STRETCH), "initial": 1.0, "over": {"ramp": 1.0, "until": 0.5}}
        },
    },
}


def solutions(folder: Path, study: dict) -> list[MacroSolution]:
    """The solutions of a study with the law of its cell and the linear one, without its report."""
    path = folder / "study.yaml"
    folder.mkdir(exist_ok=True)
    path.write_text(yaml.safe_dump(study, sort_keys=False))
    run = folder / "run"
    called("sample", path, "--out", run, "--no-store")
    called("train", run, "--no-store")
    called("solve", run, "--no-store")
    laws = ("potential", "linear")
    return [MacroSolution.load_file(run / "solutions" / f"{law}_load1.0.h5") for law in laws]


@pytest.fixture(scope="module")
def in_time(tmp_path_factory: pytest.TempPathFactory) -> MacroSolution:
    return solutions(tmp_path_factory.mktemp("in_time") / "a", STUDY)[0]


@pytest.mark.slow
def test_a_swelling_body_rises_and_takes_up_fluid_as_a_cell_held_sideways(in_time: MacroSolution) -> None:
    cell = CellProblem({"material": {"swelling": STRETCH}, "mesh": MESH}, store=False)
    dry = CellProblem({"mesh": MESH}, store=False).response(np.zeros((3, 3)), tangent=False)

    def upright(strain: float) -> object:
        return cell.response(np.diag([0, strain, 0]), tangent=False)

    strain = brentq(lambda x: upright(x).stress[0, 1, 1], 0.0, 0.2, xtol=1e-12)
    top = np.isclose(in_time.points[:, 1], HEIGHT)
    rise = in_time.profiles[-1].u[top, 1]
    np.testing.assert_allclose(rise, HEIGHT * strain, rtol=1e-4)
    taken_up = (upright(strain).fluid_volume[0] - dry.fluid_volume[0]) * HEIGHT * AREA
    assert -in_time.history.drained[-1] == pytest.approx(taken_up, abs=1e-4 * HEIGHT * AREA)
    assert not in_time.history.flagged.any()


@pytest.mark.slow
def test_a_constant_swelling_is_the_study_of_its_number(tmp_path: Path) -> None:
    """One learns a family whose swelling is known exactly, the other a single cell with a stress at rest."""
    time = {"end": 4, "step": 1, "ramp_increments": 1, "ramp_step": 0.1, "profiles": []}
    constant = {**STUDY, "macro": {**STUDY["macro"], "fields": {"swelling": STRETCH}, "time": time}}
    number = {**constant, "cell": {"material": {"swelling": STRETCH}, "mesh": MESH}}
    number["macro"] = {key: value for key, value in number["macro"].items() if key != "fields"}
    number["sampling"] = {**STUDY["sampling"], "options": {"count": 24}}
    pairs = zip(solutions(tmp_path / "a", constant), solutions(tmp_path / "b", number), strict=True)
    for one, other in pairs:
        rise = np.abs(other.profiles[-1].u).max()
        assert rise > 0.1
        np.testing.assert_allclose(one.profiles[-1].u, other.profiles[-1].u, rtol=0, atol=1e-3 * rise)
        drained = np.abs(other.history.drained).max()
        np.testing.assert_allclose(one.history.drained, other.history.drained, rtol=0, atol=2e-3 * drained)
