"""Every limit of docs/index.md has a case: what asks for more is refused, or no key could ask for it."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import pytest

import porocore
from porocore.study.config.schema import configuration_schema

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "bad_input"))
from tests.bad_input.bad_row import study  # noqa: E402

CLAY = {
    "geometry": {"kind": "orthogonal-channels", "radius": 0.2},
    "material": {"kind": "neo-hookean", "poisson_ratio": 0.2},
    "viscosity": 1e-3,
}
BELOW = {"kind": "layer", "along": "y", "below": 3}
NOT_MODELLED = "this is not modelled"
#: By the bold words of a limit and a part of its text: what asks for more, and a part of the message that refuses it.
#: Where there are no changes, no key of the schema has the words.
CASES: dict[str, dict[str, tuple[dict[str, Any], str]]] = {
    "Other physics.": {
        "no plasticity": ({"cell.material.yield_stress": 0.1}, NOT_MODELLED),
        "damage": ({"cell.material.damage": 0.1}, NOT_MODELLED),
        "no inertia": ({"macro.density": 1.0}, "there is no inertia"),
        "no heat": ({"macro.boundary.y+.temperature": 1.0}, "porocore is isothermal"),
        "relaxes do so alike": (
            {"cell.material.relaxation": {"branches": [{"strength": 1, "time": 1, "stress": "shear"}]}},
            "unknown key",
        ),
        "without a diffusion": (
            {"macro.charges": {"density": 0.1, "bath": 0.15, "diffusivity": 1}},
            "macro.charges.diffusivity: unknown key",
        ),
        "fluid fills all pores": ({"cell.saturation": 0.5}, NOT_MODELLED),
    },
    "Two microstructures at one place.": {
        "one periodic cell": (
            {
                "cells": {"clay": CLAY, "sand": CLAY},
                "macro.regions": {"deep": {**BELOW, "cell": ["clay", "sand"]}},
            },
            "macro.regions.deep.cell",
        )
    },
    "Buckling over several cells in a body.": {
        "shapes that are longer": ({"macro.supercell": [2, 1, 1]}, "it belongs under 'cell:'")
    },
    "Contact between bodies.": {
        "one body": ({"macro.bodies": [{"kind": "box"}, {"kind": "box"}]}, "unknown key"),
        "cannot touch another": ({"macro.boundary.y+.contact": "plate"}, "unknown key"),
    },
    "Wedges, pyramids and mixed meshes.": {"hexahedra of one kind": ({}, "pyramid")},
    "States far from all solved ones.": {"not reliable": ({}, "extrapolat")},
    "Exactness with the closure of the paper.": {
        "an approximation": ({"closure": "exact"}, "the closures are mean-gradient, potential")
    },
}
#: No key asks for these, under any of their names.
NO_KEYS = r"inertia|heat|plastic|damage|diffusi|electric|bodies|pyramid|extrapolat"


def limits() -> dict[str, str]:
    """Return the limits of the page: their text by their bold words."""
    text = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    section = text.partition("## What it cannot do")[2].partition("\n## ")[0]
    bullets = re.split(r"^- ", section, flags=re.MULTILINE)[1:]
    found = [re.fullmatch(r"\*\*(.+?)\*\* (.+)", " ".join(bullet.split())) for bullet in bullets]
    assert all(found), bullets
    return {each[1]: each[2] for each in found if each}


def test_every_limit_has_cases_and_every_case_a_limit() -> None:
    found = limits()
    assert found.keys() == CASES.keys()
    for name, cases in CASES.items():
        for part in cases:
            assert part in found[name], (name, part)


@pytest.mark.parametrize(
    ("changes", "message"),
    [pytest.param(*case, id=part) for cases in CASES.values() for part, case in cases.items() if case[0]],
)
def test_a_study_beyond_a_limit_is_refused(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    path.write_text(study(), encoding="utf-8")
    porocore.Study(path)
    path.write_text(study(changes), encoding="utf-8")
    with pytest.raises(porocore.ConfigurationError, match=re.escape(message)):
        porocore.Study(path)


def keys_of(schema: Any) -> set[str]:
    """Return the names of all keys of a schema."""
    if isinstance(schema, list):
        return {key for each in schema for key in keys_of(each)}
    if not isinstance(schema, dict):
        return set()
    own = schema.get("properties", {})
    return {
        *(own if isinstance(own, dict) else ()),
        *(key for each in schema.values() for key in keys_of(each)),
    }


def test_no_key_asks_for_what_is_beyond_the_limits() -> None:
    keys = keys_of(configuration_schema())
    assert {"closure", "viscosity", "boundary"} <= keys
    assert [key for key in keys if re.search(NO_KEYS, key)] == []
    for cases in CASES.values():
        for changes, words in cases.values():
            assert changes or not any(words in key for key in keys)
