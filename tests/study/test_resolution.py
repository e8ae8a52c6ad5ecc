"""What ``porocore check`` says of the thinnest wall and the narrowest pore of an image."""

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.geometry.kinds import OrthogonalChannels, Voxels
from porocore.cell.meshing.mesh import MeshSettings
from porocore.study.preflight.resolution import resolution


@pytest.fixture
def layers(tmp_path):
    """Crossed plates, 4 of 32 voxels thick, with pores of 28 between them."""
    solid = np.zeros((32, 32, 32), bool)
    for axis in range(3):
        np.moveaxis(solid, axis, 0)[14:18] = True
    np.save(tmp_path / "plates.npy", (~solid).astype(np.uint8))
    return Voxels(kind="voxels", path=str(tmp_path / "plates.npy"), pore=1, repeat="periodic")


def test_elements_across_the_thinnest_parts_are_counted(layers):
    wall, pore = resolution(Cell(geometry=layers, mesh=MeshSettings(size=0.05, fluid_size=0.1)))
    assert wall == "  thinnest wall: some 3.5 voxels or 0.11 of the cell, 2.2 elements of mesh.size"
    assert pore.startswith("  narrowest pore: some 28 voxels or 0.86 of the cell")
    assert pore.endswith(" elements of mesh.fluid_size")


def test_too_few_elements_are_said_with_the_size_to_write(layers):
    *_, note = resolution(Cell(geometry=layers, mesh=MeshSettings(size=0.1, fluid_size=0.1)))
    assert note.startswith(
        "note: 1.1 elements across the thinnest wall resolve it poorly; cell.mesh.size: 0.055 has 2"
    )
    fine = MeshSettings(size=0.0546, fluid_size=0.1)
    assert not any("note" in line for line in resolution(Cell(geometry=layers, mesh=fine)))


def test_of_a_mirrored_image_the_voxels_are_half_as_large(layers):
    mesh = MeshSettings(size=0.05, fluid_size=0.1)
    wall, *_ = resolution(Cell(geometry=layers.model_copy(update={"repeat": "mirror"}), mesh=mesh))
    assert wall == "  thinnest wall: some 3.5 voxels or 0.055 of the cell, 1.1 elements of mesh.size"


def test_a_cell_that_is_no_image_has_none():
    assert list(resolution(Cell(geometry=OrthogonalChannels()))) == []
