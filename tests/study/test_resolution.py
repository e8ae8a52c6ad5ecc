"""What ``porocore check`` says of the thinnest wall and the narrowest pore of an image."""

import re
from itertools import islice

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from porocore.cell.cell import Cell
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.meshing.mesh import MeshSettings
from porocore.study.notes.abilities import resolution


@pytest.fixture
def layers(tmp_path):
    """Crossed plates, 4 of 32 voxels thick, with pores of 28 between them."""
    solid = np.zeros((32, 32, 32), bool)
    for axis in range(3):
        np.moveaxis(solid, axis, 0)[14:18] = True
    np.save(tmp_path / "plates.npy", (~solid).astype(np.uint8))
    return Voxels(kind="voxels", path=str(tmp_path / "plates.npy"), pore=1, repeat="periodic")


def test_elements_across_the_thinnest_parts_are_counted(layers):
    cell = Cell(geometry=layers, mesh=MeshSettings(size=0.05, fluid_size=0.1))
    _, _, wall, pore = islice(resolution(cell), 4)
    assert (
        wall
        == "  thinnest wall, by the largest ball in it: some 3.5 voxels or 0.11 of the cell, 2.2 elements of mesh.size"
    )
    assert pore.startswith("  narrowest pore, by the largest ball in it: some 28 voxels or 0.86 of the cell")
    assert pore.endswith(" elements of mesh.fluid_size")


def test_elements_are_told_in_voxels_and_in_the_unit_of_the_user(layers):
    cell = Cell(geometry=layers, mesh=MeshSettings(size=0.125, fluid_size=0.0625))
    assert next(resolution(cell)) == "  mesh.size 0.125 is 4 voxels"
    solid, fluid = islice(resolution(cell, length=400e-6), 2)
    assert solid == "  mesh.size 0.125 is 4 voxels, 50 µm"
    assert fluid == "  mesh.fluid_size 0.0625 is 2 voxels, 25 µm"


def test_the_real_edge_is_told_and_the_sizes_that_give_the_same_mesh(layers):
    cell = Cell(geometry=layers, mesh=MeshSettings(size=0.19, fluid_size=0.4))
    solid, fluid = islice(resolution(cell, length=400e-6), 2)
    assert solid == (
        "  mesh.size 0.19 becomes 0.167, so that whole elements fill the cell: 5.3 voxels, 66.67 µm; any size from "
        "0.1667 to 0.1999 gives this mesh"
    )
    assert fluid.endswith("11 voxels, 133.3 µm; any size from 0.3334 on gives this mesh")
    counts = {
        size: len(layers.tetrahedra(size, "linear")["solid"].cells) for size in (0.1666, 0.1667, 0.1999, 0.2)
    }
    assert counts[0.1667] == counts[0.1999] < counts[0.1666]
    assert counts[0.2] < counts[0.1999]


def test_elements_are_counted_by_their_real_edge(layers):
    """Sizes of one mesh have one count, and no size beside it."""
    told = [
        list(resolution(Cell(geometry=layers, mesh=MeshSettings(size=size, fluid_size=0.1))))[2]
        for size in (0.0835, 0.09)
    ]
    assert told[0] == told[1]
    assert "1.3 elements" in told[0]


def test_too_few_elements_are_said_with_the_size_to_write(layers):
    found = resolution(Cell(geometry=layers, mesh=MeshSettings(size=0.1, fluid_size=0.1)))
    note = next(line for line in found if "thinnest wall resolve" in line)
    assert note.startswith(
        "note: 1.1 elements across the thinnest wall resolve it poorly; cell.mesh.size: 0.054 has 2"
    )
    fine = MeshSettings(size=0.0546, fluid_size=0.1, element="linear")
    assert not any("note" in line for line in resolution(Cell(geometry=layers, mesh=fine)))


def test_of_a_mirrored_image_the_voxels_are_half_as_large(layers):
    mesh = MeshSettings(size=0.05, fluid_size=0.1)
    cell = Cell(geometry=layers.model_copy(update={"repeat": "mirror"}), mesh=mesh)
    _, _, wall = islice(resolution(cell), 3)
    assert (
        wall
        == "  thinnest wall, by the largest ball in it: some 3.5 voxels or 0.055 of the cell, 1.1 elements of mesh.size"
    )


def test_a_cell_that_is_no_image_has_none():
    assert list(resolution(Cell(geometry=OrthogonalChannels()))) == []


@pytest.fixture
def sponge(tmp_path):
    """Pores of 31 % of a random image, with necks of a voxel between them."""
    waves = gaussian_filter(np.random.default_rng(3).standard_normal((40, 40, 40)), 4, mode="wrap")
    np.save(tmp_path / "sponge.npy", (waves > np.quantile(waves, 0.693)).astype(np.uint8))
    return Voxels(kind="voxels", path=str(tmp_path / "sponge.npy"), pore=1, repeat="mirror")


def advised(geometry, size):
    """Every note on a cell with elements of a size, and the sizes in them by key."""
    cell = Cell(geometry=geometry, mesh=MeshSettings(size=size, fluid_size=size))
    notes = [note for note in resolution(cell) if note.startswith("note: ")]
    found = re.findall(r"cell\.mesh\.(\w+): ([\d.]*\d)", " ".join(notes))
    return notes, {key: [float(size) for other, size in found if other == key] for key, _ in found}


def test_of_several_sizes_the_one_that_serves_all_is_told(sponge):
    """Three sizes of one key stood in three notes."""
    notes, sizes = advised(sponge, 0.1)
    assert "of these sizes the smallest serves all that is said above" in notes[-1]
    for key, found in sizes.items():
        assert len({*found}) == 1 or f"cell.mesh.{key}: {min(found):g}" in notes[-1]


def test_sizes_that_the_mesher_refuses_are_not_advised(sponge):
    """fluid_size: 0.012 was advised, and refused with 6,944,444 tetrahedra."""
    notes, sizes = advised(sponge, 0.1)
    for key, found in sizes.items():
        Cell(geometry=sponge, mesh=MeshSettings(**{key: min(found)}))
    assert any(
        "are more than are meshed (3,000,000): take a smaller part of the image" in note for note in notes
    )
