"""What the meshes of an image have otherwise than the image itself."""

import re

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.level_sets.cutting import lattice_edges
from porocore.cell.level_sets.voxels import Voxels, necks, runs
from porocore.cell.meshing.mesh import MeshSettings
from porocore.cell.meshing.tetrahedra import volume
from porocore.cell.quality import CLOSED_PORES, disagreements, grains, measure_mesh_quality, quality_lines


def image(folder, pores, **settings):
    np.save(folder / "image.npy", pores.astype(np.uint8))
    return Voxels(kind="voxels", path=str(folder / "image.npy"), pore=1, **settings)


def said(cell, **how):
    return (note.text for note in disagreements(cell, **how))


def cell_of(geometry, size):
    return Cell(geometry=geometry, mesh=MeshSettings(size=size, fluid_size=size, element="linear"))


def necked(width):
    """Chambers of 12 voxels along x with necks of a width between them, and wide channels along y and z."""
    pores = np.zeros((24, 24, 24), bool)
    low = 12 - width // 2
    pores[:, low : low + width, low : low + width] = True
    for axis in range(3):
        np.moveaxis(pores, axis, 0)[slice(6, 18) if axis == 0 else slice(None), 6:18, 6:18] = True
    return pores


def test_a_mirrored_piece_runs_through_where_it_reaches_both_sides():
    pores = np.zeros((6, 6, 6), bool)
    pores[:, 1, 1] = True
    pores[0:4, 4, 4] = True  # joins its own mirror image only
    labels, axes = runs(pores, periodic=False)
    assert [axes[labels[5, 1, 1]], axes[labels[0, 4, 4]], axes[0]] == ["x", "", ""]


def test_a_periodic_piece_may_run_through_by_several_parts():
    pores = np.zeros((6, 6, 6), bool)
    pores[:3, 2, 2] = pores[2, 2:, 2] = True  # leaves at high y …
    pores[2:, 0, 2] = True  # … and comes back at low y, on to the next cell along x and y
    pores[2, 0, 2] = pores[5, 0:3, 2] = True
    pores[5, 5, 5] = pores[0, 5, 5] = True  # crosses a side, but ends there
    labels, axes = runs(pores, periodic=True)
    assert labels[0, 2, 2] != labels[5, 0, 2]
    assert {axes[labels[0, 2, 2]], axes[labels[5, 0, 2]]} == {"xy"}
    assert axes[labels[5, 5, 5]] == axes[labels[0, 5, 5]] == ""


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("width", [3, 4, 6])
def test_the_width_of_a_neck_is_known_to_a_voxel(width, periodic):
    voxel = np.full(3, 0.1)
    found = necks(necked(width), voxel, 0.8, periodic=periodic)
    assert set(found) == {"x"}
    assert found["x"] == pytest.approx(0.1 * width, abs=0.101)
    assert necks(necked(width), voxel, 0.1 * (width - 1), periodic=periodic) == {}


def test_a_neck_that_the_mesh_closes_is_named_with_its_axis(tmp_path):
    # The lattice of the mesh has its nodes 4 voxels apart, none of them in the neck.
    geometry = image(tmp_path, np.roll(necked(4), 2, axis=(1, 2)), repeat="periodic")
    assert "x" not in "".join(p.axes for p in measure_mesh_quality(cell_of(geometry, 0.33)).fluid.pieces)
    notes = list(said(cell_of(geometry, 0.33)))
    (closed,) = [note for note in notes if "do not" in note]
    assert closed.startswith(
        "the image's pores run through along x, those of the mesh do not: give cell.mesh.fluid_size"
    )
    size = float(re.search(r"fluid_size: ([\d.]+)", closed)[1])
    assert "x" in measure_mesh_quality(cell_of(geometry, size)).fluid.pieces[0].axes


