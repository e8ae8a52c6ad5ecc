"""From nothing to a configuration: ``porocore init`` and ``schema``."""

import json
from pathlib import Path

import pytest
import yaml

from porocore.study.config.config import RunConfig
from porocore.study.config.loading import MODELINE, examples, load_config
from porocore.study.config.schema import configuration_schema, field_docstrings
from porocore.study.notes.checks import place
from tests.helpers.invoked import BENCHMARK, EXAMPLES, invoke, refusal

# ---- init ---------------------------------------------------------------------------------------


def test_init_lists_every_example_with_its_title():
    lines = invoke("init").stdout.splitlines()
    assert {line.split()[0] for line in lines} == {path.stem for path in EXAMPLES}
    assert all(len(line.split()) > 1 for line in lines)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_what_init_writes_is_the_example_and_ready_to_run(path, tmp_path, recwarn):
    to = tmp_path / "mine.yaml"
    assert invoke("init", path.stem, "--to", to).stdout.strip() == str(to)
    assert to.read_text(encoding="utf-8").startswith(MODELINE)
    assert f"examples/{path.name}" not in to.read_text(encoding="utf-8")
    config = load_config(to)
    assert config == load_config(path)
    place(config)
    assert not list(recwarn)


def test_init_overwrites_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert invoke("init", "filter").stdout.strip() == "filter.yaml"
    Path("filter.yaml").write_text("mine")
    assert "filter.yaml exists and is not overwritten" in refusal("init", "filter")
    assert Path("filter.yaml").read_text() == "mine"
    assert "no example 'filtre'; did you mean 'filter'?" in refusal("init", "filtre", "--to", "new.yaml")
    assert "expected a KIND to write to new.yaml" in refusal("init", "--to", "new.yaml")
    assert not Path("new.yaml").exists()
    assert next(iter(examples())) == "dehghani2022"


# ---- schema -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def validator():
    jsonschema = pytest.importorskip("jsonschema")
    schema = configuration_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_obeys_the_schema(path, validator):
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert [error.message for error in validator.iter_errors(data)] == []
    resolved = yaml.safe_load(load_config(path).resolved_yaml())
    assert [error.message for error in validator.iter_errors(resolved)] == []


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("cell.geometry.radius", 0.7),
        ("cell.geometry.radios", 0.2),
        ("cell.material.kind", "neohookean"),
        ("sampling.inputs.H44", {"range": [0, 1]}),
        ("macro.body.elements", [1, 10.5, 1]),
        ("macro.boundary.y+.tracktion", [0, 1, 0]),
        ("macro.boundary.y+.traction", [0, {"ramp": 1, "untill": 2}, 0]),
        ("macro.boundary.y+.traction", [0, "much", 0]),
        ("macro.time.end", 0),
        ("closure", 3),
        ("closure", "mean-gradients"),
        ("scales", {"modulus": "1 kPa", "pore": "1 um"}),
        ("cell.geometry.radius", {"range": [0.2]}),
        ("cell.geometry.radius", {"range": [0.2, 0.7]}),
        ("cell.mesh.size", {"range": [0.2, 0.3]}),
    ],
)
def test_the_schema_refuses_what_is_faulty(key, value, validator):
    data = yaml.safe_load(BENCHMARK.read_text(encoding="utf-8"))
    *above, last = key.split(".")
    section = data
    for part in above:
        section = section[part]
    section[last] = value
    assert list(validator.iter_errors(data)), key


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("geometry", {"radius": {"range": [0.2, 0.3]}}),
        ("geometry", {"radii": [0, {"range": [0.2, 0.3]}, 0.1]}),
        ("material", {"poisson_ratio": {"range": [0.2, 0.3]}, "swelling": {"range": [1, 1.1]}}),
        (
            "material",
            {"kind": "ogden", "bulk_modulus": 1, "terms": [{"mu": {"range": ["1 kPa", 2]}, "alpha": 2}]},
        ),
        ("viscosity", {"range": [1, "2 Pa s"]}),
    ],
)
def test_the_schema_accepts_ranges(key, value, validator):
    data = yaml.safe_load(BENCHMARK.read_text(encoding="utf-8"))
    data["cell"][key] = value
    assert [error.message for error in validator.iter_errors(data)] == []


def test_the_schema_describes_keys_and_tells_their_dimension():
    schema = configuration_schema()
    boundary = schema["$defs"]["Boundary"]["properties"]
    assert boundary["plate"]["x-dimension"] == "force"
    assert "rigid frictionless plate" in boundary["plate"]["description"]
    texts = field_docstrings(RunConfig)
    assert schema["properties"]["scales"]["description"] == texts["scales"]
    assert "x-dimension" not in schema["$defs"]["FemSettings"]["properties"]["backend"]


def test_the_schema_says_what_every_key_means_and_in_which_unit():
    schema = configuration_schema()
    count = 0
    for section in (schema, *schema["$defs"].values()):
        for key, value in section.get("properties", {}).items():
            text = value.get("description", "")
            assert text.endswith("."), f"{section['title']}.{key}: {text!r}"
            assert "``" not in text, key
            assert "x-dimension" not in value or " Unit: " in text, key
            count += 1
        said = section.get("description", "")
        assert not any(markup in said for markup in ("``", ":class:", "\n")), said
    assert count > 150
    assert schema["$defs"]["Boundary"]["properties"]["plate"]["description"].endswith(" Unit: E × area.")
    assert schema["$defs"]["MeshSettings"]["properties"]["size"]["description"].endswith(" Unit: cell.")


def test_the_schema_goes_to_a_file_and_replaces_only_a_schema(tmp_path):
    path = tmp_path / "porocore.schema.json"
    assert json.loads(invoke("schema").stdout) == configuration_schema()
    for _ in range(2):
        assert invoke("schema", "--to", path).stdout.strip() == str(path)
    assert json.loads(path.read_text(encoding="utf-8")) == configuration_schema()
    path.write_text("mine")
    assert "is no JSON schema" in refusal("schema", "--to", path)
    assert path.read_text() == "mine"
