"""Parameters of a cell: ranges in its settings, members of its family, and what messages say of faults."""

import pickle

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.family.family import member_with
from porocore.core.files.yaml_document import YamlDocument
from porocore.core.units import Scales, resolved
from porocore.errors import ConfigurationError
from porocore.study.config.config import RunConfig
from porocore.study.config.loading import benchmark_path, cell_from, validated

RADIUS, RATIO = {"range": [0.15, 0.3]}, {"range": [0.2, 0.45]}
FAMILY = {"geometry": {"radius": RADIUS}, "material": {"poisson_ratio": RATIO}}
SEVERAL = {
    "materials": {
        "core": {"poisson_ratio": RATIO},
        "1": {"poisson_ratio": 0.3},
    },
    "geometry": {"radii": [{"range": [0.1, 0.2]}, 0.2, 0.2]},
    "viscosity": {"range": [1, 2]},
}
FIBRES = {"kind": "holzapfel-gasser-ogden", "shear_modulus": 1, "bulk_modulus": 1, "k1": 1, "k2": 1}


def test_a_range_is_a_parameter_of_the_cell():
    family = cell_from(FAMILY)
    assert [(p.name, p.key, p.lower, p.upper) for p in family.parameters] == [
        ("radius", "cell.geometry.radius", 0.15, 0.3),
        ("poisson_ratio", "cell.material.poisson_ratio", 0.2, 0.45),
    ]
    assert family.geometry.radius == pytest.approx(0.225)
    assert family.is_family
    member = family.at({"poisson_ratio": 0.3, "radius": 0.2})
    assert (member.geometry.radius, member.material.poisson_ratio) == (0.2, 0.3)
    assert member == family.at([0.2, 0.3])
    assert member.parameter_values.tolist() == [0.2, 0.3]
    assert member.parameters == family.parameters
    assert not member.is_family
    assert family.at([0.3, 0.3]).at([0.2, 0.3]) == member


@pytest.mark.parametrize("settings", [FAMILY, SEVERAL])
def test_dump_and_pickle_give_the_family_back(settings):
    family = cell_from(settings)
    for copy in (cell_from(family.model_dump(mode="json")), cell_from(family.model_dump())):
        assert copy == family
        assert copy.identity == family.identity
    member = family.at([(p.lower + 2 * p.upper) / 3 for p in family.parameters])
    assert pickle.loads(pickle.dumps(member)) == member != family


def test_the_order_of_parameters_is_that_of_the_keys_not_of_the_file():
    turned = {key: FAMILY[key] for key in reversed(FAMILY)}
    assert cell_from(turned).parameters == cell_from(FAMILY).parameters


def test_names_have_region_and_axis_where_several_are_there():
    assert [p.name for p in cell_from(SEVERAL).parameters] == [
        "radii.x", "core.poisson_ratio", "viscosity",
    ]  # fmt: skip


def test_names_tell_parts_of_lists_and_equal_keys_apart():
    energy = {"kind": "expression", "energy": "p/2*(I1 - 3) - p*log(J) + (J - 1)**2*radius"}
    ogden = {"kind": "ogden", "terms": [{"mu": {"range": [1, 2]}, "alpha": 2}], "bulk_modulus": 3}
    named = [
        {**energy, "parameters": {"p": {"range": [1, 2]}, "radius": RADIUS}},
        ogden,
    ]
    assert [[p.name for p in cell_from({"material": material}).parameters] for material in named] == [
        ["material.parameters.p", "material.parameters.radius"],
        ["terms.0.mu"],
    ]


def test_identity_of_a_member_has_its_numbers_and_the_base_of_the_mesh_only():
    plain = cell_from({"material": {"poisson_ratio": 0.3}, "geometry": {"radius": 0.2}})
    of_material = cell_from({"material": {"poisson_ratio": RATIO}, "geometry": {"radius": 0.2}})
    assert of_material.at([0.3]).identity == plain.identity != of_material.identity
    moved, wider = cell_from(FAMILY), cell_from({**FAMILY, "geometry": {"radius": {"range": [0.1, 0.32]}}})
    identities = {plain.identity, moved.at([0.2, 0.3]).identity, wider.at([0.2, 0.3]).identity}
    assert len(identities) == 3
    widened = cell_from({**FAMILY, "material": {"poisson_ratio": {"range": [0.1, 0.45]}}})
    assert widened.at([0.2, 0.3]).identity == moved.at([0.2, 0.3]).identity


def test_point_group_of_a_family_is_that_of_all_members():
    # The middle of the range is the radius of the other channels.
    family = cell_from({"geometry": {"radii": [{"range": [0.15, 0.25]}, 0.2, 0.2]}})
    assert family.point_group.name == "4/mmm"
    assert family.at([0.2]).point_group.name == "m-3m"


