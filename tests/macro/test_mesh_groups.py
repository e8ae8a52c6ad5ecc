"""Groups of meshes from files: every element once, in all of its groups, whatever the format."""

from itertools import pairwise
from pathlib import Path

import meshio
import numpy as np
import pytest

from porocore.core.files.foreign_mesh import read_mesh
from porocore.core.files.gmsh_model import gmsh_session
from porocore.errors import ConfigurationError, PorocoreError
from porocore.macro.body.kinds import Box, make_body
from porocore.macro.body.mesh import BodyMesh, Facets, Patch, boundary_facets, box, called, with_patches
from porocore.macro.body.mesh_file import read_body
from porocore.macro.boundary.conditions import boundary_data
from porocore.macro.boundary.reactions import Support, shares
from porocore.macro.composition.regions import region_numbers
from porocore.macro.problem import MacroProblem, body_mesh
from tests.helpers.column_files import exodus, with_first

#: A column of 0.1 × 1 × 0.1 in three layers; the volume 'core' is the middle one, 'all' are the three.
CORE = Path(__file__).parents[1] / "strangers" / "volumes_overlap_msh22" / "core41.msh"
FORMATS = {
    "4.1": (".msh", {"Mesh.MshFileVersion": 4.1}),
    "4.1 binary": (".msh", {"Mesh.MshFileVersion": 4.1, "Mesh.Binary": 1}),
    "4.1 with all elements": (".msh", {"Mesh.MshFileVersion": 4.1, "Mesh.SaveAll": 1}),
    "4.0": (".msh", {"Mesh.MshFileVersion": 4.0}),
    "2.2": (".msh", {"Mesh.MshFileVersion": 2.2}),
    "2.2 binary": (".msh", {"Mesh.MshFileVersion": 2.2, "Mesh.Binary": 1}),
    "Salome": (".med", {}),
    "Abaqus": (".inp", {"Mesh.SaveGroupsOfElements": 1}),
    "second order": (".msh", {"Mesh.MshFileVersion": 2.2}),
}
HEAD = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"


@pytest.fixture(scope="module")
def reference():
    return read_body(CORE, None, 1.0)


def by_place(mesh: BodyMesh, elements):
    return np.sort(np.round(mesh.centres[elements], 9).view("f8,f8,f8"), axis=0)


@pytest.mark.parametrize("name", FORMATS)
def test_a_mesh_is_one_in_every_format(tmp_path, reference, name):
    suffix, options = FORMATS[name]
    path = tmp_path / f"core{suffix}"
    with gmsh_session() as gmsh:
        gmsh.open(str(CORE))
        if name == "second order":
            gmsh.model.mesh.setOrder(2)
        for option, value in options.items():
            gmsh.option.setNumber(option, value)
        gmsh.write(str(path))
    body = read_body(path, None, 1.0)
    assert len(body.cells) == 233
    assert body.weights.sum() == pytest.approx(0.01, rel=1e-12)
    assert {"all", "core"} <= set(body.volumes)
    assert body.weights[body.volumes["core"]].sum() == pytest.approx(0.01 / 3, rel=1e-12)
    for each in ("all", "core"):
        assert (by_place(body, body.volumes[each]) == by_place(reference, reference.volumes[each])).all()
    for each in Box.surfaces:
        area = 0.01 if each[0] == "y" else 0.1
        assert Facets(body, body.surfaces[each]).areas.sum() == pytest.approx(area, rel=1e-12)
    if suffix == ".msh" and name != "second order":
        np.testing.assert_array_equal(body.cells, reference.cells)
        np.testing.assert_array_equal(body.points, reference.points)
        assert list(body.surfaces) == list(reference.surfaces)


