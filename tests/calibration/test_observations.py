"""Measured curves: CSV files with units, deviations and weights, the part that counts; interpolation with slopes."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from porocore.commands.calibration.interpolation import HistoryInterpolation
from porocore.commands.calibration.observations import ObservedCurve, curve_data
from porocore.commands.calibration.reading import read_curve
from porocore.commands.calibration.settings import ObservationSettings
from porocore.core.units import Scales
from porocore.errors import ConfigurationError

SCALES = Scales(modulus=0.5e6, length=1e-3, pore=2e-6, viscosity=1e-3)
TABLE = "time [min], settlement [um], sd [um], w\n0.5, 2, 0.1, 1\n1, 4, 0.2, 4\n2, 6, 0.1, 1\n4, 8, 0.1, 1\n"


def read(
    tmp_path: Path, table: str | bytes = TABLE, scales: Scales | None = SCALES, **changes: Any
) -> ObservedCurve:
    path = tmp_path / "curve.csv"
    path.write_bytes(table if isinstance(table, bytes) else table.encode())
    settings = {"quantity": "settlement", "file": "curve.csv", "deviation_share": 0.01, **changes}
    settings = {key: value for key, value in settings.items() if value is not None}
    if "deviation" in settings or "deviation_column" in settings:
        del settings["deviation_share"]
    return read_curve("creep", ObservationSettings(**settings), tmp_path, scales, 1e9)


def test_values_times_and_units_are_those_of_the_file(tmp_path: Path) -> None:
    curve = read(tmp_path)
    assert curve.measured is not None
    np.testing.assert_allclose(curve.measured, [2, 4, 6, 8])
    time = SCALES.length**2 * SCALES.viscosity / (SCALES.modulus * SCALES.pore**2)  # type: ignore[operator]
    np.testing.assert_allclose(curve.times * time, [30, 60, 120, 240])
    np.testing.assert_allclose(curve.displayed_times, [0.5, 1, 2, 4])
    np.testing.assert_allclose(curve.measured / curve.factor * SCALES.length, [2e-6, 4e-6, 6e-6, 8e-6])
    np.testing.assert_allclose(curve.deviations, 0.08)


def test_deviations_by_number_column_and_weight(tmp_path: Path) -> None:
    np.testing.assert_allclose(read(tmp_path, deviation="0.3 um").deviations, 0.3)
    np.testing.assert_allclose(read(tmp_path, deviation="300 nm", weight=9).deviations, 0.1)
    by_row = read(tmp_path, deviation_column="sd", weight_column="w", factor=-2)
    np.testing.assert_allclose(by_row.deviations, [0.2, 0.2, 0.2, 0.2])
    assert by_row.measured is not None
    np.testing.assert_allclose(by_row.measured, [-4, -8, -12, -16])


def test_an_exponent_without_a_point_is_a_number(tmp_path: Path) -> None:
    """YAML reads 5e-4 as a text."""
    np.testing.assert_allclose(read(tmp_path, deviation="5e-4").deviations, 5e-4)


def test_a_deviation_without_a_unit_is_one_of_the_column_before_the_factor(tmp_path: Path) -> None:
    strain = "time [s],strain [%],sd\n" + "".join(f"{k},{-1.85 - 0.6 * k},0.004\n" for k in range(1, 5))
    settlement = "time [s],settlement [mm]\n" + "".join(f"{k},{0.03 * k}\n" for k in range(1, 5))
    plain = read(tmp_path, settlement, values="settlement", deviation=0.0002)
    taken = {"values": "strain", "unit": "mm", "factor": -0.05, "offset": -1.85}
    for given in ({"deviation": 0.004}, {"deviation": "0.2 um"}, {"deviation_column": "sd"}):
        curve = read(tmp_path, strain, **taken, **given)
        assert curve.measured is not None
        assert plain.measured is not None
        np.testing.assert_allclose(curve.measured, plain.measured)
        np.testing.assert_allclose(curve.deviations, plain.deviations)
        assert curve.outline == plain.outline
    assert plain.outline.endswith(
        "they are 0.03 to 0.12 mm; deviation 0.0002 mm, 0.167 % of the largest value"
    )


def test_only_the_part_between_since_and_until_counts(tmp_path: Path) -> None:
    np.testing.assert_allclose(read(tmp_path, since=1).displayed_times, [1, 2, 4])
    np.testing.assert_allclose(read(tmp_path, since="45 s", until="1 h").displayed_times, [1, 2, 4])


def test_rows_before_loading_are_left_out_by_since(tmp_path: Path) -> None:
    table = "time [min],settlement [um]\n-3,0\n-1,0.1\n0,0\n1,2\n2,3\n"
    np.testing.assert_allclose(read(tmp_path, table, since="0 s").displayed_times, [0, 1, 2])
    with pytest.raises(ConfigurationError, match=r"curve\.csv:3: time: .* got -1; .* by 'since: 0 min'$"):
        read(tmp_path, table, since="-2 min")


def test_other_tables_and_dimensionless_ones(tmp_path: Path) -> None:
    german = "# from the machine\n\nzeit (min);weg [um]\n1;2\n\n2;3\n3;4\n"
    assert len(read(tmp_path, german, time="Zeit")) == 3
    plain = read(tmp_path, "\ufefftime,settlement [-]\n1,2\n2,3\n3,4\n", None)
    assert (plain.unit, plain.factor, plain.time_factor) == ("", 1.0, 1.0)
    keyed = read(tmp_path, "time,x\n1,2\n2,3\n3,4\n", time_unit="h", unit="mm")
    np.testing.assert_allclose(keyed.factor, 1.0)


def test_decimal_numbers_in_all_spellings(tmp_path: Path) -> None:
    curve = read(tmp_path, "time,x\n.5,-1\n+1.,2e-1\n2E0,3.25\n", None, quantity="settlement")
    np.testing.assert_array_equal(curve.times, [0.5, 1, 2])
    assert curve.measured is not None
    np.testing.assert_array_equal(curve.measured, [-1, 0.2, 3.25])


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas_are_read_where_no_comma_separates(tmp_path: Path, separator: str) -> None:
    table = "time [min],settlement [um]\n0.5,2\n1e1,4.25\n1e2,-6.5\n".replace(",", separator).replace(
        ".", ","
    )
    curve = read(tmp_path, table)
    np.testing.assert_allclose(curve.displayed_times, [0.5, 10, 100])
    np.testing.assert_array_equal(curve.measured, [2, 4.25, -6.5])


REFUSED = {
    "no file": (None, {"file": "other.csv"}, "other.csv: no such file"),
    "empty": ("", {}, "got an empty file"),
    "no headings": ("1,2\n2,3\n3,4\n", {}, "curve.csv:1: expected a line of headings"),
    "a name alone above the numbers": (
        "Machine X\n1;2\n2;3\n3;4\n",
        {},
        "curve.csv:2: expected a line of headings above the numbers, by which columns are named, got none; add one, "
        "such as 'time [s]; settlement [mm]'",
    ),
    "mass": (
        "time,s [kg]\n1,2\n2,3\n3,4\n",
        {"quantity": "force", "surface": "y+"},
        "s: expected a force, such as 10 mN, got 'kg', which is a mass; did you mean 'kgf', the weight of that mass, "
        "9.80665 N for 1 kg? correct it in the file",
    ),
    "stress": (
        "time,s [kPa]\n1,2\n2,3\n3,4\n",
        {"quantity": "force", "surface": "y+"},
        "s: expected a force, such as 10 mN, got 'kPa', which is a pressure; a force is the stress times the area of "
        "the whole specimen: give 'unit: N' and as 'factor:' this area in m² times 1000, such as 0.02827 for a disc of "
        "6 mm",
    ),
    "stress without its area": (
        "time,s [kPa]\n1,2\n2,3\n3,4\n",
        {"quantity": "force", "surface": "y+", "unit": "N", "factor": -1},
        "unit: expected 'kPa', the unit of 's' in",
    ),
    "time in German": (
        "Zeit [s];Kraft [um]\n1;2\n2;3\n3;4\n",
        {},
        "no column is called 'time'; the headings in line 1 are Zeit, Kraft; give 'time: Zeit', whose unit is one of "
        "time",
    ),
    "ragged": ("time,s\n1,2\n2\n3,4\n", {}, "curve.csv:3: expected 2 entries"),
    "text": ("time,s\n1,2\n2,x\n3,4\n", {}, "curve.csv:3: s: expected a finite number, got 'x'"),
    "nan": ("time,s\n1,2\n2,nan\n3,4\n", {}, "curve.csv:3: s: expected a finite number, got 'nan'"),
    "inf": ("time,s\n1,2\n2,-inf\n3,4\n", {}, "got '-inf'"),
    "comma and points": (
        "time;s\n1;2.5\n2;2,5\n3;4\n",
        {},
        "curve.csv:3: s: expected decimal points, as in '2.5' in line 2, got '2,5'; write all numbers of the column",
    ),
    "thousands": (
        "time;s\n1;2\n2;1,000,0\n3;4\n",
        {},
        "curve.csv:3: s: expected a finite number, got '1,000,0'",
    ),
    "no headings, commas": ("0,1;2\n0,2;3\n", {}, "curve.csv:1: expected a line of headings"),
    "hole": ("time,s\n1,2\n2,\n3,4\n", {}, "got ''"),
    "time back": (
        "time,s\n1,2\n3,3\n2,4\n",
        {},
        "curve.csv:4: time: expected increasing times, got 2 after 3",
    ),
    "time twice": ("time,s\n1,2\n1,3\n2,4\n", {}, "expected at least 3 rows with different times, got 2"),
    "time before": ("time,s\n-1,2\n1,3\n2,4\n", {}, "curve.csv:2: time: expected a time from 0"),
    "no time": ("t,s\n1,2\n", {}, "no column is called 'time'; the headings in line 1 are t, s"),
    "twice": ("time,s,s\n1,2,3\n", {"values": "s"}, "the heading 's' is there 2 times"),
    "which": ("time,a,b\n1,2,3\n", {}, "values: missing;"),
    "misspelt": (
        TABLE,
        {"values": "setlement"},
        "no column is called 'setlement'; did you mean 'settlement'?",
    ),
    "of another quantity": (
        "time,s [kPa]\n1,2\n2,3\n3,4\n",
        {},
        "s: expected a length, such as 5 mm, got 'kPa', which is a",
    ),
    "unknown unit": ("time [parsnip],s\n1,2\n2,3\n3,4\n", {}, "the unit 'parsnip' is not known"),
    "two units": (TABLE, {"unit": "mm"}, "unit: expected 'um', the unit of 'settlement' in"),
    "no scales": (TABLE, {"scales": None}, "'min' is a unit, but the configuration has no scales"),
    "blanks between columns": (
        "time s\n1 2\n2 3\n3 4\n",
        {},
        "curve.csv:1: expected at least two columns, got one heading, 'time s'; separate columns by a comma",
    ),
    "few": (TABLE, {"since": 1.5}, "expected at least 3 times from 1.5, got 2 of the"),
    "deviation unit": (TABLE, {"deviation": "1 s"}, "deviation: expected a length, such as 5 mm, got '1 s'"),
    "deviation zero": (TABLE, {"deviation": 0}, "deviation: expected a number above 0, got 0"),
    "deviation column": (
        TABLE.replace("0.2", "0"),
        {"deviation_column": "sd"},
        "curve.csv:3: sd: expected a number above 0, got 0",
    ),
    "bytes": (
        b"time,s\n\x81,1\n",
        {},
        "curve.csv:2: expected text in UTF-8, UTF-16 or Windows-1252 (Latin-1), got",
    ),
    "behind the end": ("time,s\n1,2\n2,3\n1e12,4\n", {}, "lies behind the end of the study"),
}


@pytest.mark.parametrize(
    ("heading", "height", "told"),
    [
        ("strain [%]", 4.0, "got '%', a strain; a settlement is the strain times the height of 4 mm: give "
         "'unit: mm' and 'factor: 0.04'"),
        ("strain [-]", 4.0, "got a strain; a settlement is the strain times the height of 4 mm: give "
         "'unit: mm' and 'factor: 4'"),
        ("strain", 4.0, "'unit: mm' and 'factor: 4'"),
        ("s [%]", 100.0, "the height of 0.1 m: give 'unit: m' and 'factor: 0.001'"),
        ("s [%]", None, "the strain times the height: give 'unit: mm' and 'factor: the height/100'"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("unit", [None, "um"])
def test_a_strain_is_no_settlement(
    heading: str, height: float | None, told: str, unit: str | None, tmp_path: Path
) -> None:
    """Also where 'unit:' calls it a length, which makes 10 % of 4 mm to 10 µm."""
    path = tmp_path / "curve.csv"
    path.write_text(f"time [s],{heading}\n1,2\n2,3\n3,4\n", encoding="utf-8")
    data = {"quantity": "settlement", "file": "curve.csv", "deviation_share": 0.01, "unit": unit}
    scales = Scales(modulus=1e3, length=1e-3, pore=1e-6, viscosity=1e-3)
    with pytest.raises(ConfigurationError, match=re.escape(told)):
        read_curve("creep", ObservationSettings(**data), tmp_path, scales, 1e9, height=height)
    if height:
        data |= dict(re.findall(r"'(unit|factor): ([\w.]+)'", told))
        curve = read_curve("creep", ObservationSettings(**data), tmp_path, scales, 1e9, height=height)
        assert curve.measured is not None
        share = 0.01 if "%" in heading else 1
        np.testing.assert_allclose(curve.measured / curve.factor, height * share * np.array([2, 3, 4]))


def test_a_stress_times_the_area_is_a_force(tmp_path: Path) -> None:
    """2 kPa on 28.27 mm² are 0.05655 N."""
    table = "time [s],s [kPa]\n1,2\n2,3\n3,4\n"
    curve = read(
        tmp_path, table, SCALES, quantity="force", surface="y+", unit="N", factor=1000 * np.pi * 3e-3**2
    )
    assert curve.unit == "N"
    assert curve.measured == pytest.approx([0.0565487, 0.0848230, 0.1130973], rel=1e-5)


def test_exchanged_columns_are_noted(tmp_path: Path) -> None:
    table = "settlement [um],time [s]\n{}"
    exchanged = read(tmp_path, table.format("1,.1\n2,.2\n3,.3\n4,.4\n5,.4\n6,.4\n7,.4\n"), SCALES)
    assert exchanged.notes == (
        "4 rows have the same time; their mean counts; the values rise from row to row, so the two columns may be "
        "exchanged",
    )
    plateau = read(tmp_path, table.format("1,.1\n2,.2\n2,.3\n4,.4\n5,.4\n6,.4\n7,.4\n"), SCALES)
    assert plateau.notes == ("4 rows have the same time; their mean counts",)


def test_times_behind_the_end_that_have_no_unit_say_so(tmp_path: Path) -> None:
    """One unit of time is 0.5 ms: L² μ_c/(E d²)."""
    table = "time,settlement [um]\n{},1\n60,2\n110,3\n"
    settings = ObservationSettings(quantity="settlement", file="curve.csv", deviation=0.1)

    def refused(first: int, scales: Scales | None, **changes: Any) -> str:
        (tmp_path / "curve.csv").write_text(table.format(first).replace("[um]", "[um]" if scales else ""))
        with pytest.raises(ConfigurationError) as error:
            read_curve("creep", settings.model_copy(update=changes), tmp_path, scales, 20.0)
        return str(error.value)

    assert refused(1, SCALES) == (
        "the last time 110 lies behind the end of the study at 20, both multiples of the study's scale of time, "
        "0.0005 s, since the times have no unit; give 'time_unit:' or a heading such as 'time [min]', otherwise raise "
        "its macro.time.end, or give 'until:'"
    )
    assert "give 'time_unit:' or a heading such as 'time [min]', otherwise times count from" in refused(
        30, SCALES
    )
    for scales, changes in ((SCALES, {"time_unit": ""}), (SCALES, {"time_unit": "s"}), (None, {})):
        for first in (1, 30):
            assert "unit" not in refused(first, scales, **changes)


@pytest.mark.parametrize("case", REFUSED)
def test_bad_tables_are_refused_in_one_message(case: str, tmp_path: Path) -> None:
    table, changes, words = REFUSED[case]
    scales = SCALES if "scales" not in changes else None
    settings = {key: value for key, value in changes.items() if key != "scales"}
    with pytest.raises(ConfigurationError) as refused:
        read(tmp_path, TABLE if table is None else table, scales, **settings)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_made_up_data_scatter_as_they_say_and_are_the_same_again(tmp_path: Path) -> None:
    times = {"first": "1 s", "last": "1 h", "count": 4000}
    planned = ObservationSettings(
        quantity="settlement", times=times, unit="um", time_unit="s", deviation_share=0.02
    )
    curve = read_curve("creep", planned, tmp_path, SCALES, 1e9, synthetic=True)
    assert curve.displayed_times[[0, -1]] == pytest.approx([1, 3600])
    exact = np.linspace(1, 5, len(curve))
    one, other, again = (curve.made_up(exact, [seed, 0]) for seed in (1, 2, 1))
    data = curve_data([one])
    np.testing.assert_allclose(data.deviations, 0.1)
    assert np.std(data.values - exact) == pytest.approx(0.1, rel=0.05)
    np.testing.assert_array_equal(one.measured, again.measured)
    assert np.corrcoef(one.measured - exact, other.measured - exact)[0, 1] < 0.1  # type: ignore[operator]


def test_only_the_part_between_since_and_until_is_planned(tmp_path: Path) -> None:
    times = {"first": 0, "last": 4, "count": 5, "spacing": "linear"}
    settings = {"quantity": "settlement", "times": times, "time_unit": "s", "deviation": 0.1}

    def planned(**changes: Any) -> ObservedCurve:
        observation = ObservationSettings(**settings, **changes)
        return read_curve("creep", observation, tmp_path, SCALES, 1e9, synthetic=True)

    np.testing.assert_allclose(planned(since="1 s", until=3).displayed_times, [1, 2, 3])
    with pytest.raises(ConfigurationError, match=r"^since: expected at least 2 times from 4, got 1 of the 5"):
        planned(since=4)


def test_interpolation_is_exact_on_straight_lines_and_has_the_slope_of_differences() -> None:
    steps = np.array([0.0, 0.1, 0.3, 1.0, 2.0])
    times = np.array([0.05, 0.3, 0.9, 1.7, 2.0, 3.0, -0.5])
    found = HistoryInterpolation.at(steps, times)
    np.testing.assert_allclose(found.values(3 * steps + 1), 3 * np.clip(times, 0, 2) + 1, rtol=1e-14)
    both = np.stack([steps, -steps], axis=1)
    np.testing.assert_allclose(found.values(both)[:, 1], -np.clip(times, 0, 2), rtol=1e-14)
    series, h = np.sin(steps), 1e-7
    inside = times[[0, 2, 3]]
    later, earlier = (HistoryInterpolation.at(steps, inside + sign * h).values(series) for sign in (1, -1))
    rates = HistoryInterpolation.at(steps, inside).rates(series)
    np.testing.assert_allclose(rates, (later - earlier) / (2 * h), rtol=1e-7)
    assert (found.rates(series)[-2:] == 0).all()
