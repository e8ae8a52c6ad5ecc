"""Images of scanners: MetaImage, NIfTI, NRRD and DICOM are the same cell as TIFF and .npy, and faulty ones are told."""

import gzip
import locale
import re
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
import tifffile
from scipy.ndimage import gaussian_filter

from porocore.cell.cell import Cell
from porocore.cell.level_sets.grey_values import GreyValues
from porocore.cell.level_sets.image import read_image, remarks, stated_voxel
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.meshing.mesh import MeshSettings
from porocore.errors import ConfigurationError

sitk = pytest.importorskip("SimpleITK", reason="pip install SimpleITK")

SHAPE, EDGES = (10, 12, 14), (0.01, 0.02, 0.03)
x, y, z = np.meshgrid(*[(np.arange(n) + 0.5) / n * 2 * np.pi for n in SHAPE], indexing="ij")
PORES = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x) < -0.2
GREY = gaussian_filter(np.where(PORES, 60.0, 180.0), 0.5, mode="wrap")
GREY = (GREY + np.random.default_rng(0).normal(0, 8, SHAPE)).clip(0, 255).astype(np.uint8)
#: The same grey values in other types.
TYPES = {
    "uint8": GREY,
    "uint16": GREY.astype(np.uint16) * 257,
    "int16": GREY.astype(np.int16) * 100 - 5000,
    "float32": (GREY / 255).astype(np.float32),
}
#: Tags of a slice; those of its number and place are added.
TAGS = {"0008|0060": "CT", "0020|000d": "1.2.3", "0020|0037": "1\\0\\0\\0\\1\\0", "0008|103e": "scan"}


@pytest.fixture(autouse=True)
def same_locale():
    """GDCM leaves the process in the locale C where it writes; it does not where it reads."""
    before = locale.setlocale(locale.LC_ALL)
    yield
    locale.setlocale(locale.LC_ALL, before)


def itk_image(values, spacing=EDGES):
    image = sitk.GetImageFromArray(np.ascontiguousarray(values.T))
    image.SetSpacing(spacing[: values.ndim])
    return image


def save(path, values, **how):
    """A file by the ending of its name, or a folder of slices of a kind."""
    kind = "".join(path.suffixes)
    if kind == ".npy":
        np.save(path, values)
    elif kind == ".tif":
        tifffile.imwrite(path, values.T, **how)
    elif kind in (".slices", ".dicom"):
        path.mkdir()
        for k in range(values.shape[2]):
            if kind == ".slices":
                tifffile.imwrite(path / f"s{k}.tif", values[:, :, k].T)
            else:
                dicom(path / f"IM{(5 * k) % values.shape[2]:03}", values[:, :, k], k)
    else:
        sitk.WriteImage(itk_image(values), str(path), **how)
    return path


def dicom(path, page, k, series="1.2.3.1", **tags):
    image = itk_image(page)
    place = {"0020|000e": series, "0020|0013": str(k), "0020|0032": f"0\\0\\{k * EDGES[2]:.6g}"}
    for tag, text in {**TAGS, **place, "0008|0018": f"{series}.{k}", **tags}.items():
        image.SetMetaData(tag, text)
    writer = sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    writer.SetFileName(str(path.with_name("written.dcm")))
    writer.Execute(image)
    path.with_name("written.dcm").rename(path)


def header(path, **keys):
    """A MetaImage header of unsigned 16-bit voxels in a file of their own."""
    lines = {
        "ObjectType": "Image", "NDims": 3, "DimSize": "10 12 14", "ElementType": "MET_USHORT", **keys,
        "ElementDataFile": keys.get("ElementDataFile", f"{path.stem}.raw"),
    }  # fmt: skip
    path.write_text("".join(f"{key} = {value}\n" for key, value in lines.items()))
    return path


