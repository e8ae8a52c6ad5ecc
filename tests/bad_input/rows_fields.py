"""Faults of the fields and regions of a body of many cells, each told with file, line and key."""

from __future__ import annotations

import meshio
import numpy as np
from bad_row import CONFIG, Row, faulty

FAMILY = {
    "cell.geometry.radius": {"range": [0.2, 0.3]},
    "closure": "potential",
    "surrogate.options": {},
    "sampling.sampler": "sobol",
    "sampling.inputs": {"H22": {"range": [-0.1, 0.02]}},
    "sampling.options": {"count": 12},
    "sampling.test.count": 3,
    "sampling.tolerance": None,
}
DEEP = {"kind": "layer", "below": 3}
RADIUS, REGIONS = "macro.fields.radius", "macro.regions"


def image(shape=(1, 8, 1), value=0.25):
    """What writes a stack of images of this shape along x, y and z."""

    def write(path):
        with path.open("wb") as file:
            np.save(file, np.full(shape, value))

    return write


def vtu(scale=1.0, name="radius", values=(0.25, 0.28)):
    """What writes two hexahedra below and above the middle of the column, with data of these elements."""

    def write(path):
        y = np.repeat([0.0, 3.75, 7.5], 4)
        x, z = np.tile([0, 0.1, 0.1, 0], 3), np.tile([0, 0, 0.1, 0.1], 3)
        cells = [("hexahedron", np.array([range(8), range(4, 12)]))]
        points = scale * np.stack([x, y, z], axis=1)
        data = {name: [np.array(values, dtype=float)]}
        meshio.write_points_cells(path, points, cells, cell_data=data, file_format="vtu")

    return write


def cut_short(write, share=0.5):
    """What writes a file and cuts it off."""

    def cut(path):
        write(path)
        path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])

    return cut


