"""Images that are not periodic: named with the share of voxels that differ, mirrored, or blended at their faces."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.level_sets.voxels import Voxels, blended, mismatch_note
from porocore.cell.meshing.mesh import MeshSettings
from porocore.cell.quality import measure_mesh_quality, quality_lines
from porocore.errors import ConfigurationError
from porocore.testing.cell_checks.base import noise

SAMPLE = noise(4, 32, 2.0)[:20, :24, :20] == 0


def image(path, solid, **keys):
    np.save(path, ~solid)
    return Voxels(kind="voxels", path=str(path), pore=1, **keys)


def changes(solid, axis):
    """Shares of voxels that differ from one layer to the next, the last across the faces."""
    return (solid != np.roll(solid, -1, axis=axis)).mean(axis=tuple({0, 1, 2} - {axis}))


def test_a_piece_of_a_sample_is_told_not_to_be_periodic(tmp_path):
    (note,) = image(tmp_path / "image.npy", SAMPLE, repeat="periodic").warnings
    for axis, name in enumerate("xyz"):
        across, inside = 100 * changes(SAMPLE, axis)[-1], 100 * changes(SAMPLE, axis)[:-1].max()
        assert across > 30
        assert f"{across:.0f} % across {name} (inside at most {inside:.0f} %)" in note
    assert "choose 'repeat: mirror'" in note
    assert "or 'repeat: layer'" in note
    assert image(tmp_path / "image.npy", SAMPLE, repeat="mirror").warnings == ()


@pytest.mark.parametrize("seed", range(20))
def test_periodic_images_are_not_accused(seed):
    for voxels in (8, 16, 32):
        assert mismatch_note(noise(seed, voxels, voxels / 8) == 0) == ()


def test_flat_walls_in_a_face_are_no_fault():
    x, y, z = np.indices((8, 8, 12))
    for solid in (z < 6, (x < 4) | (z < 3), (x // 4 + y // 4) % 2 == 0):
        assert mismatch_note(solid) == ()
    x, _, z = np.indices((8, 8, 24))
    assert "50 % across z (inside at most 25 %)" in mismatch_note((x + z // 8) % 8 < 4)[0]


def test_a_layer_makes_a_sample_periodic_and_leaves_its_inside():
    width = 6
    found, note = blended(SAMPLE, width)
    assert found.shape == (14, 18, 14)
    np.testing.assert_array_equal(
        found[width:, width:, width:], SAMPLE[width:-width, width:-width, width:-width]
    )
    for axis in range(3):
        assert changes(found, axis)[-1] < 0.15 < 0.3 < changes(SAMPLE, axis)[-1]
    assert mismatch_note(found) == ()
    assert f"a layer of {width} voxels" in note
    assert f"image is {1 - SAMPLE.mean():.4g}, that of the cell {1 - found.mean():.4g}" in note


def test_blending_leaves_a_periodic_image_as_it_is():
    """Its repetition, cut anywhere, has the layers at one face that follow on the other one."""
    solid = noise(1, 16, 2.0) == 0
    longer = np.pad(solid, ((0, 4),) * 3, mode="wrap")
    found, _ = blended(longer, 4)
    assert (found != solid).mean() < 0.03  # distances end at the faces of the image
    solid = np.zeros((12, 12, 12), dtype=bool)
    solid[:, 3:9, 3:9] = True
    np.testing.assert_array_equal(blended(np.pad(solid, ((0, 3),) * 3, mode="wrap"), 3)[0], solid)


def test_the_layer_is_said_and_meshed(tmp_path):
    geometry = image(tmp_path / "image.npy", SAMPLE, repeat="layer", layer=6, drop_grains=True, fill_pores=50)
    quality = measure_mesh_quality(Cell(geometry=geometry, mesh=MeshSettings(size=0.15, fluid_size=0.15)))
    assert quality.unmatched == 0
    lines = quality_lines(quality)
    assert lines[0] == "geometry: image image.npy of 14 × 18 × 14 voxels, with a periodic layer of 6"
    assert lines[1].startswith("geometry: opposite sides are blended in a layer of 6 voxels")
    x, _, z = np.indices((8, 8, 24))
    torn = replace(quality, notes=(), warnings=mismatch_note((x + z // 8) % 8 < 4))
    assert quality_lines(torn)[1].startswith("note: geometry: the image is not periodic")
    with pytest.raises(ConfigurationError, match=r"layer: expected at most 10 voxels.*got 11"):
        _ = image(tmp_path / "image.npy", SAMPLE, repeat="layer", layer=11).porosity


def test_identities_know_the_layer_only_where_there_is_one(tmp_path):
    def identity(**keys):
        return Cell(geometry=image(tmp_path / "image.npy", SAMPLE, **keys)).identity

    assert identity() == identity(layer=5)
    assert identity(repeat="layer", layer=5) != identity(repeat="layer", layer=6)
    assert identity() == identity(voxel_size=1e-5) == identity(voxel_size=(2e-6,) * 3)
    oblong = identity(voxel_size=(1e-5, 1e-5, 3e-5))
    assert identity() != oblong == identity(voxel_size=(2e-6, 2e-6, 6e-6))