def test_an_open_neck_of_less_than_two_elements_is_named(tmp_path):
    geometry = image(tmp_path, necked(6), repeat="periodic")
    (note,) = [note for note in said(cell_of(geometry, 0.15)) if "necks" in note]
    assert note.startswith(
        "the image's pores run through along x, but its narrowest necks there let only balls up to a width of 0.2"
    )
    assert "the permeability there depends on the mesh: give cell.mesh.fluid_size: 0.1" in note
    assert [note for note in said(cell_of(geometry, 0.1)) if "necks" in note] == []


@pytest.mark.parametrize("size", [0.06, 0.065, 0.08, 0.1, 0.12])
def test_every_neck_of_less_than_two_elements_is_told_with_one_width_and_one_advice(tmp_path, size):
    geometry = image(tmp_path, necked(4), repeat="periodic")
    width = necks(~geometry.solid, np.full(3, 1 / 24), 1.0, periodic=True)["x"]
    notes = [note for note in said(cell_of(geometry, size)) if "pores run through along x" in note]
    assert bool(notes) == (width / lattice_edges(geometry, size)[0] < 2)
    assert all("fluid_size: 0.083" in note for note in notes)
    assert all(f"width of {width:.2g} of" in note for note in notes if "ball" in note)


def test_what_smoothing_closes_asks_for_less_smoothing(tmp_path):
    geometry = image(tmp_path, necked(3), repeat="periodic", smoothing=3)
    (closed,) = [note for note in said(cell_of(geometry, 0.06)) if "do not" in note]
    assert "smoothing closes necks; give cell.geometry.smoothing: 0.5 and cell.mesh.fluid_size" in closed
    better = geometry.model_copy(update={"smoothing": 0.5})
    assert not any("do not" in note for note in said(cell_of(better, 0.06)))


def test_pieces_that_only_the_mesh_closes_are_counted(tmp_path):
    """A chamber at the end of a neck: closed in the coarse mesh, open in the image."""
    pores = np.zeros((24, 24, 24), bool)
    for axis in range(3):
        np.moveaxis(pores, axis, 0)[:, :7, :7] = True
    pores[14:22, 14:22, 14:22] = pores[7:14, 17:19, 17:19] = pores[7:9, 5:19, 17:19] = True
    notes = list(said(cell_of(image(tmp_path, pores), 0.1)))
    (shut,) = [note for note in notes if "open in the image" in note]
    assert shut.startswith("of the mesh of the fluid 8 pieces of the volumes 0.0")
    pores[7:9] = pores[9:14, 17:19, 17:19] = False  # closed in the image too
    notes = list(said(cell_of(image(tmp_path, pores), 0.1)))
    assert not any("open in the image" in note for note in notes)


def test_a_solid_that_the_mesh_cuts_is_named(tmp_path):
    geometry = image(tmp_path, ~np.roll(necked(4), 2, axis=(1, 2)), repeat="periodic")
    notes = list(said(cell_of(geometry, 0.33)))
    assert any(
        note.startswith(
            "the image's solid runs through along x, that of the mesh does not: give cell.mesh.size"
        )
        for note in notes
    )


def test_a_porosity_that_differs_comes_with_the_size_that_mends_it(tmp_path):
    x, y, z = np.meshgrid(*[(np.arange(24) + 0.5) / 24 * 2 * np.pi] * 3, indexing="ij")
    pores = np.sin(2 * x) * np.cos(y) + np.sin(y) * np.cos(2 * z) + np.sin(z) * np.cos(x) < -0.5
    geometry = image(tmp_path, pores, repeat="periodic")
    note = next(said(cell_of(geometry, 0.2), tried=True))
    pattern = (
        r"is ([\d.]+), .* solid ([\d.]+); .*size: ([\d.]+) was meshed here and has ([\d.]+), within ([\d.]+)"
    )
    of_image, of_mesh, size, finer, limit = map(float, re.search(pattern, note).groups())
    assert of_image == pytest.approx(geometry.porosity, abs=1e-4)
    assert abs(of_image - of_mesh) > limit == pytest.approx(0.03 * geometry.porosity, rel=0.05)
    mesh = cell_of(geometry, size).make_mesh("solid", "whole")
    assert 1 - volume(mesh.points, mesh.cells) == pytest.approx(finer, abs=1e-4)
    assert not any("porosity" in note for note in said(cell_of(geometry, size)))
    assert "try cell.mesh.size: 0.1" in next(said(cell_of(geometry, 0.2)))


