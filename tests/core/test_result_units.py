"""Units of results: factors, names, texts and tables in the units asked for."""

import numpy as np
import pytest

from porocore.core.units import OutputUnits, ResultUnits, Scales, pretty, value_of
from porocore.interfaces.solution import all_series, write_series


def test_results_come_in_the_units_asked_for():
    units = ResultUnits(
        Scales(modulus=2000, length=0.01, pore=5e-6),
        OutputUnits(length="mm", stress="kPa", time="min", force="mN"),
    )
    scales = units.scales
    expected = {
        "displacement": (10, "mm"),
        "pressure": (2, "kPa"),
        "time": (scales.factor("time") / 60, "min"),
        "force": (200, "mN"),
        "volume": (1000, "mm³"),
        "flow": (scales.factor("flow") * 1e9 * 60, "mm³/min"),
        "velocity": (scales.factor("velocity") * 1e3 * 60, "mm/min"),
        "conductivity": (scales.factor("conductivity") * 1e6 * 1e3 * 60, "mm²/(kPa min)"),
        "": (1, "–"),
    }
    for quantity, (factor, name) in expected.items():
        assert units.factor(quantity) == pytest.approx(factor, rel=1e-14), quantity
        assert units.name(quantity) == name
    assert (ResultUnits().factor("time"), ResultUnits().name("time")) == (1.0, "–")
    assert pretty("um*m^-2") == "µm m⁻²"


def test_a_time_reads_as_it_was_written():
    """One of three read 0.30000000000000004 h after it had been made dimensionless and was converted back."""
    units = ResultUnits(Scales(modulus=2000, length=0.01, pore=5e-6), OutputUnits(time="h"))
    tenths = {k / 10: value_of(f"{k / 10} h", "time", units.scales) for k in range(1, 400)}
    assert any(value * units.factor("time") != hours for hours, value in tenths.items())
    assert [units.value(value, "time") for value in tenths.values()] == list(tenths)
    assert ResultUnits().value(0.1 + 0.2, "time") == 0.1 + 0.2
    assert units.value(0.1 + 0.2, "") == 0.1 + 0.2


def test_the_history_is_a_table_with_units_in_its_header(tmp_path, column):
    solution = column()
    units = ResultUnits(Scales(modulus=2000, length=0.01, pore=5e-6), OutputUnits(length="mm", time="h"))
    for given, header in (
        (units, "time [h],ramp [-],settlement [mm],"),
        (ResultUnits(), "time [-],ramp [-],"),
    ):
        path = write_series(tmp_path / "history.csv", solution, given)
        text = path.read_text(encoding="utf-8")
        assert text.startswith(header)
        table = np.loadtxt(path, delimiter=",", skiprows=1)
        assert table.shape == (len(solution.history.time), len(list(all_series(solution))))
        np.testing.assert_allclose(
            table[:, 2], solution.history.settlement * given.factor("displacement"), rtol=1e-7
        )


def test_results_as_text_have_their_unit():
    units = ResultUnits(
        Scales(modulus=517106.7969876271, length=1e-3, pore=23e-9),
        OutputUnits(length="um", stress="mmHg", time="h"),
    )
    assert units.text(0.1, "pressure") == "387.9 mmHg"
    assert units.text(-0.05, "displacement") == "-50 µm"
    assert (units.text(43.2, "displacement", 3), units.text(4e3, "displacement")) == ("43200 µm", "4e+06 µm")
    assert units.texts((0.1, 1.0, 0), "displacement") == "(100, 1000, 0) µm"
    assert (units.text(0, "time"), units.text(0.5, "")) == ("0", "0.5")
    names = {q: units.name(q) for q in ("compliance", "diffusivity", "permeability", "viscosity")}
    assert names == {
        "compliance": "1/mmHg",
        "diffusivity": "µm²/h",
        "permeability": "m²",
        "viscosity": "Pa s",
    }
    assert units.factor("compliance") * units.factor("stress") == pytest.approx(1, rel=1e-14)
    assert units.factor("diffusivity") * units.factor("time") == pytest.approx(1e6, rel=1e-14)
    assert ResultUnits().text(0.123456, "time") == "0.1235"
