"""The walk over a configuration: places, kinds, and nothing that is not declared."""

import pytest
import yaml

from porocore.core.formulas import TimeFunction
from porocore.core.models.strict import walk
from porocore.study.config.config import RunConfig
from porocore.study.config.loading import benchmark_path
from tests.helpers.nested_settings import config_from


@pytest.fixture
def data():
    settings = yaml.safe_load(benchmark_path().read_text(encoding="utf-8"))
    settings["cell"]["geometry"] = {"kind": "sphere-array", "radius": 0.2}
    settings["macro"]["body_force"] = [0, {"expression": "sin(t)"}, 0]
    return settings


def values(model, value):
    return {place.path: place for place in walk(model, value)}


def test_every_value_follows_the_one_that_holds_it(data):
    seen = set()
    for place in walk(RunConfig, data):
        assert place.path == () or place.above.path == place.path[:-1]
        assert place.above is None or place.above.path in seen
        seen.add(place.path)
    assert ("macro", "loads", "0") in seen


def test_a_kind_chooses_the_declaration(data):
    found = values(RunConfig, data)
    assert found[("cell", "geometry")].annotation.__name__ == "SphereArray"
    assert found[("cell", "geometry", "radius")].value == 0.2
    assert found[("macro", "body_force", "1")].annotation is TimeFunction


def test_settings_and_the_configuration_of_them_have_the_same_places(data):
    read, made = values(RunConfig, data), values(RunConfig, config_from(data))
    assert set(read) <= set(made)
    assert isinstance(made[("macro", "body_force", "1")].value, TimeFunction)
    assert made[("macro", "body_force", "1")].annotation is TimeFunction


def test_unknown_keys_are_passed_over(data):
    data["cell"]["colour"] = {"red": 1}
    assert not [path for path in values(RunConfig, data) if "colour" in path]
