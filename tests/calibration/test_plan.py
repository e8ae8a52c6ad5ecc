"""Plan of a calibration from a section of a study or a file of its own: unknowns, units, families; what is refused."""

from __future__ import annotations

import copy
import re
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from porocore.commands.calibration.calibrate import _identity
from porocore.commands.calibration.loading import read_plan
from porocore.commands.calibration.plan import CalibrationFolder, CalibrationPlan
from porocore.errors import ConfigurationError, RunFolderError
from porocore.interfaces.sensitivities import HatFunction
from porocore.study.config.loading import load_config
from tests.helpers.calibrated_column import STUDY

SECTION: dict[str, Any] = {
    "unknowns": {
        "radius": {"lower": 0.2, "upper": 0.3},
        "stiffness": {"of": "modulus", "lower": "100 kPa", "upper": "2 MPa", "start": "400 kPa"},
        "viscosity": {
            "lower": "0.5 mPa s",
            "upper": "2 mPa s",
            "prior": {"mean": "1 mPa s", "deviation": 0.3},
        },
        "boundary.y+.traction.y": {"lower": "20 kPa", "upper": "30 kPa"},
        "delay": {"of": "time_shift", "lower": "-5 s", "upper": "5 s"},
    },
    "observations": {"settlement": {"quantity": "settlement", "file": "creep.csv", "deviation": "1 um"}},
}
DEPTH = {"along": "y", "at": [0, 0.5, "1 mm"]}
SHIFT = {"of": "time_shift", "lower": "-5 s", "upper": "5 s"}
CREEP = "time [s], settlement [um]\n10, 5\n60, 10\n300, 20\n600, 25\n1200, 28\n"


def write(
    folder: Path, section: dict[str, Any] | None = None, study: dict[str, Any] = STUDY, name: str = "a.yaml"
) -> Path:
    (folder / "creep.csv").write_text(CREEP, encoding="utf-8")
    data = study if section is None else {**study, "calibration": section}
    path = folder / name
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return path


def changed(**unknowns: Any) -> dict[str, Any]:
    section = copy.deepcopy(SECTION)
    section["unknowns"] = {**section["unknowns"], **unknowns}
    section["unknowns"] = {k: v for k, v in section["unknowns"].items() if v is not None}
    return section


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> CalibrationPlan:
    return read_plan(write(tmp_path_factory.mktemp("plan"), SECTION))


def test_unknowns_have_the_units_bounds_and_first_values_of_the_file(plan: CalibrationPlan) -> None:
    radius, stiffness, viscosity, traction, delay = (each.unknown for each in plan.unknowns)
    assert (radius.start, radius.lower, radius.upper, radius.unit, radius.scale) == (
        0.25,
        0.2,
        0.3,
        "",
        "linear",
    )
    assert (stiffness.start, stiffness.upper, stiffness.unit, stiffness.scale) == (400, 2000, "kPa", "log")
    assert (viscosity.start, viscosity.unit) == (1.0, "mPa s")
    assert viscosity.prior is not None
    assert (viscosity.prior.mean, viscosity.prior.deviation) == (0.0, 0.3)
    assert (traction.start, traction.lower) == (pytest.approx(25), 20)
    assert (delay.start, delay.lower, delay.unit) == (0.0, -5, "s")


def test_values_become_dimensionless_by_the_scales_of_the_study(plan: CalibrationPlan) -> None:
    (experiment,) = plan.experiments
    factors = [each.dimensionless(experiment) for each in plan.unknowns]
    np.testing.assert_allclose(factors[:4], [1.0, 1e3 / 0.5e6, 1.0, 1e3 / 0.5e6], rtol=1e-14)
    time = 1e-3**2 * 1e-3 / (0.5e6 * 2e-6**2)
    assert factors[4] == pytest.approx(1 / time, rel=1e-14)


def test_the_cells_are_a_family_between_the_bounds(plan: CalibrationPlan) -> None:
    config = plan.experiments[0].config
    assert [(each.name, each.lower, each.upper) for each in config.cell.parameters] == [("radius", 0.2, 0.3)]
    assert config.sampling.sampler == "sobol"
    assert "density-sweep varies no parameters" in plan.notes[0]


def test_the_section_leaves_the_study_alone(tmp_path: Path) -> None:
    with_it, without = load_config(write(tmp_path, SECTION)), load_config(write(tmp_path, name="b.yaml"))
    assert with_it.identity == without.identity


def test_bounds_that_leave_out_the_value_of_the_study_are_noted(tmp_path: Path) -> None:
    """The pore of the study is 2 µm, its modulus 500 kPa."""
    wide = {"pore": {"lower": "5 um", "upper": "100 um"}, "stiffness": None}
    notes = read_plan(write(tmp_path, changed(**wide))).notes
    assert [each for each in notes if each.startswith("unknown")] == [
        "unknown pore: the bounds, 5 to 100 µm, leave out the value of the study, 2 µm; check the bounds and their unit"
    ]
    within = {"pore": {"lower": "2 um", "upper": "100 um"}, "stiffness": None}
    assert not [each for each in read_plan(write(tmp_path, changed(**within))).notes if "unknown" in each]


