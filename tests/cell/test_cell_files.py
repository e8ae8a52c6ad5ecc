"""Cells from files: segmented images and meshes. What is read, what is refused, and when a file counts as changed."""

import meshio
import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.level_sets.image import read_image
from porocore.cell.level_sets.tpms import TriplyPeriodic
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.meshing.mesh import MeshSettings, make_mesh
from porocore.cell.meshing.mesh_file import MeshFile
from porocore.cell.meshing.tetrahedra import volume
from porocore.errors import ConfigurationError

SETTINGS = MeshSettings(size=0.25, fluid_size=0.25)


def channels(n, r=0.25):
    """Pore voxels of the eighth of the paper's cell."""
    x = (np.arange(n) + 0.5) / (2 * n)
    X, Y, Z = np.meshgrid(x, x, x, indexing="ij")
    return np.minimum(np.minimum(X**2 + Y**2, Y**2 + Z**2), X**2 + Z**2) < r**2


def image(path, values, **keys):
    np.save(path, values)
    return Voxels(kind="voxels", path=str(path), **keys)


def test_an_image_keeps_its_porosity_and_its_wall(tmp_path):
    mask = channels(20)
    geometry = image(tmp_path / "pores.npy", mask.astype(np.uint8) * 7, pore=7)
    assert geometry.porosity == pytest.approx(mask.mean(), abs=1e-15)
    fine = MeshSettings(size=0.08, fluid_size=0.08)
    fluid = make_mesh(geometry, fine, "fluid", "eighth")
    assert 8 * volume(fluid.points, fluid.cells) == pytest.approx(mask.mean(), abs=1e-3)
    # Away from the ridges the wall is within a voxel's third of the cylinder.
    wall = fluid.points[np.unique(fluid.wall)]
    far = wall[wall[:, 2] > 0.4]
    assert np.abs(np.hypot(far[:, 0], far[:, 1]) - 0.25).max() < 1 / 40 / 3


def test_mirrored_and_periodic_images_are_the_same_cell(tmp_path):
    """The mirror images made by hand, and the cell shifted by half a period along x and back."""
    mask = channels(8)
    full = np.concatenate([mask[::-1], mask], axis=0)
    full = np.concatenate([full[:, ::-1], full], axis=1)
    full = np.concatenate([full[:, :, ::-1], full], axis=2)
    mirrored = image(tmp_path / "eighth.npy", mask, pore=1)
    whole = image(tmp_path / "whole.npy", full, pore=1, repeat="periodic")
    assert (mirrored.unfolding, whole.unfolding) == ("eighth", "whole")
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (300, 3))
    here, there = mirrored.level_set(), whole.level_set()
    np.testing.assert_allclose(there.value(points), here.value(np.abs(points)), atol=2e-7)
    points[:, 0] = -0.5
    across = points + np.array([1, 0, 0])
    np.testing.assert_allclose(there.value(points), there.value(across), atol=1e-12)
    np.testing.assert_allclose(there.gradient(points), there.gradient(across), atol=1e-9)


def test_slopes_of_an_image(tmp_path):
    function = image(tmp_path / "image.npy", channels(8), pore=1).level_set()
    points = np.random.default_rng(1).uniform(0, 0.5, (50, 3))
    slopes = [(function.value(points + d) - function.value(points - d)) / 2e-6 for d in 1e-6 * np.eye(3)]
    np.testing.assert_allclose(function.gradient(points), np.stack(slopes, axis=1), atol=1e-6)


def test_a_tiff_stack_has_its_pages_along_z(tmp_path):
    import tifffile

    pages = np.zeros((4, 4, 4), dtype=np.uint8)  # z, y, x
    pages[1, 2, 3] = 5
    tifffile.imwrite(tmp_path / "stack.tif", pages)
    assert np.argwhere(read_image(tmp_path / "stack.tif")).tolist() == [[3, 2, 1]]


@pytest.mark.parametrize(
    ("values", "keys", "message"),
    [
        (np.zeros((4, 4, 3), dtype=bool), {}, r"an image of 4 to 400 voxels.*got the shape \(4, 4, 3\)"),
        (np.full((4, 4, 4), 0.5), {}, "expected a segmented image.*numbers with decimals"),
        (
            np.ones((4, 4, 4), dtype=np.uint8),
            {"pore": 3},
            r"got the value 1 in every voxel of",
        ),
        (np.array([{}, 1], dtype=object), {}, "expected an image of numbers.*object"),
    ],
    ids=["too flat", "grey", "one phase", "pickled"],
)
def test_images_that_are_refused(tmp_path, values, keys, message):
    np.save(tmp_path / "image.npy", values, allow_pickle=True)
    geometry = Voxels(kind="voxels", path=str(tmp_path / "image.npy"), **keys)
    with pytest.raises(ConfigurationError, match=message):
        _ = geometry.porosity


