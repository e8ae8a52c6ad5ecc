"""Regions, fields and axes of a body: their values at points, and what is refused, with its key."""

from __future__ import annotations

from types import SimpleNamespace

import meshio
import numpy as np
import pytest
import tifffile
from pydantic import ValidationError

from porocore.core.units import OutputUnits, ResultUnits, Scales, using_units
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import box
from porocore.macro.body.mesh_file import read_body
from porocore.macro.composition.fields import covered_lines
from porocore.macro.composition.regions import (
    BodyFields,
    CellRanges,
    region_numbers,
    require_composition,
    sections,
)
from porocore.macro.problem import MacroSetup
from porocore.testing.synthetic.response import confined_column

#: A column of four elements up to y = 2, each 0.5 high.
MESH = box((np.array([0.0, 1.0]), np.linspace(0, 2, 5), np.array([0.0, 1.0])))
Y = MESH.quadrature_points[..., 1].ravel()
NEEDS = SimpleNamespace(parameters=("radius",), parameters_of=lambda region: ("radius",))


def setup(fields=None, regions=None):
    return MacroSetup.model_validate({"boundary": {}, "fields": fields or {}, "regions": regions or {}})


def radius(field, time=0.0, regions=None):
    """The values of a field at all points."""
    return BodyFields(setup({"radius": field}, regions), MESH, NEEDS).at(time).parameters[:, 0]


def save_mesh(path, name="density"):
    """Two hexahedra below and above y = 1 with the data 1 and 3."""
    y = np.repeat([0.0, 1.0, 2.0], 4)
    x, z = np.tile([0, 1, 1, 0], 3), np.tile([0, 0, 1, 1], 3)
    cells = [("hexahedron", np.array([range(8), range(4, 12)]))]
    meshio.write_points_cells(
        path, np.stack([x, y, z], axis=1).astype(float), cells, cell_data={name: [[1.0, 3.0]]}
    )
    return {"kind": "data", "path": str(path), "data": name}


def save_image(path, shape=(1, 2, 1)):
    """Voxels of edge 1 with the values 0, 1, … along y."""
    np.save(path, np.broadcast_to(np.arange(shape[1], dtype=float)[None, :, None], shape))
    return {"kind": "image", "path": str(path), "voxel_size": 1.0}


@pytest.mark.parametrize("kind", ["image", "mesh"])
def test_what_a_file_covers_is_told_beside_the_body(kind, tmp_path):
    """An edge of 3 without a unit, meant in another one, covers a body of (1, 2, 1) all the same."""
    field = (
        save_image(tmp_path / "a.npy") | {"voxel_size": 3}
        if kind == "image"
        else save_mesh(tmp_path / "a.vtu")
    )
    (line,) = covered_lines(sections(setup({"radius": field})), (np.zeros(3), np.array([1.0, 2.0, 1.0])))
    ends = {"image": "a.npy covers (0, 0, 0) to (3, 6, 3)", "mesh": "a.vtu covers (0, 0, 0) to (1, 2, 1)"}[
        kind
    ]
    assert line == f"macro.fields.radius: {ends}, the body (0, 0, 0) to (1, 2, 1)"


def test_an_image_of_a_field_may_be_a_metaimage(tmp_path):
    sitk = pytest.importorskip("SimpleITK", reason="pip install SimpleITK")
    sitk.WriteImage(sitk.GetImageFromArray(np.array([[[0.5], [2.5]]])), str(tmp_path / "a.mha"))
    field = {"kind": "image", "path": str(tmp_path / "a.mha"), "voxel_size": 1.0}
    np.testing.assert_array_equal(radius(field), np.where(Y < 1, 0.5, 2.5))