def nifti(values, units=2, slope=1.0, rows=None, order="<"):
    """A NIfTI file of unsigned 16-bit voxels, by the standard's table of its header."""
    start = bytearray(352)
    rows = rows or [[EDGES[0], 0, 0, 0], [0, EDGES[1], 0, 0], [0, 0, EDGES[2], 0]]
    for place, kind, content in (
        (0, "i", [348]), (40, "8h", [3, *values.shape, 1, 1, 1, 1]), (70, "2h", [512, 16]),
        (76, "8f", [1, *EDGES, 1, 1, 1, 1]), (108, "3f", [352, slope, 0]), (254, "h", [1]),
        (280, "12f", np.ravel(rows)),
    ):  # fmt: skip
        struct.pack_into(order + kind, start, place, *content)
    start[123], start[344:348] = units, b"n+1\0"
    return bytes(start) + values.T.astype(f"{order}u2").tobytes()


def voxels(path, **keys):
    return Voxels(kind="voxels", path=str(path), repeat="periodic", **{"threshold": "otsu", **keys})


KINDS = (".npy", ".tif", ".slices", ".mhd", ".mha", ".nii", ".nii.gz", ".nrrd", ".dicom")


@pytest.mark.parametrize("kind", KINDS)
def test_every_format_and_type_has_one_porosity_to_the_last_bit(tmp_path, kind):
    threshold = max(np.unique(GREY)[:-1], key=lambda level: _between(GREY, level))
    for name, values in TYPES.items():
        if kind == ".dicom" and name == "float32":
            continue  # DICOM stores whole numbers
        found = voxels(save(tmp_path / f"{name}{kind}", values), voxel_size=(10e-6, 20e-6, 30e-6))
        np.testing.assert_array_equal(found.solid, threshold < GREY)
        assert found.warnings == ()
        if kind not in (".npy", ".tif", ".slices"):
            edges, unit = stated_voxel(tmp_path / f"{name}{kind}")
            assert (edges, unit) == (pytest.approx(EDGES, rel=1e-6), "mm")
            (note,) = voxels(tmp_path / f"{name}{kind}", voxel_size=10e-6).warnings
            assert "[0.01 mm, 0.02 mm, 0.03 mm] along x, y, z, and cell.geometry has 10 x 10 x 10 µm" in note


def _between(values, level):
    """Otsu's measure by its definition."""
    low, high = values[values <= level].astype(float), values[values > level].astype(float)
    return len(low) * len(high) * (low.mean() - high.mean()) ** 2


def test_floats_of_16_bits_are_counted_as_these(tmp_path):
    values = (gaussian_filter(np.random.default_rng(1).normal(size=(24,) * 3), 1) * 30_000 + 30_000).astype(
        np.uint16
    )
    fine, floats = GreyValues.of(values), GreyValues.of(values.astype(np.float32) / np.float32(65_535))
    assert len(floats.values) == len(fine.values) > 9000
    np.testing.assert_array_equal(values / 65_535 > floats.otsu, values > fine.otsu)
    assert GreyValues.of(values.astype(np.float32)).otsu == fine.otsu


def conductivity(path):
    solver = pytest.importorskip("porocore_fem_skfem.cell_solver").SkfemCellSolver()
    geometry = voxels(path, voxel_size=(1, 2, 3), drop_grains=True)
    mesh = MeshSettings(size=0.34, fluid_size=0.34, element="linear")
    return solver.conductivity(solver.prepare(Cell(geometry=geometry, mesh=mesh)))


@pytest.fixture(scope="module")
def of_numpy(tmp_path_factory):
    return conductivity(save(tmp_path_factory.mktemp("numpy") / "image.npy", TYPES["float32"]))


@pytest.mark.parametrize("kind", [".dicom", *(pytest.param(k, marks=pytest.mark.slow) for k in KINDS[1:-1])])
def test_every_format_has_one_conductivity(tmp_path, kind, of_numpy):
    found = conductivity(save(tmp_path / f"image{kind}", TYPES["uint16"]))
    np.testing.assert_array_equal(found, of_numpy)


