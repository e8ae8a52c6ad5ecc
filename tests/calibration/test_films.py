"""Reading of measured fields: formats, units, what is left out and said, what is refused with one message."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from porocore.commands.calibration.clouds import COMPONENTS, FilmComponent
from porocore.commands.calibration.films import read_film
from porocore.commands.calibration.observations import ObservedCurve
from porocore.commands.calibration.settings import PointsSettings
from porocore.core.units import ResultUnits, Scales, using_units
from porocore.errors import ConfigurationError
from porocore.macro.problem import MacroSetup

SCALES = Scales(length=2e-3, pore=20e-9, viscosity=1e-3, modulus=0.5e6)
#: A body of 1 mm × 3 mm × 1 mm.
BODY: dict[str, Any] = {"kind": "box", "elements": [1, 3, 1], "size": [0.5, 1.5, 0.5]}
HELD: dict[str, Any] = {"y-": {"displacement": [0, 0, 0]}}
#: A time of 1 is μ_f L²/(E d²) = 20 s.
MACRO = MacroSetup(body=BODY, boundary=HELD, time={"end": 0.3, "ramp_increments": 1, "ramp_step": 0.01})
KEYS: dict[str, Any] = {"deviation": 1.0, "displacement_unit": "um", "unit": "mm", "time_unit": "s"}
PLACES = np.array([(x, y, 1.0) for y in (0.2, 1.0, 2.9) for x in (0.1, 0.9)])
T = np.array([1.0, 4.0])


def rows() -> dict[str, np.ndarray]:
    """Two frames of six points; displacements in µm are functions of place and time."""
    x, y, z = np.tile(PLACES, (2, 1)).T
    t = np.repeat(T, len(PLACES))
    return {"x": x, "y": y, "z": z, "t": t, "u1": 10 * x * t, "u2": -20 * y * t}


def csv_of(columns: dict[str, Any], separator: str = ",") -> str:
    lines = [separator.join(columns)]
    lines += [separator.join(str(v) for v in row) for row in zip(*columns.values(), strict=True)]
    return "\n".join(lines)


def read(folder: Path, content: str | None = None, **keys: Any) -> list[ObservedCurve]:
    given = {"file": "film.csv", **KEYS, **keys}
    if content is not None:
        (folder / "film.csv").write_text(content, encoding="utf-8")
    with using_units(ResultUnits(SCALES)):
        found, _ = read_film("film", PointsSettings(**given), folder, MACRO, SCALES)
    return found


def check(curves: list[ObservedCurve]) -> None:
    """The curves are those of all rows, in the order of time."""
    assert [curve.name for curve in curves] == ["film: u1", "film: u2"]
    wanted = rows()
    for curve, name in zip(curves, ("u1", "u2"), strict=True):
        assert isinstance(curve.series, FilmComponent)
        assert curve.series.component == COMPONENTS.index(name)
        np.testing.assert_allclose(curve.measured, wanted[name])
        np.testing.assert_allclose(curve.displayed_times, wanted["t"])
        np.testing.assert_allclose(curve.deviations, 1.0)
        places = np.stack([wanted[c] for c in "xyz"], axis=1)
        np.testing.assert_allclose(curve.series.places, places / 2)
        # A dimensionless displacement of 1 is 2 mm.
        assert curve.factor == pytest.approx(2000)


def test_csv_files_are_read(tmp_path: Path) -> None:
    check(read(tmp_path, csv_of(rows())))


def test_units_in_headings_and_other_names_count(tmp_path: Path) -> None:
    names = {"x": "X [um]", "y": "Y [um]", "z": "Z [um]", "t": "time (min)", "u1": "dx [mm]", "u2": "dy [mm]"}
    sizes = {"x": 1e3, "y": 1e3, "z": 1e3, "t": 1 / 60, "u1": 1e-3, "u2": 1e-3}
    content = csv_of({names[k]: v * sizes[k] for k, v in rows().items()}, ";").replace(".", ",")
    columns = {"x": "X", "y": "Y", "z": "Z", "t": "time", "u1": "dx", "u2": "dy"}
    bare = dict.fromkeys(("displacement_unit", "unit", "time_unit"))
    found = read(tmp_path, content, columns=columns, **{**bare, "deviation": "1 um"})
    for curve, name in zip(found, ("u1", "u2"), strict=True):
        np.testing.assert_allclose(curve.measured, rows()[name] * 1e-3)
        np.testing.assert_allclose(curve.displayed_times * 60, rows()["t"])
        np.testing.assert_allclose(curve.series.places[:, 1], rows()["y"] / 2)
        np.testing.assert_allclose(curve.deviations, 1e-3)


def test_a_file_of_each_time_is_read_in_the_order_of_numbers(tmp_path: Path) -> None:
    every = rows()
    for number, t in zip((9, 10), T, strict=True):
        part = {name: values[every["t"] == t] for name, values in every.items() if name != "t"}
        (tmp_path / f"frame_{number}.csv").write_text(csv_of(part), encoding="utf-8")
    check(read(tmp_path, file="frame_*.csv", frames=[1.0, "4 s"]))


def test_a_single_file_may_have_one_time(tmp_path: Path) -> None:
    part = {name: values[:6] for name, values in rows().items() if name != "t"}
    found = read(tmp_path, csv_of(part), frames=["1 s"])
    np.testing.assert_allclose(found[0].displayed_times, 1.0)
    np.testing.assert_allclose(found[0].measured, part["u1"])


def test_arrays_of_an_image_correlation_are_read(tmp_path: Path) -> None:
    """A grid of places, and times before it."""
    x, y, _ = PLACES.reshape(3, 2, 3).transpose(2, 0, 1)
    t = T[:, None, None]
    u = np.stack([10 * x * t, -20 * y * t], axis=-1)
    np.savez(tmp_path / "dic.npz", X=x, Y=y, t=T, disp=u)
    columns = {"x": "X", "y": "Y", "u1": "disp[0]", "u2": "disp[1]"}
    check(read(tmp_path, file="dic.npz", columns=columns, fixed={"z": 1.0}))


def test_vtu_files_are_read(tmp_path: Path) -> None:
    for k, t in enumerate(T):
        u = np.stack([10 * PLACES[:, 0] * t, -20 * PLACES[:, 1] * t, 0 * PLACES[:, 0]], axis=1)
        cells = [("vertex", np.arange(6)[:, None])]
        meshio.Mesh(PLACES, cells, point_data={"u": u}).write(tmp_path / f"f{k}.vtu")
    check(read(tmp_path, file="f*.vtu", frames=[1.0, 4.0], quantities=["u1", "u2"]))


def test_the_place_of_the_camera_is_taken_off(tmp_path: Path) -> None:
    """Its x axis is the body's y axis, and its origin lies elsewhere; displacements stay in its axes."""
    every = rows()
    turned = {**every, "x": every["y"] - 0.3, "y": 0.4 - every["x"]}
    found = read(tmp_path, csv_of(turned), camera={"offset": ["0.4 mm", 0.3, 0.0], "rotation": [0, 0, 90]})
    np.testing.assert_allclose(
        found[0].series.places, np.stack([every[c] for c in "xyz"], axis=1) / 2, atol=1e-12
    )
    assert found[0].series.cloud.axes is not None