def test_a_changed_file_is_another_cell(tmp_path):
    path = tmp_path / "image.npy"
    geometry = image(path, channels(4), pore=1)
    cell = Cell(geometry=geometry)
    moved = image(tmp_path / "copy.npy", channels(4), pore=1)
    assert Cell(geometry=moved).identity == cell.identity
    np.save(path, ~channels(4))
    assert Cell(geometry={"kind": "voxels", "path": str(path), "pore": 1}).identity != cell.identity
    with pytest.raises(ConfigurationError, match=r"cell.geometry.sha256: .*has changed"):
        cell.geometry.level_set()
    with pytest.raises(ValueError, match="has changed since"):
        Cell.model_validate(cell.model_dump())
    path.unlink()
    assert Cell.model_validate(cell.model_dump()) == cell  # to look at what was computed
    with pytest.raises(ValueError, match="no such file"):
        Voxels(kind="voxels", path=str(path))


def test_a_relative_path_starts_at_the_configuration(tmp_path):
    np.save(tmp_path / "image.npy", channels(4))
    found = Cell.model_validate(
        {"geometry": {"kind": "voxels", "path": "image.npy"}}, context={"folder": tmp_path}
    )
    assert found.geometry.path == str(tmp_path / "image.npy")


def joined(geometry, element):
    """Nodes, cells and phases of both phases, which share their wall."""
    settings = SETTINGS.model_copy(update={"element": element})
    meshes = [make_mesh(geometry, settings, phase, "whole") for phase in ("solid", "fluid")]
    points = np.concatenate([mesh.points for mesh in meshes])
    cells = np.concatenate([meshes[0].cells, meshes[1].cells + len(meshes[0].points)])
    points, inverse = np.unique(points, axis=0, return_inverse=True)
    tags = np.repeat([1, 2], [len(mesh.cells) for mesh in meshes])
    return meshes, points, inverse.reshape(-1)[cells], tags


def written(path, points, cells, tags, **keys):
    kind = "tetra" if cells.shape[1] == 4 else "tetra10"
    data = {"gmsh:physical": [tags], "gmsh:geometrical": [tags]}
    mesh = meshio.Mesh(points, [(kind, cells)], cell_data=data, **keys)
    meshio.write(path, mesh, **({"file_format": "gmsh22"} if path.suffix == ".msh" else {}))
    return path


