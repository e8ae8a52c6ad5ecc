"""Notes on measured curves whose size the study excludes: by linear poroelasticity, and at the start values."""

from __future__ import annotations

import copy
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from porocore.cli.entry import app
from porocore.commands.calibration.expectations import linear_notes, start_notes
from porocore.commands.calibration.loading import read_plan
from porocore.commands.calibration.plan import CalibrationPlan
from porocore.commands.calibration.problem import CurveModel, CurvePrediction
from porocore.errors import SolveError
from porocore.states import Array
from tests.helpers.calibrated_column import STUDY as COLUMN

#: A column of 0.1 mm × 0.1 mm under 25 kPa carries 0.25 mN, whatever its cell is; in long steps.
STUDY: dict[str, Any] = copy.deepcopy(COLUMN)
STUDY["macro"]["time"]["step"] = "600 s"
MODULUS = {"lower": "100 kPa", "upper": "2 MPa"}
FORCE = {"quantity": "force", "surface": "y-", "file": "force.csv", "deviation_share": 0.02}


def plan(folder: Path, unit: str, values: tuple[float, ...], **unknowns: Any) -> CalibrationPlan:
    rows = "".join(f"{60 * (k + 1)},{value}\n" for k, value in enumerate(values))
    (folder / "force.csv").write_text(f"time [s],force [{unit}]\n{rows}", encoding="utf-8")
    section = {"unknowns": unknowns or {"modulus": MODULUS}, "observations": {"press": FORCE}}
    return read_plan({**STUDY, "calibration": section})


CARRIED = (0.2, 0.24, 0.25)


@pytest.mark.parametrize("unit", ["mN", "kN", "uN"])
def test_a_force_is_compared_with_that_of_the_linear_body(
    unit: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    notes = [*linear_notes(plan(tmp_path, unit, CARRIED))]
    if unit == "mN":
        assert not notes
        return
    # Between the bounds the modulus changes by 1/5 to 4.
    told = {
        "kN": "those of the study 2.5e-07 kN by linear poroelasticity, and at most 1.25e-06 kN",
        "uN": "those of the study 250 µN by linear poroelasticity, and at least 50 µN",
    }
    (note,) = notes
    shown = unit.replace("u", "µ")
    assert note.startswith(f"press: the values reach 0.25 {shown} in size, but {told[unit]}")
    assert "check the unit of the values ('unit:' or the heading)" in note


def test_a_settlement_of_a_few_per_cent_read_as_micrometres(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is 44 times too small, of which the softest and the stiffest solid explain 3.3."""
    monkeypatch.chdir(tmp_path)
    bounds = {"modulus": {"lower": "150 kPa", "upper": "1.65 MPa"}}
    press = {"quantity": "settlement", "file": "force.csv", "deviation_share": 0.02}
    own = 0.0
    for size in (None, 1 / 44, 1 / 25, 1.0):
        values = (1e-3, 2e-3, 3e-3) if size is None else (0.3 * own * size, 0.7 * own * size, own * size)
        rows = "".join(f"{60 * (k + 1)},{value}\n" for k, value in enumerate(values))
        (tmp_path / "force.csv").write_text(f"time [s],s [um]\n{rows}", encoding="utf-8")
        section = {"unknowns": bounds, "observations": {"press": press}}
        notes = [*linear_notes(read_plan({**STUDY, "calibration": section}))]
        if size is None:
            own = float(re.findall(r"those of the study ([\d.e+-]+)", notes[0])[0])
        else:
            assert len(notes) == (size < 1 / 30)


def test_bounds_and_loads_that_are_unknown_excuse_any_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    wide = {"modulus": {"lower": "100 kPa", "upper": "100 GPa"}}
    load = {"boundary.y+.traction.y": {"lower": "20 kPa", "upper": "30 kPa"}}
    for unknowns in (wide, load):
        assert not [*linear_notes(plan(tmp_path, "N", CARRIED, **unknowns))]


def test_an_unknown_of_the_cell_is_no_parameter_of_the_linear_cell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The cell in the middle of the bounds is compared, as one without parameters."""
    monkeypatch.chdir(tmp_path)
    radius = {"radius": {"lower": 0.22, "upper": 0.26}}
    assert not [*linear_notes(plan(tmp_path, "mN", CARRIED, **radius))]
    assert len([*linear_notes(plan(tmp_path, "kN", CARRIED, **radius))]) == 1


class Constant(CurveModel):
    """A curve that is the same at all values; None: it cannot be computed."""

    def __init__(self, of: CalibrationPlan, value: float | None) -> None:
        self.unknowns, self.value = tuple(each.unknown for each in of.unknowns), value

    def curves(self, values: Array) -> CurvePrediction:
        if self.value is None:
            raise SolveError("no solution")
        return CurvePrediction(np.full(3, self.value), np.zeros((3, len(values))))


def test_before_the_fit_it_is_compared_with_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    measured = plan(tmp_path, "N", (200.0, 240.0, 250.0))
    assert not [*start_notes(measured, Constant(measured, None))]
    assert not [*start_notes(measured, Constant(measured, 10.0))]
    (note,) = start_notes(measured, Constant(measured, 1.0))
    assert note.startswith(
        "press: the values reach 250 N in size, but those of the study 1 N at the start values, and at most 5 N"
    )


def test_a_check_tells_units_that_are_left_out_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    plan(tmp_path, "mN", CARRIED)
    study = {**STUDY, "macro": {**STUDY["macro"], "time": {**STUDY["macro"]["time"], "step": 1000}}}
    section = {"unknowns": {"modulus": MODULUS}, "observations": {"press": FORCE}}
    (tmp_path / "a.yaml").write_text(yaml.safe_dump({**study, "calibration": section}), encoding="utf-8")
    done = CliRunner().invoke(app, ["check", "a.yaml"])
    assert done.exit_code == 0, done.output
    assert done.output.count("macro.time.step: 1000 has no unit beside") == 1