@pytest.mark.parametrize(("axis", "kind"), [(0, ".mhd"), (2, ".nii")])
def test_a_slit_of_longer_voxels_conducts_as_poiseuille(tmp_path, axis, kind):
    """K = φ h²/(12 μ) along it and nothing across, h being the width that the fluid's mesh has."""
    solver = pytest.importorskip("porocore_fem_skfem.cell_solver").SkfemCellSolver()
    values = np.full((12, 8, 6), 200, dtype=np.uint8)
    np.moveaxis(values, axis, 0)[:4] = 50
    path, edges = save(tmp_path / f"slit{kind}", values), np.array([10e-6, 20e-6, 30e-6])
    geometry = Voxels(kind="voxels", path=str(path), threshold="otsu", voxel_size=tuple(edges))
    cell = Cell(geometry=geometry, mesh=MeshSettings(size=0.2, fluid_size=0.2), viscosity=1e-3)
    found = np.diag(solver.conductivity(solver.prepare(cell))) * geometry.length**2
    fluid = cell.make_mesh("fluid", "whole")
    width = np.ptp(fluid.points[:, axis]) * geometry.length
    side = 2 * edges[axis] * values.shape[axis]
    assert width == pytest.approx(8 * edges[axis], rel=3e-3)
    expected = np.full(3, width / side * width**2 / 12 / 1e-3)
    expected[axis] = 0
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9 * expected.max())


@pytest.mark.parametrize("kind", [".mhd", ".nii.gz", ".dicom", ".nrrd"])
def test_a_segmented_image_is_not_touched(tmp_path, kind):
    path = save(tmp_path / f"mask{kind}", np.where(PORES, 0, 255).astype(np.uint8))
    found = voxels(path, threshold=None, pore=0, voxel_size=(10e-6, 20e-6, 30e-6))
    np.testing.assert_array_equal(found.solid, ~PORES)
    assert found.warnings == ()
    labels = np.where(PORES, 3, 1).astype(np.float32)
    np.testing.assert_array_equal(read_image(save(tmp_path / "labels.nii", labels)), labels.astype(int))


def test_numbers_of_a_file_are_read_with_its_scale_and_its_order_of_bytes(tmp_path):
    values = TYPES["uint16"]
    for order in "<>":
        (tmp_path / "image.nii").write_bytes(nifti(values, order=order))
        np.testing.assert_array_equal(read_image(tmp_path / "image.nii"), values)
        values.T.astype(f"{order}u2").tofile(tmp_path / "image.raw")
        path = header(tmp_path / "image.mhd", ElementByteOrderMSB=order == ">")
        np.testing.assert_array_equal(read_image(path), values)
        save(tmp_path / "image.tif", values, byteorder=order)
        np.testing.assert_array_equal(read_image(tmp_path / "image.tif"), values)
        np.save(tmp_path / "image.npy", values.astype(f"{order}u2"))
        np.testing.assert_array_equal(read_image(tmp_path / "image.npy"), values)
    (tmp_path / "image.nii").write_bytes(nifti(values, slope=0.5))
    np.testing.assert_array_equal(read_image(tmp_path / "image.nii", grey=True), values * 0.5)
    (tmp_path / "scaled").mkdir()
    for k in range(14):
        tags = {"0028|1052": "-1024", "0028|1053": "2"}
        dicom(tmp_path / "scaled" / f"{k}.dcm", GREY[:, :, k].astype(np.int16) * 2 - 1024, k, **tags)
    np.testing.assert_array_equal(read_image(tmp_path / "scaled", grey=True), GREY.astype(int) * 2 - 1024)