def test_names_of_salome_have_letters_outside_ascii(tmp_path):
    """The bytes of UTF-8 are signed there; older programs write Latin-1."""
    path = tmp_path / "a.med"
    with gmsh_session() as gmsh:
        gmsh.open(str(CORE))
        for dim, new in ((3, "Kern größer 中"), (2, "Öben")):
            _, group = gmsh.model.getPhysicalGroups(dim)[0]
            gmsh.model.removePhysicalName(gmsh.model.getPhysicalName(dim, group))
            gmsh.model.setPhysicalName(dim, group, new)
        gmsh.write(str(path))
    body = read_body(path, None, 1.0)
    assert "Kern größer 中" in body.volumes
    assert "Öben" in body.surfaces
    content = path.read_bytes()
    path.write_bytes(content.replace("Öben".encode(), "Öben".encode("latin-1") + b"\0"))
    assert "Öben" in read_body(path, None, 1.0).surfaces


@pytest.mark.parametrize(
    ("data", "surfaces"),
    [
        ({"Material": 7}, ["7"]),
        ({"MATERIAL": 7, "Material": 8}, None),
        ({"Material": 7, "cell_tags": 9}, ["9"]),
    ],
)
def test_data_of_groups_may_have_other_letters_if_one_alone_has(tmp_path, data, surfaces):
    path = tmp_path / "a.vtu"
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    cells = [("triangle", np.array([[0, 2, 1]])), ("tetra", np.array([[0, 1, 2, 3]]))]
    meshio.Mesh(points, cells, cell_data={k: [np.array([v]), np.array([1])] for k, v in data.items()}).write(
        path
    )
    if surfaces is None:
        with pytest.raises(ConfigurationError, match="have the data 'MATERIAL' and 'Material'; give"):
            read_body(path, None, 1.0)
    else:
        assert list(read_body(path, None, 1.0).surfaces) == surfaces


def two_tetrahedra(elements, names=""):
    """Two tetrahedra on one triangle, in lines of gmsh's format 2.2."""
    lines = elements.strip().splitlines()
    return (
        f"{HEAD}{names}$Nodes\n5\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 -1\n5 0 0 1\n$EndNodes\n"
        f"$Elements\n{len(lines)}\n" + "\n".join(lines) + "\n$EndElements\n"
    )


def test_elements_of_one_entity_have_the_groups_that_the_file_gives_to_each(tmp_path):
    """Many programs give all elements the entity 1 in the format 2.2, in which gmsh keeps groups of entities alone."""
    path = tmp_path / "a.msh"
    names = '$PhysicalNames\n3\n3 7 "low"\n3 8 "high"\n3 9 "low"\n$EndPhysicalNames\n'
    path.write_text(
        two_tetrahedra("1 4 2 8 1 1 2 3 5\n2 4 2 7 1 1 3 2 4\n3 4 2 9 1 1 2 3 5\n4 2 2 5 1 1 2 4", names)
    )
    body = read_body(path, None, 1.0)
    assert {name: elements.tolist() for name, elements in body.volumes.items()} == {
        "low": [0, 1],
        "high": [0],
    }
    assert list(body.surfaces) == ["5"]


def test_names_that_are_numbers_of_other_groups_are_told_only_where_they_are_used(tmp_path):
    path = tmp_path / "a.msh"
    names = '$PhysicalNames\n2\n2 5 "6"\n2 6 "top"\n$EndPhysicalNames\n'
    path.write_text(
        two_tetrahedra("1 4 2 2 2 1 2 3 5\n2 4 2 2 2 1 3 2 4\n3 2 2 5 5 1 2 4\n4 2 2 6 6 1 2 5", names)
    )
    body = read_body(path, None, 1.0)
    assert len(body.surface("top", "key")) == 1
    with pytest.raises(ConfigurationError, match=r"^key: in a\.msh '6' is both the name of one group"):
        body.surface("6", "key")
    patched = with_patches(body, {"5": Patch(of="top", x=(-1, 1))})
    assert len(patched.surface("5", "key")) == 1


def test_without_physical_groups_the_entities_are_the_groups(tmp_path):
    path = tmp_path / "a.msh"
    path.write_text(two_tetrahedra("1 4 2 0 3 1 2 3 5\n2 4 2 0 4 1 3 2 4\n3 2 2 0 6 1 2 4"))
    body = read_body(path, None, 1.0)
    assert set(body.volumes) == {"3", "4"}
    assert set(body.surfaces) == {"6"}


