"""docs/plugins.md held to the code: what closures need, and the building blocks that it names."""

import importlib
import inspect
import re
from pathlib import Path

import pytest

from porocore.macro.laws.closure import CLOSURES
from porocore.sampling.execution import CellPool

PAGE = (Path(__file__).parents[2] / "docs/plugins.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", CLOSURES)
def test_what_a_closure_needs_is_told(name):
    (row,) = re.findall(rf"^\| `{name}` \| (.*) \| (.*) \|$", PAGE, re.MULTILINE)
    responses, derivatives = (tuple(re.findall(r"`(\w+)`", cell)) for cell in row)
    assert responses == CLOSURES[name].responses
    assert derivatives == CLOSURES[name].derivatives


@pytest.mark.parametrize(
    ("home", "members"),
    [
        ("porocore.cell.meshing.mesh.CellMesh", ("wall", "periodic_class", "quadrature_degree")),
        ("porocore.cell.cell.Cell", ("make_mesh", "solid")),
        ("porocore.cell.materials.material.StrainEnergy", ("energy_density", "stress", "tangent")),
        ("porocore.cell.materials.material.Material", ("on",)),
        ("porocore.cell.materials.hyperelastic.Composite", ("on",)),
        ("porocore.macro.integration.stepping.Stepper", ("next", "accept", "reject")),
        ("porocore.macro.problem.MacroProblem", ("corners",)),
    ],
)
def test_what_a_plugin_is_handed_is_there(home, members):
    module, _, name = home.rpartition(".")
    part = PAGE[PAGE.index("## What a plugin is handed") : PAGE.index("## What is checked when it comes")]
    found = getattr(importlib.import_module(module), name)
    for member in members:
        assert hasattr(found, member)
        assert re.search(rf"\b{member}\b", part)


def test_training_data_carry_tangents_where_there_are_some():
    """Pools ask for them unless they are told otherwise; see the page."""
    assert inspect.signature(CellPool).parameters["tangent"].default is True