def test_slices_of_a_field_are_told_with_their_gaps_and_how_viewers_show_them(tmp_path):
    for k, value in ((2, 0), (3, 100), (9, 200), (10, 255)):
        tifffile.imwrite(tmp_path / f"{k}.tif", np.full((2, 1), value, np.uint8), photometric="miniswhite")
    field = {"kind": "image", "path": str(tmp_path / "*.tif"), "voxel_size": 1}
    np.testing.assert_array_equal(radius(field), 0)
    covers, gaps, view = covered_lines(sections(setup({"radius": field})), (np.zeros(3), np.ones(3)))
    assert covers.startswith(f"macro.fields.radius: {tmp_path.name}/*.tif covers (0, 0, 0) to (1, 2, 4)")
    assert gaps.startswith(
        "note: macro.fields.radius: slices are missing between 2.tif and 10.tif, numbered 4 to 8"
    )
    assert "shows the value 0 of the file bright and 255 dark, since its tag" in view


def test_numbers_formulas_and_tables_at_the_points():
    np.testing.assert_array_equal(radius(0.25), 0.25)
    np.testing.assert_allclose(radius("0.2 + 0.01*y*t", time=2.0), 0.2 + 0.02 * Y, rtol=1e-15)
    table = {"kind": "table", "along": "y", "table": [[0.5, 0.1], [1.0, 0.2], [1.0, 0.3]]}
    np.testing.assert_allclose(
        radius(table), np.where(Y > 1, 0.3, 0.1 + 0.2 * np.clip(Y - 0.5, 0, 0.5)), rtol=1e-14
    )


def test_a_field_is_reached_in_time():
    field = {"formula": "1 + y", "initial": 1.0, "over": {"ramp": 1.0, "until": 4.0}}
    np.testing.assert_allclose(radius(field, time=1.0), 1 + Y / 4, rtol=1e-15)
    np.testing.assert_allclose(radius(field, time=9.0), 1 + Y, rtol=1e-15)
    assert setup({"radius": field}).corners == (4.0,)


def test_files_and_pictures_are_read_at_the_centres_of_elements(tmp_path):
    above = Y > 1
    np.testing.assert_array_equal(radius(save_image(tmp_path / "a.npy")), np.where(above, 1.0, 0.0))
    grey = save_image(tmp_path / "a.npy") | {"values": [[0, 0.1], [1, 0.3]]}
    np.testing.assert_array_equal(radius(grey), np.where(above, 0.3, 0.1))
    for name in ("a.vtu", "a.vtk"):
        np.testing.assert_array_equal(radius(save_mesh(tmp_path / name)), np.where(above, 3.0, 1.0))


REGIONS = {
    "layer": {"kind": "layer", "above": 0.5, "below": 1.5},
    "box": {"kind": "box", "low": [0, 0.5, 0], "high": [1, 1.5, 1]},
    "sphere": {"kind": "sphere", "centre": [0.5, 1.0, 0.5], "radius": 0.5},
}


@pytest.mark.parametrize("kind", REGIONS)
def test_regions_are_the_elements_whose_centres_they_hold(kind):
    found = region_numbers(MESH, setup(regions={"middle": REGIONS[kind]}).regions)
    assert found.tolist() == [0, 1, 1, 0]


def test_half_spaces_and_named_volumes():
    half = {"kind": "half-space", "point": [0, 1, 0], "normal": [0, 1, 0]}
    assert region_numbers(MESH, setup(regions={"top": half}).regions).tolist() == [0, 0, 1, 1]
    named = type(MESH)(MESH.points, MESH.cells, {}, {"core": np.array([2])})
    core = setup(regions={"core": {"kind": "volume", "name": "core"}}).regions
    assert region_numbers(named, core).tolist() == [0, 0, 1, 0]
    with pytest.raises(
        ConfigurationError, match=r"macro.regions.core.name: .* no volume 'core'; it names none"
    ):
        region_numbers(MESH, core)


def test_a_region_has_its_own_values_and_the_others_of_the_body():
    top = {"kind": "layer", "above": 1.0, "fields": {"radius": 0.3}}
    np.testing.assert_array_equal(radius(0.2, regions={"top": top}), np.where(Y > 1, 0.3, 0.2))


def test_axes_are_turned_or_given_by_two_directions():
    for axes in (
        {"about": [0, 0, 2], "angle": 90},
        {"about": [0, 0, 1], "angle": "45*y/abs(y)*2"},
        {"first": [0, "x/x", 0], "second": [-1, 5, 0]},
    ):
        needs = SimpleNamespace(parameters=(), parameters_of=lambda region: ())
        place = BodyFields(setup({"axes": axes}), MESH, needs).at(0.0).place
        expected = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
        np.testing.assert_allclose(place.axes, np.broadcast_to(expected, place.axes.shape), atol=1e-15)