def test_data_of_elements_come_with_a_mesh_of_gmsh(tmp_path):
    path = tmp_path / "a.msh"
    data = '$ElementData\n1\n"density"\n1\n0\n3\n0\n1\n2\n2 0.25\n1 0.5\n$EndElementData\n'
    path.write_text(two_tetrahedra("1 4 2 2 1 1 2 3 5\n2 4 2 1 1 1 3 2 4") + data)
    found = read_mesh(path)
    np.testing.assert_array_equal(found.data["density"]["tetra"], [0.5, 0.25])
    np.testing.assert_array_equal(found.data["gmsh:physical"]["tetra"], [2, 1])


def test_a_surface_with_faces_that_are_no_boundary_cannot_be_used(tmp_path):
    path = tmp_path / "a.msh"
    names = '$PhysicalNames\n3\n2 5 "base"\n2 6 "between"\n2 7 "beyond"\n$EndPhysicalNames\n'
    faces = "3 2 2 5 5 1 2 4\n4 2 2 6 6 1 2 3\n5 2 2 6 6 1 2 4\n6 2 2 7 7 3 4 5"
    path.write_text(two_tetrahedra("1 4 2 2 2 1 2 3 5\n2 4 2 1 1 1 3 2 4\n" + faces, names))
    body = read_body(path, None, 1.0)
    assert list(body.surfaces) == ["base"]
    assert body.unnamed == 5
    for name, message in (
        ("between", "key: 1 of its 2 faces in a.msh lie inside the body"),
        ("beyond", "key: 1 of its 1 faces in a.msh belong to no element with a volume"),
        ("top", "key: the body has no surface 'top'; its surfaces are base"),
    ):
        with pytest.raises(ConfigurationError) as refused:
            body.surface(name, "key")
        assert str(refused.value).startswith(message)
    by_number = called(body, ["5", "6", "9"])
    np.testing.assert_array_equal(by_number.surface("5", "key"), body.surface("base", "key"))
    assert (list(by_number.surfaces), by_number.unnamed) == (["5"], 5)
    with pytest.raises(ConfigurationError, match=r"^key: 1 of its 2 faces in a\.msh lie inside the body"):
        by_number.surface("6", "key")
    with pytest.raises(ConfigurationError, match=r"no surface 'top'; its surfaces are 5 \('base'\)"):
        by_number.surface("top", "key")
    with pytest.raises(ConfigurationError, match="'base' and '5' are the name and the number of one surface"):
        called(body, ["5", "base"])


def test_a_set_up_names_surfaces_and_volumes_by_their_numbers(tmp_path):
    path = tmp_path / "a.msh"
    names = '$PhysicalNames\n4\n3 1 "low"\n3 2 "high"\n2 5 "base"\n2 6 "wall"\n$EndPhysicalNames\n'
    path.write_text(
        two_tetrahedra("1 4 2 2 2 1 2 3 5\n2 4 2 1 1 1 3 2 4\n3 2 2 5 5 1 2 4\n4 2 2 6 6 1 2 5", names)
    )
    held = {"displacement": [0, 0, 0]}

    def problem(base, wall, volume):
        return MacroProblem.model_validate(
            {
                "body": {"kind": "file", "path": str(path), "symmetry": []},
                "surfaces": {"patch": {"of": wall, "x": [-1, 1]}},
                "boundary": {base: held, "patch": {"traction": [0, -1, 0], "pressure": 0}},
                "regions": {"lower": {"kind": "volume", "name": volume}},
            }
        )

    named, numbered = problem("base", "wall", "low"), problem("5", 6, 1)
    one, other = (boundary_data(body_mesh(each), each) for each in (named, numbered))
    np.testing.assert_array_equal(one.prescribed, other.prescribed)
    np.testing.assert_array_equal(one.external, other.external)
    for each in (named, numbered):
        assert region_numbers(body_mesh(each), each.regions).tolist().count(1) == 1
    assert "5" in body_mesh(numbered).surfaces
    assert "base" not in body_mesh(numbered).surfaces