def test_a_number_without_a_range_is_overridden_from_the_configured_mesh():
    cell = cell_from({"material": {"poisson_ratio": RATIO}})
    member = member_with(cell, {"radius": 0.22, "poisson_ratio": 0.3})
    assert [p.name for p in member.parameters] == ["radius", "poisson_ratio"]
    assert member.moved_from == {"cell.geometry.radius": 0.25}
    assert member.geometry.radius == 0.22
    with pytest.raises(ConfigurationError, match=r"^poisson_ratio: no value is given"):
        member_with(cell, {"radius": 0.22})
    with pytest.raises(ConfigurationError, match=r"^radus: no parameter .* did you mean 'radius'"):
        member_with(cell, {"radus": 0.22, "poisson_ratio": 0.3})


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"radius": 0.4, "poisson_ratio": 0.3}, "radius: expected a number from 0.15 to 0.3"),
        ({"radius": 0.2}, "poisson_ratio: no value is given"),
        ({"radius": 0.2, "poisson_ratio": 0.3, "ratio": 1}, "ratio: no parameter"),
        ({"radius": float("nan"), "poisson_ratio": 0.3}, "radius: expected a finite number"),
        ([0.2], "expected 2 values, of radius, poisson_ratio"),
        ([0.2, "0.3"], "poisson_ratio: expected a number, got '0.3'"),
    ],
)
def test_values_that_are_no_member_are_refused(values, message):
    with pytest.raises(ConfigurationError, match=f"^{message}"):
        cell_from(FAMILY).at(values)


@pytest.mark.parametrize(
    ("settings", "key", "message"),
    [
        ({"geometry": {"radius": {"range": [0.3, 0.2]}}}, "geometry.radius", "lower < upper, got \\[0.3, 0.2\\]"),
        ({"geometry": {"radius": {"range": 0.2}}}, "geometry.radius", "two numbers, got 0.2"),
        ({"geometry": {"radius": {**RADIUS, "step": 1}}}, "geometry.radius", "got step, too"),
        ({"geometry": {"radius": {"range": [0.2, 0.6]}}}, "geometry.radius", "0.5"),
        ({"geometry": {"radius": RADIUS, "fillet": 0.2}}, "geometry.fillet", "at radius = 0.15"),
        ({"mesh": {"size": {"range": [0.2, 0.3]}}}, "mesh.size", "a range cannot stand here"),
        ({"material": {**FIBRES, "directions": [[RATIO, 0, 1]]}}, "material.directions.0", "angle"),
        ({"materials": {"a": {"poisson_ratio": {"range": [0.3, 0.7]}}}}, "materials.a.poisson_ratio", "0.5"),
    ],
)  # fmt: skip
def test_faulty_ranges_are_one_message_each_at_their_key(settings, key, message):
    with pytest.raises(ConfigurationError, match=f"^settings: cell.{key}.*{message}") as refused:
        cell_from(settings)
    assert len(str(refused.value).splitlines()) == 1
    with pytest.raises(ConfigurationError, match=f"^{key}.*{message}"):
        Cell(**settings)


def test_ends_of_a_range_may_have_units():
    material = {"kind": "mooney-rivlin", "c10": {"range": ["1 kPa", "2 kPa"]}, "c01": 0.1, "bulk_modulus": 1}
    scales = Scales(modulus=1e4, length=1e-3, pore=1e-6)
    data, faults = resolved(RunConfig, {"cell": {"material": material}}, scales)
    assert not faults
    assert data["cell"]["material"]["c10"] == {"range": [0.1, 0.2]}


def test_a_study_has_the_ranges_in_identity_and_record():
    document = YamlDocument.read(benchmark_path())
    config = validated(
        YamlDocument.of({**document.data, "cell": FAMILY, "closure": "potential"}, document.folder)
    )
    again = RunConfig.model_validate(config.model_dump(mode="json"))
    assert again == config
    assert again.identity == config.identity
    assert np.array_equal([p.base for p in again.cell.parameters], [p.base for p in config.cell.parameters])


def test_a_member_has_the_mesh_of_the_family_moved_with_its_velocity():
    mesh = {"size": 0.5, "fluid_size": 0.5, "element": "linear"}
    family = cell_from({**FAMILY, "mesh": mesh})
    base, member, h = family.make_mesh("solid", "eighth"), family.at([0.2, 0.3]), 1e-5
    moved = member.make_mesh("solid", "eighth")
    assert np.array_equal(moved.cells, base.cells)
    assert np.linalg.norm(moved.points[moved.wall][..., :2], axis=-1).min() >= 0.2 - 1e-12
    velocity = member.mesh_velocity("solid", "eighth")
    assert velocity.shape == (2, *moved.points.shape)
    assert not velocity[1].any()
    ends = [family.at([0.2 + s * h, 0.3]).make_mesh("solid", "eighth").points for s in (1, -1)]
    assert np.allclose(velocity[0], (ends[0] - ends[1]) / (2 * h), atol=1e-8)
    whole = Cell(**{**family.model_dump(), "supercell": (2, 1, 1)}).at([0.2, 0.3])
    assert whole.mesh_velocity("solid", "whole").shape == (2, *whole.make_mesh("solid", "whole").points.shape)