def test_what_does_not_change_is_evaluated_once():
    body = BodyFields(setup({"radius": "0.1*y"}), MESH, NEEDS)
    assert body.at(0.0) is body.at(5.0)
    assert not body.varies
    assert BodyFields(setup({"radius": "0.1*t"}), MESH, NEEDS).varies


def test_files_count_by_their_content(tmp_path):
    one, other = (setup({"radius": save_image(tmp_path / name)}) for name in ("a.npy", "b.npy"))
    assert one.specification() == other.specification() != setup({"radius": 0.2}).specification()
    assert not {"fields", "regions"} & setup().specification().keys()


@pytest.mark.parametrize(
    ("fields", "regions", "said"),
    [
        ({"radios": 0.2}, {}, r"macro.fields.radios: 'radios' is no parameter of the cell; did you mean 'radius'\?"),
        ({}, {}, r"macro.fields.radius: missing; the cell has the parameter 'radius', which has no value in the body"),
        (
            {},
            {"top": {"above": 1.0, "fields": {"radius": 0.2}}},
            "which has no value in the rest of the body",
        ),
        ({"radius": "0.1 + 0.2*y"}, {}, r"fields.radius: the field is 0.\d+ at .*, beyond the range \[0.1, 0.3\]"),
        (
            {"radius": {"formula": "0.4", "initial": 0.2, "over": {"ramp": 1, "until": 1}}},
            {},
            r"the field is 0.3\d* at .*, t = .*beyond",
        ),
        ({"radius": "log(y - 1)"}, {}, r"macro.fields.radius: 'log\(y - 1\)' is no finite number at \("),
        (
            {"radius": 0.2},
            {"a": {"above": 0.6}, "b": {"below": 1.2}},
            r"macro.regions.b: 1 of its 2 elements lie in the region 'a' too, one at \(0.5, 0.75, 0.5\)",
        ),
        ({"radius": 0.2}, {"a": {"above": 5.0}}, r"macro.regions.a: none of the 4 elements has its centre in this"),
        (
            {"radius": 0.2, "axes": {"first": [1, 0, 0], "second": ["y", 0, 0]}},
            {},
            "macro.fields.axes.second: the direction has no part perpendicular to the first axis",
        ),
    ],
)  # fmt: skip
def test_what_does_not_suit_the_body_or_the_cell_is_refused(fields, regions, said):
    with pytest.raises(ConfigurationError, match=said):
        require_composition(setup(fields, regions), MESH, CellRanges([{"radius": (0.1, 0.3)}] * 3), 1.0)


@pytest.mark.parametrize(
    "radius",
    ["0.2 + 0.15*sin(2*pi*t)", {"formula": "0.35", "initial": 0.2, "over": {"expression": "sin(2*pi*t)"}}],
    ids=["formula", "course"],
)
def test_a_field_that_comes_back_between_the_times_of_the_check_is_refused(radius):
    """A period fits twenty times into the run, at whose twenty-first parts the field is always where it began."""
    with pytest.raises(ConfigurationError, match=r"macro.fields.radius: the field is 0\.3.*beyond the range"):
        require_composition(setup({"radius": radius}), MESH, CellRanges([{"radius": (0.1, 0.3)}]), 20.0)


#: Cells of the rest of the body, which has a radius, and of the region 'deep', which has a radius and a level.
TWO_CELLS = CellRanges([{"radius": (0.1, 0.3)}, {"radius": (0.2, 0.5), "level": (0.0, 1.0)}])
DEEP = {"below": 1.0, "cell": "clay"}