def test_elements_that_lie_over_one_another_are_refused(tmp_path):
    path = tmp_path / "a.msh"
    text = two_tetrahedra("1 4 2 2 2 1 2 3 5\n2 4 2 1 1 1 3 2 4\n3 4 2 1 1 1 2 3 6\n4 2 2 5 5 1 2 4")
    path.write_text(text.replace("$Nodes\n5", "$Nodes\n6").replace("5 0 0 1\n", "5 0 0 1\n6 0 0 2\n"))
    with pytest.raises(ConfigurationError, match="1 faces belong to more than two elements"):
        read_body(path, None, 1.0)


def two_cubes(path, shift):
    """Two unit cubes without a common node; the faces of the first are the surface 1."""
    cube = box(tuple(np.linspace(0, 1, 3) for _ in range(3)))
    cells = np.concatenate([cube.cells, cube.cells + len(cube.points)])[:, :8]
    faces = boundary_facets(cube.cells)[:, :4]
    numbers = [np.ones(len(of), dtype=int) for of in (faces, cells)]
    points = np.concatenate([cube.points, cube.points + np.array([shift, 0.1, 0.1])])
    meshio.Mesh(points, [("quad", faces), ("hexahedron", cells)], cell_data={"region": numbers}).write(path)
    return path


def test_parts_of_a_body_that_reach_into_one_another_are_refused(tmp_path):
    with pytest.raises(
        ConfigurationError, match=r"\d+ of 48 faces of the boundary lie inside other elements"
    ):
        read_body(two_cubes(tmp_path / "a.vtu", 0.65), None, 1.0)


def test_each_piece_of_a_body_is_held(tmp_path):
    mesh = read_body(two_cubes(tmp_path / "a.vtu", 1.5), None, 1.0)
    assert np.bincount(mesh.pieces).tolist() == [125, 125]
    problem = {"body": {"kind": "box", "size": [1, 1, 1], "elements": [2, 2, 2]}}
    held = {"boundary": {"1": {"displacement": (0, 0, 0)}}}
    with pytest.raises(
        ConfigurationError, match=r"nothing holds the piece at \(1\.5 to 2\.5, .*one of 2 of the body"
    ):
        boundary_data(mesh, MacroProblem.model_validate(problem | held))


def test_sets_of_abaqus_are_read_with_all_that_they_are_given(tmp_path):
    path = tmp_path / "a.inp"
    mesh = "*NODE\n1, 0,0,0\n2, 1,0,0\n3, 0,1,0\n4, 0,0,-1\n5, 0,0,1\n"
    elements = "*ELEMENT, TYPE=C3D4\n1, 1,2,3,5\n*ELEMENT, TYPE=C3D4, ELSET=low\n2, 1,3,2,4\n"
    elements += "*ELEMENT, TYPE=CPS3, ELSET=base\n3, 1,2,4\n*ELEMENT, TYPE=CPS3, ELSET=base\n4, 1,3,4\n"
    path.write_text(mesh + elements + "*ELSET, ELSET=Both\n1, 2\n*ELSET, ELSET=all, GENERATE\n1, 2, 1\n")
    body = read_body(path, None, 1.0)
    found = {name: body.centres[own][:, 2].round(3).tolist() for name, own in body.volumes.items()}
    assert {name: sorted(z) for name, z in found.items()} == {
        "low": [-0.25], "Both": [-0.25, 0.25], "all": [-0.25, 0.25],
    }  # fmt: skip
    assert {name: len(facets) for name, facets in body.surfaces.items()} == {"base": 2}
    for more, name, count in (
        ("*ELSET, ELSET=again\n1\n*ELSET, ELSET=again\n2\n", "again", 2),
        ("*ELSET, ELSET=low\n1\n", "low", 2),
        ("*ELSET, ELSET=again\nlow,\n", "again", 1),
        ("*ELSET, ELSET=again\nLOW, 1\n", "again", 2),
    ):
        path.write_text(mesh + elements + "*ELSET, ELSET=Both\n1, 2\n" + more)
        assert len(read_body(path, None, 1.0).volumes[name]) == count