@pytest.mark.parametrize(("units", "factor"), [(1, 1e3), (2, 1), (3, 1e-3)])
def test_lengths_of_nifti_are_in_the_unit_that_it_states(tmp_path, units, factor):
    (tmp_path / "image.nii").write_bytes(nifti(TYPES["uint16"], units))
    edges, unit = stated_voxel(tmp_path / "image.nii")
    assert (unit, edges) == ("mm", pytest.approx(np.multiply(EDGES, factor), rel=1e-6))


def test_axes_are_those_of_the_voxels_and_turned_ones_are_told(tmp_path):
    path, values = tmp_path / "image.nii", TYPES["uint16"]
    a, b, c = EDGES
    for rows, told in (
        ([[-a, 0, 0, 0], [0, b, 0, 0], [0, 0, -c, 5]], False),
        ([[0, 0, c, 0], [a, 0, 0, 0], [0, b, 0, 0]], True),
        ([[0.8 * a, -0.6 * b, 0, 0], [0.6 * a, 0.8 * b, 0, 0], [0, 0, c, 0]], True),
    ):
        path.write_bytes(nifti(values, rows=rows))
        np.testing.assert_array_equal(read_image(path), values)
        assert stated_voxel(path)[0] == pytest.approx(EDGES, rel=1e-6)
        assert any("the file states that its axes lie x along [" in each for each in remarks(path)) == told
    path.write_bytes(nifti(values, rows=[[a, 0.5 * b, 0, 0], [0, b, 0, 0], [0, 0, c, 0]]))
    with pytest.raises(ConfigurationError, match="expected axes at right angles, got sheared ones"):
        read_image(path)


def test_values_in_the_wrong_order_of_bytes_are_told(tmp_path):
    values = (gaussian_filter(np.where(PORES, 9000.0, 30000.0), 0.5) + GREY).astype(np.uint16)
    values.T.astype(">u2").tofile(tmp_path / "image.raw")
    for right in (True, False):
        path = header(tmp_path / "image.mhd", ElementByteOrderMSB=right)
        assert any("their bytes stood in the other order" in each for each in remarks(path)) is not right


def test_bytes_of_8_bits_in_16_in_the_wrong_order_are_told(tmp_path):
    for values, told in ((GREY.astype(">u2"), True), (GREY.astype("<u2"), False)):
        values.T.tofile(tmp_path / "image.raw")
        path = header(tmp_path / "image.mhd", ElementType="MET_SHORT")
        assert (
            any("are multiples of 256, and would be of 8 bits if" in each for each in remarks(path)) is told
        )


def test_keys_below_the_last_one_are_told(tmp_path):
    TYPES["uint16"].T.tofile(tmp_path / "image.raw")
    path = header(tmp_path / "image.mhd")
    assert remarks(path) == ()
    with path.open("a") as file:
        file.write("\nElementByteOrderMSB = True\n")
    (told,) = remarks(path)
    assert told.startswith("ElementByteOrderMSB in image.mhd is ignored below ElementDataFile")


def test_doubts_about_an_image_are_told_where_its_solid_falls_apart(tmp_path):
    values = np.where(np.arange(12) % 6 < 3, 60, 180)[:, None, None] + GREY[:1, :12, :12] // 8
    path = save(tmp_path / "image.mhd", values.astype(np.uint16) << 8)
    with pytest.raises(
        ConfigurationError, match=r"is not connected .*; the values of the image are multiples of"
    ):
        Cell(geometry=voxels(path), mesh=MeshSettings(size=0.2)).require_stiffness()


def test_the_threshold_of_a_part_is_that_of_the_whole_file(tmp_path):
    path = save(tmp_path / "image.npy", GREY)
    part = voxels(path, crop=((0, 8), (0, 8), (0, 8)))
    assert part.level == voxels(path).level
    assert any("by Otsu's method from the whole file, not from crop alone" in each for each in part.notes)
    with pytest.raises(
        ConfigurationError,
        match=r"^cell\.geometry\.crop: expected a part of .* got a part of the shape \(2, 8, 8\)",
    ):
        assert voxels(path, crop=((0, 2), (0, 8), (0, 8))).solid.any()
    np.save(tmp_path / "long.npy", np.zeros((500, 4, 4), np.uint8))
    with pytest.raises(
        ConfigurationError, match=r"crop: \[\[64, 464\], \[0, 4\], \[0, 4\]\] takes the middle"
    ):
        read_image(tmp_path / "long.npy", ((30, 499), (0, 4), (0, 4)))