STACK = {"kind": "image", "path": "stack.npy", "voxel_size": [0.1, 1, 0.1]}
DATA = {"kind": "data", "path": "data.vtu", "data": "radius"}
#: Name, fields of the body, regions, key, part of the message, files.
FAULTS = [
    ("leaves its range", {"radius": "0.2 + 0.02*y"}, {}, RADIUS, "beyond the range [0.2, 0.3]", {}),
    (
        "leaves its range in time", {"radius": {"formula": "0.4", "initial": 0.2, "over": {"ramp": 1, "until": 6}}},
        {}, RADIUS, "beyond the range [0.2, 0.3] of the parameter 'radius'; narrow the field, or widen the range", {},
    ),
    (
        "leaves its range in a region", {"radius": 0.2}, {"deep": DEEP | {"fields": {"radius": 0.4}}},
        "macro.regions.deep.fields.radius", "the field is 0.4 at", {},
    ),
    ("is missing", {}, {}, RADIUS, "missing; the cell has the parameter 'radius'", {}),
    (
        "is missing outside a region", {}, {"deep": DEEP | {"fields": {"radius": 0.2}}}, RADIUS,
        "which has no value in the rest of the body: add 'radius:'", {},
    ),
    (
        "is of no parameter", {"radius": 0.2, "poisson_ratio": 0.3}, {}, "macro.fields.poisson_ratio",
        "is no parameter of the cell; the parameters are radius", {},
    ),
    ("is misspelt", {"radus": 0.2}, {}, "macro.fields.radus", "did you mean 'radius'?", {}),
    ("is no formula", {"radius": "0.2 +"}, {}, RADIUS, "'0.2 +'", {}),
    ("is no number", {"radius": "log(y - 4)"}, {}, RADIUS, "'log(y - 4)' is no finite number at", {}),
    (
        "has two forms", {"radius": {"formula": "0.2", "table": [[0, 1]]}}, {}, "macro.fields.radius.table",
        "unknown key", {},
    ),
    (
        "stack without its file", {"radius": STACK}, {}, "macro.fields.radius.path", "no such file", {},
    ),
    (
        "stack of the wrong size", {"radius": STACK}, {}, RADIUS,
        "the image of 1 × 4 × 1 voxels reaches from (0, 0, 0) to (0.1, 4, 0.1), but 1 of 2 elements lie outside",
        {"stack.npy": image((1, 4, 1))},
    ),
    (
        "stack in two dimensions", {"radius": STACK}, {}, "macro.fields.radius.path", "three dimensions",
        {"stack.npy": image((8, 8))},
    ),
    (
        "stack cut short", {"radius": STACK}, {}, "macro.fields.radius.path", "stack.npy",
        {"stack.npy": cut_short(image((1, 80, 1)))},
    ),
    (
        "stack with gaps", {"radius": STACK}, {}, "macro.fields.radius.path",
        "stack.npy holds no finite number at", {"stack.npy": image(value=np.nan)},
    ),
    (
        "stack of no image", {"radius": STACK | {"path": "stack.png"}}, {}, "macro.fields.radius.path",
        "expected an image as .npy, .tif or .tiff", {"stack.png": b"nothing"},
    ),
    (
        "stack beyond the range", {"radius": STACK | {"values": [[0, 0.2], [1, 0.5]]}}, {}, RADIUS,
        "the field is 0.5 at", {"stack.npy": image(value=1.0)},
    ),
    (
        "stack whose greys do not ascend", {"radius": STACK | {"values": [[1, 0.2], [0, 0.5]]}}, {},
        "macro.fields.radius.values", "do not ascend", {"stack.npy": image()},
    ),
    ("data without its file", {"radius": DATA}, {}, "macro.fields.radius.path", "no such file", {}),
    (
        "data cut short", {"radius": DATA}, {}, "macro.fields.radius.path",
        "not a mesh that meshio can read (Error: Couldn't read file",
        {"data.vtu": cut_short(vtu())},
    ),
    (
        "data of another name", {"radius": DATA | {"data": "radus"}}, {}, "macro.fields.radius.data",
        "did you mean 'radius'?", {"data.vtu": vtu()},
    ),
    (
        "data of a smaller body", {"radius": DATA}, {}, RADIUS, "1 of 2 elements of the body lie outside its elements",
        {"data.vtu": vtu(0.5)},
    ),
    (
        "data beyond the range", {"radius": DATA}, {}, RADIUS, "the field is 0.7 at",
        {"data.vtu": vtu(values=(0.2, 0.7))},
    ),
    (
        "axes without a direction", {"radius": 0.2, "axes": {"first": [1, 0, 0], "second": ["y - y", 0, 0]}}, {},
        "macro.fields.axes.second", "has no part perpendicular to the first axis", {},
    ),
    (
        "axes in both forms", {"radius": 0.2, "axes": {"about": [0, 1, 0], "angle": 3, "first": [1, 0, 0]}}, {},
        "macro.fields.axes", "first and second belong together", {},
    ),
    (
        "region that is empty", {"radius": 0.2}, {"deep": DEEP | {"below": 1}}, "macro.regions.deep",
        "none of the 2 elements has its centre in this region", {},
    ),
    (
        "regions that overlap", {"radius": 0.2}, {"deep": DEEP, "low": {"below": 2}}, "macro.regions.low",
        "1 of its 1 elements lie in the region 'deep' too", {},
    ),
    (
        "region of no volume", {"radius": 0.2}, {"core": {"kind": "volume", "name": "core"}},
        "macro.regions.core.name", "the body has no volume 'core'; it names none", {},
    ),
    (
        "region without ends", {"radius": 0.2}, {"deep": {"kind": "layer", "along": "y"}}, "macro.regions.deep",
        "a layer needs at least one of above and below", {},
    ),
    (
        "region of an unknown kind", {"radius": 0.2}, {"deep": {"kind": "cube"}}, "macro.regions.deep.kind",
        "expected one of layer, box, sphere, half-space, volume", {},
    ),
]  # fmt: skip


def row(name, fields, regions, key, part, files, command="check"):
    changes = FAMILY | {"macro.fields": fields, REGIONS: regions}
    said = f"{CONFIG}:", f" {key}: ", part
    return faulty(f"field or region: {name}, {command}", changes, *said, files=files, command=command)


ROWS: list[Row] = [
    *(row(*fault) for fault in FAULTS),
    # Nothing is written by what begins a run either.
    *(row(*fault, command=command) for command in ("run", "sample") for fault in FAULTS[:1]),
    faulty(
        "a parameter of the solid with the closure of one energy",
        FAMILY | {
            "cell.material.poisson_ratio": {"range": [0.2, 0.4]},
            "closure": "mean-gradient",
            "macro.fields": {"radius": 0.2, "poisson_ratio": 0.3},
        },
        f"{CONFIG}:",
        "but cell.material.poisson_ratio is a range, which gives each point its own; choose closure: potential",
    ),
]  # fmt: skip