def test_a_set_of_nodes_has_its_number_unless_faces_have_it(tmp_path):
    exodus("tetra", netcdf4=True)(tmp_path / "a.e")
    with_first(exodus("tetra", netcdf4=True), "ns_prop1", 21)(tmp_path / "b.e")
    body = read_body(tmp_path / "a.e", None, 1.0)
    assert body.numbers == {"21": "bottom", "22": "top", "23": "side", "5": "crown"}
    assert read_body(tmp_path / "b.e", None, 1.0).numbers == {
        "21": "bottom",
        "22": "top",
        "23": "side",
    }


def test_markers_of_su2_keep_their_names(tmp_path):
    path = tmp_path / "a.su2"
    text = "NDIME= 3\nNELEM= 1\n10 0 1 2 3 0\nNPOIN= 4\n0 0 0 0\n1 0 0 1\n0 1 0 2\n0 0 1 3\nNMARK= 2\n"
    faces = "MARKER_TAG= {}\nMARKER_ELEMS= 1\n5 0 1 2\nMARKER_TAG= {}\nMARKER_ELEMS= 1\n5 0 1 3\n"
    path.write_text(text + faces.format("base", "side"))
    assert set(read_body(path, None, 1.0).surfaces) == {"base", "side"}
    path.write_text(text + faces.format("base", "1"))
    with pytest.raises(ConfigurationError, match="the markers 'base' and '1' cannot be told apart"):
        read_body(path, None, 1.0)


def test_materials_of_nastran_are_surfaces_and_volumes_by_their_numbers(tmp_path):
    path = tmp_path / "a.bdf"
    grid = "GRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,0.,1.,0.\nGRID,4,,0.,0.,1.\n"
    path.write_text(f"BEGIN BULK\n{grid}CTETRA,1,21,1,2,3,4\nCTRIA3,2,3,1,2,3\nENDDATA\n")
    mesh = read_body(path, None, 1.0)
    assert (set(mesh.surfaces), set(mesh.volumes)) == ({"3"}, {"21"})


def test_a_damaged_file_that_makes_gmsh_crash_is_refused(tmp_path):
    """It has more nodes than it says, which gmsh writes beyond the end of its memory."""
    path = tmp_path / "core.msh"
    content = CORE.read_text(encoding="utf-8")
    assert "$Nodes\n47 104 1 104\n" in content
    path.write_text(content.replace("$Nodes\n47 104 1 104\n", "$Nodes\n47 3 1 3\n"), encoding="utf-8")
    with pytest.raises(ConfigurationError, match="gmsh crashes with this file; it is damaged"):
        read_mesh(path)


def test_options_of_gmsh_beside_a_file_are_refused(tmp_path):
    path = tmp_path / "a.msh"
    path.write_text(two_tetrahedra("1 4 2 2 1 1 2 3 5\n2 2 2 5 5 1 2 3"))
    (tmp_path / "a.msh.opt").write_text(f'SystemCall "touch {tmp_path}/hacked";\n')
    with pytest.raises(ConfigurationError, match=r"would also read a\.msh\.opt"):
        read_body(path, None, 1.0)
    assert not (tmp_path / "hacked").exists()


def test_gmsh_in_use_by_the_program_is_left_alone():
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        with pytest.raises(PorocoreError, match="gmsh is in use by this program"), gmsh_session():
            pass
        assert gmsh.isInitialized()
    finally:
        gmsh.finalize()


FREE = {"x-": {"normal": 0}, "z-": {"normal": 0}, "y-": {"normal": 0}}