def test_cells_of_regions_share_the_names_of_their_parameters():
    fields = {"radius": "0.25 + 0.05*y", "level": "t"}
    composed = setup(fields | {"radius": 0.25}, {"deep": DEEP | {"fields": {"radius": "0.4 - 0.1*y"}}})
    require_composition(composed, MESH, TWO_CELLS, 1.0)
    body = BodyFields(composed, MESH, TWO_CELLS)
    deep = Y < 1
    np.testing.assert_allclose(body.at(0.5).parameters[:, 0], np.where(deep, 0.4 - 0.1 * Y, 0.25), rtol=1e-15)
    np.testing.assert_array_equal(body.at(0.5).parameters[:, 1], np.where(deep, 0.5, np.nan))


@pytest.mark.parametrize(
    ("fields", "own", "said"),
    [
        # Within the range of the one cell, but not of the other.
        ({"radius": 0.15, "level": 0}, {}, r"fields.radius: the field is 0.15 at .*, beyond the range \[0.2, 0.5\]"),
        ({"radius": 0.25, "level": 0}, {"radius": 0.6}, r"deep.fields.radius: the field is 0.6 at .*\[0.2, 0.5\]"),
        ({"radius": 0.25, "level": 0, "edge": 1}, {}, "fields.edge: 'edge' is no parameter of the cell; the param"),
        ({"radius": 0.25}, {}, "the parameter 'level', which has no value in the region 'deep'"),
        ({"level": 0.5}, {"radius": 0.4}, "the parameter 'radius', which has no value in the rest of the body"),
    ],
)  # fmt: skip
def test_fields_are_held_to_the_cell_that_is_there(fields, own, said):
    with pytest.raises(ConfigurationError, match=said):
        require_composition(setup(fields, {"deep": DEEP | {"fields": own}}), MESH, TWO_CELLS, 1.0)


def test_a_region_has_no_field_of_another_cell():
    cells = CellRanges([{"radius": (0.1, 0.3)}, {"level": (0.0, 1.0)}])
    with pytest.raises(
        ConfigurationError,
        match=r"macro.regions.deep.fields.radius: 'radius' is no parameter of the cell 'clay'; the param",
    ):
        require_composition(
            setup({"radius": 0.2}, {"deep": DEEP | {"fields": {"radius": 0.2, "level": 1}}}), MESH, cells, 1.0
        )


def test_files_that_do_not_cover_the_body_are_refused(tmp_path):
    with pytest.raises(
        ConfigurationError, match=r"macro.fields.radius: the image of 1 × 1 × 1 voxels reaches from"
    ):
        radius(save_image(tmp_path / "a.npy", (1, 1, 1)))
    with pytest.raises(ConfigurationError, match=r"2 of 4 elements of the body lie outside its elements"):
        radius(save_mesh(tmp_path / "a.vtu") | {"scale": 0.5})
    with pytest.raises(
        ConfigurationError, match=r"macro.fields.radius.data: a.vtu has no data 'mass' of its elements"
    ):
        radius(save_mesh(tmp_path / "a.vtu") | {"data": "mass"})
    np.save(tmp_path / "b.npy", np.full((1, 2, 1), np.nan))
    gaps = {"kind": "image", "path": str(tmp_path / "b.npy"), "voxel_size": 1.0}
    with pytest.raises(ConfigurationError, match="holds no finite number at"):
        radius(gaps)


