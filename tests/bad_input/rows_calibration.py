"""Calibrations whose section, data or folder cannot be used."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tests.bad_input.bad_files import fifo, folder
from tests.bad_input.bad_row import CONFIG, Content, Row, study

CURVE = {"quantity": "settlement", "file": "creep.csv", "deviation": 0.01}
RADIUS = {"lower": 0.2, "upper": 0.3}
SECTION: dict[str, Any] = {"unknowns": {"radius": RADIUS}, "observations": {"creep": CURVE}}
CREEP = "time,settlement\n1,0.1\n2,0.2\n3,0.3\n4,0.35\n"


def row(
    name: str,
    expected: str,
    section: Mapping[str, Any] | None = None,
    data: Content = CREEP,
    words: tuple[str, ...] = (),
    files: Mapping[str, Content] | None = None,
) -> Row:
    made = {
        CONFIG: study({"calibration": {**SECTION, **(section or {})}}),
        "creep.csv": data,
        **(files or {}),
    }
    return Row(f"calibrate {name}", ("calibrate", CONFIG, "--out", "out", *words), (expected,), made)


def unknown(name: str, expected: str, **changes: Any) -> Row:
    return row(f"unknown {name}", expected, {"unknowns": {"radius": {**RADIUS, **changes}}})


def curve(name: str, expected: str, data: Content = CREEP, **changes: Any) -> Row:
    return row(f"curve {name}", expected, {"observations": {"creep": {**CURVE, **changes}}}, data)


def of_unit(name: str) -> str:
    return CREEP.replace("settlement", f"settlement [{name}]")


FILM_CSV = "x,y,z,t,u1,u2\n0.01,1,0.01,1,0,-0.1\n0.05,3,0.01,1,0,-0.2\n0.09,5,0.01,2,0,-0.3\n"


def film(name: str, expected: str, data: Content = FILM_CSV, **changes: Any) -> Row:
    film = {"file": "film.csv", "deviation": 0.01, **changes}
    section = {"observations": {}, "points": {"film": film}}
    return row(f"film {name}", expected, section, files={"film.csv": data})


#: A piston on y+ of the study.
MOVED = {"displacement": [None, 1, None], "traction": [0, 0, 0], "pressure": 0}
KEY = "calibration.observations.creep"
ROWS = [
    curve(
        "of an indenter that is not there",
        f"{KEY}.indenter: expected one with this result, got 'ball'; the run has none",
        quantity="force",
        indenter="ball",
    ),
    unknown(
        "of an indenter that is not there",
        "calibration.unknowns.radius.of: expected a number of the study, got 'contact.ball.radius'",
        of="contact.ball.radius",
    ),
    curve("nan", "creep.csv:3: settlement: expected a finite number, got 'nan'", CREEP.replace("0.2", "nan")),
    curve(
        "infinite",
        "creep.csv:3: settlement: expected a finite number, got 'inf'",
        CREEP.replace("0.2", "inf"),
    ),
    curve(
        "digits in groups",
        "creep.csv:3: settlement: expected a finite number, got '1_000'; remove the row, or write the number alone, "
        "with a decimal point or comma",
        CREEP.replace("0.2", "1_000"),
    ),
    curve(
        "digits of another script",
        "creep.csv:3: settlement: expected a finite number, got '٢'",
        CREEP.replace("0.2", "٢"),
    ),
    curve("hole", "creep.csv:3: settlement: expected a finite number, got ''", CREEP.replace("0.2", "")),
    curve(
        "comma",
        "creep.csv:3: expected 2 entries, one for each heading in line 1, got 3; remove the line, begin it with '#', "
        "end the table above it by 'last_line: 2', or write decimal points",
        CREEP.replace("0.2", "0,2"),
    ),
    curve(
        "two tables",
        "creep.csv: expected one table with 'time' in its headings, got one in line 2 and another in line 7; keep one "
        "in the file, or say which by 'heading_line: 2' and 'last_line:'",
        "Specimen 7\n" + CREEP + CREEP,
    ),
    curve(
        "comma and points",
        "creep.csv:3: settlement: expected decimal points, as in '0.1' in line 2, got '0,2'; write all numbers of the "
        "column alike",
        CREEP.replace(",", ";").replace("0.2", "0,2"),
    ),
    curve(
        "comma and point in a number",
        "creep.csv:3: settlement: expected decimal points, as in '0.1' in line 2, got '1.000,2'",
        CREEP.replace(",", ";").replace("0.2", "1.000,2"),
    ),
    curve(
        "a thousand or one",
        "creep.csv:2: settlement: '1,000' may be 1.000 or 1000, and no number in the columns that are read decides it; "
        "add \"decimal: ','\" for 1.000, or \"decimal: '.'\" for 1000",
        "time;settlement\n1;1,000\n2;2,000\n3;3,000\n",
    ),
    curve(
        "a thousand or one among decimals",
        "creep.csv:4: settlement: '1.300' may be 1.300 or 1300, since the column has decimal commas elsewhere",
        "time;settlement\n1;0,100\n2;1,200\n3;1.300\n",
    ),
    curve(
        "a number against the key",
        "creep.csv:2: settlement: expected a number with decimal commas, as the key 'decimal' says, got '0.1'; change "
        "the key, or the number",
        CREEP,
        decimal=",",
    ),
    curve(
        "a clock",
        "creep.csv:2: time: expected a number, as in line 3, got the clock time '0:01'; write all times alike",
        CREEP.replace("1,", "0:01,"),
    ),
    curve(
        "clock times without scales",
        "creep.csv:2: time: '0:00:01' is a time in seconds, but the configuration has no scales to make it "
        "dimensionless; add 'scales:' with length, pore and modulus at the top level, or write dimensionless times",
        "time,settlement\n0:00:01,0.1\n0:00:02,0.2\n0:00:03,0.3\n",
    ),
    curve("encoding", f"{KEY}.encoding: expected an encoding such as utf-8", encoding="latin-99"),
    curve("heading line", f"{KEY}.heading_line: expected the line of the headings in", heading_line=40),
    curve(
        "units that contradict",
        "creep.csv:2: time: expected 's', the unit in the heading, got 'min'; remove one of the two",
        CREEP.replace("time,settlement", "time [s],settlement\nmin,mm"),
    ),
    curve("workbook", "creep.csv: expected a CSV file, got an Excel workbook", b"PK\x03\x04" + bytes(20)),
    curve(
        "no rows",
        "creep.csv:1: expected rows of numbers below the headings 'time' and 'settlement'; add",
        CREEP[:15],
    ),
    Row(
        "check of two curves",
        ("check", CONFIG),
        (
            "calibration.observations.creep: creep.csv:3: settlement: expected a finite number, got 'x'",
            "calibration.observations.later: creep.csv: no column is called 'clock'; the headings in line 1 are time,",
        ),
        {
            CONFIG: study(
                {
                    "calibration": {
                        **SECTION,
                        "observations": {"creep": CURVE, "later": {**CURVE, "time": "clock"}},
                    }
                }
            ),
            "creep.csv": CREEP.replace("0.2", "x"),
        },
        prints=True,
    ),
    curve(
        "heading with a unit without scales",
        "creep.csv:1: time: 's' is a unit, but the configuration has no scales to make it dimensionless; add 'scales:' "
        "with length, pore and modulus at the top level, or take the unit out of the file",
        CREEP.replace("time", "time [s]"),
    ),
    curve(
        "row of units without scales",
        "creep.csv:2: time: 's' is a unit, but",
        CREEP.replace("settlement\n", "settlement\ns,mm\n"),
    ),
    curve(
        "unit of another quantity",
        "creep.csv:1: time: expected a time, such as 30 s, got 'furlong', which is a length; correct it in the file",
        CREEP.replace("time", "time [furlong]"),
    ),
    curve(
        "unit that nobody knows",
        "the unit 'Sek' is not known; did you mean 's'? correct it in the file, or name a known one by 'time_unit:'",
        CREEP.replace("time", "time [Sek]"),
    ),
    curve(
        "key with a unit of another quantity",
        f"{KEY}.time_unit: expected a time, such as 30 s, got 'furlong', which is a length; change the key",
        time_unit="furlong",
    ),
    curve(
        "zeros with a share",
        f"{KEY}.deviation_share: all values that count are 0 in creep.csv, and so is every share of the largest one; "
        "give 'deviation:' in its place",
        "time,settlement\n1,0\n2,0\n3,0\n",
        deviation=None,
        deviation_share=0.01,
    ),
    curve(
        "since behind the data",
        f"{KEY}.since: expected at least 3 times from 20, got 0 of the 4 of creep.csv, which go from 1 to 4; move it",
        since=20,
    ),
    curve(
        "until before the data", f"{KEY}.until: expected at least 3 times to 0.5, got 0 of the 4", until=0.5
    ),
    curve(
        "since with a comma",
        f"{KEY}.since: expected a number, or one with a unit, got '0,5'; decimals stand",
        since="0,5",
    ),
    unknown(
        "comma",
        "calibration.unknowns.radius.lower: expected a number, or one with a unit, got '0,2'",
        lower="0,2",
    ),
    unknown("switch", "calibration.unknowns.radius.lower: expected a number, got true", lower=True),
    row(
        "share that is yes",
        f"{KEY}.deviation_share: expected a number, got yes, which YAML reads as true",
        files={
            CONFIG: study(
                {
                    "calibration": {
                        **SECTION,
                        "observations": {
                            "creep": {
                                "quantity": "settlement",
                                "file": "creep.csv",
                                "deviation_share": "SHARE",
                            }
                        },
                    }
                }
            ).replace("SHARE", "yes")
        },
    ),
    Row(
        "check of data before the cell",
        ("check", CONFIG),
        ("creep.csv:3: settlement: expected a finite number, got 'x'",),
        {CONFIG: study({"calibration": SECTION}), "creep.csv": CREEP.replace("0.2", "x")},
    ),
    curve(
        "probe that is none",
        f"{KEY}.probe: expected one with this result, got 'q'; the run has none",
        quantity="pressure",
        probe="q",
    ),
    curve(
        "force on a surface that is free",
        f"{KEY}.surface: expected one with this result, got 'y+'; the plane surfaces that are held or moved are x-,",
        quantity="force",
        surface="y+",
    ),
    curve(
        "inflow through a surface without a pressure",
        f"{KEY}.surface: expected one with this result, got 'y-'; the surfaces with a pressure are y+",
        quantity="inflow",
        surface="y-",
    ),
    curve("since after until", "since: expected a time before until, got 3.0 and 1.0", since=3, until=1),
    curve(
        "time back", "creep.csv:4: time: expected increasing times, got 2 after 3", "time,s\n1,1\n3,2\n2,3\n"
    ),
    curve(
        "time twice",
        "creep.csv: expected at least 3 rows with different times, got 2; measure at more times",
        "time,s\n1,1\n1,2\n2,3\n",
    ),
    curve("no headings", "creep.csv:1: expected a line of headings", "1,2\n2,3\n3,4\n"),
    curve("no column", "no column is called 'time'; the headings in line 1 are t, s", "t,s\n1,2\n"),
    curve(
        "other column",
        "no column is called 'depth'; the headings in line 1 are time, settlement",
        values="depth",
    ),
    curve("empty", "creep.csv: expected a line of headings and rows of numbers, got an empty file", ""),
    curve(
        "bytes",
        "creep.csv:2: expected text in UTF-8, UTF-16 or Windows-1252 (Latin-1), got bytes that are none; name the "
        "encoding with 'encoding:'",
        b"time,s\n\x81,1\n",
    ),
    curve("folder", "creep.csv: expected a CSV file, got a folder", folder),
    curve("pipe", "creep.csv: cannot be read: expected a file, got a named pipe", fifo),
    curve("no file", f"{KEY}: ", file="none.csv"),
    curve("no file at all", f"{KEY}.file: missing; add the CSV file", file=None),
    curve("few", f"{KEY}: ", "time,s\n1,1\n2,2\n"),
    curve(
        "unit without scales",
        "settlement: 'mm' is a unit, but",
        of_unit("mm"),
    ),
    curve(
        "wrong unit",
        "settlement: expected a length, such as 5 mm, got 'kPa'",
        of_unit("kPa"),
    ),
    curve(
        "sigma",
        f"{KEY}.sigma: unknown key; the standard deviation of measured values is 'deviation:', or 'deviation_share:'",
        sigma=0.01,
    ),
    row(
        "bounds as a list",
        "calibration.unknowns.radius: expected a section with keys below it, such as {lower: 0.2, upper: 0.3 m} (or",
        {"unknowns": {"radius": [0.2, "0.3 m"]}},
    ),
    curve(
        "behind the end",
        f"{KEY}: the last time 40 lies behind",
        CREEP.replace("4,0", "40,0"),
    ),
    curve(
        "larger than the body",
        f"{KEY}: the settlement reaches 90 in creep.csv; expected less than 7.5, the height of the body",
        CREEP.replace("0.35", "90"),
    ),
    curve(
        "share in percent",
        f"{KEY}.deviation_share: expected a share of the largest value, between 0 and 1, got 2; write 0.02 for 2 %",
        deviation=None,
        deviation_share=2,
    ),
    curve("no deviation", f"{KEY}: expected exactly one of deviation", deviation=None),
    curve("deviation below zero", f"{KEY}.deviation: expected a number above 0, got -1", deviation=-1),
    curve("quantity", f"{KEY}.quantity: expected 'settlement'", quantity="temperature"),
    unknown("bounds", "calibration.unknowns.radius: expected lower < upper, got 0.3 and 0.3", lower=0.3),
    unknown(
        "number",
        "calibration.unknowns.radius.of: expected a number of the study, got 'diameter'",
        of="diameter",
    ),
    unknown(
        "start", "calibration.unknowns.radius.start: expected a value within the bounds, got 0.4", start=0.4
    ),
    row(
        "shifted behind the end",
        "calibration.unknowns.delay.upper: expected at most ",
        {"unknowns": {"radius": RADIUS, "delay": {"of": "time_shift", "lower": 0, "upper": 1e6}}},
    ),
    unknown("no cell", "calibration.unknowns: the bounds span no family of cells", upper=0.8),
    unknown(
        "text",
        "expected a number, or one with a unit, got 'x",
        lower="x" * 100,
    ),
    unknown("nan", "calibration.unknowns.radius.lower: expected a finite number", lower=float("nan")),
    unknown(
        "field backwards",
        "calibration.unknowns.radius.field.at: expected ascending coordinates, got 1 before 0",
        field={"along": "y", "at": [1, 0]},
    ),
    unknown(
        "field outside",
        "calibration.unknowns.radius.field.at: no point of the body has the value at 99",
        field={"along": "y", "at": [0, 98, 99]},
    ),
    unknown(
        "field axis",
        "calibration.unknowns.radius.field.along: expected 'x', 'y' or 'z'",
        field={"along": "r", "at": [0, 1]},
    ),
    unknown(
        "field of nothing",
        "calibration.unknowns.radius.of: expected a parameter of the cell, which alone may be a field over the body, "
        "got 'load'",
        of="load",
        field={"along": "y", "at": [0, 1]},
    ),
    unknown(
        "grid without a line",
        "calibration.unknowns.radius.field: expected either along and at, or a grid of coordinates",
        field={"start": [0.2, 0.25]},
    ),
    unknown(
        "grid beside the body",
        "calibration.unknowns.radius.field.grid: no point of the body has the value at x = 0.2, y = 0",
        field={"grid": {"x": [0, 0.1, 0.2], "y": [0, 5]}},
    ),
    unknown(
        "starts of a grid",
        "calibration.unknowns.radius.field.start: expected 4 values, one for each coordinate, got 2",
        field={"grid": {"x": [0, 0.1], "y": [0, 5]}, "start": [0.2, 0.25]},
    ),
    film(
        "without a file",
        "calibration.points.film.file: missing; add the file of the measured field",
        file=None,
    ),
    film("that is not there", "none.csv cannot be read", file="none.csv"),
    film("without times", "calibration.points.film.columns: ", FILM_CSV.replace(",t,", ",q,")),
    film(
        "of another unit",
        "calibration.points.film.outside: 3 of 3 values of film.csv lie outside the body, more than the share 0.05",
        "x,y,z,t,u2\n10,1000,10,1,-0.1\n50,3000,10,1,-0.2\n90,5000,10,2,-0.3\n",
    ),
    film(
        "of words", "film.csv:3: u2: expected a finite number, got 'much'", FILM_CSV.replace("-0.2", "much")
    ),
    film("without deviations", "calibration.points.film.deviation: missing", deviation=None),
    film("of pressures it has not", "calibration.points.film.quantities: ", quantities=["p"]),
    film(
        "with a time below zero",
        "film.csv:2: t: expected a time from 0",
        FILM_CSV.replace("0.01,1,0.01,1", "0.01,1,0.01,-1"),
    ),
    film("with a frame", "calibration.points.film.frames: film.csv has a column of times", frames=[1.0]),
    film(
        "of a camera twice",
        "calibration.points.film.camera.unknown: a part is there twice",
        camera={"unknown": ["x", "x"]},
    ),
    film(
        "planned by half",
        "calibration.points.film: grid and times of synthetic data belong together",
        file=None,
        grid=[1, 2, 3],
    ),
    row("nothing unknown", "calibration.unknowns: expected at least 1 entry", {"unknowns": {}}),
    row("no observations", "calibration: expected either 'observations:'", {"observations": {}}),
    row(
        "starts",
        "calibration.fit.starts: expected a number with 1 <= starts <= 100, got 0",
        {"fit": {"starts": 0}},
    ),
    row(
        "walkers",
        "calibration.posterior.walkers: expected a number with 4 <= walkers <= 10000, got 2",
        {"posterior": {"walkers": 2}},
    ),
    row(
        "walkers of many unknowns",
        "calibration.posterior.walkers: expected at least 6, twice the number of unknowns, got 4",
        {
            "posterior": {"walkers": 4},
            "unknowns": {
                "radius": RADIUS,
                "modulus": {"lower": 0.5, "upper": 2},
                "viscosity": {"lower": 0.1, "upper": 5},
            },
        },
    ),
    row(
        "full folder",
        "out is not empty and holds no calibration",
        files={"out/notes.txt": "mine"},
    ),
    row("file as folder", "out: expected a folder, got a file; choose another --out", files={"out": "mine"}),
    row("damaged folder", "is damaged", files={"out/calibrate.json": "{"}),
    row("other folder", "holds another calibration", files={"out/calibrate.json": "{}"}),
    row("store", "--store and --no-store exclude each other", words=("--store", "kept", "--no-store")),
    *(
        row(
            f"{name} below zero, {scale}",
            f"calibration.unknowns.{name}.lower: expected a number above 0, as every value of '{name}' is, got -1.5; "
            "give the least one that is possible",
            {"unknowns": {name: {"lower": -1.5, "upper": 2, **({"scale": scale} if scale else {})}}},
        )
        for name, scale in (("viscosity", ""), ("modulus", "linear"), ("pore", "linear"), ("radius", "log"))
    ),
    row(
        "traction from zero",
        "expected bounds of one sign for 'boundary.y+.traction.y', whose derivatives are taken relative to it, got 0.0 "
        "and 2.0; leave out 0",
        {"unknowns": {"boundary.y+.traction.y": {"lower": 0, "upper": 2}}},
    ),
    row(
        "Poisson's ratio below zero in the logarithm",
        "poisson_ratio.lower: expected a number above 0 for a search in ln x, got -0.1; or scale: linear",
        {"unknowns": {"poisson_ratio": {"lower": -0.1, "upper": 0.4, "scale": "log"}}},
    ),
    *(
        Row(
            f"{command} with a curve that is prescribed: {name}",
            (command, CONFIG),
            (
                f"{KEY}.{expected}; fit another quantity, such as the force on a surface that is held or moved",
            ),
            {
                CONFIG: study(
                    {
                        "macro.boundary.y+": MOVED,
                        "macro.probes": {"top": [0, 7.5, 0], "wall": [0, 5, 0]},
                        "calibration": {**SECTION, "observations": {"creep": {**CURVE, **changes}}},
                    }
                ),
                "creep.csv": CREEP,
            },
            prints=command == "check",
        )
        for command in ("check", "calibrate")
        for name, changes, expected in (
            (
                "settlement",
                {},
                "quantity: expected a curve that depends on the unknowns, but macro.boundary.y+ prescribes the "
                "settlement",
            ),
            (
                "probe on the piston",
                {"quantity": "displacement", "probe": "top", "component": 2},
                "probe: expected a curve that depends on the unknowns, but macro.boundary.y+.displacement prescribes "
                "the displacement 2 at top",
            ),
            (
                "probe on a wall",
                {"quantity": "displacement", "probe": "wall", "component": 1},
                "probe: expected a curve that depends on the unknowns, but macro.boundary.x-.displacement prescribes "
                "the displacement 1 at wall",
            ),
            (
                "pressure where it drains",
                {"quantity": "pressure", "probe": "top"},
                "probe: expected a curve that depends on the unknowns, but macro.boundary.y+.pressure prescribes the "
                "pressure at top",
            ),
        )
    ),
    curve(
        "rows before loading",
        "creep.csv:2: time: expected a time from 0, the beginning of the test, got -3; leave out the rows before it by "
        "'since: 0'",
        CREEP.replace("1,0.1", "-3,0.1"),
    ),
    curve(
        "behind the end from the first",
        "creep.csv:2: time: the times begin at 101, behind the end of the study at 12; times count from the beginning "
        "of the test: subtract that of its beginning from all of them, or raise macro.time.end where the test",
        "time,settlement\n101,0.1\n102,0.2\n103,0.3\n",
    ),
    Row(
        "calibrate no section",
        ("calibrate", CONFIG, "--out", "out"),
        ("expected a section 'calibration:'",),
        {CONFIG: study({})},
    ),
    Row(
        "calibrate no study",
        ("calibrate", CONFIG, "--out", "out"),
        ("experiments.creep.study: ", "none.yaml: no such file"),
        {
            CONFIG: "unknowns: {radius: {lower: 0.2, upper: 0.3}}\nexperiments: {creep: {study: none.yaml, "
            "observations: {creep: {quantity: settlement, file: creep.csv, deviation: 0.01}}}}\n"
        },
    ),
    Row("calibrate no file", ("calibrate", "none.yaml"), ("none.yaml: no such file",), {}),
]