def test_a_grain_that_the_mesh_joins_keeps_or_loses_is_said(tmp_path):
    """One touches the rest by an edge, one floats, one is a voxel that smoothing takes."""
    solid = np.zeros((24,) * 3, bool)
    for axis in range(3):
        np.moveaxis(solid, axis, 0)[:, :8, :8] = True
    touching, floating = solid.copy(), solid.copy()
    touching[12:18, 8:14, 8:14] = floating[13:19, 13:19, 13:19] = True
    for grown, what in ((touching, "joined to the rest by"), (floating, "apart in")):
        geometry = image(tmp_path, ~grown, repeat="periodic")
        assert (
            "1 grain (216 voxels) of the solid without contact to the rest, face to face" in geometry.notes[0]
        )
        (note,) = grains(cell_of(geometry, 0.06))
        assert note == f"1 of these grains (216 voxels) is {what} the mesh"
    solid[16, 16, 16] = True
    lines = quality_lines(measure_mesh_quality(cell_of(image(tmp_path, ~solid, repeat="periodic"), 0.12)))
    assert "geometry: 1 of these grains (1 voxels) is lost in the mesh" in lines


def test_small_closed_pieces_are_told_by_what_they_cost_and_with_no_advice(tmp_path):
    """A chamber of a few voxels on a long neck of one, at any size."""
    pores = np.zeros((24,) * 3, bool)
    for axis in range(3):
        np.moveaxis(pores, axis, 0)[:, :12, :12] = True
    pores[17:20, 17:20, 17:20] = pores[18, 12:18, 18] = pores[18, 11, 11:19] = True
    for size in (0.06, 0.07):
        cell = cell_of(image(tmp_path, pores, repeat="periodic", smoothing=0.5), size)
        (note,) = [note for note in said(cell) if "open in the image" in note]
        assert "% of the fluid; this share bears the pressure p and does not flow; it is small" in note


def test_cells_without_an_image_have_no_disagreement():
    assert list(said(Cell(geometry=OrthogonalChannels()))) == []


def test_the_pressure_of_closed_pores_is_said_once(tmp_path):
    pores = np.zeros((16, 16, 16), bool)
    pores[5:12, 5:12, 5:12] = True
    closed = measure_mesh_quality(cell_of(image(tmp_path, pores, repeat="periodic"), 0.2))
    assert quality_lines(closed).count(CLOSED_PORES) == 1
    pores[:, 5:12, 5:12] = True
    open_one = measure_mesh_quality(cell_of(image(tmp_path, pores, repeat="periodic"), 0.2))
    assert CLOSED_PORES not in quality_lines(open_one)


def test_the_printed_volumes_of_pieces_add_up_to_that_of_the_phase(tmp_path):
    x, y, z = np.meshgrid(*[np.arange(20)] * 3, indexing="ij")
    pores = (x - 9.5) ** 2 + (y - 9.5) ** 2 < 16
    for i, j in ((3, 3), (3, 16), (16, 3), (16, 16)):
        for k in (4, 14):
            pores |= (x - i) ** 2 + (y - j) ** 2 + (z - k) ** 2 < 7
    mesh = MeshSettings(size=0.15, fluid_size=0.1)
    quality = measure_mesh_quality(Cell(geometry=image(tmp_path, pores, repeat="periodic"), mesh=mesh))
    assert len(quality.fluid.pieces) == 9
    lines = quality_lines(quality)
    of_mesh = float(re.search(r"fluid's mesh ([\d.]+)", "\n".join(lines))[1])
    told = [float(re.search(r"of volume ([\d.]+)", line)[1]) for line in lines if "of volume" in line]
    assert len(told) == 7
    assert sum(told) == pytest.approx(of_mesh, abs=4.5e-6)
