"""Calibrations whose statements were too sharp, or said too late that they say nothing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from porocore.commands.calibration.loading import read_plan
from tests.helpers.command_run import Ended
from tests.helpers.stranger_case import Case

#: Values with which the file was made: MPa, nm and min.
TRUTH = {"modulus": 1.2, "pore": 70.0, "start": -3.0}


def results(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "out" / "calibration.json").read_text(encoding="utf-8"))
    return found


def holds_the_truth(folder: Path, ended: Ended | None) -> None:
    for name, entry in results(folder)["unknowns"].items():
        low, high = entry["interval95"]
        assert low < TRUTH[name] < high, (name, low, high)
        assert entry["identifiable"]


def holds_the_limit_of_short_steps(folder: Path, ended: Ended | None) -> None:
    """Whatever the steps, the intervals hold what ever shorter ones give, which both tolerances foretell alike."""
    holds_the_truth(folder, ended)
    found = results(folder)
    limits = {"modulus": 1.1987, "pore": 70.01, "start": -3.0130}
    for name, entry in found["unknowns"].items():
        limit = entry["value"] + found["error_of_steps"]["shift"][name]
        assert limit == pytest.approx(limits[name], rel=5e-4), name
        low, high = entry["interval95"]
        assert low < limits[name] < high
    assert found["error_of_steps"]["counted"]


def without_a_shift(folder: Path) -> None:
    """Leave out the unknown clock, so that three minutes of preload come too early."""
    given = yaml.safe_load((folder / "cal_shift.yaml").read_text(encoding="utf-8"))
    del given["unknowns"]["start"]
    (folder / "cal.yaml").write_text(yaml.safe_dump(given, allow_unicode=True), encoding="utf-8")


def solved_no_further_cells(folder: Path, ended: Ended | None) -> None:
    assert not (folder / "out" / "cells" / "rounds.json").exists()
    assert not (folder / "out" / "cells" / "fallback.h5").exists()
    assert results(folder)["reduced_misfit"] > 900


def with_a_viscosity(folder: Path) -> None:
    given = yaml.safe_load((folder / "cal_coarse.yaml").read_text(encoding="utf-8"))
    given["unknowns"]["viscosity"] = {"lower": "0.5 mPa s", "upper": "2 mPa s"}
    (folder / "cal.yaml").write_text(yaml.safe_dump(given, allow_unicode=True), encoding="utf-8")


def tells_the_conductivity(folder: Path, ended: Ended | None) -> None:
    found = results(folder)
    (direction,) = found["directions"]
    assert direction["exact"]
    entry = found["products"]["pore²/viscosity"]
    assert (entry["unit"], entry["interval95"][0] < 70.0**2 < entry["interval95"][1]) == ("nm²/(mPa s)", True)
    # By the page of the cell with pores of 50 nm.
    derived = found["derived"]["cells"][0]["numbers"]["hydraulic_permeability"]
    assert derived["unit"] == "m⁴/(N s)"
    low, high = derived["interval95"]
    assert low < 0.0002949 * (70 / 50) ** 2 * 1e-6 / (1e3 * 60) < high
    correlations = found["precision"]["correlations"]
    assert correlations["modulus"]["pore"] is None
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert "another test, another load or another quantity is needed" not in page


def compares_the_clock_with_the_test(folder: Path, ended: Ended | None) -> None:
    plan = read_plan(folder / "cal_shift.yaml")
    assert plan.rule.distances == {"start": pytest.approx(0.1 * 5.782, rel=1e-3)}


CASES = [
    Case("time-shift", "compares a clock with the test", check=compares_the_clock_with_the_test),
    Case(
        "time-shift",
        ("calibrate", "cal_shift.yaml", "--out", "out"),
        says=("the steps in time are long for these data", "start would be -3.013 min instead of -2.988 min"),
        check=holds_the_limit_of_short_steps,
        slow=True,
    ),
    Case(
        "time-shift",
        ("calibrate", "cal_shift_fine.yaml", "--out", "out"),
        says=("start would be -3.013 min instead of -2.997 min",),
        check=holds_the_limit_of_short_steps,
        slow=True,
    ),
    Case("time-shift", ("calibrate", "cal_coarse.yaml", "--out", "out"), check=holds_the_truth, slow=True),
    Case(
        "time-shift",
        ("calibrate", "cal.yaml", "--out", "out"),
        before=without_a_shift,
        says=(
            "the reduced chi-square is 992",
            "Check its clock",
            "the fitted pore lies at the bound of the search, 15 nm",
            "no further cells are solved there, since they would not explain the data",
        ),
        check=solved_no_further_cells,
        slow=True,
    ),
    Case(
        "time-shift",
        ("calibrate", "cal.yaml", "--out", "out", "--no-store"),
        before=with_a_viscosity,
        says=(
            "so no test, load or quantity makes it identifiable",
            "identifiable: pore²/viscosity = 4930 nm²/(mPa s) (95 % interval 4833 to 5000)",
        ),
        check=tells_the_conductivity,
        slow=True,
    ),
]
