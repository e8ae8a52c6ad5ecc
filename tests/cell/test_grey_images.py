"""Grey images: their values, a threshold, what is said where none was given, and meshes of another porosity."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import tifffile
from scipy.ndimage import gaussian_filter

from porocore.cell.cell import Cell
from porocore.cell.level_sets.grey_values import GreyValues
from porocore.cell.level_sets.image import read_image, remarks, stated_voxel
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.meshing.mesh import MISSED
from porocore.cell.quality import measure_mesh_quality, quality_lines
from porocore.errors import ConfigurationError

x, y, z = np.meshgrid(*[(np.arange(16) + 0.5) / 16 * 2 * np.pi] * 3, indexing="ij")
PORES = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x) < -0.4
#: Two phases of 60 and 180 that a detector blurs, with noise.
GREY = gaussian_filter(np.where(PORES, 60.0, 180.0), 0.4, mode="wrap")
GREY += np.random.default_rng(0).normal(0, 8, PORES.shape)


def image(path, values, **keys):
    np.save(path, values)
    return Voxels(kind="voxels", path=str(path), repeat="periodic", **keys)


def test_otsu_parts_two_peaks_in_the_middle_of_their_gap():
    found = GreyValues.of(np.array([[[1, 2, 2], [3, 90, 92]]], dtype=np.uint16))
    assert (found.otsu, found.share(found.otsu)) == (46.5, pytest.approx(4 / 6))
    assert GreyValues.of(np.full((4, 4, 4), 7)).otsu == 7


def test_one_value_with_decimals_is_told_as_it_is():
    found = GreyValues.of(np.full((4, 4, 4), 7.25))
    assert (found.extent, found.otsu) == ("7.25 (64)", 7.25)


@pytest.mark.parametrize(("pore", "told"), [(None, 1), (0, 0)])
def test_which_of_two_values_stands_for_pores_is_told_where_nobody_said_it(tmp_path, pore, told):
    keys = {} if pore is None else {"pore": pore}
    geometry = image(tmp_path / "two.npy", np.where(PORES, 0, 255).astype(np.uint8), **keys)
    notes = [note for note in geometry.notes if "cell.geometry.pore is not given" in note]
    assert len(notes) == told
    assert all("'pore: 255'" in note and "the value 0 are pores" in note for note in notes)


@pytest.mark.parametrize(("size", "told"), [(12, ("12 x 12 x 12 m", "'12 um'")), (12e-6, ()), (1e-3, ())])
def test_voxels_of_metres_are_told_with_the_cell_that_they_make(tmp_path, size, told):
    geometry = image(tmp_path / "two.npy", np.where(PORES, 0, 1), voxel_size=size)
    found = " ".join(note for note in geometry.warnings if "was read as" in note)
    assert bool(found) == bool(told)
    assert all(words in found for words in told)


def test_otsu_is_the_largest_variance_between_both_classes():
    values = GREY.astype(np.uint8)

    def between(level):
        low, high = values[values <= level], values[values > level]
        return len(low) * len(high) * (low.mean() - high.mean()) ** 2

    best = max(np.unique(values)[:-1], key=between)
    np.testing.assert_array_equal(values <= GreyValues.of(values).otsu, values <= best)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.int32, np.float32])
@pytest.mark.parametrize("suffix", [".npy", ".tif"])
def test_a_grey_image_of_any_kind_has_one_porosity(tmp_path, kind, suffix):
    values = (GREY * {np.uint8: 1, np.uint16: 200, np.int32: 90_000, np.float32: 0.01}[kind]).astype(kind)
    path = tmp_path / f"grey{suffix}"
    if suffix == ".npy":
        np.save(path, values)
    else:
        tifffile.imwrite(path, values.T)
    dark = Voxels(kind="voxels", path=str(path), threshold="otsu")
    assert dark.porosity == pytest.approx(PORES.mean(), abs=0.004)
    bright = dark.model_copy(update={"bright_pores": True})
    assert bright.porosity == pytest.approx(1 - dark.porosity, abs=1e-15)
    assert dark.warnings == ()
    (note,) = [each for each in dark.notes if "threshold" in each]
    assert "by Otsu's method" in note


def test_otsu_is_of_the_whole_file_and_a_number_of_itself(tmp_path):
    values = GREY.astype(np.uint8)
    part = image(tmp_path / "image.npy", values, threshold="otsu", crop=((0, 16), (0, 16), (0, 6)))
    assert part.level == GreyValues.of(values).otsu
    given = image(tmp_path / "image.npy", values, threshold=120)
    np.testing.assert_array_equal(given.solid, values > 120)
    assert Cell(geometry=given).identity != Cell(geometry=part).identity
    again = Cell.model_validate(Cell(geometry=given).model_dump())
    assert again.geometry == given
    assert "pore" not in given.specification()


def test_an_image_that_is_not_segmented_is_told_with_a_threshold(tmp_path):
    values = GREY.astype(np.uint8)
    geometry = image(tmp_path / "image.npy", values, pore=60)
    (note,) = geometry.warnings
    grey = GreyValues.of(values)
    assert f"its values are {len(np.unique(values))} distinct ones" in note
    assert f"'pore: 60' takes {100 * (values == 60).mean():.3g} % of the voxels" in note
    assert (
        f"parts them at {grey.otsu:g} and takes the darker {100 * (values <= grey.otsu).mean():.3g} %" in note
    )


def test_labels_of_three_phases_are_named_and_no_fault(tmp_path):
    values = np.where(PORES, 0, np.where(z < 3, 1, 2)).astype(np.uint8)
    geometry = image(tmp_path / "image.npy", values, pore=0)
    assert geometry.warnings == ()
    assert "the image has 3 values: 0 (" in geometry.notes[0]
    assert geometry.notes[0].endswith("voxels of the value 0 are pores, all others are one solid")
    assert image(tmp_path / "image.npy", PORES, pore=1).notes == ()


def test_the_note_stands_in_the_lines_of_a_check(tmp_path):
    lossy = np.where(PORES, 0, 255) + np.random.default_rng(1).integers(0, 5, PORES.shape) * (1 - 2 * ~PORES)
    geometry = image(tmp_path / "image.npy", lossy.astype(np.uint8), pore=0, smoothing=0.5)
    with pytest.raises(ConfigurationError, match=r"is not segmented.*expected a mesh of the porosity 0\.0"):
        measure_mesh_quality(Cell(geometry=geometry, mesh={"size": 0.3, "fluid_size": 0.3}))
    segmented = image(tmp_path / "image.npy", lossy.astype(np.uint8), threshold="otsu")
    quality = measure_mesh_quality(Cell(geometry=segmented, mesh={"size": 0.1, "fluid_size": 0.1}))
    assert segmented.porosity == PORES.mean()
    assert 1 - quality.solid.share == pytest.approx(PORES.mean(), abs=2e-3)
    assert not any("note" in line for line in quality_lines(quality))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"pore": 0, "threshold": 3}, "expected either pore, of a segmented image, or threshold"),
        ({"bright_pores": True}, "bright_pores belongs to threshold"),
        ({"threshold": "median"}, "otsu"),
        ({"threshold": float("nan")}, "finite"),
    ],
)
def test_contradictions_are_refused(tmp_path, keys, message):
    with pytest.raises(ValueError, match=message):
        image(tmp_path / "image.npy", PORES, **keys)


@pytest.mark.parametrize(
    ("values", "keys", "message"),
    [
        (GREY, {}, "expected a segmented image.*numbers with decimals; segment it first, or write 'threshold: otsu'"),
        (GREY.astype(np.uint8), {"pore": 255}, r"has the value 255; its values are \d+ distinct .*threshold: otsu"),
        (GREY, {"threshold": 400}, r"every voxel of .* is at or below 400; its values are [\d,]+ distinct"),
        (GREY, {"threshold": 400, "bright_pores": True}, "no voxel of .* is above 400"),
        (np.where(PORES, np.nan, GREY), {"threshold": "otsu"}, r"got [\d,]+ of 4,096 that are infinite or no number"),
        (np.full((4, 4, 4), np.nan), {"threshold": "otsu"}, "expected a number in every voxel"),
    ],
)  # fmt: skip
def test_what_has_no_pores_is_refused(tmp_path, values, keys, message):
    with pytest.raises(ConfigurationError, match=message):
        _ = image(tmp_path / "image.npy", values, **keys).porosity


def test_a_mesh_of_another_porosity_is_refused_and_its_finer_one_is_not(tmp_path):
    """A sheet of pores of four voxels between the nodes of a coarse lattice."""
    pores = np.zeros((24, 24, 24), bool)
    pores[2:5] = True
    geometry = image(tmp_path / "image.npy", pores, pore=1, smoothing=0)
    fine = Cell(geometry=geometry, mesh={"size": 0.08, "fluid_size": 0.08, "element": "linear"})
    assert fine.mesh_porosity == pytest.approx(0.125, rel=MISSED)
    coarse = Cell(geometry=geometry, mesh={"size": 0.33, "fluid_size": 0.08, "element": "linear"})
    with pytest.raises(ConfigurationError, match=r"cell\.mesh\.size: expected a mesh of the porosity 0\.125"):
        _ = coarse.mesh_porosity


def write_page_by_page(path, pages):
    with tifffile.TiffWriter(path) as file:
        for page in pages:
            file.write(page)


def test_pages_that_were_written_one_by_one_are_one_stack(tmp_path):
    pages = np.random.default_rng(0).integers(0, 2, (6, 8, 10)).astype(np.uint8)
    write_page_by_page(tmp_path / "stack.tif", pages)
    np.testing.assert_array_equal(read_image(tmp_path / "stack.tif"), pages.T)
    write_page_by_page(tmp_path / "two.tif", [pages, pages[:5]])
    with pytest.raises(
        ConfigurationError, match="one stack of pages of one size, got 2 stacks, 1 of 6 x 8 x 10 and 1 of 5 x"
    ):
        read_image(tmp_path / "two.tif")


def test_an_image_in_colour_is_refused_as_one(tmp_path):
    tifffile.imwrite(tmp_path / "rgb.tif", np.zeros((6, 8, 10, 3), np.uint8), photometric="rgb")
    with pytest.raises(ConfigurationError, match="an image in colour with 3; save it in grey"):
        read_image(tmp_path / "rgb.tif")


def test_a_compression_without_a_decoder_is_named(tmp_path, monkeypatch):
    lossy = Path(__file__).parents[1] / "strangers/image_not_segmented/jpeg.tif"
    monkeypatch.setitem(vars(tifffile.TIFF), "DECOMPRESSORS", {1: None})
    with pytest.raises(
        ConfigurationError, match=r"compressed by JPEG: pip install imagecodecs, or save it .*JPEG changes"
    ):
        read_image(lossy)


def imagej(path, pages, edges, unit):
    resolution = (1 / edges[0], 1 / edges[1])
    metadata = {"spacing": edges[2], "unit": unit, "axes": "ZYX"}
    tifffile.imwrite(path, pages, imagej=True, resolution=resolution, metadata=metadata)


def ome(path, pages, edges, unit):
    sizes = {f"PhysicalSize{axis}": edge for axis, edge in zip("XYZ", edges, strict=True)}
    units = {f"PhysicalSize{axis}Unit": unit for axis in "XYZ"}
    tifffile.imwrite(path, pages, ome=True, metadata={"axes": "ZYX", **sizes, **units})


@pytest.mark.parametrize(("write", "unit"), [(imagej, "um"), (imagej, "micron"), (ome, "µm")])
def test_edges_of_voxels_that_the_file_states_are_told_where_they_differ(tmp_path, write, unit):
    path, pages = tmp_path / "stack.tif", PORES.T.astype(np.uint8)
    write(path, pages, (12.0, 12.0, 15.0), unit)
    assert stated_voxel(path)[0] == pytest.approx((12, 12, 15))

    def warnings(**keys):
        return Voxels(kind="voxels", path=str(path), pore=1, **keys).warnings

    (note,) = warnings()
    assert "takes them for cubes" in note
    assert note.endswith("write 'voxel_size: [12 um, 12 um, 15 um]'")
    assert "has 12 x 12 x 12 µm" in warnings(voxel_size=12e-6)[0]
    assert "has 12 x 12 x 15 mm" in warnings(voxel_size=(12e-3, 12e-3, 15e-3))[0]
    assert warnings(voxel_size=(12e-6, 12e-6, 15e-6)) == ()
    write(path, pages, (12.0, 12.0, 12.0), unit)
    assert warnings() == ()
    tifffile.imwrite(path, pages)
    assert warnings() == ()


def test_the_resolution_of_a_plain_tiff_is_told_where_it_contradicts(tmp_path):
    path, pages = tmp_path / "stack.tif", PORES.T.astype(np.uint8)

    def warnings(resolution, unit, **keys):
        tifffile.imwrite(path, pages, resolution=resolution, resolutionunit=unit)
        return Voxels(kind="voxels", path=str(path), pore=1, **keys).warnings

    (note,) = warnings((500, 1000), "CENTIMETER", voxel_size=20e-6)
    assert "its voxels are [0.002 cm, 0.001 cm] along x, y, and cell.geometry has 20 x 20 x 20 µm" in note
    assert "the distance of the pages" in note
    assert "takes them for cubes" in warnings((500, 1000), "CENTIMETER")[0]
    assert "0.00078" in warnings((1270, 1270), "INCH", voxel_size=(30e-6, 30e-6, 25e-6))[0]
    assert warnings((500, 1000), "CENTIMETER", voxel_size=(20e-6, 10e-6, 25e-6)) == ()
    assert warnings((1270, 1270), "INCH", voxel_size=20e-6) == ()
    for resolution, unit in [
        (72, "INCH"),
        (1, "CENTIMETER"),
        (1, "INCH"),
        (28.3465, "CENTIMETER"),
        (500, "NONE"),
    ]:
        assert warnings((resolution, resolution), unit, voxel_size=20e-6) == ()


#: White at 0 and black at 255, as the masks of ImageJ with an inverting table.
DESCENDING = np.tile(np.arange(255, -1, -1, dtype=np.uint16) * 257, (3, 1))


@pytest.mark.parametrize(
    ("how", "keys", "why", "taken", "other"),
    [
        ({"photometric": "miniswhite"}, {"pore": 0}, "WhiteIsZero", "shows bright: if", "'pore: 255'"),
        ({"photometric": "miniswhite"}, {"pore": 255}, "WhiteIsZero", "shows dark: if", "'pore: 0'"),
        ({"photometric": "miniswhite"}, {"threshold": "otsu"}, "WhiteIsZero", "bright: if", "'bright_pores: true'"),
        (
            {"photometric": "miniswhite"}, {"threshold": 9, "bright_pores": True}, "WhiteIsZero", "dark: if",
            "'bright_pores: false'",
        ),
        ({"photometric": "palette", "colormap": DESCENDING}, {"pore": 0}, "its palette", "bright: if", "'pore: 255'"),
        ({"photometric": "palette", "colormap": DESCENDING[:, ::-1]}, {"pore": 0}, "", "", ""),
        ({"photometric": "minisblack"}, {"pore": 0}, "", "", ""),
    ],
)  # fmt: skip
def test_a_file_that_viewers_show_the_other_way_round_is_read_as_stored_and_told(
    tmp_path, how, keys, why, taken, other
):
    path = tmp_path / "mask.tif"
    tifffile.imwrite(path, np.where(PORES, 0, 255).T.astype(np.uint8), **how)
    geometry = Voxels(kind="voxels", path=str(path), repeat="periodic", **keys)
    shown_dark = keys.get("pore") == 255 or keys.get("bright_pores", False)
    assert geometry.porosity == pytest.approx((~PORES if shown_dark else PORES).mean(), abs=1e-15)
    if not why:
        assert geometry.warnings == ()
        return
    (note,) = geometry.warnings
    assert note.startswith("a viewer shows the value 0 of the file bright and 255 dark, since its")
    for words in (why, taken, f"write {other}"):
        assert words in note


@pytest.mark.parametrize(
    ("odd", "told"),
    [
        (lambda page: page[:-1], r"page 4 \(of .*\) with 7 x 10 values of uint8 where page 1 has 8 x 10 values"),
        (lambda page: page.astype(np.uint16), "page 4 .* of uint16 where page 1 has .* of uint8"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("count", [6, 24])
def test_a_page_of_another_size_or_type_is_refused_with_its_number(tmp_path, odd, told, count):
    pages = np.random.default_rng(0).integers(0, 2, (count, 8, 10)).astype(np.uint8)
    with tifffile.TiffWriter(tmp_path / "odd.tif") as file:
        for k, page in enumerate(pages):
            file.write(odd(page) if k == 3 else page, contiguous=False, metadata=None)
    with pytest.raises(ConfigurationError, match=told):
        read_image(tmp_path / "odd.tif")


def test_a_page_that_is_stored_in_another_way_is_refused(tmp_path):
    pages = np.random.default_rng(0).integers(0, 2, (6, 8, 10)).astype(np.uint8)
    with tifffile.TiffWriter(tmp_path / "odd.tif") as file:
        for k, page in enumerate(pages):
            file.write(
                page, contiguous=False, metadata=None, photometric="miniswhite" if k == 4 else "minisblack"
            )
    with pytest.raises(
        ConfigurationError,
        match=r"got page 5 \(of 6\) with another tag PhotometricInterpretation than page 1",
    ):
        read_image(tmp_path / "odd.tif")


def test_a_stack_that_was_compressed_by_jpeg_is_told(tmp_path):
    """The library that decompresses it need not be there; without it the image is refused with the same word."""
    from PIL import Image

    pages = [Image.fromarray(page) for page in np.where(PORES, 0, 255).astype(np.uint8).T]
    path = tmp_path / "image.tif"
    pages[0].save(path, save_all=True, append_images=pages[1:], compression="jpeg")
    assert any("compressed with loss" in each for each in remarks(path))
    if find_spec("imagecodecs") is None:
        with pytest.raises(ConfigurationError, match="compressed by JPEG: pip install imagecodecs"):
            read_image(path)


def test_a_mask_after_jpeg_is_not_taken_for_a_segmented_one(tmp_path):
    """Slices of a mask through JPEG and back have many values beside 0 and 255, and Otsu finds the phases again."""
    from PIL import Image

    mask = np.where(PORES, 0, 255).astype(np.uint8).repeat(4, 0).repeat(4, 1)
    pages = []
    for page in mask.T:
        Image.fromarray(page).save(tmp_path / "slice.jpg", quality=75)
        pages.append(np.asarray(Image.open(tmp_path / "slice.jpg")))
    values = np.stack(pages).T
    lossy = image(tmp_path / "image.npy", values, pore=0)
    assert any("the image is not segmented" in each for each in lossy.warnings)
    assert (values == 0).mean() < 0.9 * (mask == 0).mean()
    found = image(tmp_path / "image.npy", values, threshold="otsu")
    np.testing.assert_array_equal(found.solid, mask > 0)
