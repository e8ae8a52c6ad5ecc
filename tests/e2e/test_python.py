"""The Python of the tour and of its page runs, on a coarse study, and says what the command line says."""

import json
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

import porocore
from porocore.errors import ConfigurationError, RunFolderError
from porocore.study.run.folder import FinishedRun
from tests.e2e.study import LOADS, write_study

ROOT = Path(__file__).parents[2]
#: The finished run was made with one thread; this process may have more, which sum in another order.
ROUND_OFF = 1e-12


def blocks(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


@pytest.fixture
def place(study, a_copy, tmp_path, monkeypatch):
    """A folder with the coarse study as my.yaml, done in runs/mine but for one solution."""
    shutil.copy(study, tmp_path / "my.yaml")
    shutil.move(a_copy(f"solutions/linear_load{LOADS[0]!r}.h5"), tmp_path / "runs/mine")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_python_of_the_documents_runs(place, finished, undrawn, capsys):
    pytest.importorskip("xarray")
    pytest.importorskip("pyvista")
    (script,) = blocks("docs/tour.md")
    assert len([line for line in script.splitlines() if line]) <= 10
    names = {}
    exec(compile(script, "docs/tour.md", "exec"), names)
    printed = [line.split() for line in capsys.readouterr().out.splitlines()]
    metrics = json.loads((finished / "metrics.json").read_text(encoding="utf-8"))["macro"]
    assert [float(load) for load, _ in printed] == list(LOADS)
    ratios = [case["settlement_ratio"] for case in metrics]
    assert [float(ratio) for _, ratio in printed] == pytest.approx(ratios, rel=ROUND_OFF)
    assert names["samples"].responses.stress.shape == (len(names["samples"].x), 3, 3)
    assert set(names["history"].dims) == {"time", "surface", "component", "drain"}
    assert names["history"].settlement.attrs["units"] == "1"
    assert names["body"].n_cells == 8
    assert_same_results_of_all_loads(place / "runs/mine", finished)
    names = {}
    for block in blocks("docs/python.md"):
        # Studies of a cell and sweeps take long: tests/verification/test_studies.py and tests/study/test_sweep.py have
        # them, and the slow suite runs the whole page in tests/docs/test_snippets.py.
        if "study_sensitivity" not in block and ".sweep(" not in block:
            exec(compile(block, "docs/python.md", "exec"), names)
    assert np.array_equal(names["plug"].config.macro.boundary["y+"].traction, (0, -0.04, 0))
    assert names["plug"].config.sampling.inputs["p"].range == (0, 0.1)
    assert names["coarser"].config.macro.loads == (-0.1,)
    assert np.allclose(names["problem"].conductivity[1, 1], 0.766, rtol=0.02)
    assert names["response"].stress[0, 1, 1] == pytest.approx(-0.1045, rel=0.01)
    assert not (place / "runs/study").exists(), "nothing is written before the first stage"


def assert_same_results_of_all_loads(folder, finished):
    for name in ("solutions", "surrogate.h5"):
        assert (folder / name).exists()
    for path in sorted((finished / "solutions").iterdir()):
        here = porocore.MacroSolution.load_file(folder / "solutions" / path.name)
        there = porocore.MacroSolution.load_file(path)
        np.testing.assert_allclose(
            here.history.settlement, there.history.settlement, rtol=ROUND_OFF, err_msg=path.name
        )


@pytest.mark.parametrize("kind", ["surrogate", "linear"])
def test_the_law_is_that_of_the_solved_body(study, a_copy, kind):
    """The drained column is uniform in each element, so that its means are those of its points."""
    own = porocore.Study(study, out=a_copy(), progress=False)
    laws = own.solve()[LOADS[0]]
    profile = (laws.linear if kind == "linear" else laws.nonlinear).profile()
    found = own.law(kind).response(profile.grad_u, profile.element_p)
    np.testing.assert_allclose(found.stress[:, 1, 1], profile.stress[:, 1, 1], rtol=1e-3)
    K_ref = profile.conductivity if kind == "linear" else profile.reference_conductivity
    np.testing.assert_allclose(found.conductivity, K_ref, rtol=1e-3, atol=1e-3)
    assert not found.flagged.any()


def test_a_finished_run_that_is_read_stays_finished(study, a_copy):
    """Else the next ``run --resume`` writes its report again."""
    folder = a_copy()
    assert FinishedRun.find(folder) is not None
    own = porocore.Study(study, out=folder, progress=False)
    own.sample()
    own.law()
    own.solve()
    assert FinishedRun.find(folder) is not None


def test_a_solver_of_ones_own_gives_the_settlement_of_the_body(study, a_copy, capsys):
    sys.path.insert(0, str(ROOT / "examples"))
    try:
        from own_column import compare
    finally:
        sys.path.pop(0)
    own = porocore.Study(study, out=a_copy(), progress=False)
    for kind in ("surrogate", "linear"):
        here, there = compare(own, LOADS[0], kind)
        np.testing.assert_allclose(here, there, rtol=0, atol=0.02 * there[-1])
        assert here[-1] == pytest.approx(there[-1], rel=2e-3)
    assert "settlement" in capsys.readouterr().out


def test_a_folder_of_another_study_is_refused(finished, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    other = porocore.Study(write_study(tmp_path / "other.yaml", {"sampling.tolerance": 0.2}), out=finished)
    with pytest.raises(RunFolderError, match=r"sampling\.tolerance"):
        other.sample()


def test_faults_of_settings_are_told_by_their_keys():
    with pytest.raises(ConfigurationError) as error:
        porocore.Study(
            "crosscheck", macro={"loads": [0], "body": {"kind": "bax"}}, cell={"viscosity": "1 mm"}
        )
    lines = sorted(str(error.value).splitlines())
    assert lines[0].startswith(
        "settings: cell.viscosity: '1 mm' has a unit, but the configuration has no scales"
    )
    assert lines[1] == (
        "settings: macro.body.kind: expected one of box, cylinder, quarter-cylinder, wedge, axisymmetric, "
        "plane-strain, file, got 'bax'; did you "
        "mean 'box'?"
    )
    assert lines[2] == "settings: macro.loads: a load of 0 moves nothing; remove it"
    with pytest.raises(
        ConfigurationError, match=r"^settings: cell.geometry.radius: expected a number with 0 <"
    ):
        porocore.CellProblem({"geometry": {"radius": 0.7}})


def test_the_study_in_si_units_is_the_same_run(a_copy, tmp_path, capsys):
    """Nothing is computed again, and the results come with units."""
    pytest.importorskip("xarray")
    folder = a_copy()
    changes = {
        "scales": {"modulus": "2.5 kPa", "length": "10 mm", "pore": "5 um"},
        "cell.viscosity": "1 mPa s",
        "output_units": {"length": "mm", "stress": "Pa", "time": "min"},
        "sampling.inputs.p": {"range": ["-50 Pa", "0.15 kPa"], "step": "1e-4 MPa"},
        "macro.body.size": ["1 mm", "7.5 cm", "1 mm"],
        "macro.boundary.y+": {"traction": [0, "2.5 kPa", 0], "pressure": "0 Pa"},
    }
    study = porocore.Study(write_study(tmp_path / "si.yaml", changes), out=folder)
    solved = study.solve()[LOADS[0]].linear
    notes = capsys.readouterr().err.splitlines()
    assert len(notes) == 2 * len(LOADS)
    assert all("is there already" in note for note in notes)
    dataset = solved.to_xarray()
    np.testing.assert_allclose(dataset.settlement, 10 * solved.settlement, rtol=1e-14)
    assert (dataset.settlement.attrs["units"], dataset.time.attrs["units"]) == ("mm", "min")
