"""Images: opposite faces of their meshes match; parts of them; what is removed from them, and what is said of it."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from porocore.cell.cell import Cell
from porocore.cell.level_sets.cutting import LEAST_PIECE
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.meshing.connectivity import pieces, small_pieces
from porocore.cell.meshing.mesh import MeshSettings, make_mesh
from porocore.cell.quality import measure_mesh_quality, quality_lines, unmatched
from porocore.errors import ConfigurationError
from porocore.testing.cell_checks.base import image_cell


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


def smallest_piece(path, seed, size=0.25):
    """Volume of the smallest piece of either phase, in cubes of the lattice."""
    noise = gaussian_filter(np.random.default_rng(seed).standard_normal((16,) * 3), 1.6, mode="wrap")
    settings, geometry = (
        MeshSettings(size=size, fluid_size=size),
        image(path, noise > np.quantile(noise, 0.6)),
    )
    found = [pieces(make_mesh(geometry, settings, phase, "whole")) for phase in ("solid", "fluid")]
    return min(piece.volume for of_phase in found for piece in of_phase) / (1 / np.ceil(1 / size)) ** 3


def test_the_mesh_has_no_small_pieces(tmp_path, monkeypatch):
    """At narrow necks single tetrahedra come off; a solid that they float beside was refused."""
    for seed in (2, 9, 11, 13):
        assert smallest_piece(tmp_path / f"{seed}.npy", seed) > LEAST_PIECE
    monkeypatch.setattr("porocore.cell.level_sets.cutting.LEAST_PIECE", 0.0)
    assert smallest_piece(tmp_path / "3.npy", 3) < LEAST_PIECE


def test_small_pieces_are_those_below_a_volume_and_never_the_largest():
    """Two solid tetrahedra joined by a facet, one beside them that shares an edge only, and a fluid one alone."""
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4], [0, 1, 5, 6], [5, 6, 7, 8]])
    first, solid = np.arange(9), np.array([True, True, True, False])
    sizes = np.array([1.0, 1.0, 1.5, 0.5])
    assert small_pieces(cells, first, solid, sizes, 1.6).tolist() == [False, False, True, False]
    assert not small_pieces(cells, first, solid, sizes, 1.5).any()
    # Nodes 5 and 6 are images of 2 and 3: the third one joins the first across a face.
    first[[5, 6]] = 2, 3
    assert not small_pieces(cells, first, solid, sizes, 1.6).any()


def spoilt():
    """Bars of 16³ voxels with a grain of 3³ in the pore, another one across two faces, and closed pores of 1 and 5."""
    solid = np.zeros((16,) * 3, dtype=bool)
    solid[5:11, 5:11] = solid[5:11, :, 5:11] = solid[:, 5:11, 5:11] = True
    solid[1:4, 1:4, 1:4] = True
    solid[[0, 15], 12, 12] = True
    solid[8, 8, 8] = solid[8, 8, 1:6] = False
    return solid


def image(path, values, **keys):
    np.save(path, values)
    return Voxels(
        kind="voxels", path=str(path), **{"pore": 0, "repeat": "periodic", "smoothing": 0.5, **keys}
    )


def test_grains_that_float_and_closed_pores_are_removed_and_named(tmp_path):
    path, solid = tmp_path / "image.npy", spoilt()
    kept = image(path, solid)
    np.testing.assert_array_equal(kept.solid, solid)
    assert len(kept.notes) == 1
    assert "2 grains (27, 2 voxels) of the solid without contact to the rest" in kept.notes[0]
    assert "cell.geometry.drop_grains: true" in kept.notes[0]
    cleaned = image(path, solid, drop_grains=True, fill_pores=4)
    expected = solid.copy()
    expected[1:4, 1:4, 1:4] = expected[[0, 15], 12, 12] = False
    expected[8, 8, 8] = True
    np.testing.assert_array_equal(cleaned.solid, expected)
    assert cleaned.notes == (
        "2 grains (27, 2 voxels) of the solid dropped, 0.708 % of the image",
        "1 pore (1 voxel) filled, 0.0244 % of the image",
    )
    assert cleaned.porosity == 1 - expected.mean()


def test_pieces_join_across_the_sides_of_a_periodic_image_only(tmp_path):
    """Two slabs at opposite sides are one piece of a periodic cell; between mirrors one of them floats."""
    solid = np.zeros((8,) * 3, dtype=bool)
    solid[:2] = solid[6:] = True
    path = tmp_path / "image.npy"
    assert image(path, solid).notes == ()
    (note,) = image(path, solid, repeat="mirror").notes
    assert "1 grain (128 voxels)" in note


def test_check_says_what_was_removed(tmp_path):
    geometry = image(tmp_path / "image.npy", spoilt(), drop_grains=True)
    quality = measure_mesh_quality(Cell(geometry=geometry, mesh=MeshSettings(size=0.25, fluid_size=0.25)))
    assert quality_lines(quality)[1] == f"geometry: {geometry.notes[0]}"
    assert not quality.disconnected


def test_a_part_of_an_image(tmp_path):
    values = np.random.default_rng(0).integers(0, 2, (6, 9, 12))
    part = image(tmp_path / "image.npy", values, crop=((1, 6), (0, 4), (6, 12)))
    np.testing.assert_array_equal(part.solid, values[1:6, :4, 6:] != 0)


def test_the_middle_of_an_image_that_is_too_large_is_proposed(tmp_path):
    geometry = image(tmp_path / "image.npy", np.zeros((4, 6, 402), dtype=bool))
    with pytest.raises(
        ConfigurationError,
        match=r"got the shape \(4, 6, 402\); cell.geometry.crop: \[\[0, 4\], \[0, 6\], \[1, 401\]\] takes the middle",
    ):
        _ = geometry.porosity


@pytest.mark.parametrize(
    ("crop", "message"),
    [
        (
            ((0, 7), (0, 7), (0, 7)),
            r"a first voxel and a larger end within .*got the shape \(6, 9, 12\) and the part",
        ),
        (((3, 3), (0, 4), (0, 4)), "a first voxel and a larger end"),
        (
            ((0, 5), (0, 4), (0, 3)),
            r"^cell\.geometry\.crop: expected a part of .*got a part of the shape \(5, 4, 3\); take a larger one",
        ),
    ],
)
def test_parts_that_are_refused(tmp_path, crop, message):
    geometry = image(tmp_path / "image.npy", np.zeros((6, 9, 12), dtype=bool), crop=crop)
    with pytest.raises(ConfigurationError, match=message):
        _ = geometry.porosity