def test_bounds_without_a_unit_are_noted_with_what_they_are(tmp_path: Path) -> None:
    plain = {"stiffness": {"of": "modulus", "lower": 0.5, "upper": 2}, "pore": {"lower": 0.5, "upper": 2}}
    notes = read_plan(write(tmp_path, changed(**plain))).notes
    assert [each for each in notes if each.startswith("unknown")] == [
        "unknown stiffness: its values have no unit, so they are multiples of 500000 Pa, with bounds at 250000 Pa and "
        "1e+06 Pa; write them with their unit",
        "unknown pore: its values have no unit, so they are multiples of 2 µm, with bounds at 1 µm and 4 µm; write "
        "them with their unit",
    ]


@pytest.fixture
def two(tmp_path: Path) -> dict[str, Any]:
    """A file of its own with two studies, of which the second has another length and two loads."""
    write(tmp_path, name="a.yaml")
    longer = copy.deepcopy(STUDY)
    longer["scales"]["length"], longer["macro"]["loads"] = "2 mm", [-0.1, -1]
    write(tmp_path, study=longer, name="b.yaml")
    observations = SECTION["observations"]
    return {
        "unknowns": changed(delay={**SHIFT, "experiments": ["slow"]})["unknowns"],
        "experiments": {
            "quick": {"study": "a.yaml", "observations": observations},
            "slow": {"study": "b.yaml", "load": -0.5, "observations": observations},
        },
    }


def test_a_file_of_its_own_names_studies_with_other_scales(two: dict[str, Any], tmp_path: Path) -> None:
    plan = read_plan(write(tmp_path, study=two, name="both.yaml"))
    assert [each.name for each in plan.curves] == ["quick: settlement", "slow: settlement"]
    assert [each.load for each in plan.experiments] == [-1, -0.5]
    assert plan.experiments[1].config.macro.loads == (-0.5,)
    assert [*plan.unknowns[4].numbers] == ["slow"]
    np.testing.assert_allclose(plan.curves[0].times, 4 * plan.curves[1].times)


def test_a_field_has_an_unknown_for_each_control_value(tmp_path: Path) -> None:
    """With a prior of the differences: three values, two of which the data need not determine alone."""
    plan = read_plan(write(tmp_path, radius(field={**DEPTH, "smoothing": 0.01})))
    names = ["radius[0]", "radius[1]", "radius[2]"]
    found = plan.unknowns[:3]
    assert [each.unknown.name for each in found] == names
    assert [each.unknown.smoothing for each in found] == [None, 0.01, 0.01]
    hats = [each.numbers[""].hat for each in found]
    assert hats == [HatFunction.along(1, (0, 0.5, 1.0), i) for i in range(3)]
    assert [(each.name, each.lower, each.upper) for each in plan.experiments[0].config.cell.parameters] == [
        ("radius", 0.2, 0.3)
    ]


def test_control_values_far_outside_the_body_are_noted(tmp_path: Path) -> None:
    """The last of these has 1 % of the weight at the top of the body."""
    found = read_plan(write(tmp_path, radius(field={**DEPTH, "at": [0, 0.5, 50.5], "smoothing": 0.01})))
    (note,) = [each for each in found.notes if "of the weight at every point" in each]
    assert note.startswith("control value radius[2]: less than 5 % of the weight at every point of the body;")


def test_an_experiment_has_one_load(two: dict[str, Any], tmp_path: Path) -> None:
    del two["experiments"]["slow"]["load"]
    with pytest.raises(
        ConfigurationError, match=r"experiments\.slow\.load: expected one load .* -0\.1, -1; add 'load:'"
    ):
        read_plan(write(tmp_path, study=two, name="both.yaml"))


def test_plain_numbers_mean_the_same_in_all_studies(two: dict[str, Any], tmp_path: Path) -> None:
    two["unknowns"]["stiffness"] = {"of": "modulus", "lower": 0.2, "upper": 4}
    assert read_plan(write(tmp_path, study=two, name="both.yaml")).unknowns[1].unknown.start == 1.0
    two["unknowns"]["delay"] = {"of": "time_shift", "lower": -1, "upper": 1}
    with pytest.raises(ConfigurationError, match=r"unknowns\.delay: expected values with a unit"):
        read_plan(write(tmp_path, study=two, name="both.yaml"))


