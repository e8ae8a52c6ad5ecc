"""Several cells in one study: configuration, refusals with file, line and key, the study of each cell."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
import yaml

from porocore import load_config
from porocore.core.files.plain_data import merged
from porocore.core.files.yaml_document import YamlDocument
from porocore.errors import ConfigurationError, RunFolderError
from porocore.study.config.config import RunConfig
from porocore.study.config.errors import located
from porocore.study.notes.checks import check_backends, place
from porocore.study.run.folder import RunFolder

SIDE = {"displacement": [0, None, 0]}
STUDY: dict[str, Any] = {
    "cell": {"geometry": {"kind": "orthogonal-channels", "radius": 0.3}},
    "cells": {"clay": {"geometry": {"kind": "orthogonal-channels", "radius": 0.2}, "viscosity": 2}},
    "sampling": {
        "inputs": {"H22": {"range": [-0.1, 0.0], "step": 0.05}, "p": {"range": [0, 0.1], "step": 0.1}},
        "cells": {"clay": {"inputs": {"H22": {"range": [-0.2, 0.0], "step": 0.05}}}},
    },
    "surrogate": {"backend": "polynomial"},
    "macro": {
        "body": {"kind": "box", "size": [0.1, 4, 0.1], "elements": [1, 4, 1]},
        "regions": {"deep": {"below": 2, "cell": "clay"}},
        "boundary": {"x-": SIDE, "x+": SIDE, "z-": SIDE, "z+": SIDE, "y-": {"displacement": [0, 0, 0]}},
        "loads": [-0.04],
    },
}


def written(folder: Path, **changes: Any) -> Path:
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(merged(STUDY, changes), sort_keys=False))
    return path


@pytest.fixture
def config(tmp_path: Path) -> RunConfig:
    return load_config(written(tmp_path))


def test_each_cell_has_a_study_of_its_own(config: RunConfig) -> None:
    rest, clay = config.of_cell(None), config.of_cell("clay")
    assert config.cell_names == (None, "clay")
    assert (rest.cell.geometry.radius, clay.cell.geometry.radius) == (0.3, 0.2)
    assert clay.sampling.inputs["H22"].range == (-0.2, 0.0)
    assert clay.sampling.inputs["p"] == rest.sampling.inputs["p"] == config.sampling.inputs["p"]
    assert rest.cells == clay.cells == {}
    # The stages of the cell of the rest are those of the whole study.
    assert rest.stages.training == config.stages.training != clay.stages.training
    for one in (rest, clay):
        again = RunConfig.model_validate(yaml.safe_load(one.resolved_yaml()))
        assert again.stages == one.stages
        place(one)


def test_a_study_of_one_cell_is_its_own(config: RunConfig) -> None:
    one = config.of_cell(None)
    assert one.of_cell(None) is one


def test_fields_are_those_of_the_parameters_of_a_cell(tmp_path: Path) -> None:
    ranged = {"geometry": {"radius": {"range": [0.15, 0.25]}}}
    macro = {
        "fields": {"radius": 0.2},
        "regions": {"deep": {"fields": {"radius": 0.22, "axes": {"about": [0, 1, 0], "angle": 90}}}},
    }
    config = load_config(written(tmp_path, cells={"clay": ranged}, macro=macro))
    rest, clay = config.of_cell(None), config.of_cell("clay")
    assert rest.macro.fields == rest.macro.regions == {}
    assert clay.macro.fields == {"radius": 0.2}
    assert list(clay.macro.regions["deep"].fields) == ["radius", "axes"]
    place(config)
    assert load_config_again(config, tmp_path) == config


def load_config_again(config: RunConfig, folder: Path) -> RunConfig:
    path = folder / "again.yaml"
    path.write_text(config.resolved_yaml())
    return load_config(path)


def test_a_change_of_any_cell_is_another_run(tmp_path: Path, config: RunConfig) -> None:
    others = [
        {"cells": {"clay": {"viscosity": 3}}},
        {"sampling": {"cells": {"clay": {"inputs": {"H22": {"range": [-0.15, 0.0]}}}}}},
        {"macro": {"regions": {"deep": {"below": 1}}}},
    ]
    for changes in others:
        other = load_config(written(tmp_path, **changes))
        assert other.identity != config.identity
        assert other.stages.training == config.stages.training


def test_a_run_folder_has_a_folder_for_each_named_cell(tmp_path: Path, config: RunConfig) -> None:
    folder = RunFolder.claim(tmp_path / "run", config)
    rest, clay = folder.of_each_cell
    assert rest.dataset == folder.dataset == tmp_path / "run" / "samples.h5"
    assert clay.dataset == tmp_path / "run" / "cells" / "clay" / "samples.h5"
    assert clay.surrogate == clay.path / "surrogate.h5"
    assert (rest.stage_of_cell("cell"), clay.stage_of_cell("cell")) == ("cell", "cell, clay")
    assert rest.config.stages.cell != clay.config.stages.cell
    assert clay.whole is rest.whole is folder
    with pytest.raises(RunFolderError, match=f"make it first: porocore sample {tmp_path / 'run'}$"):
        clay.require(clay.dataset, "sample")
    assert RunFolder.open(folder.path).config == config


RADIUS = {"geometry": {"kind": "orthogonal-channels", "radius": 0.2}}
OTHER_INPUTS = {"sand": {"inputs": {"p": {"range": [0, 1], "step": 1}}}}


def pores(**geometry: Any) -> dict[str, Any]:
    return {"cells": {"clay": {"geometry": geometry}}}


@pytest.mark.parametrize(
    ("changes", "said", "line"),
    [
        (
            {"macro": {"regions": {"deep": {"cell": "caly"}}}},
            "macro.regions.deep.cell: there is no cell 'caly'; did you mean 'clay'? the cells are clay",
            "caly",
        ),
        (
            {"cells": {"sand": RADIUS}},
            "cells.sand: no region has this cell; write 'cell: sand' under",
            "sand",
        ),
        (
            {"sampling": {"cells": OTHER_INPUTS}},
            "sampling.cells.sand: there is no cell 'sand'; the cells are clay",
            "sand",
        ),
        (
            {"cells": {"../clay": RADIUS}},
            "cells: expected names of up to 40 letters, digits, '-' and '_', which are folders of the run, got",
            "cells",
        ),
        ({"cells": {"Clay": RADIUS}}, "cells: the cells 'clay' and 'Clay' differ by capitals alone", "cells"),
        (
            pores(radius=0.6),
            "cells.clay.geometry.radius: expected a number with 0 < radius < 0.5, got 0.6; at 0.5 a pore",
            "0.6",
        ),
        (pores(raduis=0.2), "cells.clay.geometry.raduis: unknown key; did you mean 'radius'?", "raduis"),
        (
            {"cells": {"clay": {"material": {"poisson_ratio": 0.6}}}},
            "cells.clay.material.poisson_ratio: expected a number with",
            "poisson_ratio",
        ),
        (
            {"sampling": {"cells": {"clay": {"ranges": 1}}}},
            "sampling.cells.clay.ranges: unknown key",
            "ranges",
        ),
    ],
)
def test_a_fault_of_the_configuration_has_file_line_and_key(
    tmp_path: Path, changes: dict[str, Any], said: str, line: str
) -> None:
    path = written(tmp_path, **changes)
    with pytest.raises(ConfigurationError) as error:
        load_config(path)
    (told,) = str(error.value).splitlines()
    at, _, message = told.partition(": ")
    assert message.startswith(said), message
    assert line in path.read_text().splitlines()[int(at.rpartition(":")[2]) - 1]


def test_the_cell_of_the_rest_of_the_body_is_not_left_out(tmp_path: Path) -> None:
    study = copy.deepcopy(STUDY)
    del study["cell"]
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(study, sort_keys=False))
    with pytest.raises(
        ConfigurationError, match="cell: missing; with 'cells:' the rest of the body needs a cell too"
    ):
        load_config(path)


def clay_over(name: str, *ends: float) -> dict[str, Any]:
    return {"sampling": {"cells": {"clay": {"inputs": {name: {"range": list(ends)}}}}}}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"macro": {"regions": {"deep": {"below": 9}}}},
            "cell: no part of the body has it, since every element lies in a region with another cell",
        ),
        (
            clay_over("H22", -1.2, 0.0),
            "sampling.cells.clay.inputs: the ranges reach det F = -0.2 at H22 = -1.2",
        ),
        (clay_over("p", 0.0, 1e6), "sampling.cells.clay.inputs.p.range: expected at most"),
        (
            {"sampling": {"inputs": {"H22": {"range": [-1.1, 0.0]}}}},
            "sampling.inputs: the ranges reach det F = -0.1",
        ),
        (
            {"macro": {"regions": {"deep": {"fields": {"radius": 0.2}}}}},
            "macro.regions.deep.fields.radius: 'radius' is no parameter of the cell 'clay'; there are none",
        ),
        (
            {"macro": {"regions": {"low": {"below": 1, "cell": "clay"}}}},
            "macro.regions.low: 1 of its 1 elements lie in the region 'deep' too",
        ),
    ],
)
def test_a_fault_that_shows_before_the_first_solve_has_the_key_of_its_cell(
    tmp_path: Path, changes: dict[str, Any], said: str
) -> None:
    pytest.importorskip("porocore_fem_skfem")
    path = written(tmp_path, **changes)
    with pytest.raises(ConfigurationError) as error, located(YamlDocument.read(path)):
        check_backends(load_config(path))
    (told,) = str(error.value).splitlines()
    at, _, message = told.partition(": ")
    assert message.startswith(said), message
    key = said.partition(":")[0].split(".")[-1]
    assert key in path.read_text().splitlines()[int(at.rpartition(":")[2]) - 1]


def test_with_scales_every_fluid_has_a_viscosity(tmp_path: Path) -> None:
    scales = {"length": "1 m", "pore": "1 mm", "modulus": "1 MPa"}
    with pytest.raises(ConfigurationError) as error:
        load_config(written(tmp_path, scales=scales, cells={"clay": {"viscosity": "2 mPa s"}}))
    assert "cell.viscosity: missing" in str(error.value)
    assert "cells.clay" not in str(error.value)
    own = {"viscosity": "1 mPa s"}
    config = load_config(written(tmp_path, scales=scales, cell=own, cells={"clay": {"viscosity": "2 mPa s"}}))
    assert config.cells["clay"].viscosity == pytest.approx(2 * config.cell.viscosity)
