"""Exports of testing machines and spreadsheets: the same numbers from each, or one message that says what to do."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from porocore.commands.calibration.observations import ObservedCurve
from porocore.commands.calibration.reading import read_curve
from porocore.commands.calibration.settings import ObservationSettings
from porocore.commands.calibration.tables import Entry
from porocore.core.units import Scales
from porocore.errors import ConfigurationError

SCALES = Scales(modulus=1e6, length=3e-3, pore=50e-9, viscosity=1e-3)
#: Seconds and newtons that every export holds.
TIMES = np.array([0.0, 0.5, 1.25, 1000.5, 3600.0])
FORCES = np.array([0.0051, 0.2357, 3.1932, 1234.5, -1039.63])


@dataclass(frozen=True)
class Export:
    """Bytes of a file, the keys by which it is read, and the unit of its times."""

    content: bytes
    keys: dict[str, Any] = field(default_factory=dict)
    seconds: float = 1.0


def read(folder: Path, content: bytes, end: float = 1e9, **keys: Any) -> ObservedCurve:
    (folder / "force.csv").write_bytes(content)
    settings = {"quantity": "force", "surface": "y+", "file": "force.csv", "deviation": "0.02 N", **keys}
    return read_curve("force", ObservationSettings(**settings), folder, SCALES, end)


def rows(*lines: str, end: str = "\r\n", code: str = "utf-8") -> bytes:
    return "".join(line + end for line in lines).encode(code)


ZWICK = (
    "Prüfprotokoll;Zwick/Roell Z0.5",
    'Probe "A";Knorpel 3, Ø 6 mm, Höhe 3 mm',
    "Datum;12.03.2025",
    "",
    "Prüfzeit;Standardkraft;Standardweg",
    "s;N;mm",
    "0,00;0,0051;0,0007",
    "0,50;0,2357;0,0114",
    "1,25;3,1932;0,3004",
    "1.000,50;1.234,5;0,2996",
    "3.600,00;-1.039,63;0,3002",
)
ZWICK_KEYS = {"time": "Prüfzeit", "values": "Standardkraft"}
BLOCK = ("0;0.0051", "0.5;0.2357", "1.25;3.1932", "1000.5;1234.5", "3600;-1039.63")
VALUES = [row.split(";")[1] for row in BLOCK]
CLOCK = [
    f"{clock};{value}"
    for clock, value in zip(
        ("00:00:00", "00:00:00.5", "00:00:01.25", "00:16:40.5", "01:00:00"), VALUES, strict=True
    )
]
MINUTES = [
    f"{clock};{value}"
    for clock, value in zip(("00:00", "00:00.5", "00:01.25", "16:40.5", "60:00"), VALUES, strict=True)
]

EXPORTS = {
    "Zwick/Roell testXpert": Export(rows(*ZWICK, code="latin-1"), ZWICK_KEYS),
    "Zwick/Roell testXpert, Mac Roman": Export(
        rows(*(line.replace("Ø", "ø") for line in ZWICK), code="mac-roman"),
        {**ZWICK_KEYS, "encoding": "mac-roman"},
    ),
    "Zwick/Roell testXpert, composed letters apart": Export(
        rows(*(line.replace("ü", "u\u0308") for line in ZWICK)), ZWICK_KEYS
    ),
    "Instron Bluehill": Export(
        rows(
            '"Specimen","Cartilage 3, 6 mm"',
            '"Time","12:41:05 PM"',
            "",
            "Time,Extension,Load",
            "(s),(mm),(N)",
            '"0.00000","0.00000","0.00510"',
            '"0.50000","-0.01140","0.23570"',
            '"1.25000","-0.30040","3.19320"',
            '"1000.50000","-0.29960","1234.50000"',
            '"3600.00000","-0.30020","-1039.63000"',
            code="utf-8-sig",
        ),
        {"values": "Load"},
    ),
    "Instron Bluehill, brackets in brackets": Export(
        rows(
            "Time (s),Strain 1 (Exten. 1) (%),Load (corr.) (N)",
            *("0,0,0.0051", "0.5,1,0.2357", "1.25,2,3.1932", "1000.5,3,1234.5", "3600,4,-1039.63"),
        ),
        {"values": "Load (corr.)"},
    ),
    "TA ElectroForce WinTest": Export(
        rows(
            "File Name:, C:\\WinTest\\relax.tsf",
            "Date:, 3/12/2025",
            "",
            "Points, Elapsed Time , Disp, Load 1",
            " , Sec, mm, N",
            "1, 0.000, 0.001, 0.0051",
            "2, 0.500, 0.011, 0.2357",
            "3, 1.250, 0.300, 3.1932",
            "4, 1000.500, 0.300, 1234.5",
            "5, 3600.000, 0.300, -1039.63",
        ),
        {"time": "Elapsed Time", "values": "Load 1"},
    ),
    "Bose, minutes in capitals": Export(
        rows(
            '"Scan Time","Load"',
            '"MIN","N"',
            "0,0.0051",
            "0.0083333333333333,0.2357",
            "0.0208333333333333,3.1932",
            "16.675,1234.5",
            "60,-1039.63",
        ),
        {"time": "scan time"},
        60,
    ),
    "MTS TestSuite": Export(
        rows(
            "MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A",
            "",
            "Data Acquisition: Timed\t\tTime:\t\t0.1\tSec",
            "Axial Force\tAxial Displacement\tTime",
            "N\tmm\ts",
            "0.0051\t0\t0",
            "0.2357\t0.0114\t0.5",
            "3.1932\t0.3004\t1.25",
            "1234.5\t0.2996\t1000.5",
            "-1039.63\t0.3002\t3600",
        ),
        {"values": "Axial Force"},
    ),
    "TA TRIOS": Export(
        rows(
            "Filename\trelax.tri",
            "[step]",
            "Stress Relaxation",
            "Step time\tAxial force\tGap",
            "s\tN\tum",
            "0.00000\t5.10000e-3\t3000",
            "0.50000\t0.235700\t2988",
            "1.25000\t3.19320\t2700",
            "1000.50\t1234.50\t2700",
            "3600.00\t-1039.63\t2700",
        ),
        {"time": "Step time", "values": "Axial force"},
    ),
    "Excel, German": Export(
        rows(
            "sep=;",
            "Zeit [s];Weg [µm];Kraft [N]",
            "0,00;0;0,0051",
            "0,50;11;0,2357",
            "1,25;300;3,1932",
            "1.000,50;1.299;1.234,50",
            "3.600,00;1.300;-1.039,63",
            code="cp1252",
        ),
        {"time": "Zeit", "values": "Kraft"},
    ),
    "Excel, English": Export(
        rows(
            "sep=,",
            "Time (s),Force (N)",
            "0.00,0.0051",
            "0.50,0.2357",
            "1.25,3.1932",
            '"1,000.50","1,234.50"',
            '"3,600.00","-1,039.63"',
            code="utf-8-sig",
        ),
    ),
    "Excel, French, no-break blanks": Export(
        rows(
            "Temps (s);Force (N)",
            "0,00;0,0051",
            "0,50;0,2357",
            "1,25;3,1932",
            "1\u00a0000,50;1\u00a0234,50",
            "3\u00a0600,00;-1\u00a0039,63",
            code="cp1252",
        ),
        {"time": "Temps"},
    ),
    "Excel, French, narrow blanks": Export(
        rows(
            "Temps (s);Force (N)",
            "0,00;0,0051",
            "0,50;0,2357",
            "1,25;3,1932",
            "1\u202f000,50;1\u202f234,50",
            "3\u202f600,00;\u22121\u202f039,63",
        ),
        {"time": "Temps"},
    ),
    "Excel, Unicode text": Export(
        rows(
            "Zeit [s]\tKraft [N]\tWeg [µm]",
            *("0\t0,0051\t1", "0,5\t0,2357\t2", "1,25\t3,1932\t3", "1000,5\t1234,5\t4", "3600\t-1039,63\t5"),
            code="utf-16",
        ),
        {"time": "Zeit", "values": "Kraft"},
    ),
    "UTF-16 without a mark": Export(
        rows("time [s]\tforce [N]", *(row.replace(";", "\t") for row in BLOCK), code="utf-16-be")
    ),
    "LibreOffice, Swiss": Export(
        rows(
            "Zeit [s];Kraft [N]",
            *("0;0.0051", "0.5;0.2357", "1.25;3.1932", "1'000.5;1’234.5", "3'600;-1’039.63"),
            end="\n",
        ),
        {"time": "Zeit"},
    ),
    "LibreOffice, commas in quotation marks": Export(
        rows(
            "Zeit [s],Kraft [N]",
            *('0,"0,0051"', '"0,5","0,2357"', '"1,25","3,1932"', '"1000,5","1234,5"', '3600,"-1039,63"'),
        ),
        {"time": "Zeit"},
    ),
    "a heading of two lines": Export(rows('"Time\n[s]";"Force\n[N]"', *BLOCK)),
    "DAQ with comments": Export(
        rows(
            "# LabVIEW Measurement",
            "# operator\tme",
            "time [s]\tforce [N]\ttemperature [°C]",
            "0.000\t0.0051\t37.1",
            "# paused",
            *("0.500\t0.2357\t37.1", "1.250\t3.1932\t37.0", "1000.500\t1234.5\t37.0"),
            "3600.000\t-1039.63\t37.0",
            end="\n",
        ),
        {"values": "force"},
    ),
    "headings behind a comment sign": Export(
        rows("# numpy", "# time, force", "# s, N", *(row.replace(";", ", ") for row in BLOCK), end="\n")
    ),
    "keys and values above": Export(
        rows(
            "Test: relaxation",
            "Time: 10:31",
            "Time;10.5",
            "Force;1;2;3",
            "Comment: after 5; 10 and 15 min",
            "Time;Force;",
            "[s];[N];",
            *(f"{row};" for row in BLOCK),
            ";;",
        ),
    ),
    "trailing semicolons": Export(rows("time [s];force [N];;", *(f"{row};;" for row in BLOCK))),
    "carriage returns alone": Export(rows("time [s];force [N]", *BLOCK, end="\r")),
    "cells without a number": Export(
        rows(
            "time [s];force [N];gap [mm]",
            *("0;0.0051;NaN", "0.25;---;1", "0.5;0.2357;1", "0.75;nan;1", "1.25;3.1932;", "9;;1"),
            *("1000.5;1234.5;1", ";;3", "3600;-1039.63;1"),
        ),
        {"values": "force", "missing": ["---", "NaN", ""]},
    ),
    "two blocks": Export(
        rows("1st", "time [s];force [N]", "0;1", "1;2", "2;3", "", "2nd", "time [s];force [N]", *BLOCK),
        {"heading_line": 8},
    ),
    "two blocks, the first": Export(
        rows("1st", "time [s];force [N]", *BLOCK, "", "2nd", "time [s];force [N]", "0;1", "1;2", "2;3"),
        {"heading_line": 2, "last_line": 7},
    ),
    "statistics below": Export(rows("time [s];force [N]", *BLOCK, "Maximum;1234.5"), {"last_line": 6}),
    "a unit that nobody knows": Export(
        rows("Zeit;force", "Sek;N", *BLOCK), {"time": "Zeit", "time_unit": "s"}
    ),
    "units in key, heading and row": Export(
        rows("time [s];force", "s;N", *BLOCK), {"time_unit": "sec", "unit": "N"}
    ),
    "a zero that is none, and another sign": Export(
        rows("time [s];force [N]", *(f"{t:g};{250 - f:.4f}" for t, f in zip(TIMES, FORCES, strict=True))),
        {"offset": "0.25 kN", "factor": -1},
    ),
    "clock times": Export(rows("time;force [N]", *CLOCK)),
    "clock times with decimal commas and a format": Export(
        rows("time;force", "hh:mm:ss;N", *(row.replace(".", ",") for row in CLOCK))
    ),
    "minutes and seconds": Export(rows("time;force [N]", *MINUTES)),
    "minutes and seconds as a spreadsheet names them": Export(rows("time (mm:ss.0);force [N]", *MINUTES)),
    "columns of one name": Export(
        rows("time [s];force [kN];force [N]", *(row.replace(";", ";7;") for row in BLOCK)),
        {"values": "force [N]"},
    ),
}


@pytest.mark.parametrize(
    ("texts", "keys", "seconds"),
    [
        (("0:00:30", "30:00:00", "100:00:01"), {}, (30, 108_000, 360_001)),
        (("59:30", "1:00:30", "1:01:00"), {}, (3570, 3630, 3660)),
        (("00:30", "75:30", "100:00"), {"time_unit": "mm:ss"}, (30, 4530, 6000)),
        (("00:30", "25:30", "100:00"), {"time_unit": "hh:mm"}, (1800, 91_800, 360_000)),
    ],
)
def test_a_clock_goes_on_beyond_a_day(
    tmp_path: Path, texts: tuple[str, ...], keys: dict[str, str], seconds: tuple[float, ...]
) -> None:
    """In seconds, or in minutes where no seconds are."""
    curve = read(tmp_path, rows("time;force [N]", *(f"{text};1" for text in texts)), **keys)
    assert curve.time_unit == ("min" if keys.get("time_unit") == "hh:mm" else "s")
    factor = 60 if curve.time_unit == "min" else 1
    np.testing.assert_allclose(factor * curve.displayed_times, seconds)
    assert not curve.notes


@pytest.mark.parametrize("name", EXPORTS)
def test_an_export_gives_its_numbers(name: str, tmp_path: Path) -> None:
    export = EXPORTS[name]
    curve = read(tmp_path, export.content, **export.keys)
    np.testing.assert_allclose(curve.displayed_times * export.seconds, TIMES, rtol=1e-12, atol=1e-15)
    assert curve.measured is not None
    np.testing.assert_allclose(curve.measured, FORCES, rtol=0 if "offset" not in export.keys else 1e-12)
    assert curve.unit == "N"
    np.testing.assert_allclose(curve.factor, 9)


NUMBERS = {
    "a comma that can only be decimal decides": (("0,505", "1,005", "3,202"), {}, (0.505, 1.005, 3.202)),
    "groups without decimals": (("999", "1,005", "1,003,202"), {}, (999, 1005, 1003202)),
    "groups with decimals": (("0.5", "1,005.2", "3,202"), {}, (0.5, 1005.2, 3202)),
    "an exponent is not in groups": (("1,234E+02", "2,345", "1"), {}, (123.4, 2.345, 1)),
    "four digits are not in groups": (("1234,567", "2,345", "1"), {}, (1234.567, 2.345, 1)),
    "the key decides, decimals": (("1,234", "2,345", "3,456"), {"decimal": ","}, (1.234, 2.345, 3.456)),
    "the key decides, groups": (("1,234", "2,345", "3,456"), {"decimal": "."}, (1234, 2345, 3456)),
    "points, groups by the key": (("1.234", "2.345", "999"), {"decimal": ","}, (1234, 2345, 999)),
    "blanks are groups": (("1 234", "2 345", "12"), {}, (1234, 2345, 12)),
    "other columns decide": (("1,234", "2,345", "3,456"), {"values": "a"}, (1.234, 2.345, 3.456)),
    "groups in other columns decide": (("1.234", "2.345", "999"), {"values": "b"}, (1234, 2345, 999)),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_points_and_commas_mean_what_the_columns_tell(name: str, tmp_path: Path) -> None:
    texts, keys, expected = NUMBERS[name]
    head = f"time [s];{keys.get('values', 'force')} [N]"
    times = {"a": ("0,5", "1", "2"), "b": ("0,5", "1.001,5", "1.002,5")}.get(keys.get("values", ""), "123")
    table = rows(head, *(f"{time};{text}" for time, text in zip(times, texts, strict=True)))
    curve = read(tmp_path, table, **keys)
    assert curve.measured is not None
    np.testing.assert_array_equal(curve.measured, expected)


def force(*texts: str, head: str = "time [s];force [N]") -> bytes:
    return rows(head, *(f"{k};{text}" for k, text in enumerate(texts)))


REFUSED = {
    "a comma before three digits": (
        force("1,234", "2,345", "3,456"),
        {},
        "force.csv:2: force: '1,234' may be 1.234 or 1234, and no number in the columns that are read decides it; add "
        "\"decimal: ','\" for 1.234, or \"decimal: '.'\" for 1234",
    ),
    "a point before three digits": (force("1.234", "2.345", "999"), {}, "'1.234' may be 1.234 or 1234"),
    "one point among commas": (
        force("0,505", "1,005", "1.498"),
        {},
        "force.csv:4: force: '1.498' may be 1.498 or 1498, since the column has decimal commas elsewhere; write all",
    ),
    "one point among commas, with the key": (
        force("0,505", "1,005", "1.498"),
        {"decimal": ","},
        "'1.498' may be 1.498 or 1498",
    ),
    "groups by a comma where commas separate": (
        rows("time [s],force [N]", '0.5,"1,234"', '1.5,"2,345"', "2.5,999"),
        {},
        "'1,234' may be 1.234 or 1234",
    ),
    "points in some numbers where commas separate": (
        rows("time [s],force [N]", "1,1.234", "2,2.345", "3,999"),
        {},
        "'1.234' may be 1.234 or 1234",
    ),
    "points and commas": (
        force("0,5", "0.25", "0,75"),
        {},
        "force.csv:3: force: expected decimal commas, as in '0,5' in line 2, got '0.25'; write all numbers",
    ),
    "not as the key says": (
        force("0.5", "0.25", "0.75"),
        {"decimal": ","},
        "force.csv:2: force: expected a number with decimal commas, as the key 'decimal' says, got '0.5'",
    ),
    "groups of two digits": (force("1,23,456.7", "1", "2"), {}, "got '1,23,456.7'"),
    "two kinds of groups": (force("1 234,567.8", "1", "2"), {}, "got '1 234,567.8'"),
    "commas that separate and are decimal": (
        rows("Zeit [s],Kraft [N]", "0,505,0,0259", "1,005,0,0197"),
        {"time": "Zeit"},
        "force.csv:2: expected 2 entries, one for each heading in line 1, got 4; remove the line, begin it with '#', "
        "end the table above it by 'last_line: 1', or write decimal points",
    ),
    "two blocks": (
        EXPORTS["two blocks"].content,
        {},
        "expected one table with 'time' in its headings, got one in line 2 and another in line 8; keep one in the "
        "file, or say which by 'heading_line: 2' and 'last_line:'",
    ),
    "a clock with half a day": (
        rows("time;force [N]", "12:41:05 PM;1", "12:41:06 PM;2"),
        {},
        "force.csv:2: time: expected a finite number, got '12:41:05 PM'; times count from the beginning of the test; "
        "write them in one unit, such as seconds, or as hh:mm:ss",
    ),
    "minutes or hours": (
        rows("time;force [N]", "00:01;1", "00:02;2"),
        {},
        "force.csv:2: time: '00:01' may be minutes and seconds, or hours and minutes; give 'time_unit: \"mm:ss\"' or "
        "'time_unit: \"hh:mm\"'",
    ),
    "a clock with a unit": (
        rows("time [min];force [N]", "0:00:01;1", "0:00:02;2"),
        {},
        "force.csv:2: time: expected a number in 'min', got the clock time '0:00:01'; give 'time_unit: \"hh:mm:ss\"'",
    ),
    "a clock and numbers": (
        rows("time;force [N]", "0:00:01;1", "2;2"),
        {},
        "force.csv:2: time: expected a number, as in line 3, got the clock time '0:00:01'; write all times alike",
    ),
    "seconds where none are": (
        rows("time [hh:mm];force [N]", "0:00:01;1", "0:00:02;2"),
        {},
        "force.csv:2: time: expected times as hh:mm, got '0:00:01' among others with seconds; give 'time_unit:",
    ),
    "a clock as values": (
        rows("time [s];force [N]", "1;00:00:01", "2;00:00:02"),
        {},
        "force.csv:2: force: expected a finite number, got '00:00:01'",
    ),
    "a format without a clock": (
        rows("time [hh:mm:ss];force [N]", *BLOCK),
        {},
        "the unit 'hh:mm:ss' is not known; correct it in the file, or name a known one by 'time_unit:'",
    ),
    "no number": (
        force("1", "---", "3"),
        {},
        "got '---'; remove the row, or leave out rows with this text by 'missing: ['---']'",
    ),
    "units against units": (
        rows("time [s];force [N]", "min;N", *BLOCK),
        {},
        "force.csv:2: time: expected 's', the unit in the heading, got 'min'; remove one of the two",
    ),
    "units against the key": (
        rows("time;force", "s;N", *BLOCK),
        {"time_unit": "min"},
        "time_unit: expected 's', the unit of 'time' in",
    ),
    "units of another quantity": (
        rows("time;force", "s;mm", *BLOCK),
        {"unit": "N"},
        "unit: expected 'mm', the unit of 'force' in",
    ),
    "a unit that nobody knows": (rows("time;force", "Sek;N", *BLOCK), {}, "the unit 'Sek' is not known"),
    "another encoding": (
        rows(*ZWICK, code="cp850"),
        ZWICK_KEYS,
        "expected text in UTF-8, UTF-16 or Windows-1252 (Latin-1), got bytes that are none; name the encoding with "
        "'encoding:', such as cp850",
    ),
    "an encoding that goes as Latin-1": (
        rows("Время [s];Сила [N]", *BLOCK, code="cp1251"),
        {"time": "Время"},
        "no column is called 'Время'; the headings in line 1 are Âðåìÿ, Ñèëà; the file was read as Windows-1252, if "
        "this is wrong, give 'encoding:'",
    ),
    "an encoding against the mark": (
        rows("time;force", *BLOCK, code="utf-8-sig"),
        {"encoding": "latin-1"},
        "encoding: expected utf-8, by the first bytes of",
    ),
    "not in the encoding": (
        rows("time;force", *BLOCK, "ü", code="latin-1"),
        {"encoding": "utf-8"},
        "force.csv:7: expected text in the encoding utf-8, got bytes that are none",
    ),
    "a workbook": (b"PK\x03\x04" + bytes(80), {}, "expected a CSV file, got an Excel workbook"),
    "null bytes": (
        rows("time;force", "1;2") + bytes(5),
        {},
        "force.csv:3: expected text, got a null byte",
    ),
    "a quotation mark": (
        rows("time;force", "1;2", '2;"3', "3;4"),
        {},
        "force.csv:3: expected entries with separators between them, got a quotation mark that begins an entry and "
        "does not end it; remove it",
    ),
    "headings alone": (
        rows("Specimen 3", "time;force"),
        {},
        "force.csv:2: expected rows of numbers below the headings 'time' and 'force'; add them",
    ),
    "other headings below a block": (
        rows("Specimen 3", "t;F", "s;N", *BLOCK),
        {},
        "no column is called 'time'; the headings in line 2 are t, F",
    ),
    "no row with numbers": (
        rows("time;force", "0;---", "1;---"),
        {"missing": ["---"]},
        "missing: expected rows with numbers in 'time' and 'force', but every row of",
    ),
    "a line without text": (
        rows("time;force", *BLOCK),
        {"heading_line": 9},
        "heading_line: expected the line of the headings in",
    ),
    "statistics below": (
        rows("time [s];force [N]", *BLOCK, "Maximum;1234.5"),
        {},
        "force.csv:7: time: expected a finite number, got 'Maximum'; remove the rows below the table, or end it by "
        "'last_line: 6'",
    ),
    "several statistics below": (
        rows("time [s];force [N]", *BLOCK, "Mittelwert;600", "Max;1234.5"),
        {},
        "got 'Mittelwert'; remove the rows below the table, or end it by 'last_line: 6'",
    ),
    "a row that was cut off": (rows("time;force;gap", "0;1;1", "1;2;1", "2;1,6"), {"values": "force"},
                               "force.csv:4: expected 3 entries"),
    "an offset of another quantity": (
        rows("time [s];force [N]", *BLOCK), {"offset": "3 mm"},
        "offset: expected a force, such as 10 mN, got '3 mm', which is a length",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_known_is_refused_in_one_message(name: str, tmp_path: Path) -> None:
    content, keys, words = REFUSED[name]
    with pytest.raises(ConfigurationError) as refused:
        read(tmp_path, content, **keys)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_every_number_has_one_reading_or_two_that_differ() -> None:
    """Any grouped or plain spelling of a number is read back, or is ambiguous; never another number alone."""
    generator = np.random.default_rng(3)
    for _ in range(2000):
        digits = int(generator.integers(0, 7))
        value = round(float(10 ** generator.uniform(-3, 7)), digits)
        for mark, group in ((".", ","), (",", "."), (",", " "), (".", "'"), (".", ""), (",", "")):
            text = f"{value:,.{digits}f}".replace(",", "g").replace(".", mark).replace("g", group)
            readings = Entry.read(text).readings
            assert float(readings[mark]) == value, text
            others = {float(number) for number in readings.values()} - {value}
            # Two readings differ by the thousand that one separator makes.
            assert all(max(x, value) / min(x, value) == pytest.approx(1000) for x in others if value), text


LOCALES = ((".", ","), (",", "."), (",", "\u00a0"), (".", "'"), (".", ""), (",", ""))


@pytest.mark.parametrize("seed", range(8))
def test_a_table_is_read_right_or_refused_in_every_locale(seed: int, tmp_path: Path) -> None:
    generator = np.random.default_rng(seed)
    read_right, refused = 0, list[str]()
    for _ in range(40):
        mark, group = LOCALES[generator.integers(len(LOCALES))]
        # A file with points between groups and commas between entries is none that a program writes.
        separator = ";\t,"[generator.integers(2 if group == "." else 3)]
        texts, values = [], []
        for exact in (np.cumsum(10 ** generator.uniform(-2, 4, 6)), 10 ** generator.uniform(-3, 6, 6)):
            digits, general = int(generator.integers(0, 5)), bool(generator.integers(2))
            column = [f"{value:,.{digits}f}" for value in exact]
            column = [text.rstrip("0").rstrip(".") if general and "." in text else text for text in column]
            values.append([float(text.replace(",", "")) for text in column])
            column = [text.replace(",", "g").replace(".", mark).replace("g", group) for text in column]
            texts.append([f'"{text}"' if separator in text else text for text in column])
        if (np.diff(values[0]) <= 0).any():
            continue
        table = rows(f"time [s]{separator}force [N]", *map(separator.join, zip(*texts, strict=True)))
        try:
            curve = read(tmp_path, table)
        except ConfigurationError as error:
            refused.append(str(error))
            continue
        np.testing.assert_allclose(curve.displayed_times, values[0], rtol=1e-12)
        assert curve.measured is not None
        np.testing.assert_array_equal(curve.measured, values[1])
        read_right += 1
    assert read_right > 20
    assert [words for words in refused if "' may be " not in words] == []


def test_rows_at_one_time_count_as_their_mean(tmp_path: Path) -> None:
    table = rows(
        "time [s];force [N];sd [N];w", "0;1;0.1;1", "1;2;0.1;1", "1;5;0.2;1", "2;3;0.1;2", "2;6;0.1;1"
    )
    plain = read(tmp_path, table, values="force")
    np.testing.assert_allclose(plain.measured, [1, 3.5, 4.5])  # type: ignore[arg-type]
    np.testing.assert_allclose(plain.deviations, 0.02 / np.sqrt([1, 2, 2]))
    assert plain.notes == ("4 rows have 2 times between them; the mean of the rows at one time counts",)
    keys = {"values": "force", "deviation": None, "deviation_column": "sd", "weight_column": "w"}
    weighted = read(tmp_path, table, **keys)
    # The mean by w/sd², whose precision is the sum of theirs.
    np.testing.assert_allclose(weighted.measured, [1, (200 + 125) / 125, 12 / 3])  # type: ignore[arg-type]
    np.testing.assert_allclose(weighted.deviations, np.array([100, 125, 300]) ** -0.5)


def test_numbers_without_units_in_a_study_with_scales_are_noted(tmp_path: Path) -> None:
    said = [note.split(",")[0] for note in read(tmp_path, rows("time;force", *BLOCK), unit=None).notes]
    assert said == ["'time' has no unit in force.csv", "'force' has no unit in force.csv"]
    assert read(tmp_path, rows("time;force", *BLOCK), unit="", time_unit="s").notes == ()
    assert read(tmp_path, rows("time [s];force [N]", *BLOCK)).notes == ()


def test_times_of_the_day_are_told(tmp_path: Path) -> None:
    table = rows("time;force [N]", "14:03:02;1", "14:03:04;2", "14:03:06;3")
    said = (
        r"force\.csv:2: time: the times begin at 14:03:02, behind the end of the study at 3600 s, and look like times "
        r"of the day; times count from the beginning of the test: subtract that of its beginning from all of them$"
    )
    with pytest.raises(ConfigurationError, match=said):
        read(tmp_path, table, HOUR)


def test_a_first_row_of_ones_is_data(tmp_path: Path) -> None:
    """It was taken for a row of units, and left out."""
    table = rows("time [s];force [N]", "1;1", "2;2", "3;3")
    np.testing.assert_array_equal(read(tmp_path, table).displayed_times, [1, 2, 3])
    unitless = rows("time;force", "s;1", "1;1", "2;2", "3;3")
    np.testing.assert_array_equal(
        read(tmp_path, unitless, quantity="force", unit="N").displayed_times, [1, 2, 3]
    )


def test_falling_times_keep_no_fewer_rows_than_a_curve_has(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"got 50 after 80; sort the rows by their times$"):
        read(tmp_path, rows("time [s];force [N]", "80;1", "50;2", "30;3"))
    with pytest.raises(ConfigurationError, match=r"as by 'last_line: 4'$"):
        read(tmp_path, rows("time [s];force [N]", "1;1", "2;2", "3;3", "1;3"))


#: An hour in the times of the study.
HOUR = float(3600 / SCALES.exact.time)
LAST = {
    "60.01 min": (("0", "1", "2"), True),
    "0.0416667 day": (("0", "0.01", "0.02"), True),
    "1.0001 h": (("0", "0.5", "0.7"), True),
    "3601 s": (("0", "10", "20"), True),
    "60.02 min": (("0", "1", "2"), False),
    "60.1 min": (("0", "1", "2"), False),
    "61 min": (("0", "1", "2"), False),
    "3601. s": (("0", "10.25", "20"), False),
}


@pytest.mark.parametrize("name", LAST)
def test_a_last_time_that_is_rounded_is_the_end_and_no_later_one(name: str, tmp_path: Path) -> None:
    before, is_end = LAST[name]
    last, unit = name.split()
    table = rows(f"time [{unit}];force [N]", *(f"{time};1" for time in (*before, last)))
    if not is_end:
        with pytest.raises(ConfigurationError, match="lies behind the end of the study at"):
            read(tmp_path, table, HOUR)
        return
    curve = read(tmp_path, table, HOUR)
    assert curve.times[-1] == pytest.approx(HOUR, rel=1e-14)
    (note,) = curve.notes
    assert note.startswith(f"the last time, {last} {unit}, is rounded and counts as the end of the study")


def test_an_outline_tells_rows_times_and_values(tmp_path: Path) -> None:
    keys = {**ZWICK_KEYS, "factor": -1000, "unit": "N"}
    curve = read(tmp_path, EXPORTS["Zwick/Roell testXpert"].content, **keys)
    assert curve.outline.startswith("5 values from 0 to 3600 s; they are -1.2345e+06 to 1.0396e+06 N; ")