def test_a_time_shift_keeps_the_data_within_the_study(two: dict[str, Any], tmp_path: Path) -> None:
    two["unknowns"]["delay"] = {"of": "time_shift", "lower": "0 s", "upper": "1e9 s"}
    with pytest.raises(ConfigurationError) as refused:
        read_plan(write(tmp_path, study=two, name="both.yaml"))
    found = re.search(r"delay\.upper: expected at most (\S+) s, got 1e\+09 s, by which", str(refused.value))
    assert found is not None
    for share, fits in ((0.999, True), (1.001, False)):
        two["unknowns"]["delay"]["upper"] = f"{share * float(found[1])!r} s"
        with nullcontext() if fits else pytest.raises(ConfigurationError, match="expected at most"):
            read_plan(write(tmp_path, study=two, name="both.yaml"))


def curve(**changes: Any) -> dict[str, Any]:
    given = {"quantity": "settlement", "file": "creep.csv", "deviation": "1 um", **changes}
    return {**SECTION, "observations": {"s": given}}


def radius(**changes: Any) -> dict[str, Any]:
    return changed(radius={"lower": 0.2, "upper": 0.3, **changes})


def stiffness(lower: Any, upper: Any = "2 MPa") -> dict[str, Any]:
    return changed(stiffness={"of": "modulus", "lower": lower, "upper": upper})


