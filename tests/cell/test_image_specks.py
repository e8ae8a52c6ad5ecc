"""Specks of the solid that come loose in the mesh of an image: kept and refused, or dropped where grains are."""

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.level_sets.cutting import SPECKS
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.meshing.connectivity import pieces
from porocore.cell.meshing.tetrahedra import volume


def image(blob, neck):
    """Bars along three axes with a blob that hangs on one of them by a neck of a voxel, which smoothing cuts."""
    solid = np.zeros((16,) * 3, dtype=bool)
    solid[4:10, 4:10] = solid[4:10, :, 4:10] = solid[:, 4:10, 4:10] = True
    solid[12 : 12 + blob, 12 : 12 + blob, 12 : 12 + blob] = True
    solid[10:13, 12, 12] = solid[10, 10:13, 12] = solid[10, 10, 6:13] = solid[10, 8:11, 6] = neck
    return solid


def cell(folder, solid, repeat, **keys):
    np.save(folder / "image.npy", solid)
    geometry = Voxels(kind="voxels", path=str(folder / "image.npy"), pore=0, repeat=repeat, **keys)
    edge = 32 if repeat == "mirror" else 16
    return Cell(geometry=geometry, mesh={"size": 1.5 / edge, "fluid_size": 2 / edge, "element": "linear"})


@pytest.mark.parametrize("repeat", ["periodic", "mirror"])
def test_a_speck_that_comes_loose_in_the_mesh_is_dropped_with_the_grains(tmp_path, repeat):
    solid = image(3, True)
    kept = cell(tmp_path, solid, repeat)
    assert "pieces that do not touch" in kept.disconnected
    dropped = cell(tmp_path, solid, repeat, drop_grains=True)
    # No grain in the image, since the neck holds it.
    np.testing.assert_array_equal(dropped.geometry.solid, solid)
    assert dropped.disconnected == ""
    before, after = (each.make_mesh("solid", "whole") for each in (kept, dropped))
    loose = sum(piece.volume for piece in pieces(before)[1:])
    share = volume(before.points, before.cells)
    assert 0 < loose < SPECKS * share
    assert volume(after.points, after.cells) == pytest.approx(share - loose, rel=1e-9)
    fluid = dropped.make_mesh("fluid", "whole")
    assert len(pieces(fluid)) == 1
    assert dropped.identity != kept.identity


def test_what_is_more_than_a_speck_is_refused(tmp_path):
    solid = image(4, True)
    solid[11:15, 11:15, 0:3] = True
    large = cell(tmp_path, solid, "mirror", drop_grains=True)
    assert "pieces that do not touch" in large.disconnected
