"""The studies of the commands, called from Python: files, results, resuming, refusals."""

import numpy as np
import pytest

import porocore
from porocore.cell.stability.map import LineSettings, MapPlan
from porocore.commands.sensitivity.plan import StudyPlan, Sweep
from porocore.errors import ConfigurationError, RunFolderError
from porocore.states import Status


@pytest.fixture(scope="module")
def config():
    """The packaged case on linear elements, of which a state takes a moment."""
    mesh = {"size": 0.25, "fluid_size": 0.2, "element": "linear"}
    return porocore.Study("crosscheck", cell={"mesh": mesh}).config


def test_a_stability_map_is_made_and_resumed(config, tmp_path, undrawn, capsys):
    plan = MapPlan({"H22": -0.02}, "p", (0.0, 0.01), LineSettings(steps=1))
    found = porocore.map_stability(config, tmp_path, plan, workers=1, progress=True)
    assert [len(line) for line in found.lines] == [2, 2]
    assert "stability: 4 of 4 states; took" in capsys.readouterr().err
    assert all(path.parent == tmp_path and path.exists() for path in (*found.tables, found.picture))
    with pytest.raises(RunFolderError, match="already holds a map; add --resume"):
        porocore.map_stability(config, tmp_path, plan)
    again = porocore.map_stability(config, tmp_path, plan, resume=True, progress=True)
    assert capsys.readouterr().err == "stability: 4 of 4 states are there already\n"
    assert np.array_equal(again.lines[1].stress, found.lines[1].stress)


def test_a_map_of_impossible_states_is_refused_before_its_folder_is_made(config, tmp_path):
    plan = MapPlan({"H22": -2.0}, "p", (0.0,))
    with pytest.raises(ConfigurationError, match="det F = -1"):
        porocore.map_stability(config, tmp_path / "map", plan)
    assert not (tmp_path / "map").exists()


def test_a_sensitivity_study_is_made_and_resumed(config, tmp_path, undrawn, capsys):
    plan = StudyPlan({"pressure": Sweep(0.0, 0.02, 0.01)})
    found = porocore.study_sensitivity(config, tmp_path, plan, workers=1, progress=True)
    assert "sensitivity: 2 of 2 states; took" in capsys.readouterr().err
    assert found.table.exists()
    assert found.pictures
    assert all(path.exists() for path in found.pictures.values())
    with pytest.raises(RunFolderError, match="already holds a study; add --resume"):
        porocore.study_sensitivity(config, tmp_path, plan, workers=1)
    again = porocore.study_sensitivity(config, tmp_path, plan, workers=1, resume=True, progress=True)
    assert capsys.readouterr().err == "sensitivity: 2 of 2 states are there already\n"
    assert list(again.study.lines) == list(found.study.lines) == ["pressure+"]


def test_local_fields_are_written_under_the_name_of_their_state(config, tmp_path):
    found = porocore.write_local_fields(config, tmp_path / "new", {"H22": -0.05, "p": 0.01}, pictures=False)
    assert found.vtu == tmp_path / "new" / "H22_-0.05_p_0.01.vtu"
    assert found.vtu.exists()
    assert found.pictures == {}
    assert found.response.status[0] == Status.converged


def test_a_reproduction_names_what_it_knows(tmp_path):
    with pytest.raises(ConfigurationError, match="unknown publication 'biot1941'; expected dehghani2022"):
        porocore.reproduce("biot1941", tmp_path)
    with pytest.raises(ConfigurationError, match="there is no figure '12'"):
        porocore.reproduce("dehghani2022", tmp_path, figures=["12"])
