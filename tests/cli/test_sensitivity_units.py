"""``porocore sensitivity`` in a study with scales: pressures with units in, table and figures with units out."""

import csv

import numpy as np
import pytest

from porocore.commands.sensitivity.command import parse_loads, print_ends
from porocore.commands.sensitivity.figures import FIGURES
from porocore.commands.sensitivity.plan import HalfLine, StudyPlan, Sweep
from porocore.commands.sensitivity.results import Sensitivity, line_name, write_table
from porocore.commands.sensitivity.study import LoadedState
from porocore.core.units import OutputUnits, ResultUnits, Scales, using_units
from porocore.errors import ConfigurationError
from porocore.states import CellExtrema, CellResponse, CellTangent, Status

UNITS = ResultUnits(Scales(modulus=2e3, length=1e-2, pore=5e-6), OutputUnits(stress="kPa"))
PLAN = StudyPlan({"uniaxial": Sweep(0.0, 0.2, 0.1), "pressure": Sweep(-0.4, 0.0, 0.2)})


def made_up(status):
    n = len(status)
    tangent = CellTangent(np.full((n, 3, 3, 3, 3), -0.2), np.tile(-0.1 * np.eye(3), (n, 1, 1)))
    extrema = CellExtrema(np.full((n, 3, 3), 0.5), *(np.full(n, 0.3) for _ in range(6)))
    volume = np.full(n, 0.4)
    return CellResponse(
        np.zeros((n, 3, 3)), np.array(status), volume, np.zeros((n, 3, 3)), volume, tangent, extrema
    )


@pytest.fixture
def study():
    status = [Status.converged, Status.contact, Status.converged]
    lines = {
        line_name(name, sign): HalfLine(name, sign, np.linspace(0, goal, 3), made_up(status), np.zeros(3))
        for name, sign, goal in PLAN.half_lines()
    }
    return Sensitivity(PLAN, "one", made_up([Status.converged]), np.eye(3), lines, {})


def test_pressures_may_be_given_in_units():
    plan = parse_loads("pressure=-1 kPa:0.2:500 Pa,shear=-0.5:0.5", 0.01, UNITS.scales)
    assert plan.sweeps["pressure"] == Sweep(-0.5, 0.2, 0.25)
    assert (plan.sweeps["shear"].lower, plan.sweeps["shear"].upper) == (-0.5, 0.5)


@pytest.mark.parametrize(
    ("text", "scales", "message"),
    [
        (
            "pressure=-1 mm:0",
            UNITS.scales,
            "--loads pressure: expected a pressure, such as 2 kPa, got '-1 mm'",
        ),
        (
            "pressure=-1 kPa:0",
            None,
            "--loads pressure: '-1 kPa' has a unit, but the configuration has no scales",
        ),
        ("shear=-1 kPa:0", UNITS.scales, "--loads: expected goals and a step such as shear="),
        ("pressure=1 kPa:2 kPa", UNITS.scales, "got 0.5 and 1 in multiples of the modulus"),
    ],
)
def test_what_is_no_pressure_is_refused(text, scales, message):
    with pytest.raises(ConfigurationError, match=message):
        parse_loads(text, 0.01, scales)


def test_the_printed_ends_and_progress_have_units(study, capsys):
    """The ends were multiples of E, in a study that gives its pressures in kPa."""
    with using_units(UNITS):
        print_ends(study)
        assert str(LoadedState("pressure", -0.4, Status.contact)) == "-0.8 kPa contact"
        assert str(LoadedState("shear", -0.4, Status.contact)) == "-0.4 contact"
    uniaxial, pressure = capsys.readouterr().out.splitlines()[1:]
    assert uniaxial.split()[2:5] == ["0.1", "–", "0.2"]
    assert pressure.split()[2:7] == ["−0.4", "kPa", "–", "−0.8", "kPa"]


def test_the_table_has_units(study, tmp_path):
    with using_units(UNITS), write_table(tmp_path, study).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    found = [(row["load"], row["value"], row["unit"]) for row in rows]
    assert found[:3] == [("uniaxial", "0", "-"), ("uniaxial", "0.1", "-"), ("uniaxial", "0.2", "-")]
    assert found[3:] == [("pressure", "-0.8", "kPa"), ("pressure", "-0.4", "kPa"), ("pressure", "0", "kPa")]
    told = {"Q_11 [1/kPa]": -0.05, "Q_hat_11 [1/kPa]": -0.05, "biot [kPa]": 20 / 3, "biot_hat [kPa]": 20 / 3}
    told |= {"max_energy [kPa]": 0.6, "avg_energy [kPa]": 1.0, "M_1111": -0.2, "Kt_11": 1.0}
    for name, value in told.items():
        assert float(rows[0][name]) == pytest.approx(value, rel=1e-7), name


def drawn(figure):
    return [axes.get_lines()[0].get_xydata() for axes in figure.axes if axes.lines]


def test_figures_have_units(study):
    with using_units(UNITS):
        biot, panels = FIGURES["Biot_Modulus"](study), FIGURES["Mijkl_reference"](study)
    # One axis for all loads: a pressure as large as the scale of stress stands where a strain is 1.
    assert biot.axes[0].get_xlabel() == "load: components of $H$ [–], or $p$ in multiples of 2 kPa"
    assert biot.axes[0].get_ylabel().endswith("[kPa]")
    np.testing.assert_allclose(drawn(biot)[0], [[x, 20 / 3] for x in (0, 0.1, 0.2)])
    assert [axes.get_xlabel() for axes in panels.axes[:2]] == ["$H_{11}$ [–]", "$p$ [kPa]"]
    np.testing.assert_allclose(drawn(panels)[1], [[x, -0.2] for x in (-0.8, -0.4, 0)])
    assert FIGURES["psi_max"](study).axes[0].get_ylabel() == r"maximum of $\Psi$ [$E$]"


def test_a_figure_of_the_pressure_alone_has_its_unit(study):
    lines = {"pressure-": study.lines["pressure-"]}
    alone = Sensitivity(
        StudyPlan({"pressure": PLAN.sweeps["pressure"]}), "one", study.rest, np.eye(3), lines, {}
    )
    with using_units(UNITS):
        figure = FIGURES["Q_11"](alone)
    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == (
        "$p$ [kPa]", r"$\langle Q \rangle_s$ [1/kPa]"
    )  # fmt: skip
    np.testing.assert_allclose(drawn(figure)[0], [[-0.8, -0.05], [-0.4, -0.05], [0, -0.05]])