@pytest.fixture
def overlapping(monkeypatch):
    """A box whose top has three names, one of which is the side x+ too."""
    body = Box(size=(1, 1, 1), elements=(2, 2, 2))
    mesh = make_body(body)
    top, side = mesh.surfaces["y+"], mesh.surfaces["x+"]
    surfaces = {**mesh.surfaces, "half": top[:2], "lid": np.concatenate([top[::-1], side])}
    return BodyMesh(mesh.points, mesh.cells, surfaces)


def data(mesh, boundary):
    problem = MacroProblem.model_validate(
        {"body": {"kind": "box", "size": [1, 1, 1], "elements": [2, 2, 2]}, "boundary": FREE | boundary}
    )
    return boundary_data(mesh, problem)


@pytest.mark.parametrize(
    ("one", "other", "fault"),
    [
        ({"traction": [0, -1, 0]}, {"traction": [0, -1, 0]}, "a traction t_2 would act twice"),
        ({"traction": [0, -1, 0]}, {"follower": 1}, "would act twice or on top of each other"),
        ({"follower": 1}, {"follower": 1}, "would act twice"),
        ({"plate": -1}, {"follower": 1}, "would act twice"),
        ({"flux": 1}, {"flux": 1}, "both prescribe a flux, which would be counted twice"),
        ({"pressure": 0}, {"flux": 1}, "the flux of the other does nothing"),
        ({"flux": 1}, {"pressure": 0}, "the flux of the other does nothing"),
        (
            {"displacement": [None, 0, None]},
            {"traction": [0, 1, 0]},
            "the traction of the other does nothing",
        ),
        ({"pressure": 0}, {"pressure": 1}, "another value of p"),
        ({"displacement": [None, 0, None]}, {"displacement": [None, 1, None]}, "another value of u_2"),
    ],
)
def test_faces_of_two_surfaces_cannot_be_loaded_twice(overlapping, one, other, fault):
    with pytest.raises(ConfigurationError) as refused:
        data(overlapping, {"y+": one, "lid": other})
    text = str(refused.value)
    assert text.startswith("macro.boundary.lid: 4 of its 8 faces belong to the surface 'y+' too, and there ")
    assert fault in text


@pytest.mark.parametrize(
    ("load", "support", "named"),
    [
        ({"traction": [0, -1, 0]}, {"normal": 0}, "the traction along the normal does nothing on 2 of its 2"),
        ({"traction": [1, -1, 0]}, {"normal": 0}, "the traction along the normal does nothing"),
        ({"follower": 1}, {"normal": 0}, "which acts along the normal, does nothing"),
        ({"follower": 1}, {"displacement": [None, 0, None]}, r"does nothing on .* prescribes u"),
        ({"traction": [1, 0, 0]}, {"normal": 0}, None),
        ({"follower": 1}, {"displacement": [0, None, None]}, None),
    ],
)
def test_a_load_along_a_displacement_that_is_prescribed_is_refused(overlapping, load, support, named):
    """Also where one surface has both; a load along the surface acts."""
    together = {"half": load, "y+": support}
    for boundary in (together, {"half": load | support}):
        if named is None:
            assert len(data(overlapping, boundary).prescribed)
            continue
        with pytest.raises(ConfigurationError, match=r"^macro\.boundary\.half: .*" + named):
            data(overlapping, boundary)


@pytest.mark.parametrize(
    ("one", "other", "together"),
    [
        ({"traction": [0, -1, 0]}, {"pressure": 0}, {"traction": [0, -1, 0], "pressure": 0}),
        ({"traction": [0, -1, 0]}, {"traction": [1, 0, 0]}, {"traction": [1, -1, 0]}),
        ({"pressure": 0}, {"pressure": 0}, {"pressure": 0}),
        ({"normal": 0}, {"displacement": [0, 0, None]}, {"displacement": [0, 0, None]}),
    ],
)
def test_conditions_of_two_surfaces_add_where_they_go_together(overlapping, one, other, together):
    """A part of the top that has them under two names bears what one name with both would."""
    found = data(overlapping, {"half": one, "y+": other})
    surfaces = {**overlapping.surfaces, "rest": overlapping.surfaces["y+"][2:]}
    expected = data(
        BodyMesh(overlapping.points, overlapping.cells, surfaces), {"half": together, "rest": other}
    )
    np.testing.assert_array_equal(found.prescribed, expected.prescribed)
    np.testing.assert_array_equal(found.values, expected.values)
    np.testing.assert_allclose(found.external, expected.external, atol=1e-15)


