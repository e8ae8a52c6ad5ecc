"""Files of measured data, as testing machines and spreadsheets write them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from porocore.commands.calibration.loading import read_plan
from tests.helpers.command_run import Ended
from tests.helpers.stranger_case import FOLDERS, Case


def _clean(path: Path, thousands: str = "") -> np.ndarray:
    """Numbers of a file without anything around them, converted here."""
    lines = path.read_bytes().decode("latin-1").splitlines()
    rows = [line for line in lines if re.match(r"\d", line)]
    return np.array(
        [
            [float(cell.replace(thousands or "_", "").replace(",", ".")) for cell in row.split(";")]
            for row in rows
        ]
    )


RELAX = _clean(FOLDERS / "csv-paren" / "relax_paren.csv")


def _relaxation(folder: Path, done: Ended | None) -> None:
    (path,) = folder.glob("cal_*.yaml")
    (curve,) = read_plan(path).curves
    times, forces = RELAX[:, 0], RELAX[:, 1].copy()
    if "unitsrow" not in path.name and "paren" not in path.name:
        # Two times stand there twice, the second time with these forces.
        forces[times == 3.920] = np.mean([forces[times == 3.920][0], 0.8641])
        forces[times == 8.764] = np.mean([forces[times == 8.764][0], 2.8178])
    np.testing.assert_allclose(curve.displayed_times, times, rtol=1e-13)
    np.testing.assert_allclose(curve.measured, forces, rtol=1e-13)
    # The scales of the study: 1 MPa (3 mm)² = 9 N, and L² μ/(E d²) = 3.6 s.
    assert curve.factor == pytest.approx(9, rel=1e-14)
    np.testing.assert_allclose(curve.times, times * 60 / 3.6, rtol=1e-13)


def _creep_and_relaxation(folder: Path, done: Ended | None) -> None:
    relax, creep = read_plan(folder / "both_thousand.yaml").curves
    rows = _clean(folder / "creep.csv", thousands=".")
    assert rows[-1].tolist() == [3480, 271.93, 1.5]
    np.testing.assert_allclose(creep.displayed_times, rows[:, 0], rtol=1e-13)
    np.testing.assert_allclose(creep.measured, rows[:, 1], rtol=1e-13)
    rows = _clean(folder / "relax0.csv")
    rows = rows[rows[:, 0] <= 40]
    np.testing.assert_allclose(relax.displayed_times, rows[:, 0], rtol=1e-13)
    np.testing.assert_allclose(relax.measured, rows[:, 1], rtol=1e-13)


def _with_separator_line(folder: Path) -> None:
    """The file of a German Excel: a line that says what separates."""
    path = next(folder.glob("relax_*.csv"))
    path.write_bytes(b"sep=;\r\n" + path.read_bytes().replace(b"\n", b"\r\n"))


def _in_utf_16(folder: Path) -> None:
    path = next(folder.glob("relax_*.csv"))
    path.write_bytes(path.read_bytes().decode("latin-1").encode("utf-16"))


VALUES = "relax: force: 96 values from 0 to 59.502 min; they are 0.0051 to 3.1932 N"
TWICE = "note: relax: force: 4 rows have 2 times between them; the mean of the rows at one time counts"
CASES = [
    Case("csv-machine", ("check", "cal_machine.yaml"), says=(VALUES, TWICE, "no faults"), check=_relaxation),
    Case("csv-latin1", ("check", "cal_latin1.yaml"), says=(VALUES, TWICE), check=_relaxation),
    Case("csv-unitsrow", ("check", "cal_unitsrow.yaml"), says=(VALUES,), never=("note",), check=_relaxation),
    Case("csv-paren", ("check", "cal_paren.yaml"), says=(VALUES,), never=("note",), check=_relaxation),
    Case(
        "csv-thousands",
        ("check", "both_thousand.yaml"),
        says=(
            "relax: force: 84 values from 0.202 to 38.626 min; they are 0.2357 to 3.1932 N",
            "creep: settlement: 80 values from 6 to 3480 s; they are 14.15 to 271.93 µm",
            "next: porocore calibrate both_thousand.yaml",
        ),
        check=_creep_and_relaxation,
    ),
    Case(
        "csv-paren",
        ("check", "./cal_paren.yaml"),
        says=(VALUES,),
        before=_with_separator_line,
        check=_relaxation,
    ),
    Case(
        "csv-latin1",
        ("check", "./cal_latin1.yaml"),
        says=(VALUES, TWICE),
        before=_in_utf_16,
        check=_relaxation,
    ),
]
