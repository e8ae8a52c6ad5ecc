"""``porocore check`` on a calibration: the data of a section and of a file of its own, without a solved cell."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from porocore.cli.entry import app
from porocore.core.files.plain_data import merged
from porocore.study.config.examples import benchmark_path

CREEP = "time;settlement\n0;0\n1;1.000.000,5\n1;3.000.000,5\n2;4.000.000\n"
OBSERVATIONS = {
    "creep": {"quantity": "settlement", "file": "creep.csv", "deviation": 0.1},
    "planned": {"quantity": "drained", "times": {"first": 1, "last": 90, "count": 8}, "deviation": 0.1},
}
UNKNOWNS = {"modulus": {"lower": 0.5, "upper": 2}}
SAID = (
    "unknown modulus from 0.5 to 2\n",
    "creep: 3 values from 0 to 2; they are 0 to 4e+06\n",
    "planned: 8 times from 1 to 90; no values yet\n",
    "creep: 2 rows have the same time; their mean counts\n",
)


@pytest.mark.parametrize("alone", [False, True])
def test_check_reads_the_data_of_a_calibration(
    alone: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = yaml.safe_load(benchmark_path().read_text(encoding="utf-8"))
    study = merged(study, {"macro": {"loads": [-0.05]}, "closure": "mean-gradient"})
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
    assert f"no faults; next: porocore {'calibrate' if alone else 'run'} {name}" in done.output
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*files, "creep.csv"])
