"""``porocore check`` on a calibration: the data of a section and of a file of its own, without a solved cell."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from porocore import ConfigurationError, Study
from porocore.cli.entry import app
from porocore.core.files.plain_data import merged
from porocore.study.config.loading import benchmark_path, load_config
from porocore.study.run.folder import RunFolder

CREEP = "time;settlement\n0;0\n1;1.000.000,5\n1;3.000.000,5\n2;4.000.000\n"
OBSERVATIONS = {
    "creep": {"quantity": "settlement", "file": "creep.csv", "factor": 1e-6, "deviation": 1e5},
    "planned": {"quantity": "drained", "times": {"first": 1, "last": 90, "count": 8}, "deviation": 0.1},
}
#: A check by linear poroelasticity solves the undeformed cell and the body; neither need be fine here.
COARSE = {
    "cell": {"mesh": {"size": 0.5, "fluid_size": 0.5}},
    "macro": {"loads": [-0.05], "body": {"elements": [1, 8, 1]}},
    "closure": "mean-gradient",
}
UNKNOWNS = {"modulus": {"lower": 0.5, "upper": 2}}
OUTLINE = "creep: 3 values from 0 to 2; they are 0 to 4; deviation 0.0707 to 0.1, 1.77 to 2.5 % of the largest value"
SAID = (
    "unknown modulus from 0.5 to 2\n",
    f"{OUTLINE}\n",
    "planned: 8 times from 1 to 90; no values yet; deviation 0.1\n",
    "creep: 2 rows have the same time; their mean counts\n",
)


@pytest.mark.parametrize("alone", [False, True])
def test_check_reads_the_data_of_a_calibration(
    alone: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = yaml.safe_load(benchmark_path().read_text(encoding="utf-8"))
    study = merged(study, COARSE)
    section = {"unknowns": UNKNOWNS, "observations": OBSERVATIONS}
    files = {"study.yaml": study if alone else {**study, "calibration": section}}
    if alone:
        experiments = {"test": {"study": "study.yaml", "observations": OBSERVATIONS}}
        files["calibration.yaml"] = {"unknowns": UNKNOWNS, "experiments": experiments}
    for name, data in files.items():
        (tmp_path / name).write_text(yaml.safe_dump(data), encoding="utf-8")
    (tmp_path / "creep.csv").write_text(CREEP, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    name = [*files][-1]
    done = CliRunner().invoke(app, ["check", name])
    assert done.exit_code == 0, done.output
    for words in SAID:
        assert words in done.output, done.output
    assert f"no faults; next: porocore calibrate {name} --synthetic\n" in done.output
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*files, "creep.csv"])


def test_check_from_python_reads_the_data_of_a_calibration(tmp_path: Path) -> None:
    study = yaml.safe_load(benchmark_path().read_text(encoding="utf-8"))
    section = {"unknowns": UNKNOWNS, "observations": {"creep": OBSERVATIONS["creep"]}}
    study = merged(study, {**COARSE, "calibration": section})
    path, data = tmp_path / "study.yaml", tmp_path / "creep.csv"
    path.write_text(yaml.safe_dump(study), encoding="utf-8")
    data.write_text(CREEP, encoding="utf-8")
    assert f"  {OUTLINE}" in Study(path, progress=False).check()
    data.write_text(CREEP.replace("4.000.000", "x"), encoding="utf-8")
    with pytest.raises(
        ConfigurationError, match=r"creep\.csv:5: settlement: expected a finite number, got 'x'"
    ):
        Study(path, progress=False).check()
    with pytest.raises(ConfigurationError, match=r"creep\.csv: expected a CSV file|creep\.csv: no such file"):
        Study({**study, "title": "from settings"}, progress=False).check()


@pytest.mark.parametrize(("unknown", "noted"), [("modulus", True), ("load", False)])
def test_check_notes_values_whose_sign_the_load_excludes(
    unknown: str, noted: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not where the load is fitted, which may then have another sign."""
    study = yaml.safe_load(benchmark_path().read_text(encoding="utf-8"))
    bounds = UNKNOWNS["modulus"] if unknown == "modulus" else {"lower": -0.1, "upper": 0.1}
    section = {"unknowns": {unknown: bounds}, "observations": {"creep": OBSERVATIONS["creep"]}}
    study = merged(study, {**COARSE, "calibration": section})
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(study), encoding="utf-8")
    (tmp_path / "creep.csv").write_text("time;settlement\n0;0\n1;-1\n2;-3\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["check", "study.yaml"])
    assert done.exit_code == 0, done.output
    words = "note: creep: the values reach -3e-06, below 0, but the study presses y+, so that the settlement is above 0"
    assert (words in done.output) == noted, done.output


def test_a_run_folder_finds_the_data_of_its_calibration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its configuration lies elsewhere than the study, to whose folder the path of the data is relative."""
    study = yaml.safe_load(benchmark_path().read_text(encoding="utf-8"))
    section = {"unknowns": UNKNOWNS, "observations": {"creep": OBSERVATIONS["creep"]}}
    study = merged(study, {**COARSE, "calibration": section})
    data = tmp_path / "lab" / "study.yaml"
    data.parent.mkdir()
    data.write_text(yaml.safe_dump(study), encoding="utf-8")
    (data.parent / "creep.csv").write_text(CREEP, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    folder = RunFolder.claim(tmp_path / "runs" / "lab", load_config(Path("lab/study.yaml")))
    monkeypatch.chdir(data.parent)
    done = CliRunner().invoke(app, ["check", str(folder.path / "config.yaml")])
    assert done.exit_code == 0, done.output
    assert f"{OUTLINE}\n" in done.output
    assert RunFolder.open(folder.path).config.identity == load_config(data).identity


def test_studies_of_experiments_are_found_from_a_run_folder(tmp_path: Path) -> None:
    calibration = {
        "experiments": {"file": {"study": "b.yaml", "observations": {"study": {"file": "sub/x.csv"}}}},
        "unknowns": {"radius": {"lower": 0.1, "upper": "0.2"}},
    }
    study = yaml.safe_load(benchmark_path().read_text(encoding="utf-8"))
    path = tmp_path / "a.yaml"
    path.write_text(yaml.safe_dump({**study, "calibration": calibration}), encoding="utf-8")
    found = load_config(path).sections["calibration"]
    experiment = found["experiments"]["file"]
    assert experiment["study"] == str(tmp_path / "b.yaml")
    assert experiment["observations"]["study"]["file"] == str(tmp_path / "sub" / "x.csv")
    assert found["unknowns"] == calibration["unknowns"]
