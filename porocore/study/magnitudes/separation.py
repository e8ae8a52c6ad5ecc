"""Note on few cells across the body: edge of the cell against the smallest size of the body."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from porocore.core.units.results import length_text
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.boundary.symmetry import Symmetry
from porocore.macro.problem import MacroSetup
from porocore.states import Array
from porocore.study.config.config import RunConfig

#: Cells across a body below which its results are hardly those of many cells.
FEW = 10.0
#: Components of a unit normal below this are none.
NORMAL = 1e-9


def separation(config: RunConfig, mesh: BodyMesh) -> Iterator[str]:
    """Yield a note where few cells lie across the body, none without scales, in which the cell has no length.

    The cells along each axis are counted by their own edge along it; the fewest are told.
    """
    if config.scales is None:
        return
    edges = np.array(config.cell.geometry.sides) * config.scales.pore
    sizes = _sizes(config.macro, mesh) * config.scales.length
    i = int(np.argmin(sizes / edges))
    cells = float(sizes[i] / edges[i])
    if cells >= FEW:
        return
    body, cell = length_text(float(sizes[i])), length_text(float(edges[i]))
    across = f"{body} along {'xyz'[i]}, and the edge of the periodic cell along it is {cell}{_others(sizes / edges, i)}"
    source = "scales.pore" if config.cell.geometry.length is None else "cell.geometry.voxel_size"
    check = f"check {source}, macro.body, and the unit of each length"
    if cells < 1:
        yield (
            f"the body is thinner than one cell: {across}; "
            f"it is no body of such cells, and no result means anything: {check}"
        )
        return
    yield (
        f"the body is {cells:.2g} cells thick: {across}; "
        f"its law is that of very many cells, and below {FEW:g} results are to be taken with care: {check}"
    )


def _others(counts: Array, least: int) -> str:
    """Return in words how many cells lie along the other axes."""
    finite = [
        f"{counts[i]:.2g} along {axis}"
        for i, axis in enumerate("xyz")
        if i != least and np.isfinite(counts[i])
    ]
    endless = [axis for i, axis in enumerate("xyz") if not np.isfinite(counts[i])]
    said = f" ({' and '.join(finite)})" if finite else ""
    if endless:
        said += f"; along {' and '.join(endless)} both faces are held, as if the body went on, and nothing is counted"
    return said


def _sizes(macro: MacroSetup, mesh: BodyMesh) -> Array:
    """Return the sizes of the whole body along x, y and z; it goes on for ever between two planes of symmetry."""
    sizes: Array = np.ptp(mesh.points, axis=0)
    for normal in Symmetry.of(macro).normals.values():
        across = np.abs(normal) > 1 - NORMAL
        sizes = np.where(across, 2 * sizes, sizes)
    for i, axis in enumerate("xyz"):
        faces = [macro.boundary.get(f"{axis}{sign}") for sign in "-+"]
        if all(face is not None and _held(face.normal, face.displacement[i]) for face in faces):
            sizes[i] = np.inf
    if not np.isfinite(sizes).any():
        return np.asarray(np.ptp(mesh.points, axis=0))
    return sizes


def _held(normal: object, displacement: object) -> bool:
    return normal == 0 or displacement == 0