def test_the_voxels_of_a_header_count_as_its_content(tmp_path):
    path = save(tmp_path / "image.mhd", TYPES["uint16"])
    geometry = voxels(path)
    (tmp_path / "moved").mkdir()
    for name in ("image.mhd", "image.raw"):
        (tmp_path / name).rename(tmp_path / "moved" / name)
    again = voxels(tmp_path / "moved" / "image.mhd")
    assert again.sha256 == geometry.sha256
    TYPES["uint16"].tofile(tmp_path / "moved" / "image.raw")
    with pytest.raises(ConfigurationError, match=r"cell\.geometry\.sha256: .* has changed"):
        again.checked("cell.geometry")


def test_slices_of_dicom_lie_by_their_positions_and_gaps_are_told(tmp_path):
    path = save(tmp_path / "a.dicom", GREY)
    assert voxels(path).notes[0] == "14 slices along z, by their positions"
    (path / "IM011").unlink()
    (told,) = [
        each for each in voxels(path, voxel_size=(10e-6, 20e-6, 30e-6)).warnings if "slices lie" in each
    ]
    assert "slices lie 0.03 mm apart, but 0.06 mm between " in told


def _series(folder, **tags):
    for k in range(14):
        dicom(folder / f"b{k}.dcm", GREY[:, :, k], k, "1.2.3.2", **{"0008|103e": "other", **tags})


def test_one_of_several_series_is_chosen_by_a_pattern(tmp_path):
    for k in range(14):
        dicom(tmp_path / f"a{k}.dcm", GREY[:, :, k], k)
    _series(tmp_path)
    with pytest.raises(
        ConfigurationError,
        match=r"expected one DICOM series, got 2: 'scan' \(14 files, such as a0.dcm\), 'other' \(14 .*b0.dcm\); choose",
    ) as refused:
        read_image(tmp_path)
    pattern = Path(re.search("'path: (.*)', or move", str(refused.value))[1])
    assert pattern == tmp_path / "a*"
    np.testing.assert_array_equal(read_image(pattern), GREY)
    for k in range(14):
        (tmp_path / f"a{k}.dcm").rename(tmp_path / f"b{20 + k}.dcm")
    with pytest.raises(
        ConfigurationError, match=r"b20.dcm\); move the files of one to a folder of their own"
    ):
        read_image(tmp_path)


def _twice(folder):
    _series(folder)
    dicom(folder / "twice.dcm", GREY[:, :, 4], 4, "1.2.3.2")


def _smaller(folder):
    _series(folder)
    dicom(folder / "smaller.dcm", GREY[:9, :, 4], 14, "1.2.3.2")


def _turned(folder):
    _series(folder)
    dicom(folder / "turned.dcm", GREY[:, :, 4], 14, "1.2.3.2", **{"0020|0037": "0\\1\\0\\1\\0\\0"})


def _colour(folder):
    image = sitk.GetImageFromArray(np.zeros((8, 8, 3), np.uint8), isVector=True)
    sitk.WriteImage(image, str(folder / "a.dcm"))


def _damaged(folder):
    _series(folder)
    (folder / "c.dcm").write_bytes((folder / "b1.dcm").read_bytes()[:200])