@pytest.mark.parametrize("element", ["linear", "quadratic-curved"])
@pytest.mark.parametrize("suffix", [".msh", ".vtu"])
def test_our_own_mesh_comes_back_from_a_file(tmp_path, element, suffix):
    geometry = TriplyPeriodic(kind="tpms", surface="gyroid", level=0.2)
    meshes, points, cells, tags = joined(geometry, element)
    swapped = cells[:, [1, 0, 2, 3] if element == "linear" else [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]
    names = {"solid": np.array([1, 3]), "fluid": np.array([2, 3])}
    path = written(tmp_path / f"cell{suffix}", 3e-6 * points + 1, swapped, tags, field_data=names)
    by_name = {} if suffix == ".msh" else {"solid": (1,), "fluid": (2,)}
    found = MeshFile(kind="mesh-file", path=str(path), **by_name)
    assert found.porosity == pytest.approx(volume(meshes[1].points, meshes[1].cells), abs=1e-9)
    for mesh in meshes:
        again = make_mesh(found, MeshSettings(element=element), mesh.phase, "whole")
        assert len(again.cells) == len(mesh.cells)
        assert len(again.wall) == len(mesh.wall)
        assert len(np.unique(again.periodic_class)) == len(np.unique(mesh.periodic_class))
        np.testing.assert_allclose(np.sort(again.points, axis=0), np.sort(mesh.points, axis=0), atol=1e-9)


def test_elements_of_a_file_get_the_order_that_is_asked_for(tmp_path):
    _, points, cells, tags = joined(OrthogonalChannels(), "quadratic-curved")
    geometry = MeshFile(
        kind="mesh-file",
        path=str(written(tmp_path / "cell.vtu", points, cells, tags)),
        solid=(1,),
        fluid=(2,),
    )
    curved, straight, linear = (
        make_mesh(geometry, MeshSettings(element=element), "fluid", "whole")
        for element in ("quadratic-curved", "quadratic-straight", "linear")
    )
    assert [mesh.order for mesh in (curved, straight, linear)] == [2, 2, 1]
    assert volume(straight.points, straight.cells) == pytest.approx(volume(linear.points, linear.cells))
    assert volume(curved.points, curved.cells) > volume(linear.points, linear.cells)


def test_several_tags_of_the_solid_are_its_regions(tmp_path):
    _, points, cells, tags = joined(OrthogonalChannels(), "linear")
    high = (points[cells].mean(axis=1)[:, 2] > 0) & (tags == 1)
    path = written(
        tmp_path / "cell.msh", points, cells, np.where(high, 5, tags), field_data={"upper": np.array([5, 3])}
    )
    geometry = MeshFile(kind="mesh-file", path=str(path), solid=(1, "upper"), fluid=(2,))
    mesh = make_mesh(geometry, MeshSettings(element="linear"), "solid", "whole")
    assert mesh.region_names == ("1", "upper")
    assert (mesh.regions == (mesh.points[mesh.cells].mean(axis=1)[:, 2] > 0)).all()


def test_tags_are_quoted_or_not_and_may_overlap_beyond_the_phases(tmp_path):
    """A group of the whole cell, in which every tetrahedron is there again."""
    _, points, cells, tags = joined(OrthogonalChannels(), "linear")
    names = {"solid": np.array([1, 3]), "pores": np.array([2, 3]), "cell": np.array([7, 3])}
    twice, all_tags = np.concatenate([cells, cells]), np.concatenate([tags, np.full(len(tags), 7)])
    path = written(tmp_path / "cell.msh", points, twice, all_tags, field_data=names)
    found = [
        MeshFile(kind="mesh-file", path=str(path), solid=solid, fluid=fluid).porosity
        for solid, fluid in (((1,), (2,)), (("1",), ("2",)), (("solid",), ("pores",)), (("1", "solid"), (2,)))
    ]
    assert found == [found[0]] * 4
    assert found[0] == pytest.approx(volume(points, cells[tags == 2]), rel=1e-12)
    for solid, fluid, message in (
        (
            ("cell",),
            ("pores",),
            "of the .* tetrahedra of .* with the tag 'pores' have the tag 'cell' of solid too",
        ),
        (
            ("solid",),
            (9,),
            r"has the tag 9 under fluid; its tags are 1 \('solid'\) with .*, .* 7 \('cell'\) with 100 %",
        ),
    ):
        with pytest.raises(ConfigurationError, match=message):
            _ = MeshFile(kind="mesh-file", path=str(path), solid=solid, fluid=fluid).porosity


def test_meshes_that_are_refused(tmp_path):
    _, points, cells, tags = joined(OrthogonalChannels(), "linear")
    path = tmp_path / "cell.vtu"

    def complaint(points=points, cells=cells, **keys):
        written(path, points, cells, keys.pop("labels", tags))
        geometry = MeshFile(kind="mesh-file", path=str(path), **{"solid": (1,), "fluid": (2,), **keys})
        with pytest.raises(ConfigurationError) as refused:
            _ = geometry.porosity
        assert str(path) in str(refused.value)
        return str(refused.value)

    moved = points.copy()
    inner = (points[:, 0] == 0.5) & (np.abs(points[:, 1:]) < 0.45).all(axis=1)
    moved[np.flatnonzero(inner)[0], 1] += 0.03
    text = complaint(points=moved)
    assert "not periodic along x: 2 nodes" in text
    assert "0.03 of the cell's length" in text
    assert "expected tetrahedra that fill a box, got 1 x 1 x 0, which is flat" in complaint(
        points=points * [1, 1, 0]
    )
    assert "no tetrahedron" in complaint(fluid=(3,))
    assert "the tags 2 belong to no phase" in complaint(
        fluid=(3,), labels=np.where(np.arange(len(tags)) % 2, tags, 3)
    )
    assert "it has gmsh:geometrical, gmsh:physical" in complaint(tags="colour")
    solid = tags == 1
    assert "belong to one tetrahedron only" in complaint(
        cells=cells[solid], labels=np.where(np.arange(solid.sum()) < 5, 2, 1)
    )
    path.write_text("no mesh")
    with pytest.raises(ConfigurationError, match=r"expected a mesh as \.vtu, got text by its first bytes"):
        _ = MeshFile(kind="mesh-file", path=str(path)).porosity
    with pytest.raises(ValueError, match="stand under solid and under fluid"):
        MeshFile(kind="mesh-file", path=str(path), solid=(1,), fluid=(1,))


def test_groups_that_are_named_like_the_other_phase_are_noted(tmp_path):
    """``solid: [Void]`` was taken without a word."""
    (tmp_path / "cell.msh").touch()
    path = str(tmp_path / "cell.msh")
    geometry = MeshFile(kind="mesh-file", path=path, solid=("Void",), fluid=("Matrix",))
    first, second = geometry.warnings
    assert first.startswith("the group 'Void' is given as solid and is named like the fluid; exchange")
    assert second.startswith("the group 'Matrix' is given as fluid and is named like the solid")
    assert MeshFile(kind="mesh-file", path=path, solid=("Matrix", 3), fluid=("Void",)).warnings == ()
