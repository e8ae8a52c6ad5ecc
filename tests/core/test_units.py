"""Values with units: the same study in SI units and in plain numbers, to the last bit; and what is refused."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import yaml

from porocore.core.files.yaml_document import YamlDocument
from porocore.core.units import Scales, UnitError, has_unit, in_si, using_units
from porocore.errors import ConfigurationError
from porocore.study.config.config import differences
from porocore.study.config.loading import load_config
from porocore.study.notes import checks
from tests.helpers.nested_settings import config_from

EXAMPLE = Path(__file__).parents[2] / "examples" / "brain-indentation.yaml"

SCALES = {"modulus": "2.5 kPa", "length": "12.5 mm", "pore": "5 um", "viscosity": "1.6 Pa*s"}
#: With which most values in SI units are no decimal numbers.
ODD = {"modulus": "2.1 kPa", "length": "13 mm", "pore": "7 um", "viscosity": "1.3 Pa*s"}
PLAIN = {
    "cell": {
        "material": {"kind": "mooney-rivlin", "c10": 0.1, "c01": 0.3, "bulk_modulus": 0.7},
        "viscosity": 0.003,
    },
    "sampling": {
        "inputs": {"H22": {"range": [-0.1, 0.1], "step": 0.05}, "p": {"range": [-0.02, 0.06], "step": 0.02}}
    },
    "macro": {
        "body": {"kind": "cylinder", "radius": 0.3, "height": 1.1},
        "surfaces": {"punch": {"of": "y+", "centre": [0, 1.1, 0], "radius": 0.15, "x": [0, 0.2]}},
        "boundary": {
            "y-": {"displacement": [0, {"table": [[0, 0], [0.7, -0.1]]}, 0], "pressure": 0.01},
            "y+": {"traction": [0, {"ramp": -0.3, "until": 0.9}, 0.1], "flux": 0.07},
            "punch": {"plate": -0.03, "pressure": {"expression": "0.1*t"}},
            "side": {"follower": 0.017, "pressure": None},
        },
        "body_force": [0, -0.23, 0],
        "initial": {"pressure": 0.011},
        "probes": {"tip": [0, 1.1, 0]},
        "time": {
            "end": 7.3,
            "step": 0.3,
            "ramp_step": 0.01,
            "smallest_step": 1e-5,
            "profiles": [1.7],
            "load_curve": [[0.3, 0.5]],
        },
        "loads": [0.9],
    },
}


def units_of(scales):
    """Unit → what it amounts to in SI units, and the scale of its quantity."""
    E, L, d, mu = (
        Fraction(scales[name].split()[0]) / by
        for name, by in (("modulus", Fraction(1, 1000)), ("length", 1000), ("pore", 10**6), ("viscosity", 1))
    )
    velocity = E * d**2 / (L * mu)
    return {
        "MPa": (10**6, E),
        "mm": (Fraction(1, 1000), L),
        "ms": (Fraction(1, 1000), L / velocity),
        "mN": (Fraction(1, 1000), E * L**2),
        "um/s": (Fraction(1, 10**6), velocity),
        "kN/m**3": (1000, E / L),
        "mPa*s": (Fraction(1, 1000), mu),
    }


#: By unit, the dotted paths of the values that are given in it.
WHERE = {
    "MPa": [
        "cell.material.c10",
        "cell.material.c01",
        "cell.material.bulk_modulus",
        "sampling.inputs.p.range.0",
        "sampling.inputs.p.range.1",
        "sampling.inputs.p.step",
        "macro.boundary.y-.pressure",
        "macro.boundary.y+.traction.1.ramp",
        "macro.boundary.y+.traction.2",
        "macro.boundary.side.follower",
        "macro.initial.pressure",
    ],
    "mm": [
        "macro.body.radius",
        "macro.body.height",
        "macro.surfaces.punch.centre.1",
        "macro.surfaces.punch.radius",
        "macro.surfaces.punch.x.1",
        "macro.boundary.y-.displacement.1.table.1.1",
        "macro.probes.tip.1",
    ],
    "ms": [
        "macro.boundary.y-.displacement.1.table.1.0",
        "macro.boundary.y+.traction.1.until",
        "macro.time.end",
        "macro.time.step",
        "macro.time.ramp_step",
        "macro.time.smallest_step",
        "macro.time.profiles.0",
        "macro.time.load_curve.0.0",
    ],
    "mN": ["macro.boundary.punch.plate"],
    "um/s": ["macro.boundary.y+.flux"],
    "kN/m**3": ["macro.body_force.1"],
    "mPa*s": ["cell.viscosity"],
}


def decimals(number):
    """Every digit of a number whose decimals end."""
    twos, rest = 0, number.denominator
    while rest % 2 == 0:
        twos, rest = twos + 1, rest // 2
    fives = 0
    while rest % 5 == 0:
        fives, rest = fives + 1, rest // 5
    assert rest == 1
    places = max(twos, fives)
    return f"{number.numerator * 10**places // number.denominator}e-{places}"


def with_units(scales=SCALES):
    """The same study, every value with its unit."""
    study = yaml.safe_load(yaml.safe_dump(PLAIN))
    for unit, places in WHERE.items():
        one, scale = units_of(scales)[unit]
        for place in places:
            *above, last = place.split(".")
            section = study
            for part in above:
                section = section[int(part) if isinstance(section, list) else part]
            last = int(last) if isinstance(section, list) else last
            value = Fraction(repr(section[last])) * scale / one
            terminates = set(prime_factors(value.denominator)) <= {2, 5}
            section[last] = f"{decimals(value) if terminates else f'{float(value):.17g}'} {unit}"
    return {"scales": scales, **study}


def prime_factors(number):
    found, factor = [], 2
    while factor * factor <= number:
        while number % factor == 0:
            found.append(factor)
            number //= factor
        factor += 1
    return found + ([number] if number > 1 else [])


def test_a_study_in_si_units_is_its_dimensionless_twin_to_the_last_bit():
    plain, dimensional = config_from(PLAIN), config_from(with_units())
    changed = [d for d in differences(plain, dimensional) if not d.startswith("scales")]
    assert changed == []
    assert plain.stages == dimensional.stages
    assert plain.identity == dimensional.identity


def test_values_that_no_decimal_number_gives_are_off_by_no_more_than_their_last_digit():
    plain, dimensional = (dict(leaves(config_from(s).macro.model_dump())) for s in (PLAIN, with_units(ODD)))
    assert plain.keys() == dimensional.keys()
    for key, value in plain.items():
        if isinstance(value, float):
            assert abs(dimensional[key] - value) <= np.spacing(abs(value)), key
        else:
            assert dimensional[key] == value


def leaves(data, at=""):
    pairs = (
        data.items()
        if isinstance(data, dict)
        else enumerate(data)
        if isinstance(data, list | tuple)
        else None
    )
    if pairs is None:
        yield at, data
    for key, value in pairs or ():
        yield from leaves(value, f"{at}.{key}")


def test_scales_are_not_rounded():
    """1e-3 Pa m² / (0.1 m)² is 0.1 Pa, which three roundings would miss."""
    scales = Scales(force=1e-3, length=0.1, pore=1e-6)
    assert scales.exact.stress == Fraction(1, 10)
    config = config_from(
        PLAIN | {"scales": {"force": 1e-3, "length": 0.1, "pore": 1e-6}, "cell": {"viscosity": 1}}
    )
    assert config.scales == scales
    assert Scales(modulus=0.1, length=0.1, pore=1e-6).exact == scales.exact


@pytest.mark.parametrize(
    ("one", "other"),
    [("1 kPa", "1000 Pa"), ("0.3 kPa", "300 Pa"), ("1 bar", "1e5 Pa"), ("3kPa", " 3e3  N/m^2 ")],
)
def test_one_value_in_two_units_is_one_number(one, other):
    assert in_si(one, "stress") == in_si(other, "stress")


@pytest.mark.parametrize(
    ("text", "quantity", "parts"),
    [
        ("5 kPa", "displacement", ["expected a length, such as 5 mm", "got '5 kPa', which is a pressure"]),
        ("5 mm", "stress", ["expected a stress", "got '5 mm', which is a length"]),
        ("5 kPaa", "stress", ["the unit 'kPaa' is not known"]),
        ("3 degC", "stress", ["got '3 degC', which is a temperature"]),
        ("1 kpa", "stress", ["the unit 'kpa' is not known; did you mean 'kPa'?"]),
        ("1,5 kPa", "stress", ["decimals stand after a point: write 1.5 kPa"]),
        ("3 mm Hg", "pressure", ["did you mean 'mmHg'?"]),
        ("3 mm", "pressure", ["which is a length", "did you mean 'mmHg'?"]),
        ("3 g", "force", ["which is a mass", "did you mean 'gf'", "9.80665 N for 1 kg"]),
        ("3 kg/cm**2", "stress", ["did you mean 'kgf/cm**2'"]),
        ("3 kp", "force", ["did you mean 'kgf'?"]),
        ("3 kg", "time", ["which is a mass"]),
        ("5 Sek.", "time", ["the unit 'Sek.' is not known; did you mean 's'?"]),
        ("5 Min.", "time", ["got '5 Min.', which is a length; did you mean 'min'?"]),
        ("5 Std", "time", ["the unit 'Std' is not known; did you mean 'h'?"]),
        ("5 jours", "time", ["the unit 'jours' is not known; did you mean 'day'?"]),
        ("5 Std", "stress", ["expected a stress, such as 2 kPa, got '5 Std'; the unit 'Std' is not known"]),
        ("40 kP", "stress", ["got '40 kP', which is a viscosity; did you mean 'kPa'?"]),
        ("1 px", "displacement", ["got '1 px'", "a pixel is no unit of length: write how large one voxel"]),
        ("2 pixels", "displacement", ["a pixel is no unit of length"]),
        ("3 px**2", "permeability", ["a pixel is no unit of length"]),
        ("4 %", "time", ["expected a time", "got '4 %'"]),
        ("five mm", "displacement", ["expected a length", "got 'five mm'"]),
        ("5 __import__('os')", "displacement", ["is not known"]),
        ("5 mm**99999", "displacement", ["expected a length"]),
    ],
)
def test_what_is_no_value_of_its_quantity_is_refused(text, quantity, parts):
    with pytest.raises(UnitError) as error:
        in_si(text, quantity)
    assert all(part in str(error.value) for part in parts), str(error.value)


@pytest.mark.parametrize(
    ("text", "quantity", "value"),
    [("2 min.", "time", 120), ("3 kPa.", "stress", 3000), ("4 mPa.s", "viscosity", Fraction(4, 1000))],
)
def test_points_end_abbreviations_and_multiply(text, quantity, value):
    assert in_si(text, quantity) == value


def test_a_length_is_no_slip_for_a_stress_in_mercury():
    with pytest.raises(UnitError) as error:
        in_si("3 mm", "stress")
    assert str(error.value) == "expected a stress, such as 2 kPa, got '3 mm', which is a length"


def test_plain_numbers_have_no_unit():
    assert not any(map(has_unit, ("1e-3", "-2", ".5", "", "mm", "y+")))
    assert all(map(has_unit, ("1e-3 m", "-2kPa", ".5 1/s")))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"macro": {"loads": ["1 kPa"]}}, "macro.loads.0: expected a number without a unit, got '1 kPa'"),
        (
            {"macro": {"time": {"end": "5 mm"}}},
            "macro.time.end: expected a time, such as 30 s, got '5 mm', which is a length",
        ),
        (
            {"macro": {"body": {"radius": "-5 mm"}}},
            "macro.body.radius: expected a number with 0 < radius, got '-5 mm'",
        ),
        ({"scales": {"modulus": "2 mm"}}, "scales.modulus: expected a stress, such as 2 kPa, got '2 mm'"),
        ({"scales": {"force": "1 N"}}, "scales: expected either modulus, which is E, or force"),
        (
            {"scales": {"length": -1}},
            "scales.length: expected a number with 1e-30 <= length <= 1e+30, got -1",
        ),
        ({"output_units": {"length": "kPa"}}, "output_units.length: expected a length"),
        ({"output_units": {"lenght": "mm"}}, "output_units.lenght: unknown key; did you mean 'length'?"),
    ],
)
def test_faults_of_units_name_the_key(change, message):
    study = yaml.safe_load(yaml.safe_dump({"scales": SCALES, **PLAIN}))
    for section, keys in change.items():
        for key, value in keys.items():
            below = study.setdefault(section, {})
            below[key] = {**below[key], **value} if isinstance(value, dict) else value
    with pytest.raises(ConfigurationError) as error:
        config_from(study)
    assert any(f"settings: {message}" in line for line in str(error.value).splitlines()), str(error.value)


def test_with_faulty_scales_the_faults_of_other_keys_are_told_too(tmp_path):
    """They were told alone, and everything else after they were mended."""
    text = EXAMPLE.read_text(encoding="utf-8").replace("pore: 5 um", "pore: 5 kP", 1)
    text = text.replace("  loads: [1]", "  lods: [1]\n  loads: [1]", 1).replace("under: ", "undr: ", 1)
    (tmp_path / "study.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError) as refused:
        load_config(tmp_path / "study.yaml")
    told = str(refused.value)
    assert "scales.pore: expected a length, such as 5 mm, got '5 kP', which is a viscosity" in told
    assert "macro.lods: unknown key; did you mean 'loads'?" in told
    assert len(told.splitlines()) == 3, told


def test_a_wrong_unit_does_not_hide_an_unknown_surface(tmp_path):
    text = EXAMPLE.read_text(encoding="utf-8").replace("ramp: 0.6 mm", "ramp: 0.6 kPa", 1)
    text = text.replace("    y-:", "    bottom:", 1)
    (tmp_path / "study.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError) as refused:
        load_config(tmp_path / "study.yaml")
    told = str(refused.value)
    assert "expected a length, such as 5 mm, got '0.6 kPa', which is a pressure" in told
    assert "macro.boundary.bottom: no such surface; did you mean 'y-'? the surfaces are" in told


def test_a_unit_without_scales_is_explained(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text("sampling: {inputs: {p: {range: [0, 1]}}}\nmacro:\n  body:\n    size: [1, 5 mm, 1]\n")
    with pytest.raises(ConfigurationError) as error:
        load_config(path)
    lines = str(error.value).splitlines()
    assert f"{path}:4: macro.body.size.1: '5 mm' has a unit, but the configuration has no scales" in lines[2]
    with pytest.raises(ConfigurationError, match="output_units: results get units only with 'scales:'"):
        config_from(PLAIN | {"output_units": {"length": "mm"}})


def test_the_resolved_configuration_of_a_study_with_units_loads_to_the_same(tmp_path):
    config = config_from({**with_units(), "output_units": {"length": "um", "time": "h"}})
    path = tmp_path / "resolved.yaml"
    path.write_text(config.resolved_yaml(), encoding="utf-8")
    assert load_config(path) == config


def test_the_example_in_si_units_has_only_texts_that_are_read():
    path = EXAMPLE
    config = load_config(path)
    assert config.scales is not None
    assert config.macro.body.height == pytest.approx(1)


def test_with_scales_the_fluid_has_no_default_viscosity():
    """A viscosity of 0.001 times that of the scales was taken silently."""
    given = {name: part for name, part in PLAIN.items() if name != "cell"}
    scales = {"modulus": "1 kPa", "length": "1 mm", "pore": "1 um", "viscosity": "1 mPa s"}
    for cell in ({}, {"cell": {"geometry": {"kind": "orthogonal-channels", "radius": 0.2}}}):
        with pytest.raises(ConfigurationError, match=r"cell.viscosity: missing; .* add 'viscosity: 1 mPa s'"):
            config_from(given | {"scales": scales} | cell)
    assert config_from(given | {"scales": scales, "cell": {"viscosity": "3 cP"}}).cell.viscosity == 3
    assert config_from(given).cell.viscosity == 1e-3


def test_messages_speak_in_the_units_of_the_study():
    """They were dimensionless, in studies whose values all have units."""
    study = PLAIN | {
        "scales": {"modulus": "1 kPa", "length": "1 mm", "pore": "1 um"},
        "output_units": {"time": "min", "length": "um", "stress": "mmHg"},
    }
    macro = study["macro"] | {"time": {"end": "30 min", "profiles": ["45 min"]}}
    with pytest.raises(ConfigurationError) as refused:
        config_from(
            study | {"macro": macro | {"time": {"end": "1e-3 s", "ramp_increments": 1, "ramp_step": "1 min"}}}
        )
    assert "end = 1.66667e-05 min does not lie behind the ramp, which takes 1 min" in str(refused.value)
    config = config_from(study | {"macro": study["macro"] | {"probes": {"far": [0, "5 mm", 0]}}})
    with using_units(config.result_units), pytest.raises(ConfigurationError) as refused:
        checks.place(config)
    assert "macro.probes.far: the point (0, 5000, 0) µm lies outside the body" in str(refused.value)
    assert " µm; move it inside (coordinates are multiples of scales.length where" in str(refused.value)
    moved = {"side": {"displacement": ["1 um", None, None]}}
    config = config_from(study | {"macro": study["macro"] | {"boundary": study["macro"]["boundary"] | moved}})
    with (
        using_units(config.result_units),
        pytest.raises(ConfigurationError, match="u_1 = 1 µm contradicts u_1 = 0"),
    ):
        checks.place(config)


@pytest.mark.parametrize(
    ("text", "found"), [("1:30", "90 to base 60"), ("010", "8 to base 8"), ("-1:30.5", "-90.5")]
)
def test_numbers_to_other_bases_are_refused(tmp_path, text, found):
    """YAML reads 1:30 as 90, so that an end of 1:30 h was one of 90."""
    path = tmp_path / "study.yaml"
    path.write_text(f"title: a study\nmacro:\n  time: {{end: {text}}}\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=f"study.yaml:3: '{text}' is the number {found}"):
        YamlDocument.read(path)
    path.write_text(f"title: '{text}'\n", encoding="utf-8")
    assert YamlDocument.read(path).data == {"title": text}


#: Scales of which one unit of time is 63.01 min, with all values of a column in units.
MIXED = {
    "scales": {"modulus": "0.5 MPa", "length": "1 mm", "pore": "23 nm", "viscosity": "1 Pa s"},
    "cell": {"viscosity": "1 mPa s"},
    "sampling": {"inputs": {"p": {"range": ["0 kPa", "5 kPa"], "step": "1 kPa"}}},
    "macro": {
        "loads": [1],
        "body": {"kind": "cylinder", "radius": "2 mm", "height": "1 mm"},
        "boundary": {
            "y-": {"displacement": [0, 0, 0]},
            "y+": {"traction": [0, {"ramp": "-20 kPa", "until": "2 min"}, 0], "pressure": "1 kPa"},
        },
        "time": {"end": "120 min", "step": "5 min", "profiles": ["20 min", "1 h"]},
    },
}


@pytest.mark.parametrize(
    ("at", "value", "note"),
    [
        (
            "macro.time.end",
            120,
            "120 has no unit beside macro.boundary.y+.traction.1.until: 2 min, so it is a multiple of its scale, "
            "7561 min; write '120 min' if that is meant",
        ),
        (
            "macro.time.profiles",
            [0.5, 1],
            "0.5 has no unit beside macro.boundary.y+.traction.1.until: 2 min, so it is a multiple of its scale, "
            "31.51 min;",
        ),
        ("macro.boundary.y+.traction.1.until", 0.5, "0.5 has no unit beside macro.time.end: 120 min"),
        (
            "macro.body.radius",
            20,
            "20 has no unit beside macro.body.height: 1 mm, so it is a multiple of its scale, 20 mm; write '20 mm'",
        ),
        ("macro.boundary.y+.pressure", 0.002, "so it is a multiple of its scale, 1 kPa; write '0.002 kPa'"),
        ("sampling.inputs.p.step", 0.002, "beside sampling.inputs.p.range.0: 0 kPa, so it is a multiple of"),
        (
            "scales.length",
            0.001,
            "0.001 has no unit beside scales.pore: 23 nm, so it is in m, 1e+06 nm; write",
        ),
        ("cell.viscosity", 0.001, ""),
        ("macro.boundary.y+.pressure", 0, ""),
        ("title", "120", ""),
    ],
)
def test_a_number_without_a_unit_beside_values_with_one_is_noted(at, value, note):
    """An end of 120 beside steps of 5 min was taken for 120 scale times, 126 h, in silence."""
    study = yaml.safe_load(yaml.safe_dump(MIXED))
    assert config_from(study).unit_notes == ()
    *sections, key = at.split(".")
    below = study
    for section in sections:
        below = below[int(section)] if section.isdigit() else below[section]
    below[key] = value
    notes = config_from(study).unit_notes
    assert len(notes) == bool(note), notes
    assert all(each.startswith(f"{at}: ") and note in each for each in notes), notes


def test_named_numbers_of_a_material_may_be_plain_beside_moduli():
    assert load_config(EXAMPLE.parent / "cartilage-zones.yaml").unit_notes == ()


def test_copies_of_a_study_keep_the_notes_and_its_dimensionless_form_has_none(tmp_path):
    study = yaml.safe_load(yaml.safe_dump(MIXED))
    study["macro"]["time"]["end"] = 120
    config = config_from(study)
    assert config.with_backends(surrogate="polynomial").unit_notes == config.unit_notes != ()
    (tmp_path / "resolved.yaml").write_text(config.resolved_yaml(), encoding="utf-8")
    again = load_config(tmp_path / "resolved.yaml")
    assert again.unit_notes == ()
    assert again == config