def _cut_slice(folder):
    _series(folder)
    (folder / "b5.dcm").write_bytes((folder / "b5.dcm").read_bytes()[:-10])


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (_twice, "expected one slice at each position, got .*twice.dcm.* at one"),
        (
            _smaller,
            "expected slices of one size and direction, got smaller.dcm of 9 x 12 x 1, where b0.dcm has 10 x",
        ),
        (_turned, "expected slices of one size and direction, got turned.dcm"),
        (_colour, "expected one value in every voxel, got 3, as of an image in colour"),
        (_cut_slice, "b5.dcm: expected a DICOM image, got none, or a damaged one"),
        (_damaged, "c.dcm: expected a DICOM image, got none, or a damaged one"),
    ],
)
def test_slices_of_dicom_that_are_no_stack_are_refused(tmp_path, make, told, capfd):
    make(tmp_path)
    with pytest.raises(ConfigurationError, match=told):
        read_image(tmp_path)
    assert capfd.readouterr() == ("", "")


def test_losses_and_viewers_of_dicom_are_told(tmp_path):
    _series(tmp_path, **{"0028|2110": "01"})
    assert any("compressed with loss" in each for each in remarks(tmp_path))
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes().replace(b"MONOCHROME2", b"MONOCHROME1"))
    assert any("is MONOCHROME1" in each for each in voxels(tmp_path).warnings)


@pytest.mark.parametrize(
    ("values", "tags", "bits"),
    [
        (GREY, {}, None),
        (GREY.astype(np.int8), {}, None),
        (TYPES["uint16"], {}, None),
        (GREY.astype(np.uint16) * 16, {}, 12),
        (TYPES["int16"], {}, None),
        (TYPES["int16"], {"0028|1052": "-1024", "0028|1053": "2"}, None),
        (GREY.astype(np.uint16) * 16, {"0028|1052": "-10.5", "0028|1053": "0.3"}, 12),
    ],
)
def test_values_of_monochrome1_are_those_that_are_stored(tmp_path, values, tags, bits):
    """SimpleITK reverses them; the stored ones are known here, and those of every other format."""
    intercept, slope = (float(tags.get(f"0028|105{k}", k - 2)) for k in (2, 3))
    begin = {}
    for k in range(14):
        path = tmp_path / f"{k}.dcm"
        dicom(path, values[:, :, k], k)
        content = path.read_bytes()
        for tag, text in tags.items():
            content = _with(content, tag, text.encode() + b" " * (len(text) % 2))
        if bits:
            content = _with(content, "0028|0101", bytes([bits, 0]))
            content = _with(content, "0028|0102", bytes([bits - 1, 0]))
        assert content.endswith(values[:, :, k].T.tobytes())
        begin[path] = content
    for kind in (b"MONOCHROME2", b"MONOCHROME1"):
        for path, content in begin.items():
            path.write_bytes(content.replace(b"MONOCHROME2", kind))
        np.testing.assert_allclose(
            read_image(tmp_path, grey=True), values * slope + intercept, rtol=1e-14, atol=1e-12
        )
    if values.dtype.kind == "i":
        return  # SimpleITK writes these in single slices only
    sitk.WriteImage(itk_image(values), str(tmp_path / "frames.dcm"))
    content = (tmp_path / "frames.dcm").read_bytes()
    (tmp_path / "frames.dcm").write_bytes(content.replace(b"MONOCHROME2", b"MONOCHROME1"))
    np.testing.assert_array_equal(read_image(tmp_path / "frames.dcm", grey=True), values)


def _with(content, tag, value):
    """A file of implicit little-endian tags with another value of one."""
    key = struct.pack("<HH", *(int(part, 16) for part in tag.split("|")))
    place = content.rindex(key, 0, content.rindex(b"\xe0\x7f\x10\0")) + 4
    (length,) = struct.unpack_from("<I", content, place)
    return content[:place] + struct.pack("<I", len(value)) + value + content[place + 4 + length :]


def _raw(folder, values=None, cut=0, **keys):
    found = (TYPES["uint16"] if values is None else values).T.tobytes()
    (folder / "a.raw").write_bytes(found[: len(found) - cut] if cut >= 0 else found + b"\0" * -cut)
    return header(folder / "a.mhd", **keys)


