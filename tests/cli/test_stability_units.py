"""``porocore stability`` in a study with scales: its tables, files and figure have units."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from porocore.cell.stability.map import EVENTS, LineSettings, MapPlan, StabilityLine, write_tables
from porocore.cell.stability.modes import WAVES
from porocore.commands.stability.command import parse_plan, print_onsets, print_states
from porocore.core.inputs import NAMES
from porocore.core.units import OutputUnits, ResultUnits, Scales, using_units
from porocore.errors import ConfigurationError
from porocore.report.figures.stability import stability_figure
from porocore.states import Status

UNITS = ResultUnits(Scales(modulus=2e3, length=1e-2, pore=5e-6), OutputUnits(stress="kPa"))
#: p runs to 0.4 in a cell at H22 = −0.1, which creases halfway.
PLAN = MapPlan({"p": 0.4}, "H22", (-0.1,), LineSettings(steps=2, tolerance=0.01))


@pytest.fixture
def line():
    start, goal = PLAN.ends(-0.1)
    onsets = np.full((len(EVENTS), 2), np.nan)
    onsets[EVENTS.index("crease")] = 0.5
    return StabilityLine(
        start=start,
        goal=goal,
        share=np.array([0.0, 0.5, 1.0]),
        status=np.array([Status.converged] * 3),
        contact_share=np.zeros(3),
        min_gap=np.ones(3),
        stress=np.zeros((3, 3, 3)),
        pivots=np.zeros((3, len(WAVES)), dtype=int),
        eigenvalues=np.full((3, len(WAVES)), np.nan),
        acoustic=np.full(3, 0.1),
        direction=np.tile([0.0, 1.0, 0.0], (3, 1)),
        onsets=onsets,
    )


def test_pressures_have_the_unit_of_the_study(line, capsys):
    """They were multiples of E, in a study that gives them in kPa."""
    with using_units(UNITS):
        print_states(PLAN, line)
        print_onsets(PLAN, [line])
    words = capsys.readouterr().out
    states, _, onsets = words.partition("p [kPa] at which it begins, ± 0.01")
    assert "acoustic [kPa]" in states.replace("\n", " ")
    assert [word for word in states.split() if word in ("0.4000", "0.8000")] == ["0.4000", "0.8000"]
    assert "0.2000" in states
    assert [word for word in onsets.split() if word in ("−0.1000", "0.4000", "0.8000")] == [
        "−0.1000",
        "0.4000",
        "0.8000",
    ]


def test_pressures_may_be_given_in_units():
    plan = parse_plan("p=0.8 kPa", "H22=-0.1,0", 2, 0.01, False, UNITS.scales)
    assert plan.along == {"p": 0.4}
    plan = parse_plan("H22=-0.1", "p=0, 300 Pa, 0.2", 2, 0.01, False, UNITS.scales)
    assert plan.values == (0, 0.15, 0.2)
    with pytest.raises(ConfigurationError, match="--across: expected a pressure, such as 2 kPa, got '1 mm'"):
        parse_plan("H22=-0.1", "p=1 mm", 2, 0.01, False, UNITS.scales)


def test_without_scales_they_are_multiples(line, capsys):
    print_onsets(PLAN, [line])
    words = capsys.readouterr().out
    assert "p at which it begins, ± 0.005" in words
    assert "0.2000" in words
    assert "kPa" not in words


def read(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_files_have_units_in_the_names_of_their_columns(line, tmp_path):
    line.eigenvalues[:] = 0.5
    with using_units(UNITS):
        states, onsets = map(read, write_tables(tmp_path, PLAN, [line]))
    assert [row["p [kPa]"] for row in states] == ["0", "0.4", "0.8"]
    assert [row["H22"] for row in states] == ["-0.1"] * 3
    assert states[0]["acoustic [kPa]"] == "0.2"
    assert states[0]["eigenvalue_110 [kPa/d²]"] == "1"
    assert (onsets[0]["H22"], onsets[0]["p_crease_from [kPa]"]) == ("-0.1", "0.4")


def labels(figure):
    return {text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel())}


def test_the_figure_has_units(line):
    line.eigenvalues[:] = 0.5
    step = np.eye(10)[NAMES.index("H22")] * 0.1
    other = replace(line, start=line.start - step, goal=line.goal - step)
    with using_units(UNITS):
        figure, both = stability_figure(PLAN, [line]), stability_figure(PLAN, [line, other])
    assert {"pore pressure $p$ [kPa]", "lowest eigenvalue [kPa/$d^2$]", "acoustic\nminimum [kPa]"} <= labels(
        figure
    )
    np.testing.assert_allclose(
        figure.axes[-2].get_lines()[0].get_xydata(), [[0, 0.2], [0.4, 0.2], [0.8, 0.2]]
    )
    crease = next(drawn for drawn in figure.axes[0].get_lines() if drawn.get_label() == "crease")
    assert crease.get_xdata()[0] == pytest.approx(0.4)
    assert {"pore pressure $p$ [kPa]", "$H_{22}$ [–]"} <= labels(both)
    onset = next(drawn for drawn in both.axes[0].get_lines() if str(drawn.get_label()).startswith("crease"))
    np.testing.assert_allclose(onset.get_xydata(), [[0.4, -0.2], [0.4, -0.1]])
    assert both.axes[0].get_xlim() == pytest.approx((-0.024, 0.824))


def test_the_figure_without_scales_is_in_multiples(line):
    line.eigenvalues[:] = 0.5
    found = labels(stability_figure(PLAN, [line]))
    assert {r"pore pressure $p$$\,/E$ [–]", "lowest eigenvalue [$E/d^2$]", "acoustic\nminimum [$E$]"} <= found
