"""Faulty fields and regions of a study: one message with file, line and key."""

from __future__ import annotations

import copy

import pytest
import yaml

from porocore import load_config
from porocore.core.files.yaml_document import YamlDocument
from porocore.errors import ConfigurationError
from porocore.study.config.errors import located
from porocore.study.notes.checks import place

SIDE = {"displacement": [0, None, 0]}
STUDY = {
    "cell": {"geometry": {"kind": "orthogonal-channels", "radius": {"range": [0.2, 0.3]}, "axes": "xyz"}},
    "sampling": {"inputs": {"p": {"range": [0, 0.1], "step": 0.1}}},
    "macro": {
        "body": {"kind": "box", "size": [0.1, 7.5, 0.1], "elements": [1, 2, 1]},
        "boundary": {"x-": SIDE, "x+": SIDE, "z-": SIDE, "z+": SIDE, "y-": {"displacement": [0, 0, 0]}},
        "loads": [-0.04],
    },
}
DEEP = {"kind": "layer", "below": 3}


def written(folder, macro):
    study = copy.deepcopy(STUDY)
    study["macro"] |= macro
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(study, sort_keys=False))
    return path


@pytest.mark.parametrize(
    ("macro", "said"),
    [
        ({"fields": {"radius": "0.2 + 0.02*y"}}, "macro.fields.radius: the field is 0.341547 at (0.01127, 7.077, "),
        ({}, "macro.fields.radius: missing; the cell has the parameter 'radius'"),
        ({"fields": {"radius": 0.2, "raduis": 1}}, "macro.fields.raduis: 'raduis' is no parameter of the cell; did"),
        ({"fields": {"radius": "0.2 + w"}}, "macro.fields.radius: 'w' at character 7"),
        (
            {"fields": {"radius": {"kind": "tabel"}}},
            "macro.fields.radius.kind: expected one of formula, table, grid, image, data, axes, got 'tabel'",
        ),
        (
            {"fields": {"radius": {"kind": "table", "along": "w", "table": [[0, 1]]}}},
            "macro.fields.radius.along: expected 'x', 'y'",
        ),
        (
            {"fields": {"radius": 0.2}, "regions": {"deep": DEEP | {"fields": {"radius": 0.4}}}},
            "macro.regions.deep.fields.radius: the field is 0.4 at",
        ),
        ({"regions": {"deep": DEEP | {"belwo": 3}}}, "macro.regions.deep.belwo: unknown key; did you mean 'below'?"),
        ({"regions": {"deep": DEEP | {"cell": "clay"}}}, "there is no cell 'clay'; there are none; add it under"),
        (
            {"fields": {"radius": 0.2}, "regions": {"deep": DEEP, "low": {"below": 2}}},
            "macro.regions.low: 1 of its 1 elements lie in the region 'deep' too",
        ),
    ],
)  # fmt: skip
def test_a_fault_is_told_with_file_line_and_key(tmp_path, macro, said):
    path = written(tmp_path, macro)
    with pytest.raises(ConfigurationError) as error, located(YamlDocument.read(path)):
        place(load_config(path))
    (line,) = str(error.value).splitlines()
    at, _, message = line.partition(" ")
    assert said in message
    number = int(at.rstrip(":").rpartition(":")[2])
    assert path.read_text().splitlines()[number - 1].strip().partition(":")[0] in (
        *message.partition(":")[0].split("."),
        "macro",
    )


def test_what_suits_the_cell_is_read_back_as_it_was(tmp_path):
    regions = {"deep": DEEP | {"fields": {"axes": {"about": [0, 0, 1], "angle": "10*y"}}}}
    config = load_config(written(tmp_path, {"fields": {"radius": "0.2 + 0.01*y"}, "regions": regions}))
    place(config)
    (tmp_path / "again.yaml").write_text(config.resolved_yaml())
    assert load_config(tmp_path / "again.yaml") == config
