"""Inputs of several cells that the body does not move, or moves in one cell alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from porocore import load_config
from porocore.core.files.plain_data import merged
from porocore.study.notes.linear_reach import too_wide

SIDE = {"displacement": [0, None, 0]}
STUDY: dict[str, Any] = {
    "cell": {"geometry": {"kind": "orthogonal-channels", "radius": 0.3}},
    "cells": {"clay": {"geometry": {"kind": "orthogonal-channels", "radius": 0.2}}},
    "sampling": {
        "sampler": "sobol",
        "inputs": {name: {"range": [-0.1, 0.1]} for name in ("H11", "H22", "p")},
    },
    "surrogate": {"backend": "polynomial"},
    "macro": {
        "body": {"kind": "box", "size": [0.1, 4, 0.1], "elements": [1, 4, 1]},
        "regions": {"deep": {"below": 2, "cell": "clay"}},
        "boundary": {"x-": SIDE, "x+": SIDE, "z-": SIDE, "z+": SIDE, "y-": {"displacement": [0, 0, 0]}},
        "loads": [-0.04],
    },
}
ZERO, FULL = (0.0, 0.0), (-0.1, 0.1)
AFTER = ", by linear poroelasticity; keep it where large strains may"


def said(folder: Path, rest: dict[str, Any], clay: dict[str, Any], own: dict[str, Any]) -> list[str]:
    sampling = {"cells": {"clay": {"inputs": {name: {"range": ends} for name, ends in own.items()}}}}
    changes = {"sampling": sampling} if own else {}
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(merged(STUDY, changes), sort_keys=False))
    config, full = load_config(path), dict.fromkeys(("H11", "H22", "p"), FULL)
    reached = {None: full | rest, "clay": full | clay}
    return [line for name in config.cell_names for line in too_wide(config, name, reached, [])]


@pytest.mark.parametrize(
    ("rest", "clay", "own", "expected"),
    [
        ({}, {}, {}, []),
        (
            {"H11": ZERO},
            {"H11": ZERO},
            {},
            [f"note: remove H11 from 'sampling.inputs:': the body does not move it{AFTER}"],
        ),
        (
            {"H22": ZERO},
            {},
            {},
            [
                "note: move H22 from 'sampling.inputs:' to 'sampling.cells.clay.inputs:': the body moves it in no "
                f"other cell{AFTER}"
            ],
        ),
        ({"H22": ZERO}, {}, {"H22": [-0.1, 0.1]}, ["note: remove H22 from 'sampling.inputs:'"]),
        ({}, {"H22": ZERO}, {}, []),
        ({}, {"H33": ZERO}, {"H33": [-0.1, 0.1]}, ["note: remove H33 from 'sampling.cells.clay.inputs:'"]),
        ({"H11": ZERO, "H22": ZERO, "p": ZERO}, {}, {"H11": [0, 0.1], "H22": [0, 0.1], "p": [0, 0.1]}, []),
        ({"H22": (-0.001, 0)}, {}, {}, []),
    ],
    ids=["all", "none", "one cell", "own", "the rest", "own unmoved", "last inputs", "inherited range"],
)
def test_what_to_do_with_an_input_that_does_not_move(
    tmp_path: Path, rest: Any, clay: Any, own: Any, expected: list[str]
) -> None:
    found = said(tmp_path, rest, clay, own)
    assert len(found) == len(expected)
    for line, start in zip(found, expected, strict=True):
        assert line.startswith(start)
    assert "[0, 0]" not in "".join(found)