def test_a_face_of_two_surfaces_counts_wholly_for_each(overlapping):
    """A stress (3, 3) of which the force on each surface is known, and a flow through them."""
    stress, flow = np.array([[1.0, 2.0, 0.5], [2.0, -1.0, 0.3], [0.5, 0.3, 4.0]]), np.array([0.3, 2.0, 1.0])
    names = ("half", "y+", "lid", "x+", "z+", "y-")
    facets = {name: Facets(overlapping, overlapping.surfaces[name]) for name in names}
    reference = overlapping.element.facet
    total = np.zeros((len(overlapping.points), 3))
    inflow = np.zeros(len(overlapping.points))
    for name in ("y+", "x+", "z+", "y-"):
        vectors = np.einsum("fqi,q,qa->fai", facets[name].normals, reference.weights, reference.values)
        np.add.at(total, facets[name].nodes, vectors @ stress.T)
        corners = np.einsum("fqi,q,qa->fai", facets[name].normals, reference.weights, reference.corner_values)
        np.add.at(inflow, facets[name].nodes[:, :4], -corners @ flow)
    n = len(overlapping.p_nodes)
    held = {name: Support(each, np.eye(3)) for name, each in facets.items()}
    field = np.broadcast_to(stress, (len(overlapping.cells), 3, 3))
    area = {
        "half": [0, 0.5, 0],
        "y+": [0, 1, 0],
        "lid": [1, 1, 0],
        "x+": [1, 0, 0],
        "z+": [0, 0, 1],
        "y-": [0, -1, 0],
    }
    for name, share in shares(overlapping, held).items():
        force = share.total(np.concatenate([total.ravel(), np.zeros(n)]), field)
        np.testing.assert_allclose(force, stress @ area[name], atol=1e-12)
    drains = {name: Support(each, np.ones((1, 1))) for name, each in facets.items()}
    at_nodes = np.concatenate([np.zeros(total.size), inflow[overlapping.p_nodes]])
    for name, share in shares(overlapping, drains, fluid=True).items():
        rate = share.total(at_nodes, np.broadcast_to(-flow, (len(overlapping.cells), 3)))
        np.testing.assert_allclose(rate, [-flow @ np.array(area[name])], atol=1e-12)


def test_threads_make_and_read_meshes_one_after_the_other():
    """gmsh has one state in a process; threads that share it mixed up their models."""
    from concurrent.futures import ThreadPoolExecutor

    from porocore.cell.cell import Cell

    def points(radius):
        cell = Cell.model_validate(
            {
                "geometry": {"kind": "orthogonal-channels", "radius": radius},
                "mesh": {"size": 0.5, "element": "linear"},
            }
        )
        return np.sort(cell.geometry.tetrahedra(0.5, "linear")["solid"].points, axis=0)

    radii = [0.25, 0.3, 0.27, 0.32] * 3
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(points, radii))
    alone = {radius: points(radius) for radius in {*radii}}
    for radius, each in zip(radii, found, strict=True):
        np.testing.assert_array_equal(each, alone[radius])
    assert all(not np.array_equal(a, b) for a, b in pairwise(alone.values()))


def test_data_of_a_file_of_salome_are_no_names_of_groups(tmp_path):
    """meshio keeps there the labels of its data, which are no pairs of a number and a dimension."""
    path = tmp_path / "data.med"
    cells = [("tetra", np.array([[0, 1, 2, 3]])), ("triangle", np.array([[0, 1, 2]]))]
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    meshio.write(path, meshio.Mesh(points, cells, cell_data={"phase": [np.array([3]), np.array([1])]}))
    assert read_mesh(path).tags[3] == {3: "3"}