def test_lost_points_duplicates_and_points_outside_are_counted(tmp_path: Path) -> None:
    every = {name: values.tolist() for name, values in rows().items()}
    every["u1"][3] = "NaN"
    every["u2"][4] = ""
    every["x"][5] = "---"
    for name in every:  # one row twice, with other values, and one as it is
        every[name] += [every[name][0], every[name][1]]
    every["u1"][-2] += 2.0
    every["y"][7] = 3.9
    found = read(tmp_path, csv_of(every), outside=0.1)
    assert [len(curve) for curve in found] == [9, 9]
    notes = " ".join(note for curve in found for note in curve.notes)
    assert "1 rows are exact copies of others, and were left out" in notes
    assert "1 of 14 rows have no place or no time, and were left out" in notes
    assert "1 of 12 values lie outside the body and were left out" in notes
    assert "1 values have the place and the time of another one; the means of such values count" in notes
    assert "1 of 11 values of u1 are missing, and were left out" in notes
    unknown = read(tmp_path, csv_of(every), outside=0.1, camera={"unknown": ["x"]})[0].notes
    assert "1 of 12 values lie outside the body at the given place of the camera and were left out" in unknown
    first = found[0]
    assert first.measured[0] == pytest.approx(rows()["u1"][0] + 1.0)
    assert first.deviations[0] == pytest.approx(1 / np.sqrt(2))