def _renamed(folder, old, new):
    path = _raw(folder)
    path.write_text(path.read_text().replace(old, new))
    return path


def _write(name, content):
    def make(folder):
        (folder / name).write_bytes(content)
        return folder / name

    return make


def _saved(name, values, **how):
    def make(folder):
        image = sitk.GetImageFromArray(values, **how)
        sitk.WriteImage(image, str(folder / name))
        return folder / name

    return make


def _in_two(folder):
    sitk.WriteImage(itk_image(TYPES["uint16"]), str(folder / "a.nhdr"))
    return (folder / "a.nhdr").rename(folder / "a.nrrd")


def _cut(name, missing=100):
    def make(folder):
        path = save(folder / name, TYPES["uint16"])
        path.write_bytes(path.read_bytes()[:-missing])
        return path

    return make


def _packed(missing):
    """A compressed image that is cut, or else damaged."""

    def make(folder):
        path = save(folder / "a.mhd", TYPES["uint16"], useCompression=True)
        content = (folder / "a.zraw").read_bytes()
        (folder / "a.zraw").write_bytes(content[:-missing] if missing else bytes(99) + content[99:])
        return path

    return make


BOX = np.zeros((14, 12, 10), np.uint16)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (
            lambda folder: _raw(folder, cut=100),
            "a.mhd: expected a.raw of 3,360 bytes, for 10 x 12 x 14 voxels of 2 bytes, got 100 fewer; check DimSize",
        ),
        (
            lambda folder: _raw(folder, cut=-64),
            "expected a.raw of 3,360 bytes, .* got 64 more; check DimSize and",
        ),
        (lambda folder: _raw(folder, DimSize="90000 90000 90000"), "of at most 1,000,000,000 voxels"),
        (
            lambda folder: _raw(folder, GREY, cut=1, ElementType="MET_UCHAR"),
            "of 1,680 bytes, for 10 x 12 x 14 voxels of 1 byte, got 1 fewer",
        ),
        (
            lambda folder: _raw(folder, ElementType="USHORT"),
            "ElementType: expected one of MET_.*, got 'USHORT'",
        ),
        (
            lambda folder: _renamed(folder, "ElementType", "ElementTyp"),
            "expected the key ElementType in its header, got 'ElementTyp'",
        ),
        (
            lambda folder: _renamed(folder, "ElementDataFile", "elementdatafile"),
            "expected the key ElementDataFile in its header, got 'elementdatafile'",
        ),
        (
            lambda folder: _renamed(folder, "NDims = 3\n", ""),
            "expected the key NDims in its header, got none",
        ),
        (
            lambda folder: _raw(folder, DimSize="10,12,14"),
            "DimSize: expected 3 whole numbers above 0 with blanks between them, got '10,12,14'",
        ),
        (lambda folder: _raw(folder, ElementSpacing="0.1"), "ElementSpacing: expected 3 numbers with blanks"),
        (lambda folder: _raw(folder, TransformMatrix="1 0 0"), "TransformMatrix: expected 9 numbers"),
        (lambda folder: _raw(folder, BinaryData="False"), "expected voxels as binary data, got text"),
        (lambda folder: _raw(folder, ElementNumberOfChannels=3), "one value in every voxel, got 3"),
        (_write("a.mhd", b"\x89PNG\r\n\x1a\n"), "expected a MetaImage, got a PNG picture by its first bytes"),
        (_packed(10), "a.zraw of .* voxels of 2 bytes, compressed, got 10 fewer; check"),
        (
            _packed(0),
            "expected 10 x 12 x 14 voxels of uint16 in a.zraw, got compressed values that are damaged",
        ),
        (_cut("a.mha"), "the file is cut off, 100 bytes of its 10 x 12 x 14 voxels"),
        (_cut("a.nii"), "the file is cut off, 100 bytes of its 10 x 12 x 14 voxels"),
        (_cut("a.nii.gz", 300), "the file is cut off, .* bytes of its 10 x 12 x 14 voxels"),
        (_cut("a.nrrd"), "expected an NRRD image, got one that is damaged or cut short"),
        (_write("a.nii", nifti(TYPES["uint16"])[:300]), "expected a NIfTI image, got one that is damaged"),
        (_write("a.nii", gzip.compress(b"no image" * 99)), "got a file packed by gzip by its first bytes"),
        (
            _write("a.dcm", b"\0" * 128 + b"DICM" + b"\0" * 99),
            "expected a DICOM file, got one that is damaged",
        ),
        (_write("a.nrrd", b""), "expected an NRRD image, got an empty file"),
        (_in_two, "expected voxels behind the header, got the name of another file"),
        (
            _saved("a.nii", np.zeros((14, 12, 10, 3), np.uint8), isVector=True),
            "one value in every voxel, got 3",
        ),
        (_saved("a.nii", BOX.astype(np.complex64)), "complex numbers; save one real number"),
        (
            _saved("a.nii", np.stack([BOX] * 3), isVector=False),
            "an array of 4 axes, 10 x 12 x 14 x 3; save one",
        ),
        (_saved("a.mha", BOX[0]), "got one slice of 10 x 12 pixels; give the folder of all slices"),
        (_saved("a.nii", BOX[:1]), "got one slice of 10 x 12 pixels; give the folder of all slices"),
        (_saved("a.dcm", BOX[0]), "got one slice of 10 x 12 pixels; give the folder of all slices"),
    ],
)
def test_a_faulty_file_is_refused_in_one_message(tmp_path, make, told, capfd):
    """SimpleITK prints nothing of its own, and gives no values that the file has not."""
    path = make(tmp_path)
    with pytest.raises((ConfigurationError, ValueError), match=told):
        read_image(path, grey=True)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("suffix", [".mhd", ".mha"])
