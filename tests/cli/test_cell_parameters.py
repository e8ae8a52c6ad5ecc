"""``porocore cell state --parameters``: the member of a family, against the cell that has these numbers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import porocore
from tests.helpers.invoked import invoke, refusal

pytest.importorskip("porocore_fem_skfem")

MESH = {"size": 0.5, "fluid_size": 0.5, "element": "linear"}


@pytest.fixture
def family(tmp_path: Path) -> Path:
    cell = {
        "geometry": {"kind": "orthogonal-channels", "radius": 0.22},
        "material": {"kind": "neo-hookean", "poisson_ratio": {"range": [0.2, 0.45]}},
        "mesh": MESH,
        "viscosity": 1e-3,
    }
    path = tmp_path / "family.yaml"
    path.write_text(yaml.safe_dump({"cell": cell, "closure": "potential"}), encoding="utf-8")
    return path


@pytest.mark.parametrize("viscosity", [None, 2e-3])
def test_a_member_is_the_cell_with_its_numbers(family: Path, viscosity: float | None) -> None:
    """A range and, where it is named, a number; the cell without ranges knows nothing of families."""
    replaced = "" if viscosity is None else f",viscosity={viscosity}"
    done = invoke(
        "cell", "state", family, "--at", "H22=-0.05", "--parameters", f"poisson_ratio=0.3{replaced}", "--json"
    )
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    plain = porocore.CellProblem(
        {
            "geometry": {"kind": "orthogonal-channels", "radius": 0.22},
            "material": {"kind": "neo-hookean", "poisson_ratio": 0.3},
            "mesh": MESH,
            "viscosity": viscosity or 1e-3,
        },
        store=False,
    )
    expected = plain.response(np.diag([0.0, -0.05, 0.0]))
    assert found["status"] == "converged"
    assert expected.fluid_volume is not None
    # The porosity of a member is that of its mesh, as the fluid volume at rest is.
    at_rest = plain.response(np.zeros((3, 3))).fluid_volume
    assert at_rest is not None
    assert found["porosity"] == pytest.approx(at_rest[0], rel=1e-9)
    np.testing.assert_allclose(found["conductivity"], plain.conductivity, rtol=1e-8, atol=1e-10)
    assert found["fluid_volume"] == pytest.approx(expected.fluid_volume[0], rel=1e-8)
    np.testing.assert_allclose(found["stress"], expected.stress[0], rtol=1e-8, atol=1e-10)


def test_a_value_that_is_missing_or_outside_is_told(family: Path) -> None:
    assert refusal("cell", "state", family).endswith("give its value with --parameters poisson_ratio=0.325")
    assert refusal("cell", "state", family, "--parameters", "poisson_ratio=0.5").startswith("--parameters: ")
    assert refusal("cell", "state", family, "--parameters", "raduis=0.2").startswith("--parameters: ")
    for given, said in (
        ("poisson_ratio=nan", "poisson_ratio: expected a finite number, got 'nan'"),
        ("radius=0.2,poisson_ratio=abc", "poisson_ratio: expected a finite number, got 'abc'"),
        ("radius=0.2,radius=0.21", "radius is given twice"),
    ):
        told = refusal("cell", "state", family, "--parameters", given)
        assert told.startswith(f"--parameters: {said}; ")