@pytest.mark.parametrize("named", [False, True])
def test_a_picture_of_greys_without_values_is_asked_for_them(tmp_path, named):
    image = save_image(tmp_path / "a.npy") | ({"values": [[0, 0.2], [1, 0.6]]} if named else {})
    with pytest.raises(ConfigurationError, match="beyond the range") as told:
        require_composition(setup({"radius": image}), MESH, CellRanges([{"radius": (0.1, 0.3)}]), 1.0)
    hint = "or widen the range; without 'values: [[value in the file, parameter], …]' the file holds the parameter"
    assert (hint in str(told.value)) is not named


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"axes": 0.2}, "'axes' are the material axes"),
        ({"fibres": {"about": [0, 0, 1], "angle": 3}}, "material axes are given under the name 'axes'"),
        ({"axes": {"about": [0, 0, 1]}}, "about and angle belong together"),
        (
            {"axes": {"about": [0, 0, 1], "angle": 90, "initial": 0, "over": {"ramp": 1, "until": 2}}},
            "expected initial and over under 'angle:'",
        ),
        ({"radius": "0.1*w"}, "unknown name"),
        ({"radius": {"formula": "1", "initial": 2}}, "initial and over belong together"),
        (
            {"radius": {"kind": "table", "along": "y", "table": [[1, 1], [0, 1]]}},
            "entry 2 lies before entry 1",
        ),
        (
            {"axes": {"about": [0, 0, 1], "angle": "90 deg"}},
            r"in degrees, without a unit; write 90, got '90 deg'",
        ),
        ({"axes": {"about": [0, 0, 1], "angle": "1 rad"}}, r"in degrees, without a unit; write 57\.2958"),
        (
            {"radius": {"kind": "image", "path": "a.npy", "voxel_size": 1, "values": [[10, 0.1], [10, 0.2]]}},
            "expected more than 10 in entry 2, got 10; sort them, and give each once",
        ),
    ],
)
def test_faulty_fields_are_refused_when_they_are_read(fields, said):
    with pytest.raises(ValidationError, match=said):
        setup(fields)


def test_the_names_of_volumes_come_with_the_mesh(tmp_path):
    # Two tetrahedra under the names 'lower' and 2, and a face.
    (tmp_path / "a.msh").write_text(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n3 1 \"lower\"\n2 5 \"base\"\n$EndPhysicalNames\n"
        "$Nodes\n5\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 -1\n5 0 0 1\n$EndNodes\n"
        "$Elements\n3\n1 4 2 2 2 1 2 3 5\n2 4 2 1 1 1 3 2 4\n3 2 2 5 5 1 2 4\n$EndElements\n"
    )  # fmt: skip
    mesh = read_body(tmp_path / "a.msh", None, 1.0)
    assert {name: elements.tolist() for name, elements in mesh.volumes.items()} == {"lower": [1], "2": [0]}
    assert mesh.centres[1, 2] < 0 < mesh.centres[0, 2]


def test_parts_and_kinks_of_a_problem_know_them():
    problem = confined_column(2, fields={"radius": 0.2}, regions={"top": {"above": 1.0}})
    assert {"fields", "regions"} <= problem.parts


@pytest.mark.parametrize(
    ("fields", "regions", "said"),
    [
        (
            {"radius": "0.1 + 0.1*y"},
            {},
            r"the field is 0\.29\d* at \([\d.]+, 19\d\d, [\d.]+\) mm, beyond the range",
        ),
        (
            {"radius": {"formula": "0.3", "initial": 0.2, "over": {"ramp": 1, "until": 2}}},
            {},
            r"mm, t = 1\d{4} s, beyond the range",
        ),
        (
            {"radius": {"formula": "log(y - 1)"}},
            {},
            r"no finite number at \([\d.]+, 56\.\d+, [\d.]+\) mm, t = 0, one of",
        ),
        (
            {"radius": 0.2, "axes": {"first": [0, 1, 0], "second": [0, "y", 0]}},
            {},
            r"axes.second: the direction has no part perpendicular to the first axis at \(.*\) mm, so that it gives",
        ),
        (
            {"radius": 0.2},
            {"low": {"kind": "layer", "below": 0.1}},
            r"low: none of the 4 elements .* they lie from \(500, 250, 500\) mm to \(500, 1750, 500\) mm: move",
        ),
        (
            {"radius": 0.2},
            {"low": {"kind": "layer", "below": 1.5}, "high": {"kind": "layer", "above": 0.5}},
            r"one at \(500, 750, 500\) mm; regions must not overlap",
        ),
    ],
)
def test_places_and_times_in_messages_have_the_units_of_the_study(fields, regions, said):
    """A length is 1 m."""
    scales = Scales(modulus=1.0, length=1.0, pore=0.01, viscosity=1.0)
    units = ResultUnits(scales, OutputUnits(length="mm"))
    ranges = CellRanges([{"radius": (0.1, 0.25)}] * 3)
    with using_units(units), pytest.raises(ConfigurationError, match=said):
        require_composition(setup(fields, regions), MESH, ranges, 2.0)
