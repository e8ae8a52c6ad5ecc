"""Sub-volumes that an image does not have, or that cannot be a cell."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import numpy as np

from tests.bad_input.bad_files import fifo, folder, link
from tests.bad_input.bad_row import CONFIG, Content, Row, study

HALF = np.zeros((8, 8, 12), dtype=np.uint8)
HALF[:, 4:] = 1


def npy(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def rev(
    name: str,
    words: tuple[str, ...],
    expected: str,
    geometry: Mapping[str, Any] | None = None,
    files: Mapping[str, Content] | None = None,
) -> Row:
    image = {"kind": "voxels", "path": "image.npy", "pore": 1, **(geometry or {})}
    made = {CONFIG: study({"cell.geometry": image}), "image.npy": npy(HALF), **(files or {})}
    out = () if "--out" in words else ("--out", "out")
    return Row(f"cell rev {name}", ("cell", "rev", CONFIG, *out, *words), (expected,), made)


#: Options with a value that cannot be used, and a part of the message.
REFUSED = [
    ("--sizes", "", "--sizes: expected edges in voxels such as 16,32,64"),
    ("--sizes", "x" * 5000, "--sizes: expected edges in voxels such as 16,32,64"),
    ("--sizes", "8.5", "--sizes: expected edges in voxels such as 16,32,64"),
    ("--sizes", "9" * 4000, "--sizes: expected edges of 4 to 400 voxels"),
    ("--sizes", "8,6", "--sizes: expected increasing edges"),
    ("--sizes", "8,8", "--sizes: expected increasing edges"),
    ("--sizes", "3,8", "--sizes: expected edges of 4 to 400 voxels"),
    ("--sizes", "8,401", "--sizes: expected edges of 4 to 400 voxels"),
    ("--sizes", "8,12", "--sizes: expected edges of at most 8 voxels, since the image has 8 x 8 x 12"),
    ("--sizes", "8", "fewer than 3 elements of"),
    ("--count", "0", "--count: expected 1 to 1,000 sub-volumes"),
    ("--count", "1" + "0" * 30, "--count: expected 1 to 1,000 sub-volumes"),
    ("--seed", "-1", "--seed: expected a whole number from 0"),
    ("--element", "0", "--element: expected 0.5 to 100 voxels"),
    ("--element", "nan", "--element: expected 0.5 to 100 voxels"),
    ("--element", "1e300", "--element: expected 0.5 to 100 voxels"),
    ("--element", "3", "--sizes: an image of 8 x 8 x 12 voxels has no sub-volume for a cell"),
    ("--tolerance", "0", "--tolerance: expected a share between 0 and 1"),
    ("--tolerance", "nan", "--tolerance: expected a share between 0 and 1"),
    ("--tolerance", "5", "such as 0.05 for 5 %"),
    ("--workers", "0", "--workers: expected 1 to"),
    ("--fem", "b" * 5000, "bbb"),
]
FINE = ("--element", "2")
CROPPED = {"crop": [[0, 8], [1, 7], [0, 8]]}
ROWS = [
    *(rev(f"{option}={text[:20]!r} of {len(text)}", (f"{option}={text}",), part) for option, text, part in REFUSED),
    Row("cell rev of channels", ("cell", "rev", CONFIG, "--out", "out"), ("expected voxels",), {CONFIG: study()}),
    rev("beyond the crop", ("--within-crop", "--sizes", "8", *FINE), "of at most 6 voxels, since the part", CROPPED),
    rev("crop beyond the image", FINE, "cell.geometry.crop: expected", {"crop": [[0, 8], [0, 9], [0, 8]]}),
    rev("layer of all", ("--sizes=6", "--element=1"), "layer: 4 needs 8", {"repeat": "layer", "layer": 4}),
    rev("of a changed image", FINE, "has changed", {"sha256": "0" * 64}),
    rev("of a plane", FINE, "an image in three dimensions", files={"image.npy": npy(HALF[0])}),
    rev("of floats", FINE, "expected a segmented image", files={"image.npy": npy(HALF * 0.5)}),
    rev("over a study", FINE, "already holds a study; add --resume", files={"out/rev.json": '{"subvolumes": [1]}'}),
    rev("over a file", FINE, "already holds a study", files={"out/rev.json": "mine"}),
    rev("with a damaged record", (*FINE, "--resume"), "not a complete record", files={"out/rev.json": '{"format": 1}'}),
    rev("with a record that is a folder", (*FINE, "--resume"), "not a complete record", files={"out/rev.json": folder}),
    rev(
        "with a later record", (*FINE, "--resume"), "expected porocore-representative-volume version 1",
        files={"out/rev.json": '{"format": "porocore-representative-volume", "version": 9}'},
    ),
    rev(
        "with another record", (*FINE, "--resume"), "sub-volumes of another image",
        files={"out/rev.json": '{"format": "porocore-representative-volume", "version": 1, "identity": "x"}'},
    ),
    rev("into a file", (*FINE, "--out", "mine"), "mine", files={"mine": "mine"}),
    rev("below a device", (*FINE, "--out", "/dev/null/rev"), "/dev/null"),
    rev("into a named pipe", (*FINE, "--out", "pipe"), "pipe", files={"pipe": fifo}),
    rev("into a loop of links", (*FINE, "--out", "loop"), "loop", files={"loop": link("loop")}),
]  # fmt: skip
