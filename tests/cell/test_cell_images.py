"""Meshes of random images: opposite faces match, with the nodes between corners too."""

import pytest

from porocore.cell.cell import Cell
from porocore.cell.mesh_quality import measure_mesh_quality, unmatched
from porocore.cell.meshing.mesh import MeshSettings, make_mesh
from porocore.testing.cell_laws.open_cells import image_cell


@pytest.mark.parametrize("seed", range(4))
def test_every_facet_of_an_image_has_its_partner(tmp_path, seed):
    """Of both phases together, where the wall lies in a face."""
    settings = MeshSettings(size=0.2, fluid_size=0.2)
    geometry = image_cell(tmp_path / "image.npy", seed, 16)
    assert unmatched([make_mesh(geometry, settings, phase, "whole") for phase in ("solid", "fluid")]) == 0


def test_the_quality_of_a_sound_image_names_no_facet(tmp_path):
    cell = Cell(
        geometry=image_cell(tmp_path / "image.npy", 0, 16), mesh=MeshSettings(size=0.25, fluid_size=0.2)
    )
    assert measure_mesh_quality(cell).unmatched == 0
