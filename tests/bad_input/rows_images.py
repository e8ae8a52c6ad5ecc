"""Images that cannot be a cell."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np

from tests.bad_input.bad_files import fifo, folder, holes, link
from tests.bad_input.bad_row import Content, Row, faulty

HALF = np.zeros((8, 8, 8), dtype=np.uint8)
HALF[:4] = 1
#: A grey image of which one voxel is zero.
GREY = np.full((8, 8, 8), 200, dtype=np.uint8)
GREY[:4] = 90
GREY[2, 5, 3] = 0


def npy(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def header(text: str, data: bytes = b"") -> bytes:
    """A .npy file with any header."""
    padded = text.encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(padded)) + padded + data


def declared(shape: str, descr: str = "'|u1'", data: bytes = b"\0" * 512) -> bytes:
    return header(f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}", data)


def archive(path: Path) -> None:
    with path.open("wb") as file:
        np.savez(file, HALF)


def tiff(array: np.ndarray, **how: object):
    def make(path: Path) -> None:
        import tifffile

        tifffile.imwrite(path, array, **how)

    return make


def cut_data(path: Path) -> None:
    """A TIFF of one page less the end of its voxels, which stand behind it."""
    import tifffile

    tifffile.imwrite(path, HALF, metadata=None, volumetric=True, tile=(16, 16, 16))
    path.write_bytes(path.read_bytes()[:-100])


def tiff_of(width: int, height: int, pages: int = 1) -> bytes:
    """A TIFF that declares pages of the given size and holds eight bytes of them."""
    entries = [
        (256, 4, width), (257, 4, height), (258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, 0), (277, 3, 1),
        (278, 4, height), (279, 4, min(width * height, 2**32 - 1)),
    ]  # fmt: skip
    size = 2 + 12 * len(entries) + 4
    blocks = []
    for page in range(pages):
        at = 8 + page * size
        following = 0 if page == pages - 1 else at + size
        rows = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in entries)
        blocks.append(struct.pack("<H", len(entries)) + rows + struct.pack("<I", following))
    return b"II*\0" + struct.pack("<I", 8) + b"".join(blocks) + b"\0" * 8


def looped() -> bytes:
    """A TIFF whose page is followed by itself."""
    whole = bytearray(tiff_of(8, 8))
    whole[8 + 2 + 12 * 9 : 8 + 2 + 12 * 9 + 4] = struct.pack("<I", 8)
    return bytes(whole)


CANNOT = "not an image that can be read"
SIZE = "expected an image of 4 to 400 voxels"
SOLID = "expected an image in three dimensions"
TYPE = "expected a segmented image"
NUMBERS = "expected an image of numbers"
OTHER = "expected an image as .npy, .tif, .tiff, .mhd, .mha, .nii, .nii.gz, .nrrd or .dcm"
#: Suffix, content, words of the message.
FAULTS: dict[str, tuple[str, Content, str]] = {
    "missing": (".npy", lambda path: None, "no such file"),
    "of another kind": (
        ".png",
        b"\x89PNG",
        OTHER,
    ),
    "without a suffix": (
        "",
        npy(HALF),
        OTHER,
    ),
    "a folder": (
        ".npy",
        folder,
        "expected slices as .npy, .tif, .tiff, .dcm, got no files; save the slices as TIFF",
    ),
    "of voxels alone": (
        ".raw",
        b"\0" * 2 * 6**3 + b"\1" * 2 * 6**3,
        "'NDims = 3', 'DimSize = 6 6 6', 'ElementType = MET_FLOAT', 'ElementDataFile = image.raw'",
    ),
    "a header without voxels": (
        ".mhd",
        "ObjectType = Image\nElementDataFile = gone.raw\n",
        ".mhd: ElementDataFile: ",
    ),
    "a header of many files": (
        ".mhd",
        "ElementDataFile = LIST\na.raw\nb.raw\n",
        "names one file, such as 'ElementDataFile = image.raw', got 'LIST'; write all voxels into one file",
    ),
    "a named pipe": (".npy", fifo, "got a named pipe"),
    "an endless device": (".npy", link("/dev/zero"), "got a device"),
    "a loop of links": (".npy", link("image.npy"), "a symbolic link that leads back to itself"),
    "a dangling link": (
        ".npy",
        link("nowhere"),
        "image.npy: a symbolic link to nowhere, which does not exist",
    ),
    "of a terabyte": (".npy", holes(1 << 40), "at most"),
    "empty": (".npy", b"", "expected a .npy file of NumPy, got an empty file"),
    "junk": (".npy", bytes(range(256)) * 10, CANNOT),
    "words": (".npy", "Dear diary", "expected a .npy file of NumPy, got text by its first bytes"),
    "of zeros": (".npy", b"\0" * 999, "got a file of zeros alone by its first bytes; copy it again"),
    "a TIFF in truth": (".npy", tiff_of(8, 8), "got a TIFF image by its first bytes; rename it to image.tif"),
    "an array in truth": (
        ".tif",
        npy(HALF),
        "got a .npy file of NumPy by its first bytes; rename it to image.npy",
    ),
    "an array without a suffix": ("", npy(HALF), "rename it to image.npy"),
    "a picture in truth": (
        ".tif",
        b"\x89PNG\r\n\x1a\n",
        "got a PNG picture by its first bytes; save the image as",
    ),
    "packed in truth": (
        ".tif",
        b"\x1f\x8b\x08\0",
        "got a file packed by gzip by its first bytes; unpack it first",
    ),
    "a pointer in truth": (".tif", "version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
    "cut in its header": (".npy", npy(HALF)[:40], CANNOT),
    "cut in its data": (
        ".npy",
        npy(HALF)[:-100],
        "the file is cut off, 100 bytes of its 8 x 8 x 8 voxels are missing",
    ),
    "of version 9": (
        ".npy",
        b"\x93NUMPY\x09\x00" + npy(HALF)[8:],
        "expected a .npy file of version 1.0 or 2.0, got 9",
    ),
    "an archive": (".npy", archive, "got a ZIP archive by its first bytes; unpack it first"),
    "of objects": (
        ".npy",
        npy(np.array([{"a": 1}] * 8).reshape(2, 2, 2)),
        "got Python objects; convert it, as by image.astype(numpy.uint8)",
    ),
    "with a header that is code": (".npy", header("__import__('os').system('touch hacked')"), CANNOT),
    "with a header of braces": (".npy", header("{" * 100), CANNOT),
    "with a header without a shape": (".npy", header("{'descr': '|u1'}"), CANNOT),
    "of shape 10^12": (".npy", declared("(1000000000000,)"), SOLID),
    "of shape 10^4 cubed": (".npy", declared("(10000, 10000, 10000)"), SOLID),
    "of shape 10^30": (".npy", declared(f"({10**30}, 1, 1)"), ""),
    "of negative shape": (".npy", declared("(-8, -8, -8)"), ""),
    "of 400 cubed declared and 512 bytes": (
        ".npy",
        declared("(400, 400, 400)"),
        "63,999,488 bytes of its 400 x 400 x 400 voxels are missing",
    ),
    "of void items of 10^9 bytes": (".npy", declared("(8, 8, 8)", "'|V1000000000'"), NUMBERS),
    "of 3 voxels": (".npy", npy(np.zeros((3, 3, 3), dtype=int)), SIZE),
    "of no voxels": (".npy", npy(np.zeros((0, 0, 0), dtype=int)), SIZE),
    "a number": (".npy", npy(np.array(1)), SOLID),
    "a line": (".npy", npy(np.zeros(8, dtype=int)), SOLID),
    "a plane": (
        ".npy",
        npy(HALF[0]),
        "got one slice of 8 x 8 pixels; give the folder of all slices as path, or stack all slices into one file",
    ),
    "of four dimensions": (
        ".npy",
        npy(np.stack([HALF, HALF])),
        "an array of 4 axes, 2 x 8 x 8 x 8; save one channel",
    ),
    "of 3 voxels along one edge": (".npy", npy(HALF[:, :3]), SIZE),
    "of 401 voxels": (".npy", declared("(401, 401, 401)"), SIZE),
    "of floats": (".npy", npy(HALF * 0.5), TYPE),
    "of NaN": (".npy", npy(np.full((8, 8, 8), np.nan)), TYPE),
    "of complex numbers": (".npy", npy(HALF.astype(complex)), "got complex numbers; save one real number"),
    "of texts": (".npy", npy(HALF.astype("U3")), NUMBERS),
    "of dates": (".npy", npy(HALF.astype("datetime64[s]")), NUMBERS),
    "of records": (".npy", npy(np.zeros((8, 8, 8), dtype=[("a", "u1")])), NUMBERS),
    "all pore": (".npy", npy(np.zeros((8, 8, 8), dtype=int)), "got the value 0 in every voxel"),
    "all solid": (".npy", npy(np.ones((8, 8, 8), dtype=int)), "got the value 1 in every voxel"),
    "of 1 and 2": (
        ".npy",
        npy(HALF + 1),
        "which stands for pores where none is given; its values are 1 (256), 2 (256)",
    ),
    "of other values": (".npy", npy(np.arange(512).reshape(8, 8, 8) + 7), "no voxel"),
    "TIFF, empty": (".tif", b"", "expected a TIFF image, got an empty file"),
    "TIFF, junk": (
        ".tif",
        b"II*\0" + bytes(range(256)),
        "the file is cut off: it ends at byte 260, before page 1",
    ),
    "TIFF, its beginning only": (".tif", b"II*\0", "got one without a page"),
    "TIFF, its header only": (
        ".tif",
        tiff_of(8, 8)[:8],
        "the file is cut off: it ends at byte 8, before page 1",
    ),
    "TIFF, cut short": (".tif", tiff_of(8, 8)[:40], "the file is cut off: it ends at byte 40, before page 1"),
    "TIFF, cut between pages": (".tif", tiff_of(8, 8, 9)[:600], "before page 6; copy it again"),
    "TIFF, cut in its data": (".tif", cut_data, "bytes of its voxels are missing; copy it again"),
    "TIFF of one page": (".tif", tiff(HALF[0]), SOLID),
    "TIFF of floats": (".tif", tiff(HALF * np.float32(0.5)), TYPE),
    "TIFF in colour": (".tif", tiff(np.zeros((8, 8, 8, 3), dtype=np.uint8)), "an image in colour with 3"),
    "TIFF of 10^9 × 10^9": (".tif", tiff_of(10**9, 10**9), SOLID),
    "TIFF of 400 × 400 declared and 8 bytes": (".tif", tiff_of(400, 400, 400), ""),
    "TIFF whose page follows itself": (".tif", looped(), ""),
    "TIFF of zeros that were packed": (
        ".tif",
        tiff(np.zeros((500, 500, 500), dtype=np.uint8), compression="zlib"),
        SIZE,
    ),
    "TIFF, all pore": (".tif", tiff(np.zeros((8, 8, 8), dtype=np.uint8)), "every voxel"),
}


def slices(count: int = 8, **others: Content) -> dict[str, Content]:
    """A folder of slices, and others by the stems of their names."""
    found: dict[str, Content] = {f"scan/s_{k}.tif": tiff(HALF[0]) for k in range(count)}
    return {**found, **{f"scan/{name}.tif": content for name, content in others.items()}}


#: Name, path, words of the message, files.
SLICES: tuple[tuple[str, str, str, dict[str, Content]], ...] = (
    (
        "that are pictures",
        "scan",
        "expected slices as .npy, .tif, .tiff, .dcm, got 2 .png, 1 .txt; save the slices as TIFF",
        {"scan/1.png": b"\x89PNG", "scan/2.png": b"\x89PNG", "scan/log.txt": "of the scanner"},
    ),
    (
        "of no pattern",
        "scan/t*.tif",
        "got no name of this pattern in a folder of 8 .tif; check the",
        slices(),
    ),
    ("of no folder", "scam/*.tif", "scam: no such folder", slices()),
    (
        "of two stacks",
        "scan",
        "got s_#.tif (8), mask_#.tif (1); choose by a pattern of names, such as 'path: /",
        slices(mask_1=tiff(HALF[0])),
    ),
    (
        "of one number twice",
        "scan",
        "one slice of each number, got s_01.tif and s_1.tif",
        slices(s_01=tiff(HALF[0])),
    ),
    (
        "of two sizes",
        "scan/*.tif",
        "*.tif: expected slices of one size and kind, got s_8.tif of 7 x 8 uint8 along x, y, where s_0.tif has 8 x 8",
        slices(s_8=tiff(HALF[0][:, :7])),
    ),
    (
        "of two types",
        "scan",
        "got s_8.tif of 8 x 8 uint16 along x, y",
        slices(s_8=tiff(HALF[0].astype(np.uint16))),
    ),
    (
        "one of which is a stack",
        "scan",
        "expected one slice in each file, got s_8.tif of the",
        slices(s_8=tiff(HALF)),
    ),
    (
        "one of which is text",
        "scan/*.tif",
        "*.tif: s_8.tif: expected a TIFF image, got text",
        slices(s_8="a"),
    ),
    (
        "beside a whole image",
        "scan",
        "expected slices as .npy, .tif, .tiff, .dcm, got 1 .mhd, 1 .raw; write the path of a.mhd itself",
        {"scan/a.mhd": "ElementDataFile = a.raw\n", "scan/a.raw": b"12345678"},
    ),
    ("that are too few", "scan", "expected an image of 4 to 400 voxels", slices(2)),
    (
        "of floats",
        "scan",
        "expected a segmented image",
        {f"scan/{k}.tif": tiff(HALF[0] + np.float32(0.5)) for k in range(8)},
    ),
)
LONG = "x" * 300 + ".npy"


def row(kind: str, **keys: object) -> Row:
    suffix, content, expected = FAULTS[kind]
    name = f"image{suffix}"
    changes = {"cell.geometry": {"kind": "voxels", "path": name, **keys}}
    return faulty(f"image {kind}", changes, expected, files={name: content})


ROWS = [
    *map(row, FAULTS),
    *(
        faulty(f"image with a path {name}", {"cell.geometry": {"kind": "voxels", "path": path}}, expected)
        for name, path, expected in (
            ("of 300 characters", LONG, "too long"),
            ("of 5,000 characters", "y/" * 2500 + "image.npy", "too long"),
            ("with a null character", "image\0.npy", ""),
            ("with a line break", "image\n.npy", "no such file"),
            ("that is a number", 7, "expected text, got 7"),
        )
    ),
    *(
        faulty(
            f"image with {key} {value}",
            {"cell.geometry": {"kind": "voxels", "path": "image.npy", "pore": 1, **more, key: value}},
            expected,
            files={"image.npy": npy(HALF)},
        )
        for key, value, more, expected in (
            ("layer", 5, {"repeat": "layer"}, "cell.geometry.layer: expected at most 4 voxels"),
            ("layer", 0, {"repeat": "layer"}, "cell.geometry.layer"),
            ("repeat", "never", {}, "cell.geometry.repeat"),
            ("voxel_size", 0, {}, "cell.geometry.voxel_size"),
            ("voxel_size", "12 kPa", {}, "cell.geometry.voxel_size: expected a length"),
            ("voxel_size", ["1 um", "2 um"], {}, "cell.geometry.voxel_size: expected a list of 3 entries"),
            ("crop", [[0, 8], [0, 8]], {}, "cell.geometry.crop"),
            ("voxel_size", ["1 um", "2 um", "x"], {}, "cell.geometry.voxel_size"),
            ("voxel_size", float("nan"), {}, "cell.geometry.voxel_size"),
        )
    ),
    *(
        faulty(
            f"image of one value of the type {array.dtype} by Otsu",
            {"cell.geometry": {"kind": "voxels", "path": "image.npy", "threshold": "otsu"}},
            "got the value 7 in every voxel of",
            "so Otsu's method finds no two classes",
            files={"image.npy": npy(array)},
        )
        for array in (np.full((8, 8, 8), 7), np.full((8, 8, 8), 7.0))
    ),
    faulty(
        "image of a threshold for other grey values",
        {"cell.geometry": {"kind": "voxels", "path": "image.npy", "threshold": 0.5}},
        "cell.geometry.threshold: 0.5 makes pores of 0.195 % of the voxels, whose values are",
        "'threshold: otsu' parts them at",
        "if they are the pores, give a smaller cell.mesh",
        files={"image.npy": npy(GREY)},
    ),
    faulty(
        "image of a threshold below all grey values",
        {"cell.geometry": {"kind": "voxels", "path": "image.npy", "threshold": -1}},
        "no voxel of",
        "'threshold: otsu' parts them at",
        files={"image.npy": npy(GREY)},
    ),
    faulty(
        "image of voxels that contradict the scales",
        {
            "scales": {"modulus": "1 kPa", "length": "1 mm", "pore": "1 um", "viscosity": "1 mPa*s"},
            "cell.viscosity": 1,
            "cell.geometry": {"kind": "voxels", "path": "image.npy", "pore": 1, "voxel_size": "3 um"},
        },
        "scales.pore: expected 48 µm",
        files={"image.npy": npy(HALF)},
    ),
    faulty(
        "image of voxels without a unit beside scales.pore",
        {
            "scales": {"modulus": "1 kPa", "length": "1 mm", "pore": "1 um", "viscosity": "1 mPa*s"},
            "cell.viscosity": 1,
            "cell.geometry": {"kind": "voxels", "path": "image.npy", "pore": 1, "voxel_size": 12},
        },
        "scales.pore: expected 192 m",
        "voxel_size 12 has no unit and was read in metres: write the unit",
        files={"image.npy": npy(HALF)},
    ),
    faulty(
        "images of several voxel sizes",
        {
            "cell.geometry": {"kind": "voxels", "path": "image.npy", "pore": 1, "voxel_size": "12 um"},
            "cells": {
                name: {"geometry": {"kind": "voxels", "path": "image.npy", "pore": 1, "voxel_size": size}}
                for name, size in (("b", "10 um"), ("c", "5 um"))
            },
            "macro.regions": {"r": {"cell": "b", "above": 5}, "s": {"cell": "c", "below": 1}},
        },
        "cells.b.geometry.voxel_size: expected a cell of 192 µm, as by cell.geometry.voxel_size, got 160 µm of 'b' and "
        "80 µm of 'c'; all cells of a study have one edge",
        files={"image.npy": npy(HALF)},
    ),
    *(
        faulty(
            f"slices {name}",
            {"cell.geometry": {"kind": "voxels", "path": path, "pore": 1}},
            "cell.geometry.path: ",
            expected,
            files=files,
        )
        for name, path, expected, files in SLICES
    ),
    faulty(
        "image with another checksum",
        {"cell.geometry": {"kind": "voxels", "path": "image.npy", "sha256": "0" * 64}},
        "has changed",
        files={"image.npy": npy(HALF)},
    ),
]
