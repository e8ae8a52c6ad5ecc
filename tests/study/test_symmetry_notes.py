"""What is said of the symmetry of a cell before and after its undeformed state is solved."""

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.core.tensors import CUBIC, MIRRORS, TRIVIAL, PointGroup
from porocore.states import MacroState
from porocore.study.notes.abilities import broken_by_the_mesh, defect, uncovered, uncovered_shears
from porocore.study.notes.checks import place
from porocore.study.notes.magnitudes import out_of_plane, separation
from tests.helpers.grouped_cell import GroupedCell
from tests.helpers.nested_settings import config_from

OBLIQUE = PointGroup.generated([[[0, 1, 0], [1, 0, 0], [0, 0, 1]], np.diag([1, 1, -1])])


def inputs(*names):
    return InputSpace.from_ranges({name: (-0.1, 0.1) for name in names})


@pytest.mark.parametrize(
    ("names", "group", "shears"),
    [
        (("H22", "p"), CUBIC, []),
        (("H22", "p"), MIRRORS, []),
        (("H22", "p"), OBLIQUE, ["H12"]),
        (("H22", "H12", "p"), OBLIQUE, []),
        (("H22", "H21", "p"), OBLIQUE, []),
        (("H22", "p"), TRIVIAL, ["H12", "H13", "H23"]),
        (("H12", "H13"), MIRRORS, []),  # both together stretch along a shear of 2 and 3
        (("p",), PointGroup.generated([[[0, 1, 0], [0, 0, 1], [1, 0, 0]]]), ["H12", "H13", "H23"]),
    ],
)
def test_shears_that_are_no_inputs(names, group, shears):
    assert uncovered_shears(inputs(*names), group) == shears
    said = uncovered(inputs(*names), group)
    assert len(said) == bool(shears)
    if shears:
        assert " and ".join(shears) in said[0]
        assert group.name in said[0]


def test_a_group_that_the_rest_state_does_not_have():
    rest = GroupedCell.random(OBLIQUE).respond(MacroState.zeros(1))
    C = rest.tangent.stress_grad_u[0]
    assert defect(C, OBLIQUE) < 1e-14
    assert broken_by_the_mesh(rest, OBLIQUE) == []
    assert defect(C, CUBIC) > 0.05
    assert "breaks its symmetry, m-3m" in broken_by_the_mesh(rest, CUBIC)[0]


@pytest.mark.parametrize(
    ("body", "fibre", "said"),
    [
        (
            {"kind": "axisymmetric", "radius": 1.0, "height": 1.0},
            (0.0, 1.0, 0.7),
            "turns the body about its axis",
        ),
        ({"kind": "axisymmetric", "radius": 1.0, "height": 1.0}, (0.5, 1.0, 0.0), None),
        ({"kind": "plane-strain", "size": [1.0, 1.0]}, (0.3, 0.0, 0.7), "shears the body out of its plane"),
        ({"kind": "box", "size": [1.0, 1.0, 1.0], "elements": [1, 1, 1]}, (0.0, 1.0, 0.7), None),
    ],
)
def test_a_cell_that_leaves_the_plane_of_a_flat_body_is_told(body, fibre, said):
    """By fibres that lie in a mirror plane, or do not; the cell is so small that nothing else is told."""
    fibres = {
        "kind": "holzapfel-gasser-ogden",
        "shear_modulus": 1.0,
        "bulk_modulus": 2.0,
        "k1": 1.0,
        "k2": 1.0,
    }
    config = config_from(
        {
            "scales": {"modulus": 1e3, "length": 1.0, "pore": 0.02, "viscosity": 1e-3},
            "cell": {"material": fibres | {"directions": [list(fibre)]}, "viscosity": 1.0},
            "sampling": {"inputs": {"H22": {"range": [-0.1, 0.0]}, "p": {"range": [0.0, 0.1]}}},
            "closure": "potential",
            "macro": {"body": body, "boundary": {"y-": {"displacement": [0, 0, 0]}}, "loads": [1]},
        }
    )
    notes = list(out_of_plane(config, place(config)))
    assert len(notes) == (said is not None)
    assert all(said in note for note in notes)
    assert not list(separation(config, place(config)))