#: Section, key below ``calibration``, words.
REFUSED: dict[str, tuple[dict[str, Any], str, str]] = {
    "number": (changed(radios={"lower": 1, "upper": 2}), "unknowns.radios", "did you mean 'radius'?"),
    "of": (
        changed(a={"of": "modules", "lower": 1, "upper": 2}),
        "unknowns.a.of",
        "expected a number of the study, got 'modules'; did you mean 'modulus'?",
    ),
    "bounds": (radius(upper=0.1), "unknowns.radius", "expected lower < upper, got 0.2 and 0.1"),
    "no cell": (radius(upper=0.7), "unknowns", "cell.geometry.radius"),
    "start": (radius(start=0.4), "unknowns.radius.start", "expected a value within the bounds, got 0.4"),
    "log": (
        changed(delay={**SHIFT, "scale": "log"}),
        "unknowns.delay.lower",
        "expected a number above 0 for a",
    ),
    "unit": (stiffness("1 mm"), "unknowns.stiffness.lower", "expected a stress, such as 2 kPa, got 'mm'"),
    "one unit": (
        stiffness(1),
        "unknowns.stiffness.lower",
        "expected a value with a unit, such as 1 MPa, got 1",
    ),
    "plain": (radius(lower="0.2 mm"), "unknowns.radius", "expected plain numbers, got 'mm' as a unit"),
    "text": (
        radius(lower="low"),
        "unknowns.radius.lower",
        "expected a number, or one with a unit, got 'low'",
    ),
    "switch": (radius(lower=True), "unknowns.radius.lower", "expected a number, got true"),
    "missing": (changed(radius={"lower": 0.2}), "unknowns.radius.upper", "missing; add 'upper:'"),
    "key": (radius(uper=0.3), "unknowns.radius.uper", "unknown key; did you mean 'upper'?"),
    "twice": (
        changed(r=radius()["unknowns"]["radius"] | {"of": "radius"}),
        "unknowns.r",
        "'radius' is the same number",
    ),
    "experiment": (radius(experiments=["slow"]), "unknowns.radius.experiments", "there is one alone"),
    "no field": (
        changed(modulus={"lower": 0.5, "upper": 2, "field": DEPTH}, stiffness=None),
        "unknowns.modulus",
        "expected a parameter of the cell, which alone may be a field over the body, got 'modulus'",
    ),
    "descends": (
        radius(field={**DEPTH, "at": [0, "1 mm", 0.5]}),
        "unknowns.radius.field.at",
        "expected ascending coordinates, got '1 mm' before 0.5",
    ),
    "one place": (radius(field={**DEPTH, "at": [0]}), "unknowns.radius.field.at", "at least 2"),
    "above the body": (
        radius(field={**DEPTH, "at": [0, 1, 3, "4 mm"]}),
        "unknowns.radius.field.at",
        "no point of the body has the value at 3; the body reaches from 0 to 1 along y",
    ),
    "far above the body": (
        radius(field={**DEPTH, "at": [0, 1, "7 mm", "8 mm"]}),
        "unknowns.radius.field.at",
        "no point of the body has the value at 7 mm; the body reaches from 0 to 0.001 m along y, and each",
    ),
    "unit of a place": (
        radius(field={**DEPTH, "at": [0, "1 kPa"]}),
        "unknowns.radius.field.at",
        "expected a length",
    ),
    "first values": (
        radius(field={**DEPTH, "start": [0.25]}),
        "unknowns.radius.field.start",
        "expected 3 values, one for each coordinate, got 1",
    ),
    "first values outside": (
        radius(field={**DEPTH, "start": [0.25, 0.26, 0.4]}),
        "unknowns.radius.field.start",
        "expected a value within the bounds, got 0.4",
    ),
    "two starts": (
        radius(start=0.25, field={**DEPTH, "start": [0.25, 0.26, 0.27]}),
        "unknowns.radius.start",
        "stand in field.start too",
    ),
    "smoothing": (
        radius(field={**DEPTH, "smoothing": 0}),
        "unknowns.radius.field.smoothing",
        "expected a number above 0, got 0",
    ),
    "same name": (
        changed(
            radius={"lower": 0.2, "upper": 0.3, "field": DEPTH},
            **{"radius[1]": {"of": "poisson_ratio", "lower": 0.2, "upper": 0.4}},
        ),
        "unknowns.radius[1]",
        "another unknown has a value that is called 'radius[1]'; rename one",
    ),
    "prior": (
        radius(prior={"mean": 0.25, "deviation": 0}),
        "unknowns.radius.prior.deviation",
        "expected a number above 0, got 0",
    ),
    "file": (curve(file="no.csv"), "observations.s", "no.csv: no such file"),
    "no file": (curve(file=None), "observations.s.file", "missing; add the CSV file"),
    "until": (curve(until="3 m"), "observations.s.until", "expected a time, such as 30 s, got '3 m'"),
    "deviations": (curve(deviation_share=0.1), "observations.s", "expected exactly one of deviation"),
    "probe": (curve(quantity="displacement"), "observations.s", "the quantity 'displacement' needs 'probe:'"),
    "surface": (curve(surface="y+"), "observations.s", "the quantity 'settlement' has no 'surface'"),
    "nothing": (
        {"unknowns": SECTION["unknowns"]},
        "",
        "expected either 'observations:' or 'points:' of this study",
    ),
    "few": (curve(until="400 s"), "unknowns", "as unknowns without a prior, got 3 for 4"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_faults_are_told_with_file_line_and_key(case: str, tmp_path: Path) -> None:
    section, key, words = REFUSED[case]
    path = write(tmp_path, section)
    with pytest.raises(ConfigurationError) as refused:
        read_plan(path)
    told = str(refused.value)
    assert words in told
    assert "\n" not in told
    where, _, text = told.partition(": ")
    file, _, line = where.rpartition(":")
    assert file == str(path)
    assert text.startswith(f"calibration{'.' if key else ''}{key}: ")
    last = (key or "calibration").rpartition(".")[2]
    lines = path.read_text(encoding="utf-8").splitlines()
    assert "missing" in words or last in lines[int(line) - 1]


def test_other_data_are_named_by_curve_and_file(tmp_path: Path) -> None:
    path, out = write(tmp_path, SECTION), tmp_path / "out"

    def claim() -> CalibrationFolder:
        return CalibrationFolder(out, _identity(read_plan(path), False), resume=True)

    claim()
    claim()
    text = "holds another calibration, with other data of 'settlement' (creep.csv); choose"
    for old, new in (("[um]", "[nm]"), ("60,", "61,"), ("20\n", "21\n")):
        (tmp_path / "creep.csv").write_text(CREEP.replace(old, new), encoding="utf-8")
        with pytest.raises(RunFolderError, match=re.escape(text)):
            claim()


def test_a_study_without_a_section_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigurationError, match="expected a section 'calibration:' with unknowns and observations"
    ):
        read_plan(write(tmp_path))
    with pytest.raises(
        ConfigurationError, match="a file of its own has 'experiments:' with the study of each"
    ):
        read_plan({"unknowns": SECTION["unknowns"], "observations": SECTION["observations"]})


def test_a_number_without_a_scale_is_compared_with_the_test(two: dict[str, Any], tmp_path: Path) -> None:
    """The clock is compared with the time from the first datum to the middle one."""
    two["unknowns"]["delay"] = {"of": "time_shift", "lower": "-100 ms", "upper": "100 ms"}
    found = read_plan(write(tmp_path, study=two, name="both.yaml"))
    times = [curve.times * curve.time_factor for curve in found.curves]
    middle = min(float(np.median(each) - each[0]) for each in times)
    rule = found.rule
    assert rule.distances == {"delay": pytest.approx(0.1 * middle * 1000)}
    two["unknowns"]["delay"]["resolution"] = "20 ms"
    two["unknowns"]["radius"]["resolution"] = 0.005
    rule = read_plan(write(tmp_path, study=two, name="both.yaml")).rule
    assert rule.distances == {"delay": pytest.approx(20), "radius": 0.005}
    two["unknowns"]["delay"]["resolution"] = "0 ms"
    with pytest.raises(ConfigurationError, match=r"delay\.resolution: expected a number above 0, got '0 ms'"):
        read_plan(write(tmp_path, study=two, name="both.yaml"))
