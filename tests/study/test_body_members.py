"""``porocore check`` of a body of a family's cells: the members that are solved for it, and what they predict."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from porocore import load_config
from porocore.macro.composition.linearised_law import RestCoefficients
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.states import MacroState
from porocore.study.findings import body_members
from porocore.study.findings.body_members import BodyMembers, linear_in_body, parameters_in_body, spread
from porocore.study.outline.reach_notes import predicted_reach
from porocore.testing.synthetic import porous_family

RANGES = {"radius": (0.15, 0.3), "poisson_ratio": (0.2, 0.4)}
SIDE = {"displacement": [0, None, 0]}


def study(tmp_path, fields, **macro):
    data = {
        "cell": {
            "geometry": {"kind": "orthogonal-channels", "radius": {"range": [0.15, 0.3]}},
            "material": {"poisson_ratio": {"range": [0.2, 0.4]}},
        },
        "closure": "potential",
        "sampling": {
            "sampler": "sobol",
            "inputs": {"H22": {"range": [-0.1, 0.02]}, "p": {"range": [-0.02, 0.1]}},
            "options": {"count": 8},
        },
        "macro": {
            "body": {"kind": "box", "size": [0.1, 2.0, 0.1], "elements": [1, 8, 1]},
            "boundary": {
                **dict.fromkeys(("x-", "x+", "z-", "z+"), SIDE),
                "y-": {"displacement": [0, 0, 0]},
                "y+": {"traction": [0, 1, 0], "pressure": 0},
            },
            "loads": [-0.02],
            "time": {"end": 20, "step": 2, "profiles": []},
            "fields": fields,
        }
        | macro,
    }
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(data))
    return load_config(path)


@pytest.fixture
def solved(monkeypatch):
    """Made-up members in place of solved ones, and the parameters that were asked for."""
    asked = []

    def undeformed(cell, *others):
        asked.append(tuple(cell.parameter_values.tolist()))
        at = porous_family.respond(MacroState.zeros(1).with_parameters(cell.parameter_values))
        phi = float(at.fluid_volume[0])
        return SimpleNamespace(response=at, solid_fraction=1 - phi, conductivity=at.conductivity[0])

    monkeypatch.setattr(body_members, "undeformed", undeformed)
    return asked


def coefficients(config, *values):
    at = porous_family.respond(MacroState.zeros(1).with_parameters(values))
    solid = config.cell.at(values).solid
    return LinearCoefficients.from_reference(at, 1 - float(at.fluid_volume[0]), solid, at.conductivity[0])


def test_members_are_spread_over_what_the_body_has():
    values = np.column_stack([np.linspace(0.16, 0.28, 50), np.full(50, 0.3)])
    chosen = spread(values, RANGES, 3)
    assert sorted(chosen[:, 0]) == pytest.approx([0.16, 0.219, 0.28], abs=2e-3)
    assert len(spread(values, RANGES, 50)) < 20
    assert len(spread(values[:1].repeat(7, axis=0), RANGES, 6)) == 1


def test_a_body_of_two_cells_is_that_of_its_two_members(tmp_path, solved):
    """Two layers have the coefficients of the elements' own cells."""
    low = {"deep": {"below": 1.0, "fields": {"radius": 0.18}}}
    config = study(tmp_path, {"radius": 0.28, "poisson_ratio": 0.3}, regions=low)
    members = BodyMembers.solved(config, None)
    assert sorted(solved) == [(0.18, 0.3), (0.28, 0.3)]
    found = linear_in_body(config, members.law, coefficients(config, 0.225, 0.3))
    own = {r: coefficients(config, r, 0.3) for r in (0.18, 0.28)}
    by_element = [own[0.18 if y < 1 else 0.28] for y in (np.arange(8) + 0.5) / 4]
    assert isinstance(found, RestCoefficients)
    np.testing.assert_allclose(found.storage, [c.storage for c in by_element], rtol=1e-12)
    np.testing.assert_allclose(found.conductivity, [c.conductivity for c in by_element], rtol=1e-12)
    lines = list(members.as_lines(config))
    assert lines[0] == "over the body, by 2 of its cells with radius 0.180 to 0.280, poisson_ratio 0.300:"
    stiff, soft = (own[r].stiffness[1, 1, 1, 1] for r in (0.18, 0.28))
    assert f"confined modulus {soft:.3f} to {stiff:.3f} E; conductivity K" in lines[1]


def test_the_reach_of_a_body_of_many_cells_is_told(tmp_path, solved):
    """The softest cells strain most: its ranges are those that the linear solution of its own modulus reaches."""
    time = {"end": 8000, "step": 400, "profiles": []}
    fields = {"radius": "0.16 + 0.065*y", "poisson_ratio": 0.25}
    config = study(tmp_path, fields, loads=[-0.06], time=time)
    members = BodyMembers.solved(config, None)
    assert len(members.values) == 6
    told = "\n".join(predicted_reach(config, members.law))
    assert "leaves the sampled ranges" in told
    assert "H22: {range:" in told
    # A column that is graded upwards alone is not sheared.
    assert "H12" not in told
    assert "H23" not in told
    # Drained under the whole load at the end, by the modulus of the softest member.
    softest = max(members.values[:, 0])
    strain = -0.06 / coefficients(config, softest, 0.25).stiffness[1, 1, 1, 1]
    assert f"since H22 = −{abs(strain):.3g} at" in told
    within = study(tmp_path, fields, loads=[-0.01], time=time)
    members = BodyMembers.solved(within, None)
    assert "stays within the sampled ranges" in "\n".join(predicted_reach(within, members.law))


def test_fields_that_change_are_looked_at_over_time(tmp_path):
    field = {"formula": "0.28", "initial": 0.18, "over": {"ramp": 1, "until": 20}}
    config = study(tmp_path, {"radius": field, "poisson_ratio": 0.25})
    np.testing.assert_allclose(np.unique(parameters_in_body(config)[:, 0].round(12)), [0.18, 0.23, 0.28])


def test_a_body_of_one_cell_keeps_its_coefficients(tmp_path):
    config = study(tmp_path, {"radius": 0.2, "poisson_ratio": 0.3})
    c = coefficients(config, 0.2, 0.3)
    one = config.model_copy(update={"macro": config.macro.model_copy(update={"fields": {}})})
    assert linear_in_body(one, LinearPoroelasticity(c), c) is c