def test_compressed_values_are_those_that_are_stored(tmp_path, suffix):
    for name, values in TYPES.items():
        path = save(tmp_path / f"{name}{suffix}", values, useCompression=True)
        np.testing.assert_array_equal(read_image(path, grey=True), values)


def test_one_time_of_a_series_is_an_image(tmp_path):
    sitk.WriteImage(sitk.JoinSeries([itk_image(TYPES["uint16"])]), str(tmp_path / "a.mha"))
    np.testing.assert_array_equal(read_image(tmp_path / "a.mha"), TYPES["uint16"])
    sitk.WriteImage(itk_image(GREY), str(tmp_path / "frames.dcm"))
    np.testing.assert_array_equal(read_image(tmp_path / "frames.dcm"), GREY)


def test_a_header_by_the_message_makes_an_image_of_voxels_alone(tmp_path):
    cube = GREY[:8, :8, :8]
    for name, values in (("cube.raw", cube), ("a_10x12x14.raw", GREY), ("b_10x12x14_.raw", TYPES["uint16"])):
        (tmp_path / name).write_bytes(values.T.tobytes())
        with pytest.raises(ConfigurationError, match="if its voxels stand in it") as refused:
            read_image(tmp_path / name)
        lines = re.findall("'(.*?)'", str(refused.value).partition("with the lines")[2])
        (tmp_path / "written.mhd").write_text("\n".join(lines))
        np.testing.assert_array_equal(read_image(tmp_path / "written.mhd"), values)


def test_without_simpleitk_one_message_says_how_to_get_it(tmp_path, monkeypatch):
    path = save(tmp_path / "image.mha", GREY)
    monkeypatch.setitem(sys.modules, "SimpleITK", None)
    with pytest.raises(
        ConfigurationError, match=r"image\.mha: images as .* pip install SimpleITK, or save the image"
    ):
        read_image(path)