FAULTS: dict[str, tuple[dict[str, Any], str]] = {
    "a metre for a millimetre": (
        {"unit": "m"},
        "would fit if they were 0.001 times as large: check the unit",
    ),
    "both sides of a symmetric body": (
        {"camera": {"offset": [-0.4, 0.0, 0.0]}},
        r"beyond x-: name that symmetry plane in 'macro.body.symmetry: \[x-\]'",
    ),
    "both sides, with a turned camera": (
        {"camera": {"offset": [-0.4, 0.0, 0.0], "rotation": [0.0, 0.0, 1e-6]}},
        r"as mirror images beyond x-, which do not count with a camera that is turned: keep one side, or give 'camera",
    ),
    "both sides, with an unknown camera": (
        {"camera": {"offset": [-0.4, 0.0, 0.0], "unknown": ["x"]}},
        r"camera that is unknown: keep one side, or .*; where the others count, raise 'outside:', which is 0.05$",
    ),
    "points too far": (
        {"camera": {"offset": [0.0, 0.25, 0.0]}},
        r"\[y\+\]', or keep one side, or give 'camera.offset:', the origin of their axes in the body$",
    ),
    "axes exchanged": (
        {"columns": {"x": "y", "y": "x"}},
        "would fit with other axes: check the columns",
    ),
    "elsewhere": (
        {"camera": {"offset": [7.0, 0.0, 0.0]}},
        "would fit at another place: give 'camera.offset:'",
    ),
    "no time": ({"columns": {"t": "missing"}}, "no column is called 'missing'"),
    "no value": ({"quantities": ["p"]}, "quantities: .* has no 'p'; it has u1"),
    "no deviation": ({"deviation": None}, "deviation: missing; give the standard deviation of u1"),
    "a deviation of 0": ({"deviation": 0.0}, "deviation: expected a number above 0"),
    "behind the end": ({"time_unit": "h"}, r"film.csv:2: t: the time 1 h lies behind the end"),
    "a pattern of nothing": ({"file": "none*.csv"}, "file: no file is called 'none\\*.csv'"),
    "no such file": ({"file": "none.csv"}, "none.csv cannot be read"),
    "too many frames": ({"frames": [1.0, 2.0]}, "frames: expected 1 time for film.csv, got 2"),
    "a time twice": ({"frames": [1.0]}, "frames: film.csv has a column of times"),
    "times twice": ({"file": "fil*.csv", "frames": [1.0]}, "frames: film.csv has a column of times"),
    "too few frames": (
        {"file": "fil*.csv", "frames": [1.0, 2.0]},
        "frames: expected 1 time for film.csv, got 2",
    ),
    "a wrong unit": ({"displacement_unit": "kPa"}, "displacement_unit: "),
    "nothing in time": ({"since": 5.0}, "file: no row of .* has a finite place and a time that counts"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_get_one_message(tmp_path: Path, fault: str) -> None:
    keys, naming = FAULTS[fault]
    with pytest.raises(ConfigurationError, match=naming) as told:
        read(tmp_path, csv_of(rows()), **keys)
    assert "\n" not in str(told.value)


def test_a_film_of_next_to_one_point_is_doubted(tmp_path: Path) -> None:
    found = read(tmp_path, csv_of(rows()), unit="um")
    assert found[0].notes == (
        "the points extend over 2.7e-06 m, and the body over 0.003 m; they would span it if they were 1000 times as "
        "large; check the unit of the places, 'unit:' or the heading, got 'um'",
    )


def test_an_entry_that_is_no_number_is_told_with_its_line(tmp_path: Path) -> None:
    every = {name: values.tolist() for name, values in rows().items()}
    every["u2"][4] = "lost"
    with pytest.raises(ConfigurationError, match=r"film.csv:6: u2: expected a finite number, got 'lost'"):
        read(tmp_path, csv_of(every))
    assert len(read(tmp_path, csv_of(every), missing=["lost"])[1]) == 11


def test_files_that_are_no_arrays_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(b"PK\x03\x04 nothing")
    (tmp_path / "a.vtu").write_text("<VTKFile>", encoding="utf-8")
    for name, naming in (
        ("a.npz", "is no readable NPZ file"),
        ("a.vtu", "expected points with data that meshio reads"),
    ):
        with pytest.raises(ConfigurationError, match=naming):
            read(tmp_path, file=name)
    np.savez(tmp_path / "b.npz", x=np.zeros(3), y=np.zeros(4))
    with pytest.raises(ConfigurationError, match=r"arrays of .* that have one shape"):
        read(tmp_path, file="b.npz")


def test_places_of_the_deformed_body_are_doubted_by_the_measured_displacements(tmp_path: Path) -> None:
    """Displacements of 20 µm bring points there from just outside the body, or from just inside."""
    every = rows()
    every["u1"] = np.full(12, -20.0)
    every["x"], every["u2"] = np.where(every["x"] < 0.5, every["x"], 1.04), every["u2"] / 10
    doubted = read(tmp_path, csv_of(every), place="deformed")[0].notes
    assert "6 of 12 values of film.csv lie outside the body, more than the share 0.05" in doubted[0]
    assert doubted[0].endswith("is refused if it is so at the start values")
    every["u1"] = np.full(12, 20.0)
    assert not read(tmp_path, csv_of(every), place="deformed")[0].notes


def test_a_film_of_a_meridian_may_show_both_sides_of_the_axis(tmp_path: Path) -> None:
    body = {"kind": "axisymmetric", "radius": 0.5, "height": 1.5, "elements": [2, 3]}
    round_ = MACRO.model_validate({**MACRO.model_dump(), "body": body})
    every, other = {name: values for name, values in rows().items() if name != "z"}, np.arange(12) % 2 == 1
    mirrored = {**every, **{name: np.where(other, -every[name], every[name]) for name in ("x", "u1")}}
    (tmp_path / "film.csv").write_text(csv_of(mirrored), encoding="utf-8")
    with using_units(ResultUnits(SCALES)):
        found, _ = read_film("film", PointsSettings(file="film.csv", **KEYS), tmp_path, round_, SCALES)
    np.testing.assert_allclose(found[0].measured, every["u1"])
    np.testing.assert_allclose(found[0].series.places[:, 0], every["x"] / 2)
    np.testing.assert_array_equal(found[0].series.places[:, 2], 0.0)
    assert (
        "6 of 12 values lie beyond the axis of revolution and count as their mirror images" in found[0].notes
    )


@pytest.mark.parametrize("kind", ["axisymmetric", "plane-strain"])
def test_a_body_of_two_dimensions_has_no_third_displacement(tmp_path: Path, kind: str) -> None:
    """Its zeros are no data; a turned camera may see them along another axis."""
    size = {"radius": 0.5, "height": 1.5} if kind == "axisymmetric" else {"size": [0.5, 1.5]}
    flat = MACRO.model_validate({**MACRO.model_dump(), "body": {"kind": kind, "elements": [2, 3], **size}})

    def components(**keys: Any) -> tuple[list[str], str]:
        given = PointsSettings(**{"file": "film.csv", **KEYS, **keys})
        with using_units(ResultUnits(SCALES)):
            found, _ = read_film("film", given, tmp_path, flat, SCALES)
        return [curve.name for curve in found], " ".join(note for curve in found for note in curve.notes)

    every = {name: values for name, values in rows().items() if name != "z"}
    (tmp_path / "film.csv").write_text(csv_of({**every, "u3": 0 * every["u1"]}), encoding="utf-8")
    for keys in ({}, {"quantities": ["u1", "u2", "u3"]}, {"camera": {"unknown": ["rz"]}}):
        names, notes = components(**keys)
        assert names == ["film: u1", "film: u2"]
        assert "u3 is left out, since a body in two dimensions" in notes
    assert len(components(camera={"unknown": ["rx"]})[0]) == 3
    with pytest.raises(
        ConfigurationError, match=r"quantities: u3 .* cannot move that way; name other components"
    ):
        components(quantities=["u3"])
    (tmp_path / "film.csv").write_text(csv_of({**every, "u3": 1 + every["u1"]}), encoding="utf-8")
    assert components()[0] == ["film: u1", "film: u2"]
    with pytest.raises(ConfigurationError, match=r"quantities: u3 .* cannot move that way; leave u3 out"):
        components(quantities=["u1", "u3"])


def test_points_beyond_a_symmetry_plane_are_their_mirror_images(tmp_path: Path) -> None:
    """A film of the whole width of a specimen of which a half is solved."""
    half = MacroSetup(
        body={**BODY, "symmetry": ["x-"]},
        boundary={"x-": {"normal": 0}, **HELD},
        time={"end": 0.3, "ramp_increments": 1, "ramp_step": 0.01},
    )
    every, other = rows(), np.arange(12) % 2 == 1
    mirrored = {**every, **{name: np.where(other, -every[name], every[name]) for name in ("x", "u1")}}
    (tmp_path / "film.csv").write_text(csv_of(mirrored), encoding="utf-8")
    with using_units(ResultUnits(SCALES)):
        found, _ = read_film("film", PointsSettings(file="film.csv", **KEYS), tmp_path, half, SCALES)
    check(found)
    assert "6 of 12 values lie beyond a symmetry plane and count as their mirror images" in found[0].notes


@pytest.mark.parametrize(
    ("content", "naming"),
    [
        (
            "x;y;z;t;u1\n0,1;0,2;1;1;5,5\n0,2;0.25;1;1;5,6\n",
            "film.csv:3: y: expected decimal commas, as in '0,1' in line 2, got '0.25'",
        ),
        (
            "x;y;z;t;u1\n1;2;1;1;1,234.5\n",
            "film.csv:2: u1: expected decimal points, got '1,234.5'; write all",
        ),
        (
            "x;y;z;t;u1\n1;2;1;1;1,234.5\n1;3;1;1;2.5\n",
            "film.csv:2: u1: expected decimal points, as in '2.5' in line 3, got '1,234.5'",
        ),
        (
            "x;y;z;t;u1\n0,1;0,2;1;1;5,5\n0,2;0,25;1;1;5,6\n0,2;0,3;1;1;1.234,5\n",
            "film.csv:4: u1: expected decimal commas, as in '0,1' in line 2, got '1.234,5'",
        ),
        (
            "x;y;z;t;u1\n1;2;1;1;1,234\n1;3;1;1;2,500\n",
            "'1,234' may have a decimal comma or one between groups",
        ),
        ("x;y;z;t;u1\n1;2;1;1;inf\n", "film.csv:2: u1: expected a finite number, got 'inf'"),
    ],
)
def test_numbers_that_may_be_others_are_refused(tmp_path: Path, content: str, naming: str) -> None:
    with pytest.raises(ConfigurationError, match=naming):
        read(tmp_path, content)


def test_infinite_numbers_of_an_array_are_refused(tmp_path: Path) -> None:
    every = rows()
    every["u1"][2] = -np.inf
    np.savez(tmp_path / "film.npz", **every)
    with pytest.raises(ConfigurationError, match=r"u1: expected finite numbers .* got infinity in value 3"):
        read(tmp_path, file="film.npz")


def test_advice_names_keys_that_a_film_has(tmp_path: Path) -> None:
    """Two tables in one file, and a row cut short."""
    twice = csv_of(rows()) + "\n\n" + csv_of(rows())
    short = csv_of(rows()) + "\n1,2"
    for content, naming in (
        (twice, "keep one table in the file$"),
        (short, "begin it with '#', or write decimal points$"),
    ):
        with pytest.raises(ConfigurationError, match=naming) as told:
            read(tmp_path, content)
        assert not [key for key in ("last_line", "heading_line", "decimal:") if key in str(told.value)]


#: Changed columns, keys, and words of the note.
DOUBTS: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "all zero": ({"u1": 0.0}, {}, "all values are 0; check the column"),
    "a deviation above all": (
        {},
        {"deviation": 1e3},
        "the deviation of 1000 µm is larger than all values, which reach",
    ),
    "minutes for seconds": (
        {"t": 0.1},
        {},
        "the film ends at 0.1 s, and the test at 6 s; check the unit of the times",
    ),
    "absurd pressures": (
        {"p": 20.0},
        {"pressure_unit": "MPa", "pressure_deviation": 1.0},
        "the pressures reach 20 MPa, 40 times the modulus of the solid; check their unit, 'pressure_unit:'",
    ),
    "no unit": ({}, {"time_unit": None, "until": 0.2, "since": 0.1}, "the times of film.csv have no unit"),
}


@pytest.mark.parametrize("doubt", DOUBTS)
def test_what_is_unlikely_gets_a_note(tmp_path: Path, doubt: str) -> None:
    changes, keys, naming = DOUBTS[doubt]
    every = rows()
    for name, value in changes.items():
        every[name] = np.full(len(every["x"]), value)
    if doubt == "no unit":
        every["t"] = every["t"] / 20
    found = read(tmp_path, csv_of(every), **keys)
    notes = [note for curve in found for note in curve.notes]
    assert any(naming in note for note in notes), notes


def test_units_of_frames_are_units_of_the_times(tmp_path: Path) -> None:
    every = {name: values[:6] for name, values in rows().items() if name != "t"}
    (tmp_path / "f1.csv").write_text(csv_of(every), encoding="utf-8")
    (bare,) = (read(tmp_path, file="f*.csv", frames=[0.1], time_unit=None)[0].notes,)
    assert "the times of f*.csv have no unit" in bare[0]
    assert not read(tmp_path, file="f*.csv", frames=["2 s"], time_unit=None)[0].notes


def test_a_made_up_film_has_no_pressures_by_itself(tmp_path: Path) -> None:
    times = {"first": "1 s", "last": "5 s", "count": 3}
    keys = {"grid": [2, 3, 1], "times": times, "fixed": {"z": "0.5 mm"}, "unit": None, "time_unit": None}
    given = PointsSettings(**{**KEYS, **keys})
    with using_units(ResultUnits(SCALES)):
        found, _ = read_film("film", given, tmp_path, MACRO, SCALES, synthetic=True)
    assert found[0].notes == ("u1, u2 and u3 are made up, and no p; name other components in 'quantities:'",)
    assert found[0].outline.startswith("18 points at 3 times from ")


def test_an_outline_counts_points_and_times(tmp_path: Path) -> None:
    outline = read(tmp_path, csv_of(rows()))[0].outline
    assert outline.startswith("12 values at 2 times from 1 to 4 s; they are 1 to 36 µm")
    assert read(tmp_path, csv_of(rows()), until=2.0)[0].outline.startswith("6 values at 1 s; ")
