"""Images of a folder of slices: the same as one stack, what is told of them, and when they count as changed."""

import re
from pathlib import Path

import numpy as np
import pytest
import tifffile

from porocore.cell.cell import Cell
from porocore.cell.level_sets.image import open_image, read_image
from porocore.cell.level_sets.voxels import Voxels
from porocore.errors import ConfigurationError

PAGES = np.random.default_rng(3).integers(0, 60_000, (12, 7, 9)).astype(np.uint16)


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "scan"
    path.mkdir()
    for k, page in enumerate(PAGES):
        tifffile.imwrite(path / f"slice{k}.tif", page)
    return path


def voxels(path, **keys):
    return Voxels(kind="voxels", path=str(path), threshold="otsu", repeat="periodic", **keys)


@pytest.mark.parametrize("pattern", ["", "*.tif", "slice[0-9]*.tif"])
def test_slices_are_the_stack_of_their_pages_to_the_last_bit(tmp_path, folder, pattern):
    tifffile.imwrite(tmp_path / "stack.tif", PAGES)
    slices, stack = voxels(folder / pattern), voxels(tmp_path / "stack.tif")
    for read in (
        open_image(folder / pattern, grey=True),
        read_image(folder / pattern, ((2, 9), (0, 6), (3, 11))),
    ):
        whole = open_image(tmp_path / "stack.tif")
        expected = whole if read.shape == whole.shape else whole[2:9, 0:6, 3:11]
        np.testing.assert_array_equal(read, expected)
        assert (read.dtype, read.strides) == (expected.dtype, expected.strides)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (50, 3)) * slices.sides
    np.testing.assert_array_equal(slices.level_set().value(points), stack.level_set().value(points))
    assert slices.notes == ("12 slices along z, from slice0.tif to slice11.tif", *stack.notes)
    assert slices.warnings == stack.warnings


def test_slices_of_arrays_are_those_of_numpy(tmp_path, folder):
    for k, page in enumerate(PAGES):
        np.save(tmp_path / f"{k:03}.npy", page.T)
    np.testing.assert_array_equal(read_image(tmp_path / "*.npy"), read_image(folder))


def test_what_else_lies_there_is_told(folder):
    for name in ("log.txt", ".hidden", "preview.png"):
        (folder / name).write_text("no image")
    assert voxels(folder).notes[0].endswith("to slice11.tif; left out: log.txt, preview.png")


@pytest.mark.parametrize(
    ("gone", "told"),
    [((3, 7, 8), "numbered 3, 7 to 8; those"), ((1, 3, 5, 7, 9, 11), ""), ((0, 11), "")],
)
def test_missing_numbers_are_told(folder, gone, told):
    for k in gone:
        (folder / f"slice{k}.tif").unlink()
    found = [each for each in voxels(folder).warnings if "slices are missing" in each]
    assert len(found) == bool(told)
    assert all(
        each.startswith(f"slices are missing between slice0.tif and slice11.tif, {told}") for each in found
    )


def test_a_viewer_of_the_slices_counts_as_that_of_a_stack(tmp_path):
    for k, page in enumerate(PAGES):
        tifffile.imwrite(tmp_path / f"{k}.tif", page, photometric="miniswhite")
    assert any("WhiteIsZero" in each for each in voxels(tmp_path).warnings)


def _change(folder):
    tifffile.imwrite(folder / "slice4.tif", PAGES[5])


def _rename(folder):
    (folder / "slice4.tif").rename(folder / "slice40.tif")


def _remove(folder):
    (folder / "slice11.tif").unlink()


@pytest.mark.parametrize("change", [_change, _rename, _remove])
def test_another_slice_is_another_image(folder, change):
    geometry = voxels(folder)
    given = geometry.model_dump()
    moved = folder.rename(folder.with_name("moved"))
    assert voxels(moved).sha256 == geometry.sha256
    assert Cell(geometry=voxels(moved / "*.tif")).identity == Cell(geometry=voxels(moved)).identity
    again = voxels(moved)
    change(moved)
    told = "slices have changed, are missing or were added since"
    with pytest.raises(ConfigurationError, match=f"cell.geometry.sha256: .*{told}"):
        again.checked("cell.geometry")
    with pytest.raises(ValueError, match=told):
        Voxels.model_validate({**given, "path": str(moved)})


def test_slices_without_numbers_are_to_be_numbered(tmp_path):
    for name in "abcd":
        np.save(tmp_path / f"{name}.npy", np.zeros((4, 4), np.uint8))
    with pytest.raises(ConfigurationError, match=r"d.npy \(1\); number them along z, such as slice_001.tif$"):
        read_image(tmp_path)


def test_the_pattern_of_a_message_leads_to_one_stack_from_every_folder(tmp_path, folder, monkeypatch):
    np.save(folder / "other.npy", np.zeros((4, 4), np.uint8))
    with pytest.raises(ConfigurationError, match="choose by a pattern") as refused:
        read_image(folder)
    monkeypatch.chdir(tmp_path.parent)
    assert voxels(Path(re.search("'path: (.*)'", str(refused.value))[1])).slices.left_out == ()
